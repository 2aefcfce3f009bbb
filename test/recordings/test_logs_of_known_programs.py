"""Tables as programs and sensors that many people have write them: what a first MAP makes of their names."""

import numpy as np
import pytest
from flown_columns import flown_columns
from scipy.io import savemat

from aircraft_sysid_ros.aircraft.atmosphere import STANDARD_GRAVITY as G
from aircraft_sysid_ros.recordings.tabular.column_expression import parse_column_expression
from aircraft_sysid_ros.recordings.tabular.guess.first_map import guess_map
from aircraft_sysid_ros.recordings.tabular.guess.names import guess_ground_track, guess_name
from aircraft_sysid_ros.recordings.tabular.guess.two_sides import two_sided_columns
from aircraft_sysid_ros.recordings.tabular.signals import UNITS
from aircraft_sysid_ros.recordings.tabular.source import open_source
from aircraft_sysid_ros.recordings.tabular.units import conversion

DEGREES, FOOT, KNOT = 180.0 / np.pi, 0.3048, 1852.0 / 3600.0
#: By how much [SI] a line may be off the truth: what the digits of a file take away.
DIGITS = {"rad": 2e-3, "rad/s": 2e-2, "m/s^2": 0.2, "m/s": 0.3, "m": 1.5, "Pa": 5.0, "kg": 0.1, "1": 0.02}
IMU = {f"{kind}.{axis}" for kind in ("specific_force", "angular_velocity") for axis in "xyz"}
ATTITUDE = {f"attitude.{angle}" for angle in ("roll", "pitch", "yaw")}
SURFACES = {"elevator", "aileron", "rudder"}
PLACE, VELOCITY = {"latitude", "longitude", "altitude"}, {f"velocity.{way}" for way in ("north", "east", "down")}


@pytest.fixture(scope="module")
def flown():
    return flown_columns()


def _written(path, columns, before="", separator=",", step=1):
    """A file of columns (n,) by name."""
    rows = zip(*(column[::step] for column in columns.values()), strict=True)
    lines = [
        separator.join(columns),
        *(separator.join(v if isinstance(v, str) else f"{v:.7f}" for v in row) for row in rows),
    ]
    path.write_text(before + "\n".join(lines) + "\n")


def _of_imu(flown, names, rate=1.0, signs=(1.0, 1.0, 1.0)):
    """Columns of an IMU whose names begin so; ``rate`` are its numbers of a rate by SI."""
    return {
        f"{name}{axis}": flown[f"{signal}.{low}"] * scale * sign
        for name, signal, scale in ((names[0], "specific_force", 1.0), (names[1], "angular_velocity", rate))
        for axis, low, sign in zip(names[2], "xyz", signs, strict=True)
    }


def vectornav(flown, path):
    _written(path / "log.csv", {
        "TimeStartup": flown["time"] * 1e9,
        **{f"YawPitchRoll_{name.title()}": DEGREES * flown[f"attitude.{name}"] for name in ("yaw", "pitch", "roll")},
        **_of_imu(flown, ("Accel_", "AngularRate_", "XYZ")),
        "PosLla_Lat": DEGREES * flown["latitude"], "PosLla_Lon": DEGREES * flown["longitude"],
        "PosLla_Alt": flown["altitude"],
        **{f"VelNed_{way[0].upper()}": flown[f"velocity.{way}"] for way in ("north", "east", "down")},
    }, step=2)  # fmt: skip
    return IMU | ATTITUDE | PLACE | VELOCITY


def xsens(flown, path):
    """Forward, left and up; Euler angles from the east to the left."""
    before = "// General information:\n//  MT Manager version:\t2020.0\n//  Update Rate:\t100.0Hz\n"
    _written(path / "log.txt", {
        "PacketCounter": np.arange(len(flown["time"])), "SampleTimeFine": flown["time"] * 1e4,
        **_of_imu(flown, ("Acc_", "Gyr_", "XYZ"), rate=DEGREES, signs=(1.0, -1.0, -1.0)),
        "Roll": DEGREES * flown["attitude.roll"], "Pitch": -DEGREES * flown["attitude.pitch"],
        "Yaw": np.mod(270.0 - DEGREES * flown["attitude.yaw"], 360.0) - 180.0,
        "Latitude": DEGREES * flown["latitude"], "Longitude": DEGREES * flown["longitude"],
        "Altitude": flown["altitude"],
        "Vel_E": flown["velocity.east"], "Vel_N": flown["velocity.north"], "Vel_U": -flown["velocity.down"],
    }, before, separator="\t")  # fmt: skip
    return IMU | ATTITUDE | PLACE | VELOCITY


