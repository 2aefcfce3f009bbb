"""The controller's laws against the simulator, and whole flights in closed loop."""

from dataclasses import replace

import numpy as np
import pytest
from autopilot import Instruments
from dynamic_inversion import AttitudeController, Follower, Reference, Seen, invert, rig_of
from one_process import CASES, Case, fly, truth_of
from task import EXCITATION, PITCHES, Multisine, Task

from aircraft_sysid_ros.aircraft.atmosphere import altitude_at, pressure
from aircraft_sysid_ros.aircraft.frames import quaternion_from_euler
from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX
from aircraft_sysid_ros.simulation.closed_loop import SteppedAeroplane, damage_of
from aircraft_sysid_ros.simulation.dynamics import CONTROLS, RATES, motion

NO_EXCITATION = np.zeros(3)


def parameters_of(aircraft, coefficients):
    return np.array([coefficients[name] for name in aircraft.model.parameter_names])


@pytest.mark.parametrize("damage", ["none", "elevator", "aileron", "cg_aft"])
def test_with_the_truth_the_aeroplane_accelerates_as_wanted(aircraft, damage):
    """Against the simulator, which knows nothing of it; one step is exact in a model affine in the surfaces."""
    there = damage_of(aircraft, damage)
    aeroplane = SteppedAeroplane(aircraft, 0, 1.0, damage=there, change_time=0.0)
    parameters = parameters_of(aircraft, there.apparent(aircraft))
    rng = np.random.default_rng(1)
    for _ in range(30):
        state = aeroplane.state.copy()
        state[3:6] += rng.normal(0.0, 1.5, 3)
        state[RATES : RATES + 3] = rng.normal(0.0, 0.7, 3)
        wanted = rng.normal(0.0, 5.0, 3)
        before = motion(aeroplane._after, aeroplane.setup.place, state, np.zeros(3), 0.0)
        surfaces = invert(rig_of(aircraft), parameters, before.signals.copy(), state[RATES : RATES + 3], wanted)
        state[CONTROLS : CONTROLS + 3] = surfaces
        after = motion(aeroplane._after, aeroplane.setup.place, state, np.zeros(3), 0.0)
        assert after.angular_acceleration == pytest.approx(wanted, abs=1e-8)


@pytest.mark.parametrize("spoil", [{"Cm_de": 0.0}, {"Cl_da": 0.0, "Cl_dr": 0.0}, {"Cm_de": np.nan}])
def test_surfaces_stay_where_the_model_cannot_tell_them_apart(aircraft, spoil):
    parameters = parameters_of(aircraft, {**aircraft.coefficients, **spoil})
    signals = np.zeros(19)
    signals[SIGNAL_INDEX["V"]], signals[SIGNAL_INDEX["qbar"]] = 17.0, 177.0
    signals[SIGNAL_INDEX["de"]] = 0.03
    found = invert(rig_of(aircraft), parameters, signals, np.zeros(3), np.ones(3))
    assert found.tolist() == [0.03, 0.0, 0.0]


def test_the_reference_model_is_critically_damped():
    follower, dt = Follower(3.0), 1e-4
    for k in range(1, 20001):
        follower.step(0.4, dt)
        if k % 5000 == 0:
            wt = 3.0 * k * dt
            assert follower.angle == pytest.approx(0.4 * (1.0 - (1.0 + wt) * np.exp(-wt)), abs=2e-4)


def test_level_and_undisturbed_it_asks_for_trim(aircraft):
    controller = AttitudeController(aircraft)
    trim = SteppedAeroplane(aircraft, 0, 1.0).setup.trim
    attitude = quaternion_from_euler(0.0, trim.alpha, 0.0)
    seen = Seen(np.zeros(3), attitude, trim.airspeed, trim.alpha, trim.beta, 1.177, 0.0)
    parameters = parameters_of(aircraft, aircraft.coefficients)
    command = controller.step(seen, Reference(0.0, 0.0, trim.airspeed), parameters, NO_EXCITATION, 0.01)
    assert command == pytest.approx(trim.controls, abs=2e-3)  # the sideslip of trim is flown out


