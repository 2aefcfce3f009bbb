"""The aircraft file: what is read, and one clear line for everything that is wrong."""

import numpy as np
import pytest
import yaml

from aircraft_sysid_ros.aircraft.aerodynamic_model import TEXTBOOK_TERMS, textbook_model
from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict, inertia_matrix, load_aircraft
from aircraft_sysid_ros.aircraft.sensor_settings import DEFAULT_PROCESS_NOISE, DEFAULT_SENSORS
from aircraft_sysid_ros.effects.effect import with_setting
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft

MINIMAL = """\
name: Small
mass: 2.0
wing_area: 0.3
span: 1.2
chord: 0.25
inertia: {xx: 0.07, yy: 0.09, zz: 0.15, xz: 0.014}
"""


def loaded(tmp_path, text):
    path = tmp_path / "small.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return load_aircraft(path)


def with_sensor(**sensors):
    return aircraft_from_dict({**yaml.safe_load(MINIMAL), "sensors": sensors}).sensors


def test_a_minimal_file_is_enough(tmp_path):
    aircraft = loaded(tmp_path, MINIMAL)
    assert (aircraft.name, aircraft.mass, aircraft.wing_area) == ("Small", 2.0, 0.3)
    assert (aircraft.span, aircraft.chord) == (1.2, 0.25)
    np.testing.assert_array_equal(aircraft.inertia, [[0.07, 0.0, -0.014], [0.0, 0.09, 0.0], [-0.014, 0.0, 0.15]])
    for position in ("imu_position", "air_data_position", "gps_position", "aerodynamic_reference"):
        np.testing.assert_array_equal(getattr(aircraft, position), np.zeros(3))
    assert aircraft.sensors == DEFAULT_SENSORS and aircraft.process_noise == DEFAULT_PROCESS_NOISE
    assert aircraft.model.identifier == textbook_model().identifier
    assert aircraft.coefficients == {} and set(aircraft.surface_signs.values()) == {1.0}
    assert aircraft.ground_altitude is None and aircraft.magnetic_declination is None
    # 0.8 of the speed at which a lift coefficient of 1.6 carries the weight
    assert aircraft.minimum_airspeed == pytest.approx(0.8 * np.sqrt(2 * 2.0 * 9.80665 / (1.225 * 0.3 * 1.6)))


def test_a_full_file_is_read(tmp_path):
    aircraft = loaded(tmp_path, MINIMAL + FULL)
    np.testing.assert_array_equal(aircraft.imu_position, [0.05, 0.0, 0.02])
    assert aircraft.ground_altitude == -3.0 and aircraft.magnetic_declination == 0.05
    assert aircraft.minimum_airspeed == 9.0 and aircraft.trim_airspeed == 17.0
    assert aircraft.process_noise["wind"] == 0.0
    assert aircraft.surface_signs == {"elevator": 1.0, "aileron": 1.0, "rudder": -1.0, "flaps": 1.0}
    assert aircraft.coefficients == {"CZ_alpha": -4.5}
    assert aircraft.parameter_bounds == {"CZ_alpha": (-8.0, -2.0), "Cm_q": (-20.0, -1.0)}
    assert aircraft.model.terms["CZ"] == ("1", "alpha", "alpha**3", "q")
    assert aircraft.model.terms["Cm"] == TEXTBOOK_TERMS["Cm"]  # an axis that is not named keeps its terms
    assert aircraft.source["trim_airspeed"] == 17


FULL = """\
imu_position: [0.05, 0, 2e-2]
ground_altitude: -3
magnetic_declination: 5e-2
minimum_airspeed: 9
trim_airspeed: 17
process_noise: {wind: 0}
surface_signs: {rudder: -1}
coefficients: {CZ_alpha: -4.5}
parameter_bounds: {CZ_alpha: [-8, -2], Cm_q: [-20, -1e0]}
model: {CZ: [1, alpha, alpha**3, q]}
"""


def test_numbers_that_yaml_reads_as_text_are_numbers(tmp_path):
    assert yaml.safe_load("1e-3") == "1e-3"
    assert loaded(tmp_path, MINIMAL.replace("0.07", "7e-2")).inertia[0, 0] == 0.07