def flightgear(flown, path):
    _written(path / "log.csv", {
        "/sim/time/elapsed-sec": flown["time"] + 40.0,
        "/position/latitude-deg": DEGREES * flown["latitude"], "/position/longitude-deg": DEGREES * flown["longitude"],
        "/position/altitude-ft": flown["altitude"] / FOOT,
        "/orientation/roll-deg": DEGREES * flown["attitude.roll"],
        "/orientation/pitch-deg": DEGREES * flown["attitude.pitch"],
        "/orientation/heading-deg": np.mod(DEGREES * flown["attitude.yaw"], 360.0),
        "/velocities/airspeed-kt": flown["indicated_airspeed"] / KNOT,
        **{f"/velocities/speed-{way}-fps": flown[f"velocity.{way}"] / FOOT for way in ("north", "east", "down")},
        **{f"/accelerations/pilot/{a}-accel-fps_sec": flown[f"specific_force.{a}"] / FOOT for a in "xyz"},
        **{f"/orientation/{n}-rate-degps": DEGREES * flown[f"angular_velocity.{a}"]
           for n, a in (("roll", "x"), ("pitch", "y"), ("yaw", "z"))},
        "/orientation/alpha-deg": DEGREES * flown["angle_of_attack"],
        "/orientation/side-slip-deg": DEGREES * flown["sideslip"],
        "/surface-positions/elevator-pos-norm": flown["elevator"] / 0.4,
        "/controls/engines/engine/throttle": flown["throttle"],
        "/engines/engine/oil-temperature-degf": 180.0 + 0.0 * flown["time"],
    }, step=2)  # fmt: skip
    air = {"indicated_airspeed", "angle_of_attack", "sideslip", "throttle"}
    return IMU | ATTITUDE | PLACE | VELOCITY | air


def jsbsim(flown, path):
    _written(path / "log.csv", {
        "Time": flown["time"], "V_{Total} (ft/s)": flown["true_airspeed"] / FOOT,
        **{f"{n} (deg/s)": DEGREES * flown[f"angular_velocity.{a}"] for n, a in zip("PQR", "xyz", strict=True)},
        **{f"{n} (deg)": DEGREES * flown[f"attitude.{a}"]
           for n, a in (("Phi", "roll"), ("Theta", "pitch"), ("Psi", "yaw"))},
        "Alpha (deg)": DEGREES * flown["angle_of_attack"], "Beta (deg)": DEGREES * flown["sideslip"],
        "Altitude ASL (ft)": flown["altitude"] / FOOT, "Latitude (deg)": DEGREES * flown["latitude"],
        "Longitude (deg)": DEGREES * flown["longitude"],
        **{f"V_{{{way.title()}}} (ft/s)": flown[f"velocity.{way}"] / FOOT for way in ("north", "east", "down")},
        "Nx (G)": flown["specific_force.x"] / G, "Ny (G)": flown["specific_force.y"] / G,
        "Nz (G)": -flown["specific_force.z"] / G,
        "fcs/elevator-pos-rad": flown["elevator"], "fcs/throttle-pos-norm": flown["throttle"],
    })  # fmt: skip
    air = {"true_airspeed", "angle_of_attack", "sideslip", "elevator", "throttle"}
    return IMU | ATTITUDE | PLACE | VELOCITY | air


def xplane(flown, path):
    _written(path / "Data.txt", {
        "_real,_time ": flown["time"], "_totl,_time ": flown["time"] + 30.0,
        "_Vind,_kias ": flown["indicated_airspeed"] / KNOT, "Vtrue,_ktas ": flown["true_airspeed"] / KNOT,
        "Vtrue,_ktgs ": np.hypot(flown["velocity.north"], flown["velocity.east"]) / KNOT,
        "__VVI,__fpm ": -flown["velocity.down"] * 60.0 / FOOT,
        **{f"____{n},rad/s ": flown[f"angular_velocity.{a}"] for n, a in (("Q", "y"), ("P", "x"), ("R", "z"))},
        "pitch,__deg ": DEGREES * flown["attitude.pitch"], "_roll,__deg ": DEGREES * flown["attitude.roll"],
        "hding,_true ": np.mod(DEGREES * flown["attitude.yaw"], 360.0),
        "hding,__mag ": np.mod(DEGREES * flown["attitude.yaw"] - 3.0, 360.0),
        "_beta,__deg ": DEGREES * flown["sideslip"], "__lat,__deg ": DEGREES * flown["latitude"],
        "__lon,__deg ": DEGREES * flown["longitude"], "p-alt,ftMSL ": flown["altitude"] / FOOT,
    }, separator="|", step=5)  # fmt: skip
    rates = {signal for signal in IMU if signal.startswith("angular")}
    return rates | ATTITUDE | PLACE | {"indicated_airspeed", "true_airspeed", "velocity.down", "sideslip"}