@pytest.mark.parametrize(("held", "left"), [(-0.5, -0.5), (-0.1, 0.0), (0.5, 0.5)])
def test_what_the_model_learns_the_integral_gives_up_and_no_more(aircraft, held, left):
    """A pitching moment that the integral has held: once the model knows it, the elevator stays where it is."""
    controller = AttitudeController(aircraft)
    trim = SteppedAeroplane(aircraft, 0, 1.0).setup.trim
    attitude = quaternion_from_euler(0.0, trim.alpha, 0.0)
    seen = Seen(np.zeros(3), attitude, trim.airspeed, trim.alpha, trim.beta, 1.177, 0.0)
    moment = 0.01
    explained = moment * 0.5 * 1.177 * 17.0**2 * aircraft.wing_area * aircraft.chord / aircraft.inertia[1, 1] / 8.0
    known = {**aircraft.coefficients, "Cm_0": aircraft.coefficients["Cm_0"] + moment}
    controller._integral = np.array([0.0, held])
    elevators = [
        controller.step(seen, Reference(0.0, 0.0, 17.0), parameters_of(aircraft, c), NO_EXCITATION, 0.0)[0]
        for c in (aircraft.coefficients, known)
    ]
    wanted = left + explained if held < -explained else left  # else it would go beyond zero, or away from it
    assert controller._integral == pytest.approx([0.0, wanted], abs=1e-9)
    if held < -explained:
        assert elevators[1] == pytest.approx(elevators[0], abs=1e-9)


def test_no_airspeed_does_not_blow_the_surfaces_up(aircraft):
    controller = AttitudeController(aircraft)
    seen = Seen(np.zeros(3), quaternion_from_euler(0.3, 0.2, 0.0), 0.0, 0.0, 0.0, 1.2, 0.0)
    parameters = parameters_of(aircraft, aircraft.coefficients)
    for _ in range(500):
        command = controller.step(seen, Reference(0.0, 0.0, 17.0), parameters, NO_EXCITATION, 0.01)
    assert np.all(np.isfinite(command)) and np.abs(command[:3]).max() <= np.radians(25.0) + 1e-12
    assert 0.0 <= command[3] <= 1.0


def test_instruments_take_the_lever_arm_of_the_probe_out(aircraft):
    instruments = Instruments(aircraft)
    assert instruments.seen is None and instruments.condition(0) is None
    rates, flow = np.array([1.0, 0.5, -0.3]), np.array([16.0, 0.5, 1.0])
    at_probe = flow + np.cross(rates, aircraft.air_data_position)
    v = np.linalg.norm(at_probe)
    shown = [v, np.arctan2(at_probe[2], at_probe[0]), np.arcsin(at_probe[1] / v), 1.2, pressure(400.0)]
    instruments.take_imu(rates)
    instruments.take_attitude(np.array([1.0, 0.0, 0.0, 0.0]))
    instruments.take_air_data(np.array(shown), 10)
    seen = instruments.seen
    assert [seen.airspeed, seen.alpha, seen.beta] == pytest.approx(
        [np.linalg.norm(flow), np.arctan2(1.0, 16.0), np.arcsin(0.5 / np.linalg.norm(flow))], rel=1e-9
    )
    instruments.take_air_data(np.array([np.nan, *shown[1:]]), 20)
    assert instruments.seen == seen  # what is not measured is not used
    assert instruments.lacking == []
    for altitude in (0.0, 410.0, 3000.0):
        assert altitude_at(pressure(altitude)) == pytest.approx(altitude, abs=1e-6)


