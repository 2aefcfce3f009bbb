"""One bad minute does not reach a controller: held soon, back to what was known, used again when it is over."""

from __future__ import annotations

import re

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.history import ParameterCheckpoint, SampleHistory
from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.identification.monitoring.agreement import BLOCK, NEWEST, SplitHalfAgreement, solved
from aircraft_sysid_ros.identification.monitoring.integrity import IntegrityMonitor
from aircraft_sysid_ros.identification.monitoring.sensor_faults import SensorFaultDetector
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.trust import Evidence, Trust, disagree, judge
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.state import (
    D_ACCELEROMETER_BIAS,
    SUSPECTED,
    StateField,
    Status,
)
from aircraft_sysid_ros.reconstruction.state_row import _suspected
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.sensors.sensor_models import EPOCH
from aircraft_sysid_ros.simulation.dynamics import Effect
from aircraft_sysid_ros.simulation.sensor_faults import stuck_surface, with_fault
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

CM, NAMES_OF_CM = 4, ("Cm_0", "Cm_alpha", "Cm_q", "Cm_de")
ONLY_CM = np.arange(6) == CM
BEGIN, END, DURATION = 60.0, 85.0, 135.0  # [s] of the bad time

# -- bounds of the aircraft file ------------------------------------------------------------------------------------


def evidence(value: float, std: float = 0.05, bounds=(-8.0, -2.0)) -> Evidence:
    return Evidence("CZ_alpha", value, std, 100.0, 0.01, 10_000, "", bounds)


@pytest.mark.parametrize(
    ("value", "std", "status"),
    [(-4.0, 0.05, Trust.USE), (-1.5, 0.05, Trust.REJECT), (-1.95, 0.05, Trust.HOLD), (-8.05, 0.05, Trust.HOLD),
     (-9.0, 0.05, Trust.REJECT), (-1.0, 5.0, Trust.HOLD)],
)  # fmt: skip
def test_nothing_outside_the_bounds_of_the_file_is_used(value, std, status):
    verdict = judge(evidence(value, std))
    assert verdict.status == status
    assert ("bounds of the aircraft file (-8 to -2)" in verdict.reason) == (status != Trust.USE)


def test_bounds_that_leave_nothing_are_refused(aircraft):
    bounded = aircraft_from_dict({**aircraft.source, "parameter_bounds": {"CZ_alpha": [2, 8]}})
    with pytest.raises(InputError, match="parameter_bounds CZ_alpha must overlap what aeroplanes have, -15 to 0"):
        Identifier(bounded)


# -- two estimators -------------------------------------------------------------------------------------------------


def motion(rng, count, theta, noise=0.02, elevator=0.1) -> np.ndarray:
    """Points of C_m that theta (4,) explains, all terms in motion."""
    points = np.zeros((count, CoefficientSample.TERMS + 32))
    points[:, CoefficientSample.TIME] = 0.04 * np.arange(count)
    x = np.column_stack([np.ones(count), rng.standard_normal((count, 3)) * [0.1, 0.02, elevator]])
    points[:, CoefficientSample.TERMS + 22 : CoefficientSample.TERMS + 26] = x
    points[:, CoefficientSample.MEASURED.start + CM] = x @ theta + noise * rng.standard_normal(count)
    points[:, CoefficientSample.LEARNT] = 1.0
    return points


def std_of(points: np.ndarray, noise=0.02) -> np.ndarray:
    x = points[:, CoefficientSample.TERMS + 22 : CoefficientSample.TERMS + 26]
    return noise * np.sqrt(np.diag(np.linalg.inv(x.T @ x)))


def test_the_model_has_cm_where_the_tests_put_it(aircraft):
    assert aircraft.model.axis_slice("Cm") == slice(22, 26)