# What replaces the minimal file, or follows it, and what the message must name.
BAD = {
    "unknown key": (MINIMAL + "wing_aera: 0.3\n", "unknown key 'wing_aera': did you mean 'wing_area'?"),
    "unlike any key": (MINIMAL + "zzz: 0.3\n", "unknown key 'zzz': known are name, mass"),
    "key of two lines": (MINIMAL + '"a\\nb": 1\n', "unknown key 'a b'"),
    "key without name": (MINIMAL + "null: 1\n", "unknown key 'None'"),
    "negative mass": (MINIMAL.replace("2.0", "-2"), "mass must be positive, not -2"),
    "zero span": (MINIMAL.replace("1.2", "0"), "span must be positive, not 0"),
    "nan": (MINIMAL.replace("0.25", ".nan"), "chord must be a finite number, not 'nan'"),
    "nan as text": (MINIMAL.replace("0.25", "nan"), "chord must be a finite number, not 'nan'"),
    "infinite": (MINIMAL.replace("0.3", "-.inf"), "wing_area must be a finite number"),
    "too large for a number": (MINIMAL.replace("2.0", "1" + "0" * 400), "mass must be a finite number"),
    "text for a number": (MINIMAL.replace("2.0", "heavy"), "mass must be a number, not 'heavy'"),
    "unit with a number": (MINIMAL.replace("2.0", "2 kg"), "mass must be a number, not '2 kg'"),
    "yes for a number": (MINIMAL.replace("2.0", "yes"), "mass must be a number, not true"),
    "date for a number": (MINIMAL.replace("2.0", "2024-01-02"), "mass must be a number, not '2024-01-02'"),
    "list for a number": (MINIMAL.replace("2.0", "[2.0]"), "mass must be a number, not a list"),
    "list that holds itself": (MINIMAL.replace("2.0", "&a [*a]"), "mass must be a number, not a list"),
    "mapping for a number": (MINIMAL.replace("2.0", "{kg: 2}"), "mass must be a number, not a mapping"),
    "long text": (MINIMAL.replace("2.0", "x" * 9000), "mass must be a number, not 'xxx"),
    "missing key": (MINIMAL.replace("mass: 2.0\n", ""), "the required key 'mass' is missing"),
    "empty key": (MINIMAL.replace("2.0", ""), "the required key 'mass' is missing"),
    "key twice": (MINIMAL + "mass: 3\n", "the key 'mass' is there twice, at lines 2 and 7: remove one"),
    "key twice inside": (MINIMAL + "process_noise: {wind: 1, wind: 2}\n", "'wind' is there twice, at line 7: remove"),
    "not a mapping": ("- 1\n- 2\n", "must be a YAML mapping"),
    "a word": ("aircraft", "must be a YAML mapping"),
    "empty file": ("", "must be a YAML mapping"),
    "bad YAML": (MINIMAL + "model: [1, 2\n", "not valid YAML at line"),
    "tab": (MINIMAL + "sensors:\n\tgyro: 1\n", "not valid YAML at line 8"),
    "two documents": (MINIMAL + "---\na: 1\n", "not valid YAML"),
    "python object": (MINIMAL + "model: !!python/object/apply:os.getcwd []\n", "not valid YAML at line 7"),
    "impossible date": (MINIMAL + "trim_airspeed: 2024-13-45\n", "not valid YAML"),
    "number of 5000 digits": (MINIMAL + "trim_airspeed: " + "9" * 5000, "not valid YAML"),
    "nesting bomb": (MINIMAL + "model: " + "[" * 5000, "it is nested too deeply"),
    "control character": (MINIMAL + "model: \x01", "not valid YAML"),
    "binary file": (b"\x89HDF\r\n\x1a\n\xff\xfe\x00", "not text in UTF-8"),
    "name that is false": (MINIMAL.replace("Small", "no"), "name must be text .*, not false"),
    "name of blanks": (MINIMAL.replace("Small", "'  '"), "name must be text"),
    "name that does not print": (MINIMAL.replace("Small", '"a\\x07b"'), "name must be text that prints, not 'ab'"),
    "name that is a list": (MINIMAL.replace("Small", "[a]"), "name must be text .*, not a list"),
    "inertia as number": (
        MINIMAL.replace("{xx: 0.07, yy: 0.09, zz: 0.15, xz: 0.014}", "3"),
        "inertia must be a mapping",
    ),
    "inertia without yy": (MINIMAL.replace("yy: 0.09, ", ""), "inertia needs 'yy'"),
    "inertia negative": (MINIMAL.replace("0.09", "-0.09"), "inertia yy must be positive, not -0.09"),
    "inertia not positive": (MINIMAL.replace("0.014", "0.2"), "inertia is not that of a body"),
    "inertia typo": (MINIMAL.replace("xz:", "xy:"), "unknown key of inertia 'xy'"),
    "position of two": (MINIMAL + "imu_position: [1, 2]\n", "imu_position must be three numbers"),
    "position as number": (MINIMAL + "gps_position: 1\n", "gps_position must be three numbers"),
    "position with text": (
        MINIMAL + "gps_position: [1, 2, x]\n",
        "z of gps_position must be a number, null, or an estimated one",
    ),
    "sensor typo": (MINIMAL + "sensors: {gyo: {rate: 1}}\n", "unknown sensor 'gyo': did you mean 'gyro'?"),
    "sensor key typo": (
        MINIMAL + "sensors: {gyro: {nois: 1}}\n",
        "unknown key of sensor gyro: 'nois': did you mean 'noise'?",
    ),
    "sensor as number": (
        MINIMAL + "sensors: {gyro: 0.1}\n",
        "sensor gyro must be a mapping with noise, .*, not '0.1'",
    ),
    "sensor switched off": (MINIMAL + "sensors: {gyro: no}\n", "sensor gyro must be a mapping .*, not false"),
    "sensors switched off": (MINIMAL + "sensors: no\n", "sensors must be a mapping such as .*, not false"),
    "sensors as list": (MINIMAL + "sensors: [gyro]\n", "sensors must be a mapping such as .*, not a list"),
    "negative delay": (
        MINIMAL + "sensors: {gyro: {delay: -0.1}}\n",
        "delay of sensor gyro must be between 0 and 2 s",
    ),
    "long delay": (
        MINIMAL + "sensors: {gyro: {delay: 20}}\n",
        "delay of sensor gyro must be between 0 and 2 s, not 20",
    ),
    "rate zero": (MINIMAL + "sensors: {gyro: {rate: 0}}\n", "rate of sensor gyro must be positive"),
    "noise zero": (MINIMAL + "sensors: {gyro: {noise: 0}}\n", "noise of sensor gyro must be positive"),
    "noise of two": (
        MINIMAL + "sensors: {gyro: {noise: [1, 2]}}\n",
        "noise of sensor gyro must have 1 numbers",
    ),
    "noise of GPS of two": (
        MINIMAL + "sensors: {gps_position: {noise: [1, 2]}}\n",
        "must have 1 or 3 numbers",
    ),
    "noise of a group": (
        MINIMAL + "sensors: {air_data: {noise: 1}}\n",
        "noise of sensor air_data must have 3 numbers",
    ),
    "process noise": (MINIMAL + "process_noise: {wind: -1}\n", "process_noise wind must not be negative"),
    "process noise typo": (MINIMAL + "process_noise: {winds: 1}\n", "unknown key of process_noise: 'winds'"),
    "process noise as number": (MINIMAL + "process_noise: 0.2\n", "process_noise must be a mapping"),
    "surface": (MINIMAL + "surface_signs: {ruder: -1}\n", "unknown surface 'ruder': did you mean 'rudder'?"),
    "sign": (MINIMAL + "surface_signs: {rudder: 0.5}\n", "surface_signs rudder must be 1 or -1"),
    "coefficient": (MINIMAL + "coefficients: {CZ_alpha: high}\n", "coefficient CZ_alpha must be a number"),
    "bounds of nobody": (
        MINIMAL + "parameter_bounds: {CZ_alhpa: [-8, -2]}\n",
        "unknown parameter in parameter_bounds: 'CZ_alhpa': did you mean 'CZ_alpha'?",
    ),
    "one bound": (
        MINIMAL + "parameter_bounds: {CZ_alpha: [-8]}\n",
        r"parameter_bounds CZ_alpha must be two numbers \[lowest, highest\], not a list",
    ),
    "bounds that fall": (
        MINIMAL + "parameter_bounds: {CZ_alpha: [-2, -8]}\n",
        "parameter_bounds CZ_alpha must rise, not go from -2 to -8",
    ),
    "bounds that are one": (
        MINIMAL + "parameter_bounds: {CZ_alpha: [-2, -2]}\n",
        "parameter_bounds CZ_alpha must rise, not go from -2 to -2",
    ),
    "bound without a number": (
        MINIMAL + "parameter_bounds: {CZ_alpha: [-8, .nan]}\n",
        "parameter_bounds CZ_alpha must be a finite number",
    ),
    "bounds unlike any name": (
        MINIMAL + "parameter_bounds: {lift_slope: [-8, -2]}\n",
        r"'lift_slope': the nearest are \w+, \w+, \w+; names are axis and term",
    ),
    "bound in words": (
        MINIMAL + "parameter_bounds: {CZ_alpha: [low, -2]}\n",
        "parameter_bounds CZ_alpha must be a number",
    ),
    "bounds as list": (MINIMAL + "parameter_bounds: [-8, -2]\n", "parameter_bounds must be a mapping"),
    "coefficients as list": (MINIMAL + "coefficients: [1]\n", "coefficients must be a mapping"),
    "model as list": (MINIMAL + "model: [alpha]\n", "model must be a mapping"),
    "model axis": (MINIMAL + "model: {CL: [1]}\n", "the model names the axis 'CL'"),
    "model term": (MINIMAL + "model: {CZ: [alfa]}\n", "'alfa' in 'alfa' is not a signal"),
    "model term twice": (MINIMAL + "model: {CZ: [alpha, alpha]}\n", "the term 'alpha' twice in CZ"),
    "airspeed zero": (MINIMAL + "minimum_airspeed: 0\n", "minimum_airspeed must be positive"),
    "trim airspeed": (MINIMAL + "trim_airspeed: fast\n", "trim_airspeed must be a number"),
    "mass of a planet": (MINIMAL.replace("2.0", "1e300"), r"mass must be between 0.001 and 2e\+06 kg, not 1e\+300"),
    "mass of an electron": (MINIMAL.replace("2.0", "1e-300"), "mass must be between 0.001 and .* kg, not 1e-300"),
    "wing area": (MINIMAL.replace("0.3", "1e9"), "wing_area must be between 0.0001 and 10000 m²"),
    "span": (MINIMAL.replace("1.2", "1e300"), "span must be between 0.01 and 500 m, not"),
    "chord": (MINIMAL.replace("0.25", "1e-300"), "chord must be between 0.001 and 100 m, not 1e-300"),
    "mass in g": (MINIMAL.replace("2.0", "2000"), r"mass over wing_area is 6.67e\+03 kg/m², .*, 2000 kg and 0.3 m²"),
    "area in cm²": (MINIMAL.replace("0.3", "3000"), r"wing_area is 1e\+04 times span times chord, .*: check the units"),
    "place in mm": (
        MINIMAL + "imu_position: [120, 0, 40]\n",
        "imu_position is 126 m from the centre of gravity of an aeroplane whose span is 1.2 m: give it in m",
    ),
    "chord in mm": (MINIMAL.replace("0.25", "25"), "wing_area is 0.01 times span times chord"),
    "inertia in kg cm²": (
        MINIMAL.replace("0.07", "700").replace("0.09", "900").replace("0.15", "1500"),
        "inertia xx is that of 2 kg at 18.7 m from the axis, and the span is 1.2 m: check its unit, 700 kg m²",
    ),
    "inertia of nothing": (
        MINIMAL.replace("0.07", "1e-300").replace("0.09", "1e-300").replace("0.14", "1e-300").replace("0.014", "0"),
        r"inertia xx must be between 1e-09 and 1e\+10 kg m², not 1e-300",
    ),
    "position far away": (MINIMAL + "imu_position: [0, 1e300, 0]\n", "imu_position must be between -200 and 200 m"),
    "noise of nothing": (
        MINIMAL + "sensors: {gyro: {noise: 1e-300}}\n",
        "the noise of sensor gyro must be between 1e-09 and 100 rad/s, not 1e-300",
    ),
    "noise of everything": (
        MINIMAL + "sensors: {gps: {noise: [1, 1e300]}}\n",
        "the noise of sensor gps must be between 1e-09 and 1000 m/s, not",
    ),
    "rate": (MINIMAL + "sensors: {gyro: {rate: 1e300}}\n", r"the rate of sensor gyro must be between 0.01 and .* Hz"),
    "wind": (MINIMAL + "process_noise: {wind: 1e300}\n", "process_noise wind must be between 0 and 100 m/s per √s"),
    "speed": (MINIMAL + "minimum_airspeed: 1e300\n", "minimum_airspeed must be between 0.01 and 2000 m/s"),
    "altitude": (MINIMAL + "ground_altitude: 1e300\n", r"ground_altitude must be between -1000 and 100000 m"),
    "large coefficient": (MINIMAL + "coefficients: {CZ_alpha: 1e300}\n", "coefficient CZ_alpha must be between"),
    "noise of an input": (MINIMAL + "inputs: {tab: {noise: 1e300}}\n", "the noise of input tab must be between"),
    "many terms": (
        MINIMAL + f"model: {{CZ: [{', '.join(f'alpha*{i}' for i in range(61))}]}}\n",
        "CZ has 61 terms: at most 60",
    ),
    "long term": (MINIMAL + f"model: {{CZ: [{'+'.join(['alpha'] * 900)}]}}\n", "is longer than 4000 characters"),
    "long name in a term": (MINIMAL + f"model: {{CZ: [{'a' * 3000}]}}\n", "'a{60}…' in 'a{60}…' is not a signal"),
    "deep term": (MINIMAL + f"model: {{CZ: ['{'(' * 900}alpha{')' * 900}']}}\n", "is not an expression|too deeply"),
    "a term that YAML cuts": (MINIMAL + "model: {CZ: [1, lag(de, 0.05)]}\n", r"put one with a comma in quotes in YAML"),
    "escapes of a terminal": (MINIMAL + '"\\e[2J\\a": 1\n', r"unknown key '\[2J'"),
    "megabytes": (MINIMAL + "# " + "x" * 11_000_000, "larger than 10 MB"),
}