def mavlink(flown, path):
    """SCALED_IMU: thousandths of g and of rad/s."""
    _written(path / "log.csv", {
        "time_boot_ms": flown["time"] * 1e3,
        **{f"{a}acc": 1e3 / G * flown[f"specific_force.{a}"] for a in "xyz"},
        **{f"{a}gyro": 1e3 * flown[f"angular_velocity.{a}"] for a in "xyz"},
        "roll": DEGREES * flown["attitude.roll"], "pitch": DEGREES * flown["attitude.pitch"],
        "yaw": np.mod(DEGREES * flown["attitude.yaw"], 360.0),
        "lat": DEGREES * flown["latitude"], "lng": DEGREES * flown["longitude"],
            "alt": flown["altitude"],
    }, step=4)  # fmt: skip
    return {"specific_force.z", *(f"angular_velocity.{a}" for a in "xyz"), *ATTITUDE, "latitude", "longitude"}


def mavlogdump(flown, path):
    """Each message with its name before a point, in one table."""
    at = flown["time"]
    _written(path / "log.csv", {
        "timestamp": [f"{1_717_164_300.0 + t:.6f}" for t in at],
        "ATTITUDE.time_boot_ms": at * 1e3,
        **{f"ATTITUDE.{angle}": flown[f"attitude.{angle}"] for angle in ("roll", "pitch", "yaw")},
        **{f"ATTITUDE.{n}speed": flown[f"angular_velocity.{a}"] for n, a in zip(("roll", "pitch", "yaw"), "xyz",
                                                                              strict=True)},
        **{f"RAW_IMU.{a}acc": np.round(1e3 / G * flown[f"specific_force.{a}"]) for a in "xyz"},
        "VFR_HUD.airspeed": flown["indicated_airspeed"], "VFR_HUD.alt": flown["altitude"],
        "VFR_HUD.climb": -flown["velocity.down"],
        "GLOBAL_POSITION_INT.lat": np.round(1e7 * DEGREES * flown["latitude"]),
        "GLOBAL_POSITION_INT.lon": np.round(1e7 * DEGREES * flown["longitude"]),
        "GLOBAL_POSITION_INT.alt": np.round(1e3 * flown["altitude"]),
    }, step=4)  # fmt: skip
    return {"specific_force.z", *(f"angular_velocity.{a}" for a in "xyz"), *ATTITUDE, *PLACE, "indicated_airspeed"}


def matlab(flown, path):
    """A timetable, whose times are durations."""
    _written(path / "log.csv", {
        "Time": [f"{t:.2f} sec" for t in flown["time"]],
        **{f"a{a}_mps2": flown[f"specific_force.{a}"] for a in "xyz"},
            **{f"{n}_rps": flown[f"angular_velocity.{a}"] for n, a in zip("pqr", "xyz", strict=True)},
        **{f"{n}_rad": flown[f"attitude.{a}"] for n, a in (("phi", "roll"), ("theta", "pitch"), ("psi", "yaw"))},
        "TAS_mps": flown["true_airspeed"], "lat_deg": DEGREES * flown["latitude"],
        "lon_deg": DEGREES * flown["longitude"], "alt_m": flown["altitude"],
    }, step=2)  # fmt: skip
    return ATTITUDE | PLACE | {"true_airspeed", "specific_force.x", "specific_force.z"}


def sidpac(flown, path):
    """The matrix ``fdata`` of SIDPAC, of which only those columns are set that were measured."""
    fdata = np.zeros((len(flown["time"]), 90))
    for column, values in {
        1: flown["time"], 2: flown["true_airspeed"] / FOOT, 3: DEGREES * flown["sideslip"],
        4: DEGREES * flown["angle_of_attack"], 5: DEGREES * flown["angular_velocity.x"],
        6: DEGREES * flown["angular_velocity.y"], 7: DEGREES * flown["angular_velocity.z"],
        8: DEGREES * flown["attitude.roll"], 9: DEGREES * flown["attitude.pitch"], 10: DEGREES * flown["attitude.yaw"],
        11: flown["specific_force.x"] / G, 12: flown["specific_force.y"] / G, 13: flown["specific_force.z"] / G,
        14: DEGREES * flown["elevator"], 27: flown["dynamic_pressure"] / 47.880259, 30: flown["altitude"] / FOOT,
    }.items():  # fmt: skip
        fdata[:, column - 1] = values
    savemat(path / "log.mat", {"fdata": fdata[::2], "t": flown["time"][::2, None]})
    air = {"true_airspeed", "sideslip", "angle_of_attack", "elevator", "dynamic_pressure", "altitude"}
    return IMU | ATTITUDE | air