def test_instruments_put_air_data_together_that_come_in_parts(aircraft):
    """As from a MAVLink bridge, beside which the controller never flew."""
    instruments, second = Instruments(aircraft), 1_000_000_000
    instruments.take_imu(np.zeros(3))
    instruments.take_attitude(np.array([1.0, 0.0, 0.0, 0.0]))
    of_airspeed = np.array([17.0, np.nan, np.nan, 1.2, pressure(400.0)])
    of_angles = np.array([np.nan, 0.05, 0.01, np.nan, np.nan])
    instruments.take_air_data(of_airspeed, second)
    assert instruments.seen is None and instruments.lacking == ["angle_of_attack", "sideslip"]
    instruments.take_air_data(of_angles, second + second // 50)
    now = second + second // 50
    assert instruments.condition(now) == pytest.approx((17.0, 0.05, 0.01)) and instruments.lacking == []
    assert instruments.condition(now + second) is not None and instruments.condition(now + second + 1) is None
    seen = instruments.seen
    instruments.take_air_data(of_angles + 0.01, 3 * second)  # the airspeed is too old
    assert instruments.seen == seen and instruments.condition(3 * second) is None  # no parameter is LIVE by it
    instruments.take_air_data(of_airspeed, 3 * second + 1)
    assert instruments.condition(3 * second + 1) == pytest.approx((17.0, 0.06, 0.02))


@pytest.mark.filterwarnings("error")
def test_a_clock_that_goes_back_and_what_is_no_number_leave_the_instruments_as_they_are(aircraft):
    """Airspeed and height were NaN for ever after it, and so was every command."""
    instruments = Instruments(aircraft)
    instruments.take_imu(np.zeros(3))
    instruments.take_attitude(np.array([1.0, 0.0, 0.0, 0.0]))
    for second, airspeed in ((1000.0, 17.0), (1000.02, 17.0), (5.0, 16.0), (5.02, 16.0)):
        instruments.take_air_data(np.array([airspeed, 0.05, 0.0, 1.2, pressure(400.0)]), int(second * 1e9))
        assert instruments.seen.airspeed == pytest.approx(airspeed)
        assert instruments.seen.height == pytest.approx(0.0, abs=1e-6)
    before = instruments.seen
    instruments.take_imu(np.full(3, np.nan))
    instruments.take_attitude(np.full(4, np.nan))
    assert instruments.seen == before


@pytest.mark.long
def test_task_and_excitation_are_what_they_are_said_to_be():
    task = Task(3, 75.0, 17.0)
    pitches = np.array([task.reference(t).pitch for t in np.arange(0.0, 75.0, 0.1)])
    assert set(np.round(pitches, 9)) == set(np.round(PITCHES, 9)) and np.all(pitches[:20] == 0.0)
    waves = np.array([Multisine(0.01).at(k) for k in range(1000)])
    assert np.abs(waves).max(axis=0) == pytest.approx(EXCITATION, rel=0.05)
    correlation = np.corrcoef(waves.T) - np.eye(3)
    assert np.abs(correlation).max() < 1e-9  # over a period no surface moves as another does


def quiet(aircraft):
    """Nearly noiseless sensors."""
    sensors = {n: replace(s, noise=tuple(1e-3 * v for v in s.noise)) for n, s in aircraft.sensors.items()}
    return replace(aircraft, sensors=sensors)


@pytest.mark.long
def test_with_the_truth_it_tracks_also_after_damage(aircraft):
    case = Case("short", "elevator", time=8.0, duration=16.0)
    errors = {
        kind: fly(quiet(aircraft), case, kind, 0, turbulence=0.0, excitation=0.0).tracking_error(8.0)
        for kind in ("truth", "fixed")
    }
    assert np.degrees(errors["truth"]) < 1.5  # the attitude of the autopilot itself is off by some tenths
    assert errors["fixed"] > 2.0 * errors["truth"]


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.long)])
def test_live_parameters_beat_fixed_ones_when_the_elevator_loses_half_of_its_effect(aircraft, seed):
    case = replace(CASES["elevator"], time=20.0, duration=45.0)
    live, fixed = (fly(aircraft, case, kind, seed, turbulence=2.0) for kind in ("live", "fixed"))
    assert np.isnan(live.lost_at) and np.isnan(fixed.lost_at)
    assert live.tracking_error(20.0) < fixed.tracking_error(20.0)
    assert live.tracking_error(30.0) < 0.8 * fixed.tracking_error(30.0)
    assert live.published.out_of_bounds == 0 and live.published.messages > 35
    assert live.published.relearnt < 15.0
    assert truth_of(aircraft, case)(21.0)["Cm_de"] == 0.5 * aircraft.coefficients["Cm_de"]