@pytest.mark.long_after_the_first
@pytest.mark.parametrize(("text", "message"), BAD.values(), ids=BAD.keys())
def test_a_bad_file_is_one_line_that_names_the_file_and_the_key(tmp_path, text, message):
    with pytest.raises(InputError, match=message) as raised:
        loaded(tmp_path, text)
    line = str(raised.value)
    assert str(tmp_path / "small.yaml") in line
    assert len(line.splitlines()) == 1 and line.isprintable() and len(line) < 800


def test_a_name_is_one_line(tmp_path):
    """It stands in comments of parameter files, which a second line would end."""
    text = MINIMAL.replace("name: Small", "name: |\n  Small\n  FW_AIRSPD_MIN 3")
    assert loaded(tmp_path, text).name == "Small FW_AIRSPD_MIN 3"


def test_a_file_that_is_not_there_and_a_folder_are_named(tmp_path):
    with pytest.raises(InputError, match=r"cannot read the aircraft file .*none\.yaml: No such file"):
        load_aircraft(tmp_path / "none.yaml")
    with pytest.raises(InputError, match=r"cannot read the aircraft file .*: Is a directory"):
        load_aircraft(tmp_path)


@pytest.mark.parametrize(("text", "name"), [("172", "172"), ("'007'", "007"), ("é ✈", "é ✈"), ("'no'", "no")])
def test_a_name_may_be_a_number_or_in_any_script(tmp_path, text, name):
    assert loaded(tmp_path, MINIMAL.replace("Small", text)).name == name