def ftis(flown, path):
    """Of the flight test instrumentation system of a university's jet: a structure of values, units and texts each."""
    zero = 0.0 * flown["time"]
    rows = {
        "vane_AOA": (DEGREES * flown["angle_of_attack"], "deg"), "elevator_dte": (zero + 2.5, "deg"),
        "lh_engine_FMF": (zero + 400.0, "lbs/hr"), "lh_engine_OP": (zero + 70.0, "psi"),
        "column_Se": (DEGREES * flown["elevator"] * 1.7, "deg"),
        **{f"delta_{s[0]}": (DEGREES * flown[s], "deg") for s in ("aileron", "elevator", "rudder")},
        "Gps_utcSec": (44_000.0 + np.floor(flown["time"]), "sec"),
        "Ahrs1_Roll": (DEGREES * flown["attitude.roll"], "deg"),
        "Ahrs1_Pitch": (DEGREES * flown["attitude.pitch"], "deg"),
        "Fms1_trueHeading": (np.mod(DEGREES * flown["attitude.yaw"], 360.0), "deg"),
        "Gps_lat": (DEGREES * flown["latitude"], "deg"), "Gps_long": (DEGREES * flown["longitude"], "deg"),
        **{f"Ahrs1_b{name}Rate": (DEGREES * flown[f"angular_velocity.{axis}"], "deg/s")
           for name, axis in (("Roll", "x"), ("Pitch", "y"), ("Yaw", "z"))},
        "Ahrs1_bLongAcc": (flown["specific_force.x"] / G, "g"), "Ahrs1_bLatAcc": (flown["specific_force.y"] / G, "g"),
        "Ahrs1_VertAcc": (-np.gradient(flown["velocity.down"], flown["time"]) / G, "g"),
        "Ahrs1_bNormAcc": (-flown["specific_force.z"] / G, "g"),
        "Dadc1_alt": (flown["altitude"] / FOOT, "ft"), "Dadc1_bcAltMb": (zero + 1016.0, "mB"),
        "Dadc1_mach": (flown["true_airspeed"] / 338.0, "<no unit>"),
        "Dadc1_tas": (flown["true_airspeed"] / KNOT, "knots"),
        "Dadc1_altRate": (-60.0 * flown["velocity.down"] / FOOT, "ft/min"),
        "time": (9.0 + flown["time"], "sec"),
    }  # fmt: skip
    parts = {}
    for name, (values, unit) in rows.items():
        on_end = values[::10, None] if name != "time" else values[None, ::10]
        parts[name] = {"data": on_end, "units": np.array([[unit]], object), "description": np.array([[name]], object)}
    savemat(path / "flight.mat", {"flightdata": parts})
    place = (PLACE - {"altitude"}) | {"pressure_altitude", "velocity.down"}
    imu = IMU - {"specific_force.y"}  # nothing shows its sign without a sideslip and a velocity
    return imu | ATTITUDE | place | SURFACES | {"angle_of_attack", "true_airspeed"}


def attas(flown, path):
    """As a research jet names its channels (Jategaonkar, Flight Vehicle System Identification), units in a line."""
    rows = {
        "T": (flown["time"], "s"),
        **{f"A{axis.upper()}CG": (flown[f"specific_force.{axis}"], "M/S**2") for axis in "xyz"},
        "AZCKP": (1.01 * flown["specific_force.z"], "M/S**2"),
        **{n: (DEGREES * flown[f"angular_velocity.{n[-1].lower()}"], "DEG/S") for n in ("PRGX", "QRGY", "RRGZ")},
        **{n: (DEGREES * flown[f"attitude.{a}"], "DEG")
           for n, a in (("PHI", "roll"), ("THE", "pitch"), ("PSI", "yaw"))},
        "ALCG": (DEGREES * flown["angle_of_attack"], "DEG"), "BECG": (DEGREES * flown["sideslip"], "DEG"),
        "VTASCG": (flown["true_airspeed"], "M/S"), "HQNH": (flown["altitude"] / FOOT, "ft"),
        "DELV": (DEGREES * flown["elevator"], "DEG"), "DRUD": (DEGREES * flown["rudder"], "DEG"),
        "DAIL_L": (-DEGREES * flown["aileron"], "DEG"), "DAIL_R": (DEGREES * flown["aileron"], "DEG"),
        "PHLAT": (DEGREES * flown["latitude"], "DEG"), "LALON": (DEGREES * flown["longitude"], "DEG"),
        "ALDOT": (np.gradient(DEGREES * flown["angle_of_attack"], flown["time"]), "DEG/S"),
    }  # fmt: skip
    lines = [" ".join(rows), " ".join(unit for _, unit in rows.values())]
    lines += [" ".join(f"{v:.7e}" for v in row) for row in zip(*(v[::4] for v, _ in rows.values()), strict=True)]
    (path / "flight.asc").write_text("\n".join(lines) + "\n")
    air = {"angle_of_attack", "sideslip", "true_airspeed", "pressure_altitude"}
    return IMU | ATTITUDE | (PLACE - {"altitude"}) | SURFACES | air


