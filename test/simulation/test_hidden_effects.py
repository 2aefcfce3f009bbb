"""Hidden effects of the textbook simulator: what is there is exactly what the truth says, and nothing tells it."""

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft import atmosphere
from aircraft_sysid_ros.commands.simulate import parse_hidden
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions, first_order_lag, measure
from aircraft_sysid_ros.simulation.dynamics import trim_airspeed_of
from aircraft_sysid_ros.simulation.hidden_effects import RECIPES, SIMULATED, hidden_effect, plans_of
from aircraft_sysid_ros.simulation.jsbsim_flight import signals_of
from aircraft_sysid_ros.simulation.simulated_flight import hidden_flight, simulate_samples
from aircraft_sysid_ros.simulation.truth_files import truth_document
from aircraft_sysid_ros.simulation.varied_plan import PLANS


def all_signals(flight, every):
    truth = flight.truth[::every]
    altitude = truth.origin[2] - truth.position[:, 2]
    return {
        **signals_of(flight.aircraft, truth),
        "flaps": truth.controls[:, 3],
        "height": truth.height,
        "time": truth.time,
        "mach": truth.airspeed / np.array([atmosphere.speed_of_sound(h) for h in altitude]),
    }


def misfit(flight, model):
    """Part (6,) of the true coefficients, as the file's mass properties give them, that a model cannot say."""
    every = 1 if model.lags else 5  # what remembers is sampled as it was flown
    signals, coefficients = all_signals(flight, every), flight.apparent_coefficients[::every]
    out = []
    for i, axis in enumerate(model.terms):
        columns, c = model.regressors(axis, signals), coefficients[:, i]
        out.append(np.std(c - columns @ np.linalg.lstsq(columns, c, rcond=None)[0]) / np.std(c))
    return np.array(out)


@pytest.fixture(scope="module")
def clean():
    return hidden_flight(seed=4, duration=40.0)


def test_every_effect_of_the_library_can_be_hidden_but_two():
    assert set(SIMULATED) == set(BY_ID) - {"fuel_burn", "late_controls"}
    assert all(set(plans_of(name)) <= set(PLANS) for name in SIMULATED)


@pytest.mark.long
@pytest.mark.parametrize(
    "name",
    [
        n if i % 5 == 0 else pytest.param(n, marks=pytest.mark.long)
        for i, n in enumerate([*RECIPES, "mass_change", "cg_shift"])
    ],
)
def test_the_oracle_knows_what_is_there(name):
    """With its terms the model says the coefficients of the flight to the last digits; without them it does not."""
    flight = hidden_flight(effect=name, seed=1, duration=60.0)
    limited = any(np.isfinite(lag.rate) for lag in flight.oracle.model.lags)
    most = 0.05 if limited else 1e-4  # what is limited in its rate alone is flown with SHORTEST_LAG besides
    assert misfit(flight, flight.oracle.model).max() < most
    if name != "lift_tilt":  # too small at its physical size on this aeroplane, and thrust that falls hardly larger
        assert misfit(flight, flight.aircraft.model).max() > (0.005 if name == "propeller_thrust" else 0.02)


def test_the_same_seed_is_the_same_flight_and_strength_scales_the_truth(aircraft):
    first, second = (hidden_flight(effect="dihedral_alpha", seed=2, duration=20.0) for _ in range(2))
    np.testing.assert_array_equal(first.samples.values, second.samples.values)
    for name in RECIPES:
        full, half = (hidden_effect(name, s, 3, 100.0, aircraft, aircraft.coefficients) for s in (1.0, 0.5))
        np.testing.assert_allclose([t.value for t in half.terms], [0.5 * t.value for t in full.terms])
        assert [t.expression for t in half.terms] == [t.expression for t in full.terms]
        if "t0" in full.inner:
            assert 30.0 <= full.inner["t0"] <= 70.0


@pytest.mark.long
@pytest.mark.parametrize(
    "name", ["control_damage", "alpha_scale", "airspeed_drift", "air_data_lag", "mass_change", "imu_offset"]
)
def test_what_the_user_has_tells_nothing(clean, name):
    flight = hidden_flight(effect=name, seed=4, duration=40.0)
    assert flight.aircraft.source == clean.aircraft.source
    assert [s.topic for s in flight.streams] == [s.topic for s in clean.streams]
    assert [sorted(s.fields) for s in flight.streams] == [sorted(s.fields) for s in clean.streams]
    assert truth_document(flight)["hidden"][0]["effect"] == name
    assert truth_document(clean)["hidden"] == []


def test_mass_and_centre_of_gravity_change_at_their_time():
    flight = hidden_flight(effect="mass_change", seed=3, duration=40.0)
    ratio = flight.apparent_coefficients[:, 2] / flight.truth.coefficients[:, 2]
    late = flight.truth.time > flight.hidden[0].inner["t0"]
    np.testing.assert_allclose(ratio[~late], 1.0, rtol=1e-9)
    np.testing.assert_allclose(ratio[late], 1.0 / flight.hidden[0].mass_factor, rtol=1e-9)