def test_yaml_anchors_and_merges_still_work(tmp_path):
    sensors = "sensors:\n  gyro: &g {noise: 0.1, rate: 50}\n  accelerometer: {<<: *g, noise: 0.3}\n"
    aircraft = loaded(tmp_path, MINIMAL + sensors)
    assert aircraft.sensors["gyro"].noise == (0.1,)
    assert (aircraft.sensors["accelerometer"].noise, aircraft.sensors["accelerometer"].rate) == ((0.3,), 50.0)


def test_keys_without_a_value_have_their_defaults(tmp_path):
    empty = "sensors:\nmodel:\nimu_position:\nprocess_noise:\ncoefficients:\nminimum_airspeed:\ntrim_airspeed:\n"
    aircraft = loaded(tmp_path, MINIMAL + empty)
    assert aircraft.sensors == DEFAULT_SENSORS and len(aircraft.model.parameter_names) == 32
    assert with_sensor(gyro=None)["gyro"] == DEFAULT_SENSORS["gyro"]


def test_only_what_the_file_gives_goes_before_the_messages():
    sensors = with_sensor(gyro={"noise": 0.01}, accelerometer={"rate": 200, "delay": 0.01})
    assert sensors["gyro"].noise_is_given and sensors["gyro"].noise == (0.01,)
    assert not sensors["accelerometer"].noise_is_given
    assert (sensors["accelerometer"].rate, sensors["accelerometer"].delay) == (200.0, 0.01)
    assert sensors["accelerometer"].noise == DEFAULT_SENSORS["accelerometer"].noise
    assert not any(sensor.noise_is_given for sensor in DEFAULT_SENSORS.values())