def onspeed(flown, path):
    """A logger of angle of attack for light aeroplanes, in g, degrees, feet and knots."""
    _written(path / "log_012.csv", {
        "timeStamp": np.round(1e3 * flown["time"]), "Pfwd": 300.0 + 0.0 * flown["time"],
        "Palt": flown["altitude"] / FOOT, "IAS": flown["indicated_airspeed"] / KNOT,
        "AngleofAttack": DEGREES * flown["angle_of_attack"], "flapsPos": 0.0 * flown["time"],
        "TAS": flown["true_airspeed"] / KNOT, "imuTemp": 41.0 + 0.0 * flown["time"],
        "VerticalG": -flown["specific_force.z"] / G, "LateralG": flown["specific_force.y"] / G,
        "ForwardG": flown["specific_force.x"] / G,
        **{f"{name}Rate": DEGREES * flown[f"angular_velocity.{axis}"]
           for name, axis in (("Roll", "x"), ("Pitch", "y"), ("Yaw", "z"))},
        "Pitch": DEGREES * flown["attitude.pitch"], "Roll": DEGREES * flown["attitude.roll"],
        "boomBeta": DEGREES * flown["sideslip"],
        "EarthVerticalG": -np.gradient(flown["velocity.down"], flown["time"]) / G,
        "VSI": -60.0 * flown["velocity.down"] / FOOT,
        # Another IMU, which is not in the axes of this one.
        "vnAccelFwd": flown["specific_force.x"] - 0.1 * flown["specific_force.z"],
        "vnAccelLat": flown["specific_force.y"] - 0.1 * flown["specific_force.z"],
        "vnAccelVert": 0.9 * flown["specific_force.z"], "vnPitch": DEGREES * flown["attitude.pitch"] + 6.0,
    }, step=2)  # fmt: skip
    air = {"pressure_altitude", "indicated_airspeed", "true_airspeed", "angle_of_attack", "sideslip", "velocity.down"}
    return IMU | air | {"attitude.roll", "attitude.pitch"}


def indexed(flown, path):
    """Vectors of which the unit stands before the number of the element."""
    unit = {"accel_body_mps2": "specific_force", "angular_rate_body_radps": "angular_velocity"}
    euler, ways = ("roll", "pitch", "yaw"), ("north", "east", "down")
    _written(path / "flight_16951.csv", {
        "seconds_since_launch": flown["time"],
        **{f"velocity_ned_mps[{i}]": flown[f"velocity.{way}"] for i, way in enumerate(ways)},
        **{f"{name}[{i}]": flown[f"{signal}.{axis}"] for name, signal in unit.items() for i, axis in enumerate("xyz")},
        **{f"orientation_rad[{i}]": flown[f"attitude.{name}"] for i, name in enumerate(euler)},
        **{f"position_sigma_ned_m[{i}]": 0.0 * flown["time"] + 0.3 for i in range(3)},
    }, step=2)  # fmt: skip
    return IMU | ATTITUDE | VELOCITY


@pytest.mark.parametrize(
    "layout",
    [vectornav, xsens, flightgear, jsbsim, xplane, mavlink, mavlogdump, matlab, sidpac, ftis, attas, onspeed, indexed],
)
def test_a_log_of_a_known_program_is_guessed(tmp_path, flown, layout):
    """Of FlightGear no name was known, of VectorNav the accelerometers; SIDPAC held "no columns of numbers"."""
    expected = layout(flown, tmp_path)
    (file,) = tmp_path.iterdir()
    lines = {}
    for part in guess_map(file).parts:
        lines |= {line.signal: line for line in part.lines if line.active}
    assert expected <= set(lines), f"not guessed: {sorted(expected - set(lines))}"
    table = _read(file)
    for signal, line in lines.items():
        convert = conversion(line.unit, UNITS[signal])
        values = parse_column_expression(line.expression).evaluate(table) if line.expression else table[line.column]
        values = line.sign * convert(values + line.offset)
        truth = flown["altitude" if signal == "pressure_altitude" else signal]
        off = values - np.interp(table[""], flown["time"], truth)
        if UNITS[signal] == "rad":
            off = np.angle(np.exp(1j * off))
        assert np.median(np.abs(off)) < DIGITS[UNITS[signal]], (signal, line)