def test_two_changes_of_the_mass_properties_each_come_at_their_own_time(aircraft):
    flight = simulate_samples(aircraft, 3, 20.0, hidden=[("mass_change", 1.0), ("cg_shift", 1.0)], rate=100.0)
    mass, shift = flight.hidden
    assert abs(mass.inner["t0"] - shift.inner["t0"]) > 0.5
    found, true, time = flight.apparent_coefficients, flight.truth.coefficients, flight.truth.time
    ratio = np.where(time > mass.inner["t0"], mass.mass_factor, 1.0)
    np.testing.assert_allclose(found[:, 2] * ratio, true[:, 2], rtol=1e-9)
    heavy, before = found[:, :3] * ratio[:, None], time <= shift.inner["t0"]
    assert shift.cg_shift[1:] == (0.0, 0.0)
    off = found[:, 4] - true[:, 4]
    np.testing.assert_allclose(off[before], 0.0, atol=1e-9)
    np.testing.assert_allclose(off[~before], shift.cg_shift[0] / aircraft.chord * heavy[~before, 2], atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "field"),
    [
        ("airspeed_drift", "true_airspeed"),
        ("alpha_drift", "angle_of_attack"),
        pytest.param("beta_drift", "sideslip", marks=pytest.mark.long),
    ],
)
def test_a_drift_grows_from_nothing(clean, name, field):
    """Same flight, same noise: an angle shows d t more, an airspeed the share d t."""
    flight = hidden_flight(effect=name, seed=4, duration=40.0, manoeuvres=clean.manoeuvres)
    ((key, rate),) = flight.hidden[0].settings
    assert key[-1] == "drift"
    shown, without = (next(s for s in f.streams if s.topic == "air_data") for f in (flight, clean))
    time = (shown.stamp - shown.stamp[0]) * 1e-9
    more = shown.fields[field] - without.fields[field]
    if name == "airspeed_drift":
        assert rate == pytest.approx(-0.03 / 60.0) and abs(more[0]) < 0.01
        share = more / without.fields[field]
        np.testing.assert_allclose(share, rate * time, atol=1e-3)  # noise does not drift
    else:
        assert abs(rate) == pytest.approx(np.radians(1.5) / 60.0)
        np.testing.assert_allclose(more, rate * time, atol=1e-4)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "field"),
    [("alpha_offset", "angle_of_attack"), pytest.param("beta_offset", "sideslip", marks=pytest.mark.long)],
)
def test_a_vane_that_is_mounted_wrong_shows_the_same_too_much_always(clean, name, field):
    flight = hidden_flight(effect=name, seed=4, duration=40.0, manoeuvres=clean.manoeuvres)
    ((key, offset),) = flight.hidden[0].settings
    assert key[-1] == "offset" and abs(offset) == pytest.approx(np.radians(2.0))
    shown, without = (next(s for s in f.streams if s.topic == "air_data") for f in (flight, clean))
    np.testing.assert_allclose(shown.fields[field] - without.fields[field], offset, atol=1e-9)


def test_wind_changes_by_a_gust():
    calm, gusty = (hidden_flight(effect=e, seed=6, duration=40.0, manoeuvres="varied") for e in (None, "wind_change"))
    difference = gusty.truth.wind - calm.truth.wind
    np.testing.assert_allclose(difference[0], 0.0)
    np.testing.assert_allclose(difference[-1], [*gusty.hidden[0].gust, 0.0], atol=1e-12)


def test_a_lag_is_of_first_order():
    time = np.arange(2001) / 1000.0
    late = first_order_lag(time, np.where(time < 0.5, 1.0, 3.0)[:, None], 0.1)[:, 0]
    expected = np.where(time < 0.5, 1.0, 3.0 - 2.0 * np.exp(-(time - 0.5) / 0.1))
    np.testing.assert_allclose(late, expected, atol=0.03)


def test_recorded_commands_lead_the_surfaces():
    """What a servo of first order follows is what was recorded: filtered again, it is the surface."""
    flight = hidden_flight(effect="actuator_lag", seed=2, duration=30.0, manoeuvres="standard")
    options = SensorOptions(noise_scale=0.0, command_lag=flight.hidden[0].command_lag)
    (controls,) = [s for s in measure(flight.aircraft, flight.truth, 0, options)[0] if s.topic == "control_surfaces"]
    time = (controls.stamp - controls.stamp[0]) * 1e-9
    surface = np.interp(time + 0.0062, flight.truth.time, flight.truth.controls[:, 0])
    again = first_order_lag(time, controls.fields["elevator"][:, None], options.command_lag)[:, 0]
    assert np.std(again - surface) < 0.25 * np.std(controls.fields["elevator"] - surface)