@pytest.mark.parametrize("group_first", [True, False])
def test_a_single_sensor_goes_before_its_group(group_first):
    given = {"air_data": {"noise": [0.3, 0.02, 0.03], "delay": 0.1}, "sideslip": {"noise": 0.05}}
    sensors = with_sensor(**dict(given.items() if group_first else reversed(given.items())))
    assert [sensors[s].noise[0] for s in ("airspeed", "angle_of_attack", "sideslip")] == [0.3, 0.02, 0.05]
    assert [sensors[s].delay for s in ("airspeed", "angle_of_attack", "sideslip")] == [0.1, 0.1, 0.1]


@pytest.mark.parametrize("said", ["gyro", "gyroscope", "accelerometer", "imu"])
def test_the_imu_has_one_delay_whichever_of_its_sensors_it_is_said_of(said):
    sensors = with_sensor(**{said: {"delay": 0.02}})
    assert [sensors[name].delay for name in ("accelerometer", "gyro")] == [0.02, 0.02]


@pytest.mark.parametrize("other", ["accelerometer", "imu"])
def test_two_delays_of_the_imu_are_refused(other):
    with pytest.raises(InputError, match=r"gyro and accelerometer .* one delay.*imu: \{delay: 0\.02\}"):
        with_sensor(**{other: {"delay": 0.01}, "gyro": {"delay": 0.02}})