def test_three_angles_of_an_orientation_whose_order_no_law_shows_are_left_to_the_user(tmp_path, flown):
    """A sensor by Bosch has heading, roll and pitch: its heading was taken for roll, by convention."""
    angles = [
        np.mod(DEGREES * flown["attitude.yaw"], 360.0),
        *(DEGREES * flown[f"attitude.{n}"] for n in ("roll", "pitch")),
    ]
    _written(tmp_path / "log.csv", {
        "time_s": flown["time"], **_of_imu(flown, ("acc_", "gyro_", "xyz")), "tas_mps": flown["true_airspeed"],
        **{f"orientation_{axis}_deg": angle for axis, angle in zip("xyz", angles, strict=True)},
    }, step=2)  # fmt: skip
    (part,) = guess_map(tmp_path / "log.csv").parts
    assert [line.active for line in part.lines if line.signal in ATTITUDE] == [False] * 3
    assert 0.0 not in {line.sign for line in part.lines}


@pytest.mark.parametrize(
    ("names", "left", "signal", "expression"),
    [
        (("ail_left", "ail_right"), -1.0, "aileron", "(ail_right - ail_left)/2"),
        (("LH aileron [deg]", "RH aileron [deg]"), 1.0, "aileron", "(`RH aileron [deg]` + `LH aileron [deg]`)/2"),
        (("elev_l", "elev_r"), 1.0, "elevator", "(elev_r + elev_l)/2"),
    ],
)
def test_left_and_right_surfaces_make_one_signal(tmp_path, flown, names, left, signal, expression):
    """Of a table with two ailerons neither was known."""
    moved = DEGREES * flown[signal] + np.random.default_rng(2).normal(0.0, 0.05, (2, len(flown["time"])))
    _written(tmp_path / "log.csv", {
        "time_s": flown["time"], names[0]: left * moved[0], names[1]: moved[1],
        **_of_imu(flown, ("acc_", "gyro_", "xyz")), "tas_mps": flown["true_airspeed"],
    }, step=2)  # fmt: skip
    (part,) = guess_map(tmp_path / "log.csv").parts
    (line,) = (line for line in part.lines if line.signal == signal)
    assert (line.expression, line.active, line.sign) == (expression, True, 1.0)


def _aileron_of(path, flown, columns):
    """The line of the aileron in the MAP of a table with an IMU and some columns of ailerons."""
    imu = _of_imu(flown, ("acc_", "gyro_", "xyz"))
    _written(path / "log.csv", {"time_s": flown["time"], **imu, "tas_mps": flown["true_airspeed"], **columns}, step=2)
    (part,) = guess_map(path / "log.csv").parts
    lines = [line for line in part.lines if line.signal == "aileron"]
    return min(lines, key=lambda line: not line.active)


def test_surfaces_that_do_not_move_as_one_are_left_to_the_user(tmp_path, flown):
    """As elevons do that hold a roll and a pitch: half of their sum is no aileron."""
    wild = np.random.default_rng(3).normal(0.0, 5.0, (2, len(flown["time"])))
    line = _aileron_of(tmp_path, flown, {"ail_left": wild[0], "ail_right": wild[1]})
    assert not line.active and "do not move as one" in line.evidence


def test_of_two_sides_one_of_which_stands_still_half_of_the_difference_is_no_aileron(tmp_path, flown):
    """A potentiometer that is not connected: the aileron would have half of its size."""
    moved = DEGREES * flown["aileron"]
    line = _aileron_of(tmp_path, flown, {"ail_left_deg": 0.0 * moved, "ail_right_deg": moved})
    assert not line.active and "do not move as one" in line.evidence


def test_pulses_of_two_servos_are_no_angle(tmp_path, flown):
    """Half of their difference looks like degrees, since their middle is not in it."""
    pulse = 10.0 * DEGREES * flown["aileron"]
    line = _aileron_of(tmp_path, flown, {"ail_left": 1500.0 - pulse, "ail_right": 1510.0 + pulse})
    assert not line.active and "ail_left: it goes up to" in line.evidence


def test_of_two_sides_in_unlike_units_it_is_said_why_they_make_no_line(flown):
    """They were passed over without a word."""
    sides = {"ail_left": -DEGREES * flown["aileron"], "ail_right": flown["aileron"]}
    (column,), names = two_sided_columns("log", sides, {"ail_left": "deg", "ail_right": "rad"}, flown["time"])
    assert column.doubt == "ail_left is in deg, ail_right in rad" and names == set(sides)


def test_commands_of_two_sides_come_after_their_deflections_and_are_never_sure(tmp_path, flown):
    moved = DEGREES * flown["aileron"]
    commands = {"ail_cmd_left_deg": -moved, "ail_cmd_right_deg": moved}
    line = _aileron_of(tmp_path, flown, commands)
    assert line.active and line.certainty == "likely" and "a command" in line.evidence
    late = np.interp(flown["time"] - 0.1, flown["time"], moved)
    line = _aileron_of(tmp_path, flown, commands | {"ail_left_deg": -late, "ail_right_deg": late})
    assert line.expression == "(ail_right_deg - ail_left_deg)/2" and line.certainty == "sure"