def test_halves_of_the_same_flight_agree_in_two_hundred_draws(aircraft):
    rng, theta = np.random.default_rng(1), np.array([0.02, -0.7, -7.0, -0.85])
    for _ in range(200):
        halves, points = (
            SplitHalfAgreement(aircraft.model, 1.0),
            motion(rng, (NEWEST + THRESHOLDS.disagree_blocks + 1) * BLOCK, theta),
        )
        for part in np.split(points, len(points) // 25):
            halves.add(ONLY_CM, part)
        assert halves.disagreeing(CM, std_of(points), np.zeros(4)) == {}


def test_what_changed_in_the_newest_motion_is_named_and_constants_are_not(aircraft):
    rng, theta = np.random.default_rng(2), np.array([0.02, -0.7, -7.0, -0.85])
    changed = theta * [5.0, 1.0, 1.0, 0.5]
    points = [motion(rng, 8 * BLOCK, theta), motion(rng, NEWEST * BLOCK, changed)]
    halves = SplitHalfAgreement(aircraft.model, 1.0)
    for part in np.split(np.vstack(points), len(np.vstack(points)) // 25):
        halves.add(ONLY_CM, part)
    found = halves.disagreeing(CM, std_of(np.vstack(points)), np.zeros(4))
    assert list(found) == [3]
    assert found[3] == pytest.approx((0.5 * theta[3], theta[3]), rel=0.1)
    halves.forget(CM)
    assert halves.disagreeing(CM, std_of(points[0]), np.zeros(4)) == {}


def test_little_motion_says_nothing(aircraft):
    """In the newest part the elevator hardly moves: its error is large there, whatever the value."""
    rng, theta = np.random.default_rng(3), np.array([0.02, -0.7, -7.0, -0.85])
    points, newest = motion(rng, 8 * BLOCK, theta), motion(rng, NEWEST * BLOCK, theta, elevator=1e-4)
    halves = SplitHalfAgreement(aircraft.model, 1.0)
    for part in np.split(np.vstack([points, newest]), 11 * BLOCK // 25):
        halves.add(ONLY_CM, part)
    assert halves.disagreeing(CM, std_of(points), np.zeros(4)) == {}


def test_collinear_terms_have_no_solution():
    x = np.column_stack([np.ones(100), np.ones(100), np.arange(100.0), np.ones(100)])
    assert solved(x.T @ x) is None
    assert solved(np.zeros((4, 4))) is None


def test_estimates_disagree_where_the_difference_is_sure_and_matters():
    a, b = np.array([1.0, 1.0, 1.0, 1.0, np.nan]), np.array([2.0, 2.0, 1.1, 2.0, 2.0])
    std = np.array([0.1, 0.2, 0.001, 0.1, 0.1])
    effect = np.array([1.0, 1.0, 1.0, 0.01, 1.0])
    assert disagree(a, b, std, std, effect).tolist() == [True, False, False, False, False]


# -- signs of the first step ----------------------------------------------------------------------------------------


def level(count: int, begin: float = 0.0, rate: float = 100.0) -> np.ndarray:
    """Rows of a first step that is at peace with its sensors."""
    rows = np.zeros((count, StateField.WIDTH))
    rows[:, StateField.TIME] = begin + np.arange(count) / rate
    rows[:, StateField.AIRSPEED], rows[:, StateField.STATUS], rows[:, StateField.CONSISTENCY] = 17.0, Status.OK, 1.0
    rows[:, StateField.FUSED] = 170.0 * rows[:, StateField.TIME]
    rows[:, StateField.STANDARD_DEVIATIONS] = 0.01
    return rows


def looks(aircraft, rows: np.ndarray) -> list[list[str]]:
    signs, found = SensorFaultDetector(aircraft), []
    for part in np.split(rows, np.arange(20, len(rows), 20)):
        signs.add(part)
        found.append([sign.words for sign in signs.evaluate()])
    return found


def test_a_quiet_first_step_has_no_signs_nor_has_an_aeroplane_on_the_ground(aircraft):
    rows = level(2000)
    assert not any(looks(aircraft, rows))
    rows[1000:, StateField.STATUS], rows[1000:, StateField.AIRSPEED] = Status.NO_AIR_DATA, 0.5
    rows[1000:, [StateField.ANGLE_OF_ATTACK, StateField.SIDESLIP]] = np.nan
    assert not any(looks(aircraft, rows))


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        (StateField.STATUS, Status.NO_GPS, "no GPS"),
        (StateField.STATUS, Status.NO_AIR_DATA, "no airspeed"),
        (StateField.ANGLE_OF_ATTACK, np.nan, "no angle of attack"),
        (StateField.SIDESLIP, np.nan, "no sideslip"),
        (StateField.CONSISTENCY, 2.5, "sensors contradict each other"),
        (StateField.ACCELEROMETER_BIAS.start, 0.5, "an IMU bias leaps"),
        (StateField.GYRO_BIAS.start + 1, 0.31, "an IMU bias leaps"),
    ],
)
def test_signs_of_trouble(aircraft, column, value, words):
    rows = level(2000)
    rows[1000:1100, column] = value
    found = looks(aircraft, rows)
    assert not any(found[:50]) and not any(found[75:])
    assert [words] in found[50:56]


@pytest.mark.parametrize(("doubt", "leaps"), [(0.01, True), (0.1, False)])
def test_a_bias_that_is_doubted_more_than_before_may_move_as_far(aircraft, doubt, leaps):
    """An attitude that is believed less widens the standard deviation of the bias, which then leaves what it was."""
    rows, column = level(2000), StateField.ACCELEROMETER_BIAS.start + 1
    rows[1000:, column] = 0.3
    rows[1000:, StateField.STANDARD_DEVIATIONS.start + D_ACCELEROMETER_BIAS + 1] = doubt
    assert (["an IMU bias leaps"] in looks(aircraft, rows)) is leaps


def test_measurements_that_are_rejected_in_bulk_are_a_sign_and_single_ones_are_not(aircraft):
    rows = level(2000)
    rows[500:, StateField.REJECTED] += 3.0
    assert not any(looks(aircraft, rows))
    rows[1000:, StateField.REJECTED] += 50.0 * (rows[1000:, StateField.TIME] - 10.0)
    assert ["measurements are rejected"] in looks(aircraft, rows)[50:60]


def test_the_sensor_whose_innovations_are_too_large_is_named(aircraft):
    rows = level(2000)
    rows[1000:1100, StateField.CONSISTENCY] = 2.5
    rows[1020:1080, StateField.CONTRADICTION] = next(code for code, name in SUSPECTED.items() if name == "GPS")
    assert ["sensors contradict each other: innovations of the GPS are too large"] in looks(aircraft, rows)[50:56]


@pytest.mark.long
@pytest.mark.parametrize(
    ("large", "named"),
    [
        ({Kind.GPS_VELOCITY: 9.0, Kind.GPS_POSITION: 4.0}, "GPS"),
        ({Kind.SIDESLIP: 9.0, Kind.AIRSPEED: 2.0}, "sideslip"),
        ({Kind.ATTITUDE: 9.0, Kind.ANGLE_OF_ATTACK: 8.0}, "IMU or several sensors"), ({Kind.AIRSPEED: 2.9}, None),
    ],
)  # fmt: skip
def test_one_sensor_alone_is_suspected_and_of_several_what_predicts_them(large, named):
    nis = np.ones(len(Kind))
    for kind, value in large.items():
        nis[kind] = value
    assert SUSPECTED.get(int(_suspected(nis))) == named


def test_a_bias_that_is_still_being_found_is_no_leap(aircraft):
    """200 biases that come from their prior to their value as their standard deviations say."""
    rng = np.random.default_rng(4)
    for _ in range(200):
        rows = level(1000)
        std = 0.2 / np.sqrt(1.0 + 3.0 * rows[:, StateField.TIME])
        steps = np.sqrt(np.maximum(-np.diff(std**2, prepend=std[0] ** 2), 0.0))
        rows[:, StateField.ACCELEROMETER_BIAS.start] = np.cumsum(steps * rng.standard_normal(len(rows)))
        rows[:, StateField.STANDARD_DEVIATIONS.start + D_ACCELEROMETER_BIAS] = std
        assert not any(looks(aircraft, rows))


def test_a_state_that_begins_anew_is_a_sign(aircraft):
    rows = np.vstack([level(500), level(500, begin=10.0)])
    found = looks(aircraft, rows)
    assert found[25] == ["state reconstruction had to start over"]
    assert not any(found[:25] + found[26:])


@pytest.mark.parametrize(("seconds", "axes_back"), [(1.5, 0), (5.0, 6)])
def test_a_short_contradiction_is_held_and_forgotten_and_a_long_one_goes_back(aircraft, seconds, axes_back):
    integrity, back = IntegrityMonitor(aircraft, 0.04, 0.08, 0.999, False, SampleHistory(60, 250)), []
    rows = level(3000)
    rows[1000 : 1000 + int(100 * seconds), StateField.CONSISTENCY] = 2.5
    for part in np.split(rows, np.arange(20, len(rows), 20)):
        now = float(part[-1, StateField.TIME])
        integrity.sensors.add(part)
        back += integrity.evaluate(now, np.zeros(6, np.bool_))
        held = bool(integrity.summary()["held"])
        assert held == (10.6 < now < 10.0 + seconds + 5.0) or abs(now - 10.5) < 0.4 or abs(now - seconds - 15.0) < 0.4
        if integrity.checkpoints.is_due(now):
            integrity.checkpoints.keep(ParameterCheckpoint(now, None, None, None, None, None))
    assert integrity.count == 6
    assert len(back) == axes_back and all(good.time < 10.0 for _, good in back)


# -- flights --------------------------------------------------------------------------------------------------------

SENSORS = ("airspeed_blocked", "alpha_stuck", "gps_lost", "gps_spoofed", "imu_bias_jump")
#: Faults that no other test here flies.
ALONE = ("gps_spoofed", "imu_bias_jump")
MAIN = ("CZ_alpha", "Cm_alpha", "Cm_q", "Cm_de", "Cl_p", "Cl_da", "Cn_beta", "Cn_r", "Cn_dr", "CY_beta")


@pytest.fixture(scope="module")
def bounded(aircraft):
    """The aeroplane with bounds that are half as far from the truth as from zero."""
    bounds = {n: sorted((0.5 * aircraft.coefficients[n], 1.5 * aircraft.coefficients[n])) for n in MAIN}
    return aircraft_from_dict({**aircraft.source, "parameter_bounds": bounds})


@pytest.fixture(scope="module")
def sound(bounded):
    return simulate_samples(bounded, 3, DURATION)


class Flown:
    """A flight through the chain and what was published on the way, by time of flight [s]."""

    def __init__(self, aircraft, samples, block: int = 400, **options) -> None:
        self.pipeline = Pipeline(aircraft, None, ParameterOptions(**options))
        self.sets = []
        for at in range(0, len(samples), block):
            self.pipeline.push(samples[at : at + block])
            time = (samples.stamp[min(at + block, len(samples)) - 1] - EPOCH) * 1e-9
            self.sets.append((time, {p.name: p for p in self.pipeline.parameters.snapshot().parameters}))
        self.pipeline.flush()

    @property
    def parameters(self) -> Identifier:
        return self.pipeline.parameters

    def used(self, begin: float, end: float, names=MAIN) -> list[list[str]]:
        """Names with USE at every time between two."""
        chosen = [found for time, found in self.sets if begin < time <= end]
        return [[n for n in names if found[n].status == Trust.USE] for found in chosen]


def bits(parameters: Identifier) -> np.ndarray:
    return np.array([(p.value, p.std, p.status, p.age) for p in parameters.snapshot().parameters])


def check_never_wild(flown: Flown, truth: dict[str, float], begin: float) -> None:
    """What is published of what had been known stays near the truth, whatever its status; USE is in its bounds."""
    known = {n for n in flown.used(begin - 3.0, begin)[-1]}
    bounds = flown.parameters.aircraft.parameter_bounds
    assert len(known) >= 8
    for time, found in flown.sets:
        for name in known if time > begin else ():
            p = found[name]
            assert not abs(p.value / truth[name] - 1.0) > 0.25, (time, p)
            assert np.isfinite(p.value) or p.status == Trust.HOLD  # NaN says that it is not known
        for name in MAIN:
            low, high = bounds[name]
            assert found[name].status != Trust.USE or low <= found[name].value <= high


@pytest.mark.long
@pytest.mark.parametrize("fault", [f if f in ALONE else pytest.param(f, marks=pytest.mark.long) for f in SENSORS])
def test_a_sensor_that_fails_is_held_soon_and_used_again_when_it_is_well(bounded, sound, fault):
    flown = Flown(bounded, with_fault(sound.samples, fault, BEGIN, END))
    check_never_wild(flown, bounded.coefficients, BEGIN)
    assert not any(flown.used(BEGIN + 4.0, END - 1.0)) or fault == "imu_bias_jump"  # which the filter finds in 20 s
    assert not any(flown.used(BEGIN + 4.0, BEGIN + 10.0))
    before, after = flown.used(BEGIN - 3.0, BEGIN)[-1], flown.used(END + 40.0, DURATION)
    assert all(set(before) <= set(used) for used in after)
    for p in flown.parameters.snapshot().parameters:
        if p.name in before:
            assert p.value == pytest.approx(bounded.coefficients[p.name], rel=0.08)


@pytest.mark.long
def test_reason_and_age_say_what_happened(bounded, sound):
    flown = Flown(bounded, with_fault(sound.samples, "gps_lost", BEGIN, END))
    found = {time: p["Cm_alpha"] for time, p in flown.sets}
    (early, late) = (min(t for t in found if t > at) for at in (70.0, 80.0))
    said = re.match(r"no GPS since ([\d.]+) s: the values are those from before it", found[early].reason)
    first_state = flown.parameters.stream.start_time + 1e-9 * (flown.pipeline.state.epoch - EPOCH)
    assert float(said[1]) == pytest.approx(BEGIN - first_state, abs=0.5)  # learning goes back to seconds before that
    assert found[late].age - found[early].age == pytest.approx(late - early, abs=0.3)
    assert (found[early].value, found[early].std) == (found[late].value, found[late].std)


@pytest.mark.long
def test_a_sound_flight_is_the_same_to_the_last_bit_with_the_gates(bounded, sound):
    flown = Flown(bounded, sound.samples)
    snapshot, estimates = flown.parameters.snapshot(), flown.parameters.estimates()
    assert not flown.parameters.learning.integrity.count
    assert snapshot.parameters == estimates.parameters
    assert np.array_equal(snapshot.covariance, estimates.covariance)
    assert sum(p.status == Trust.USE for p in snapshot.parameters) > 25


@pytest.mark.long
def test_a_fault_is_the_same_in_blocks_of_any_size(bounded, sound):
    samples = with_fault(sound.samples, "alpha_stuck", BEGIN, END)
    samples = samples[: np.searchsorted(samples.stamp, EPOCH + 110_000_000_000)]
    one, other = (Flown(bounded, samples, block).parameters for block in (97, 10**6))
    assert one.learning.integrity.count == other.learning.integrity.count == 6
    assert np.array_equal(bits(one), bits(other), equal_nan=True)
    assert [p.reason for p in one.snapshot().parameters] == [p.reason for p in other.snapshot().parameters]


@pytest.mark.long  # what is known to each of them: test_fourier_recalls_what_it_remembered
def test_another_learner_goes_back_too(bounded, sound):
    flown = Flown(bounded, with_fault(sound.samples, "alpha_stuck", BEGIN, END), estimator="fourier")
    check_never_wild(flown, bounded.coefficients, BEGIN)
    assert not any(flown.used(BEGIN + 4.0, END - 1.0))
    assert len(flown.used(END + 40.0, DURATION)[-1]) >= 8


@pytest.mark.long
def test_a_rudder_that_sticks_keeps_the_values_from_before_until_it_moves(bounded):
    effects = stuck_surface(bounded.coefficients, "dr", 0.0, BEGIN, END)
    flown = Flown(bounded, simulate_samples(bounded, 3, DURATION, effects=effects).samples)
    rudder = ("CY_dr", "Cn_dr")
    assert not any(flown.used(BEGIN + 10.0, END, rudder))
    found = next(p["Cn_dr"] for time, p in flown.sets if time > END - 5.0)
    assert found.reason.startswith("the rudder is stuck or lost since 5")
    assert found.value == pytest.approx(bounded.coefficients["Cn_dr"], rel=0.1)
    assert all("Cn_dr" in used for used in flown.used(END + 40.0, DURATION))
    assert all("Cm_de" in used for used in flown.used(BEGIN - 5.0, DURATION))  # what it does not touch


@pytest.mark.long
def test_a_record_that_stands_still_is_no_change_of_the_aeroplane(bounded, sound):
    """The elevator goes on moving: nothing of it is in the recording."""
    flown = Flown(bounded, with_fault(sound.samples, "elevator_record", BEGIN, END))
    elevator = ("Cm_de", "Cm_alpha", "Cm_q", "CZ_alpha")
    assert not any(flown.used(BEGIN + 6.0, END, elevator))
    found = next(p["Cm_de"] for time, p in flown.sets if time > END - 5.0)
    assert found.reason.startswith("the record of the elevator stands still since 5")
    after = [p for time, p in flown.sets if time > END + 15.0]
    for name in ("Cm_de", "Cm_alpha", "Cm_q"):
        assert all(p[name].value == pytest.approx(bounded.coefficients[name], rel=0.1) for p in after)
        assert all(p[name].status == Trust.USE for p in after)
    assert all("Cl_da" in used for used in flown.used(BEGIN - 5.0, DURATION))  # what it does not touch


@pytest.mark.long
def test_a_record_that_shows_half_is_named_and_not_believed(bounded, sound):
    """To the pitch axis alone it is an elevator of twice the effect, which no aeroplane has."""
    values, stamps = sound.samples.values.copy(), sound.samples.stamp
    wrong = (stamps >= EPOCH + BEGIN * 1e9) & (stamps < EPOCH + END * 1e9) & (sound.samples.kind == Kind.CONTROLS)
    values[wrong, 0] *= 0.5
    flown = Flown(bounded, Samples(stamps, sound.samples.kind, values))
    path = [(time, p["Cm_de"]) for time, p in flown.sets if time > BEGIN + 2.0]
    truth = bounded.coefficients["Cm_de"]
    assert all(p.value == pytest.approx(truth, rel=0.15) for _, p in path if p.status == Trust.USE)
    found = next(p for time, p in path if time > BEGIN + 10.0)
    assert found.status == Trust.HOLD and found.value == pytest.approx(truth, rel=0.05)
    assert found.reason.startswith("the record of the elevator needs the factor 2, or the aeroplane has changed")
    assert found.reason.endswith("the values are those from before it")
    assert all({"Cm_de", "Cm_alpha", "Cm_q"} <= set(used) for used in flown.used(END + 20.0, DURATION))
    assert all("Cl_da" in used for used in flown.used(BEGIN - 5.0, DURATION))  # what it does not touch


@pytest.mark.long
def test_an_airspeed_that_stands_still_in_gusts_is_held(bounded):
    """Wind explains it: only that it repeats itself to the last bit tells."""
    flight = simulate_samples(bounded, 3, DURATION, turbulence="light")
    flown = Flown(bounded, with_fault(flight.samples, "airspeed_blocked", BEGIN, DURATION))
    assert not any(flown.used(BEGIN + 6.0, DURATION))
    found = flown.sets[-1][1]["Cm_alpha"]
    assert found.reason.startswith("no airspeed since ")
    assert found.value == pytest.approx(bounded.coefficients["Cm_alpha"], rel=0.15)


@pytest.mark.long  # a change of the same kind: test_relearning.py
def test_an_aeroplane_that_changes_is_learnt_anew_and_used_again(bounded):
    text = f"max(sign(time-{BEGIN}),0)*de"
    effects = tuple(Effect(axis, text, -0.4 * bounded.coefficients[f"{axis}_de"]) for axis in ("Cm", "CZ"))
    flown = Flown(bounded, simulate_samples(bounded, 3, DURATION, effects=effects).samples)
    path = [(time, p["Cm_de"]) for time, p in flown.sets if time > BEGIN + 2.0]
    truth = 0.6 * bounded.coefficients["Cm_de"]
    assert all(p.value == pytest.approx(truth, rel=0.2) for _, p in path if p.status == Trust.USE)
    assert all(p.status == Trust.USE for time, p in path if time > BEGIN + 20.0)
    assert path[-1][1].reason.startswith("changed: -0.8")
    assert all("Cl_da" in used for used in flown.used(BEGIN, DURATION))


@pytest.mark.long
def test_a_hold_survives_a_clock_that_begins_anew_and_a_reset_ends_it(bounded, sound):
    samples = with_fault(sound.samples, "gps_lost", BEGIN, END)
    flown = Flown(bounded, samples[: np.searchsorted(samples.stamp, EPOCH + 70_000_000_000)])
    flown.parameters.flush()
    before = {p.name: p.value for p in flown.parameters.snapshot().parameters}
    flown.parameters.restart_clock()
    after = flown.parameters.snapshot().parameters
    assert {p.name: p.value for p in after} == before
    assert not any(p.status == Trust.USE for p in after)
    flown.parameters.reset()
    assert not flown.parameters.learning.integrity.summary()["held"]


@pytest.mark.long
def test_what_is_published_grows_old_while_nothing_can_be_learnt(bounded, sound):
    samples = sound.samples[: np.searchsorted(sound.samples.stamp, EPOCH + 70_000_000_000)]
    flown = Flown(bounded, samples)
    before = flown.parameters.snapshot()
    rows = np.tile(flown.pipeline.state.last_row, (300, 1))
    rows[:, StateField.TIME] += 0.01 * np.arange(1, 301)
    rows[:, StateField.CONSISTENCY] = 10.0
    for row in rows:
        flown.parameters.push_states(row[None], flown.pipeline.state.epoch)
    after = flown.parameters.snapshot()
    assert before.time + 2.0 < after.time <= rows[-1, StateField.TIME]
    assert not any(p.status == Trust.USE for p in after.parameters)
    for old, new in zip(before.parameters, after.parameters, strict=True):
        assert new.age == pytest.approx(old.age + after.time - before.time, abs=5.0)
        assert new.value == pytest.approx(old.value, abs=3.0 * old.std)


# -- learners remember ----------------------------------------------------------------------------------------------


@pytest.mark.long
def test_fourier_recalls_what_it_remembered(bounded, sound):
    pipeline = Pipeline(bounded, None, ParameterOptions(estimator="fourier"))
    first, then, last = (np.searchsorted(sound.samples.stamp, EPOCH + s * 10**9) for s in (40, 50, 80))
    pipeline.push(sound.samples[:first])
    learner = pipeline.parameters.learning.estimator
    memory, known, predicts = learner.checkpoint(), learner.estimate(CM), learner.known()
    pipeline.push(sound.samples[first:then])
    assert not np.allclose(learner.estimate(CM).theta, known.theta, rtol=1e-6)
    learner.restore(memory)
    theta = learner.known()
    assert learner.estimate(CM).theta == pytest.approx(known.theta, rel=1e-9)
    assert learner.estimate(CM).covariance == pytest.approx(known.covariance, rel=1e-6)
    assert theta == pytest.approx(predicts, rel=1e-9)
    pipeline.push(sound.samples[then:last])
    assert learner.estimate(CM).theta == pytest.approx(
        [bounded.coefficients[n] for n in NAMES_OF_CM], rel=0.05, abs=2e-3
    )


def test_maximum_likelihood_recalls_what_it_remembered(bounded):
    learner = Identifier(bounded, ParameterOptions(estimator="rml")).learning.estimator
    learner.recursion.theta[:5] = 0.3
    memory = learner.checkpoint()
    learner.recursion.theta[:5], learner.recursion.root[:] = 0.5, 0.1
    learner._waiting.add(CM)
    learner.restore(memory)
    assert learner.known()[:5] == pytest.approx(0.3)
    assert np.array_equal(learner.recursion.root, memory[0].root)
    assert not learner.needs_reseed(CM)
    learner.recursion.theta[:5] = 0.7  # and again: the memory is not what the learner goes on with
    learner.restore(memory)
    assert learner.known()[:5] == pytest.approx(0.3)