def test_gps_noise_is_one_number_or_three_and_aliases_are_known():
    sensors = with_sensor(gps={"noise": [2.0, 0.1], "rate": 10}, beta={"rate": 20}, gyroscope={"noise": [0.2]})
    assert sensors["gps_position"].noise == (2.0, 2.0, 2.0) and sensors["gps_velocity"].noise == (
        0.1,
        0.1,
        0.1,
    )
    assert sensors["gps_velocity"].rate == 10.0 and sensors["sideslip"].rate == 20.0
    assert sensors["gyro"].noise == (0.2,)
    assert with_sensor(gps_position={"noise": [1, 2, 3]})["gps_position"].noise == (1.0, 2.0, 3.0)


def test_the_inertia_is_that_of_6_19():
    inertia = inertia_matrix(1.0, 2.0, 3.0, 0.4)
    assert inertia[0, 2] == inertia[2, 0] == -0.4 and np.all(np.linalg.eigvalsh(inertia) > 0.0)


def test_named_inputs_are_signals_of_terms(tmp_path):
    text = "inputs: {trim_tab: {unit: deg, noise: 0.1, limits: [-20, 30]}, engine_left: {unit: 1}, spoiler: }\n"
    aircraft = loaded(tmp_path, MINIMAL + text + "model: {Cm: [1, alpha, q, de, trim_tab], CZ: [1, spoiler*alpha]}\n")
    tab, engine, spoiler = aircraft.inputs
    assert (tab.name, engine.name, spoiler.name) == aircraft.model.inputs == ("trim_tab", "engine_left", "spoiler")
    np.testing.assert_allclose([tab.factor, tab.noise, *tab.limits], np.radians([1.0, 0.1, -20.0, 30.0]))
    assert engine.factor == spoiler.factor == 1.0 and engine.limits == (-10.0, 10.0)
    assert "CZ_spoiler*alpha" in aircraft.model.parameter_names
    assert aircraft.model.signals_of_axes[2] == ("alpha", "spoiler")
    tilted = aircraft.model.regressors("CZ", {"alpha": [0.1, 0.2], "spoiler": [2.0, np.nan]})
    np.testing.assert_allclose(tilted, [[1.0, 0.2], [1.0, np.nan]])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("inputs: {alpha: }", "the input 'alpha' has the name of a signal that there is already: give it another one"),
        ("inputs: {trim-tab: }", "the input 'trim-tab' cannot be used in a term: name it with letters, digits and _"),
        ("inputs: {max: }", "the input 'max' has a name that expressions already use: give it another one"),
        ("inputs: {sin: }", "the input 'sin' has a name that expressions already use: give it another one"),
        ("inputs: {lambda: }", "the input 'lambda' has a name that expressions already use: give it another one"),
        ("inputs: {if: }", "the input 'if' has a name that expressions already use: give it another one"),
        ("inputs: {1: }", "the input '1' cannot be used in a term: name it with letters, digits and _"),
        ("inputs: [trim_tab]", "inputs must be a mapping such as {trim_tab: {unit: deg}}, not a list"),
        ("inputs: {tab: deg}", "input tab must be a mapping such as {unit: deg}, not 'deg'"),
        ("inputs: {tab: {units: deg}}", "unknown key of input tab: 'units': did you mean 'unit'?"),
        ("inputs: {tab: {unit: ft}}", "input tab has the unit 'ft': use one of rad, deg, 1, N, rad/s"),
        ("inputs: {tab: {noise: 0}}", "the noise of input tab must be positive, not 0"),
        ("inputs: {tab: {limits: 3}}", "the limits of input tab must be two numbers [lowest, highest], not '3'"),
        ("inputs: {tab: {limits: [1, -1]}}", "the limits of input tab must rise, not go from 1 to -1"),
        ("inputs: {" + ", ".join(f"x{i}: " for i in range(11)) + "}", "inputs are 11: at most 10 can be named"),
        ("model: {Cm: [1, trim_tab]}", "'trim_tab' in 'trim_tab' is not a signal: use one of alpha beta"),
        ("inputs: {tab: , tab: }", "'tab'"),
    ],
)
def test_inputs_that_cannot_be_are_one_sentence(tmp_path, text, said):
    with pytest.raises(InputError) as caught:
        loaded(tmp_path, MINIMAL + text + "\n")
    assert said in str(caught.value) and "\n" not in str(caught.value)