def test_a_matrix_without_names_takes_those_of_the_list_beside_it(tmp_path, flown):
    """As textbooks describe their data: number, name, unit and words, brackets among them. It was one of vectors."""
    values = [flown["time"], *(DEGREES * flown[f"angular_velocity.{axis}"] for axis in "xyz"), flown["altitude"]]
    savemat(tmp_path / "fElv1.mat", {"fElv1": np.stack(values, axis=1)[::4]})
    listed = ("T s time", "PRGX DEG/S roll rate", "QRGY DEG/S pitch rate", "RRGZ DEG/S yaw rate",
              "HRADIO M radio altitude (above ground)")  # fmt: skip
    (tmp_path / "channels.txt").write_text("".join(f"{i}   {line}\n" for i, line in enumerate(listed, 1)))
    (table,) = open_source(tmp_path / "fElv1.mat").tables("*")
    assert table.columns == ("T", "PRGX", "QRGY", "RRGZ", "HRADIO")
    assert dict(table.units) == {"T": "s", "PRGX": "DEG/S", "QRGY": "DEG/S", "RRGZ": "DEG/S", "HRADIO": "M"}
    assert "channels.txt" in table.note


@pytest.mark.parametrize("last", ["It was flown in calm air.", "plot(t, p); x = 3;", "The names are in the manual:"])
def test_a_text_of_as_many_lines_is_no_list_of_names(tmp_path, flown, last):
    """The columns of a matrix were called by the lines of a README beside it."""
    values = [flown["time"], *(flown[f"angular_velocity.{axis}"] for axis in "xyz"), flown["altitude"]]
    savemat(tmp_path / "f1.mat", {"f1": np.stack(values, axis=1)[::40]})
    (tmp_path / "README.txt").write_text("Flight\nby nobody\nof an aeroplane\nwith wings\n" + last + "\n")
    (table,) = open_source(tmp_path / "f1.mat").tables("*")
    assert "README" not in table.note and not any("Flight" in name for name in table.columns)


def _read(file):
    """Numbers of the columns of a file, and under "" their times [s] since the flight began."""
    from aircraft_sysid_ros.recordings.tabular.guess.times import guess_time
    from aircraft_sysid_ros.recordings.tabular.source import open_source

    for table in open_source(file).tables("*"):
        if len(table.columns) > 5:
            content = next(table.read(list(table.columns), 100_000))
            seconds = guess_time(table, content).seconds
            return {
                "": seconds - seconds[0],
                **{k: v.astype(float) for k, v in content.items() if v.dtype.kind in "fi"},
            }
    raise AssertionError(file)


@pytest.mark.parametrize(
    "name",
    ["Vtrue,_ktgs", "/engines/engine/oil-temperature-degf", "/autopilot/settings/target/altitude-ft", "P deg/sec/deg",
     "hding,__mag", "/accelerations/pilot-gdamped", "/fmu/out/imu/x", "/gimbal/pitch", "/camera/imu/angular_velocity.x",
     "/autopilot/pid/pitch", "/controls/flight/elevator", "/home/altitude", "/wind/velocity/north", "/traffic/latitude",
     "/esc/temperature", "/hydraulic/pressure", "/goal/latitude", "/body/rates/roll", "/moments/pitch",
     "acc_norm", "Accel_Norm", "Long CG", "cg_lat", "CG t", "mass_cg", "r_cg",
     "/acceleration/north", "/inputs/yaw", "EarthVerticalG", "orientation[1]", "vnYawSigma", "position_sigma_ned_m[0]"],
)  # fmt: skip
def test_what_only_ends_like_a_signal_is_none(name):
    assert guess_name(name) is None and guess_ground_track(name) is None


@pytest.mark.parametrize(
    ("name", "signal", "unit"),
    [("Vertical Accel(g)", "specific_force.z", "g"), ("Lateral Accel (g)", "specific_force.y", "g"),
     ("altitudeAMSL", "altitude", ""), ("AIRS_TrueSpeed", "true_airspeed", ""), ("AIRS_IAS", "indicated_airspeed", ""),
     ("ATTITUDE.rollspeed", "angular_velocity.x", ""), ("VFR_HUD.climb", "velocity.down", "")],
)  # fmt: skip
def test_names_of_panels_and_ground_stations(name, signal, unit):
    """Dynon's vertical acceleration, the ground station's altitude and PX4's old logs were not known."""
    guess = guess_name(name)
    assert (guess.signal, guess.unit) == (signal, unit)