def test_a_scale_in_the_file_undoes_that_of_the_sensor():
    """Samples of a sensor with a scale, read with a file that knows it, are those of a sensor without."""
    flight = hidden_flight(effect="alpha_scale", seed=2, duration=30.0, noise_scale=0.2)
    errors = []
    for aircraft in (flight.aircraft, flight.oracle):
        estimator = StateEstimator(aircraft)
        rows = np.vstack([estimator.push(flight.samples), estimator.flush()])
        late = rows[:, StateField.TIME] > rows[-1, StateField.TIME] - 15.0
        since = rows[late, StateField.TIME] - rows[-1, StateField.TIME] + flight.truth.time[-1]
        true = np.interp(since, flight.truth.time, flight.truth.alpha)
        errors.append(np.std(rows[late, StateField.ANGLE_OF_ATTACK] - true))
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.long
def test_a_scale_of_one_changes_nothing(clean):
    sensors = {name: replace(sensor, scale=1.0) for name, sensor in clean.aircraft.sensors.items()}
    rows = [StateEstimator(a).push(clean.samples) for a in (clean.aircraft, replace(clean.aircraft, sensors=sensors))]
    np.testing.assert_array_equal(*rows)


@pytest.mark.long
def test_low_passes_come_near_the_ground_and_stay_above_it():
    flight = hidden_flight(effect="ground_effect", seed=1, duration=80.0)
    assert 0.0 < flight.truth.height.min() < 0.5 * flight.aircraft.span
    assert np.mean(flight.truth.height < flight.aircraft.span) > 0.03


@pytest.mark.long_after_the_first
@pytest.mark.parametrize("manoeuvres", PLANS)
def test_every_kind_of_flight_shows_what_it_is_for(manoeuvres):
    truth = hidden_flight(seed=5, duration=80.0, manoeuvres=manoeuvres).truth
    if manoeuvres == "high_alpha":
        assert truth.alpha.max() > np.radians(12.0)
    if manoeuvres == "flaps":
        assert truth.controls[:, 3].max() > 0.15 and truth.controls[0, 3] == 0.0
    else:
        assert np.all(truth.controls[:, 3] == 0.0)
    if manoeuvres == "sideslips":
        assert np.abs(truth.beta).max() > np.radians(8.0)
    if manoeuvres == "speeds":
        assert np.ptp(truth.airspeed) > 0.25 * truth.airspeed[0]


def test_bad_requests_are_one_sentence(aircraft):
    with pytest.raises(InputError, match="'wings' is not an effect"):
        hidden_flight(effect="wings", duration=20.0)
    with pytest.raises(InputError, match="no simulated flight can hide it"):
        hidden_flight(effect="fuel_burn", duration=20.0)
    with pytest.raises(InputError, match="must be from 0 to 3"):
        hidden_flight(effect="stall", strength=7.0, duration=20.0)
    with pytest.raises(InputError, match="unknown manoeuvres 'loops'"):
        hidden_flight(manoeuvres="loops", duration=20.0)


def test_effects_on_the_command_line():
    assert parse_hidden("stall") == ("stall", 1.0)
    assert parse_hidden("stall:0.5") == ("stall", 0.5)
    assert parse_hidden("CZ: alpha**3 = -5") is None
    with pytest.raises(InputError, match="strength 'much'"):
        parse_hidden("stall:much")


def test_an_aeroplane_without_a_rudder_hides_what_it_can(aircraft):
    """Of a slipstream and of a damage there is what its other surfaces do; a fin that it has not is not damaged."""
    without = {name: value for name, value in aircraft.coefficients.items() if not name.endswith("_dr")}
    for seed in range(10):
        for name in ("propwash", "control_damage", "stuck_control"):
            terms = hidden_effect(name, 1.0, seed, 100.0, aircraft, without).terms
            assert terms
            assert not any("dr" in term.expression for term in terms)


def test_an_effect_of_derivatives_that_an_aeroplane_has_not_is_refused(aircraft):
    known = {name: value for name, value in aircraft.coefficients.items() if name[3:] not in ("de", "da", "dr")}
    with pytest.raises(InputError, match=r"control_damage.*Cm_de"):
        hidden_effect("control_damage", 1.0, 0, 100.0, aircraft, known)


@pytest.mark.parametrize("name", ["tow_line", "aeroelasticity", "wind_change"])
def test_what_is_a_share_of_the_flight_is_one_of_the_airspeed_that_is_flown(aircraft, name):
    """An aeroplane of ten times the mass whose file leaves the airspeed to the lift coefficient."""
    heavy = replace(aircraft, mass=10.0 * aircraft.mass, trim_airspeed=None)
    said = replace(heavy, trim_airspeed=trim_airspeed_of(heavy))
    left, given = (hidden_effect(name, 1.0, 2, 100.0, one, aircraft.coefficients) for one in (heavy, said))
    assert left == given