BOMB = "\n".join(f"- &{b} [{', '.join([f'*{a}'] * 10)}]" for a, b in zip("abcdefgh", "bcdefghi", strict=True))


def test_aliases_that_repeat_each_other_are_refused(tmp_path):
    with pytest.raises(InputError, match="more than 200000 values"):
        loaded(tmp_path, f"- &a [1, 2]\n{BOMB}\n")


def test_an_alias_that_repeats_a_few_values_is_read(tmp_path):
    text = MINIMAL.replace("span: 1.2", "span: &span 1.2").replace("chord: 0.25", "chord: *span")
    assert loaded(tmp_path, text).chord == 1.2


def test_coordinates_that_nobody_knows_and_that_were_found_are_kept_apart():
    there = aircraft_from_dict({**yaml.safe_load(MINIMAL), "air_data_position": [None, "0.40 ± 0.02", -0.1]})
    assert there.air_data_position.tolist() == [0.0, 0.4, -0.1]
    found = {at: sigma for (key, at), sigma in there.unsaid.items() if key == "air_data_position"}
    assert np.isnan(found.pop("x")) and found == {"y": 0.02}
    assert {at for key, at in there.unsaid if key == "imu_position"} == set("xyz")
    said = {key: [0, 0, 0] for key in ("imu_position", "air_data_position")}
    assert aircraft_from_dict({**yaml.safe_load(MINIMAL), **said}).unsaid == {}
    for wrong in ("0.4 ± x", "0.4 ±", "0.4 ± -1", "nan ± 1", "1e400 ± 1"):
        with pytest.raises(InputError, match="y of imu_position must be"):
            aircraft_from_dict({**yaml.safe_load(MINIMAL), "imu_position": [0, wrong, 0]})


def test_a_sensor_that_a_file_has_by_its_alias_keeps_what_is_said_of_it_when_more_is_put_there():
    aircraft = aircraft_from_dict(
        {**default_aircraft().source, "sensors": {"controls": {"rate": 40.0, "noise": 0.003}}}
    )
    moved = with_setting(aircraft, ("sensors", "control_surfaces", "lag"), 0.06).sensors["control_surfaces"]
    assert (moved.rate, moved.noise, moved.lag) == (40.0, (0.003,), 0.06)