@pytest.mark.parametrize(
    ("name", "signal", "unit"),
    [("/odom/velocity/north", "velocity.north", ""), ("/gnss/vel/north", "velocity.north", ""),
     ("/fdm/velocities/p-rad_sec", "angular_velocity.x", "rad/s"), ("/boom/vane/alpha", "angle_of_attack", ""),
     ("/autopilot/state/pitch", "attitude.pitch", ""), ("/inputs/elevator-deg", "elevator", "deg"),
     ("/controls/engines/engine/throttle", "throttle", "")],
)  # fmt: skip
def test_as_much_of_a_path_as_is_known_says_what_it_is(name, signal, unit):
    """A velocity to the north was a position there, and of alpha pint has a unit."""
    guess = guess_name(name)
    assert (guess.signal, guess.unit) == (signal, unit)


def test_rates_in_thousandths_are_not_taken_for_degrees(tmp_path, flown):
    """Of 530 mrad/s it was said that they are deg/s, since they are too fast for rad/s."""
    mavlink(flown, tmp_path)
    (part,) = guess_map(tmp_path / "log.csv").parts
    assert {line.unit for line in part.lines if line.signal.startswith("angular_velocity")} == {"mrad/s"}


def test_rates_beside_thousandths_of_g_may_be_thousandths_too(tmp_path, flown):
    """Without an attitude nothing told, and 810 mrad/s were deg/s, 17 times too fast."""
    _written(tmp_path / "log.csv", {
        "time_boot_ms": flown["time"] * 1e3,
        **{f"{a}acc": np.round(1e3 / G * flown[f"specific_force.{a}"]) for a in "xyz"},
        **{f"{a}gyro": np.round(1e3 * flown[f"angular_velocity.{a}"]) for a in "xyz"},
    }, step=4)  # fmt: skip
    (part,) = guess_map(tmp_path / "log.csv").parts
    assert {line.unit for line in part.lines if line.signal.startswith("specific_force")} == {"mg"}
    rates = [line for line in part.lines if line.signal.startswith("angular_velocity")]
    assert len(rates) == 3
    assert not any(line.active for line in rates)


def test_what_simulink_logs_as_a_structure_with_time_has_its_time(tmp_path, flown):
    """Its signals were tables of their own without one."""
    force = np.stack([flown[f"specific_force.{axis}"] for axis in "xyz"], axis=1)
    kinds = [("values", "O"), ("dimensions", "O"), ("label", "O")]
    several = np.array(
        [(flown["true_airspeed"][:, None], 1.0, "TAS_mps"), (force, 3.0, "acc"), (np.zeros((2, 2, 9001)), 4.0, "")],
        kinds,
    )
    one = {"values": flown["throttle"][:, None], "dimensions": 1.0, "label": "throttle"}
    logs = {
        "logs": {"time": flown["time"], "signals": several, "blockName": "flight/To Workspace"},
        "lever": {"time": flown["time"], "signals": one, "blockName": "flight/To Workspace1"},
    }
    savemat(tmp_path / "log.mat", logs)
    parts = {
        part.file: {line.signal: line.column for line in part.lines} for part in guess_map(tmp_path / "log.mat").parts
    }
    assert parts["lever"] == {"throttle": "throttle"}
    assert parts["logs"]["true_airspeed"] == "TAS_mps" and parts["logs"]["specific_force.z"] == "acc[2]"


def test_signals_of_simulink_of_one_label_are_all_there_and_a_structure_with_such_fields_is_read_as_one(tmp_path):
    """The second of two was lost, one called time was the time, and of any other structure all but its time was."""
    time = 0.02 * np.arange(200)
    kinds = [("values", "O"), ("dimensions", "O"), ("label", "O")]
    several = np.array([(np.sin(k * time)[:, None], 1.0, label) for k, label in enumerate(("p", "p", "time"))], kinds)
    savemat(tmp_path / "log.mat", {
        "logs": {"time": time, "signals": several, "blockName": "flight/Scope"},
        "untimed": {"time": np.array([]), "signals": several, "blockName": "flight/Scope1"},
        "flight": {"time": time, "signals": {"q": np.cos(time)}, "alpha": np.sin(time)},
        "matrix": {"time": time, "signals": np.stack([time, time], axis=1)},
    })  # fmt: skip
    tables = {table.name: table.columns for table in open_source(tmp_path / "log.mat").tables("*")}
    assert tables["logs"] == ("time", "p", "p of signal 2", "time of signal 3")
    assert tables["untimed"] == ("p", "p of signal 2", "time")
    assert tables["flight"] == ("time", "alpha") and tables["flight/signals"] == ("q",)
    assert tables["matrix"] == ("time", "signals[0]", "signals[1]")
    parts = {part.file: part for part in guess_map(tmp_path / "log.mat").parts}
    assert parts["logs"].time.column == parts["flight"].time.column == "time"
