"""Rules by which a sensor is said to be wrong: in its own wind, in both halves, and not where the file says nothing."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.diagnosis.flight import reconstruction
from aircraft_sysid_ros.diagnosis.flight.reconstruction import Likelihood, fit_wind_noise, reconstruct_as_flown
from aircraft_sysid_ros.diagnosis.flight_diagnosis import _accuses, _left_out_first, level_of
from aircraft_sysid_ros.diagnosis.measurement import faults, late_controls, other_judge
from aircraft_sysid_ros.diagnosis.measurement.faults import jobs_of, likelier_first, sharpened, try_setting
from aircraft_sysid_ros.diagnosis.measurement.setting import AIR_DATA_LAG, Setting, in_file, is_a_fault, is_small
from aircraft_sysid_ros.diagnosis.words import MeasurementFinding
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.effects.effect import Effect, with_setting
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.reconstruction.state import LearntNoise
from aircraft_sysid_ros.samples import Kind, Samples, concatenate, samples_of
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

#: Of a filter that nobody runs.
NOISE = LearntNoise(np.ones((1, 3)), np.ones((7, 6)), np.ones(1))


def likelihood(value: float, walk: float = 0.2) -> Likelihood:
    return Likelihood(np.array([value]), np.ones(1), walk, NOISE)


def put_law(monkeypatch, module, law) -> None:
    """In place of the filter: of aircraft and samples a likelihood, whatever noise it is told."""
    monkeypatch.setattr(module, "log_likelihood", lambda aircraft, samples, noise=None: law(aircraft, samples))
    monkeypatch.setattr(module, "likelihood_as_learnt", law)


def setting_of(effect: Effect, value: float, which: int = 0) -> Setting:
    return Setting(effect, effect.variants[which], 0.0, value, 100.0, 5.0, 0.001)


def imu_at(rate: float) -> Samples:
    stamps = (np.arange(100) / rate * 1e9).astype(np.int64)
    return samples_of(Kind.IMU, stamps, *np.zeros((6, 100)))


@pytest.fixture(scope="module")
def calm_flight(aircraft):
    """A flight in calm air, and its file."""
    return aircraft, simulate_samples(aircraft, 31, 60.0, hidden=[("alpha_offset", 1.0)])


@pytest.mark.long
def test_a_vane_that_is_mounted_wrong_is_told_from_one_that_bends(calm_flight):
    aircraft, flown = calm_flight
    ((_, offset),) = flown.hidden[0].settings
    flight, calm = reconstruct_as_flown(aircraft, flown.samples, with_covariance=False)
    found = {
        name: try_setting(job)
        for name in ("alpha_offset", "alpha_drift")
        for job in jobs_of(flight, [BY_ID[name]], calm)
    }
    assert found["alpha_offset"].evidence > max(1.0, found["alpha_drift"].evidence)
    assert found["alpha_offset"].value == pytest.approx(offset, abs=0.005)


def test_with_its_offset_in_the_file_a_vane_is_a_sound_one(aircraft):
    """The first step sees the same angles, whatever offset is put on them and taken off again."""
    samples = simulate_samples(aircraft, 5, 20.0).samples
    values = samples.values.copy()
    values[samples.kind == Kind.ANGLE_OF_ATTACK, 0] += 0.03
    knowing = with_setting(aircraft, ("sensors", "angle_of_attack", "offset"), 0.03)
    sound = reconstruction.reconstruct(aircraft, samples, with_covariance=False).rows
    same = reconstruction.reconstruct(knowing, replace(samples, values=values), with_covariance=False).rows
    np.testing.assert_allclose(same, sound, rtol=1e-6, atol=1e-6)


def test_an_offset_is_one_of_angles_and_has_limits(aircraft):
    for name, value in (("airspeed", 0.1), ("angle_of_attack", 0.5), ("gyro", 0.1)):
        with pytest.raises(InputError, match="offset"):
            with_setting(aircraft, ("sensors", name, "offset"), value)


def test_gusts_beyond_the_largest_walk_are_no_calm_air(aircraft, monkeypatch):
    put_law(monkeypatch, reconstruction, lambda aircraft, samples: likelihood(0.0, walk=50.0))
    flown, calm = fit_wind_noise(aircraft, None)
    assert not calm and flown.process_noise["wind"] == reconstruction.LARGEST_WALK


def test_a_place_that_the_file_does_not_state_is_no_fault(aircraft):
    without = {k: v for k, v in aircraft.source.items() if k != "imu_position"}
    stated = aircraft_from_dict({**without, "imu_position": [0.0, 0.0, 0.0]})
    found = setting_of(BY_ID["imu_offset"], 0.1)
    assert is_a_fault(found, stated, imu_at(100.0))
    assert not is_a_fault(found, aircraft_from_dict(without), imu_at(100.0))


@pytest.mark.parametrize(("airspeed", "fault"), [(20.0, True), (80.0, False)])
def test_a_probe_ahead_by_what_averaging_delays_is_no_fault(aircraft, airspeed, fault):
    """That is 20 ms here: 0.4 m at 20 m/s, 1.6 m at 80 m/s. The place of the IMU is no matter of time."""
    way = 0.8 / aircraft.span
    flown = concatenate(
        [imu_at(100.0), samples_of(Kind.AIRSPEED, np.arange(0, 10**10, 10**7), np.full(1000, airspeed))]
    )
    assert is_a_fault(setting_of(BY_ID["probe_offset"], way), aircraft, flown) is fault
    assert is_a_fault(setting_of(BY_ID["imu_offset"], way), aircraft, flown)


@pytest.mark.parametrize(("rate", "delay", "fault"), [(10, 0.05, False), (10, 0.08, True), (100, 0.05, True)])
def test_half_a_sample_late_is_no_fault(aircraft, rate, delay, fault):
    assert is_a_fault(setting_of(BY_ID["imu_lag"], delay), aircraft, imu_at(rate)) is fault


@pytest.mark.parametrize(("rows", "fault"), [(1, True), (5, False)])
def test_a_record_that_is_held_in_the_rows_of_a_faster_one_is_half_of_its_own_interval_late(aircraft, rows, fault):
    """Surfaces at 10 Hz that were filled forward to 50 Hz had been "recorded late" on a clean flight."""
    moved = 0.1 * np.sin(np.arange(1000) // rows * rows / 50.0)
    moved[400:700] = moved[400]  # a surface may stand still
    samples = samples_of(Kind.CONTROLS, np.arange(1000) * 20_000_000, moved, *np.zeros((6, 1000)))
    assert is_a_fault(setting_of(BY_ID["late_controls"], 0.05), aircraft, samples) is fault
    assert is_a_fault(setting_of(BY_ID["late_controls"], 0.08), aircraft, samples)
    assert is_a_fault(setting_of(BY_ID["actuator_lag"], -0.05), aircraft, samples)


def test_thrust_that_is_new_in_every_row_does_not_hide_that_surfaces_are_held(aircraft):
    moved, thrust = 0.1 * np.sin(np.arange(1000) // 5 * 5 / 50.0), 3.0 + np.sin(np.arange(1000) / 50.0)
    columns = [moved, *np.zeros((4, 1000)), thrust, np.zeros(1000)]
    samples = samples_of(Kind.CONTROLS, np.arange(1000) * 20_000_000, *columns)
    assert not is_a_fault(setting_of(BY_ID["late_controls"], 0.05), aircraft, samples)


@pytest.mark.parametrize(("rows", "fault"), [(1, True), (5, False)])
def test_vanes_that_are_held_are_as_late_as_surfaces_are(aircraft, rows, fault):
    angle = 0.1 * np.sin(np.arange(1000) // rows * rows / 50.0)
    stamp = np.arange(1000) * 20_000_000
    airspeed = samples_of(Kind.AIRSPEED, stamp, 20.0 + np.sin(stamp / 2e9))
    samples = concatenate([airspeed, samples_of(Kind.ANGLE_OF_ATTACK, stamp, angle)])
    assert is_a_fault(setting_of(BY_ID["air_data_lag"], 0.05), aircraft, samples) is fault


def test_commands_in_steps_are_not_held(aircraft):
    steps = 0.1 * np.sign(np.sin(np.arange(2000) / 30.0))
    samples = samples_of(Kind.CONTROLS, np.arange(2000) * 20_000_000, steps, *np.zeros((6, 2000)))
    assert is_a_fault(setting_of(BY_ID["late_controls"], 0.05), aircraft, samples)


@pytest.mark.parametrize(
    ("name", "after", "fault"),
    [
        ("air_data_lag", 0.95, False),
        ("air_data_lag", 0.8, True),
        ("air_data_lag", 1.2, False),  # much is left: gusts go together with a late angle, too
        ("actuator_lag", 0.95, False),
        ("alpha_scale", 1.0, True),
        ("gps_lag", 1.0, True),
    ],
)
def test_a_delay_is_a_fault_where_it_lowers_an_error(aircraft, name, after, fault):
    """In calm air too; a scale makes derivatives wrong that fit as well, and motion over ground needs no model."""
    errors = {"CY": (1.0, 1.0), "Cm": (0.5, 0.5 * after) if after <= 1.0 else (1.0, 0.8)}
    finding = MeasurementFinding(setting_of(BY_ID[name], 0.2), 0.001, (), errors)
    assert _accuses(finding, aircraft, imu_at(100.0)) == fault


@pytest.mark.parametrize(("calm", "after", "level"), [(True, 1.0, 0.01), (False, 0.8, 0.01), (False, 0.95, 0.001)])
def test_in_gusts_a_scale_that_lowers_no_error_must_be_surer(calm, after, level):
    """The aeroplane turns into gusts: a vane looks as if it showed too little, and no replica has that."""
    finding = MeasurementFinding(setting_of(BY_ID["alpha_scale"], 0.88), 0.005, (), {"CZ": (1.0, after)})
    assert level_of(finding, calm) == level


@pytest.mark.parametrize(("gains", "kept"), [((40.0, 40.0), True), ((80.0, -1.0), True), ((90.0, -10.0), False)])
def test_no_half_of_a_flight_may_speak_against_a_setting(aircraft, monkeypatch, gains, kept):
    halves = iter([gains[0], 0.0, gains[1], 0.0])
    put_law(monkeypatch, faults, lambda aircraft, samples: likelihood(next(halves)))
    assert faults._in_both_halves(aircraft, aircraft, imu_at(100.0), NOISE) is kept


def test_a_late_gps_and_a_late_imu_are_flown_as_they_are_hidden(aircraft):
    for name, sensor in (("gps_lag", "gps_velocity"), ("imu_lag", "gyro")):
        flown = simulate_samples(aircraft, 6, 20.0, hidden=[(name, 1.0)])
        ((_, lag),) = flown.hidden[0].settings
        assert flown.hidden[0].sensors_of(aircraft).sensors[sensor].delay == pytest.approx(lag)


@pytest.mark.long
def test_a_gps_that_is_late_is_found_in_gusts(aircraft):
    flown = simulate_samples(aircraft, 7, 40.0, hidden=[("gps_lag", 1.0)], turbulence="light")
    ((_, lag),) = flown.hidden[0].settings
    flight, calm = reconstruct_as_flown(aircraft, flown.samples, with_covariance=False)
    (job,) = jobs_of(flight, [BY_ID["gps_lag"]], calm)
    found = try_setting(job)
    assert found.of_motion and found.evidence > 1.0
    assert found.value - found.nominal == pytest.approx(lag - aircraft.sensors["gps_velocity"].delay, abs=0.05)


@pytest.mark.long
@pytest.mark.parametrize(("other_way", "is_said"), [(-1.0, True), (0.2, True), (0.9, False)])
def test_a_delay_of_the_controls_gains_more_than_one_the_other_way(calm_flight, monkeypatch, other_way, is_said):
    """A surface that follows the gyros is their derivative when it is shifted, whichever way."""
    aircraft, flown = calm_flight
    flight = reconstruction.reconstruct(aircraft, flown.samples, with_covariance=False)
    start = aircraft.sensors["control_surfaces"].delay

    def errors(flight, changed):
        moved = (changed.sensors["control_surfaces"].delay - start) / -0.06
        gain = (1.0 if moved > 0.0 else other_way) * (1.0 - (abs(moved) - 1.0) ** 2)
        return {"Cl": (0.4 * float(np.exp(-0.25 * gain)),) * 2}

    for module in (faults, late_controls):
        monkeypatch.setattr(module, "control_errors", errors)
    job, _ = jobs_of(flight, [BY_ID["actuator_lag"]], True)
    assert (try_setting(job).evidence > 1.0) is is_said


def test_a_delay_of_the_controls_is_looked_for_beyond_one_that_gains_a_little(calm_flight, monkeypatch):
    """Controls 0.15 s late in calm air: 0.047 s gained 0.8, 0.15 s 16, and 0.1 s between them was worse than none."""
    aircraft, flown = calm_flight
    flight = reconstruction.reconstruct(aircraft, flown.samples, with_covariance=False)
    start = aircraft.sensors["control_surfaces"].delay

    def errors(flight, changed):
        late = changed.sensors["control_surfaces"].delay - start
        near, far = (np.exp(-(((late - place) / 0.02) ** 2)) for place in (0.047, 0.15))
        gain = 0.8 * near + 16.0 * far - 30.0 * abs(late) * (late < 0.0) - 0.1 * (abs(late) > 0.07)
        return {"Cl": (0.4 * float(np.exp(-0.5 * gain)),) * 2}

    for module in (faults, late_controls):
        monkeypatch.setattr(module, "control_errors", errors)
    (job,) = jobs_of(flight, [BY_ID["late_controls"]], True)
    assert try_setting(job).value == pytest.approx(start + 0.15, abs=0.005)


@pytest.mark.parametrize(("unexplained", "is_said"), [(0.4, True), (0.9, False)])
def test_a_delay_of_the_controls_is_told_by_moments_that_the_model_explains(
    calm_flight, monkeypatch, unexplained, is_said
):
    """Thrust that nobody recorded, in flights of an autopilot: shifted surfaces went together with a part of it."""
    aircraft, flown = calm_flight
    flight = reconstruction.reconstruct(aircraft, flown.samples, with_covariance=False)
    start = aircraft.sensors["control_surfaces"].delay

    def errors(flight, changed):
        moved = (changed.sensors["control_surfaces"].delay - start) / -0.06
        gain = 1.0 - (abs(moved) - 1.0) ** 2 if moved > 0.0 else -1.0
        return {"Cl": (unexplained * float(np.exp(-0.25 * gain)),) * 2, "Cn": (0.3, 0.3)}

    for module in (faults, late_controls):
        monkeypatch.setattr(module, "control_errors", errors)
    job, _ = jobs_of(flight, [BY_ID["actuator_lag"]], True)
    assert (try_setting(job).evidence > 1.0) is is_said


@pytest.mark.parametrize(("key", "value", "small"), [("airspeed", 1.04, False), ("sideslip", 0.96, True)])
def test_a_scale_counts_by_what_it_makes_of_coefficients(calm_flight, key, value, small):
    """That of the airspeed with its square."""
    flight = SimpleNamespace(points=np.zeros((0, 1)))
    assert is_small(("sensors", key, "scale"), value, flight) is small


def test_what_the_file_leaves_out_goes_before_a_fault_that_is_little_better(aircraft):
    without = aircraft_from_dict({k: v for k, v in aircraft.source.items() if k != "air_data_position"})
    fault = replace(setting_of(BY_ID["alpha_scale"], 0.8), nominal=1.0, evidence=2.4, gain=48.0)
    likelier = (1.1, 60.0, "probe_offset")  # in gusts a place needs more to be believed at all
    for evidence, gain, first in ((1.8, 36.0, "probe_offset"), (1.1, 22.0, "alpha_scale"), likelier):
        place = replace(setting_of(BY_ID["probe_offset"], 0.3), evidence=evidence, gain=gain)
        assert _left_out_first([fault, place], without, imu_at(100.0))[0].effect.identifier == first


@pytest.mark.parametrize(("gain", "first"), [(239.0, "air_data_lag"), (390.0, "probe_offset")])
def test_of_a_probe_ahead_and_late_air_data_the_likelier_goes_first(aircraft, gain, first):
    """A stranger's vane was 20 ms late, which needs twice the gain; its place, which the file states, made a scale.

    A place that the file leaves out goes before: a vane is somewhere, and may be late as well.
    """
    late = replace(setting_of(BY_ID["air_data_lag"], 0.025), evidence=9.4, gain=376.0)
    place = replace(setting_of(BY_ID["probe_offset"], 0.14), evidence=12.0, gain=gain)
    other = replace(setting_of(BY_ID["beta_scale"], 0.8), evidence=10.0, gain=200.0)
    ordered = likelier_first([place, other, late])
    assert [each.effect.identifier for each in ordered][1] == "beta_scale" and ordered[0].effect.identifier == first
    without = aircraft_from_dict({k: v for k, v in aircraft.source.items() if k != "air_data_position"})
    assert _left_out_first(ordered, aircraft, imu_at(100.0))[0].effect.identifier == first
    assert _left_out_first(ordered, without, imu_at(100.0))[0].effect.identifier == "probe_offset"


def test_a_scale_that_a_filter_with_the_errors_as_states_denies_is_none(aircraft, monkeypatch):
    flight = SimpleNamespace(aircraft=aircraft, samples=imu_at(100.0))
    found = {"lambda_alpha": {"value": 0.03, "std": 0.01}, "b_alpha": {"value": 0.0, "std": 0.01}}
    monkeypatch.setattr(other_judge, "air_data_errors", lambda *_: found)
    for scale, agrees in ((1.14, False), (0.96, True), (0.9, False)):
        setting = replace(setting_of(BY_ID["alpha_scale"], scale), nominal=1.0)
        assert other_judge.is_found_by_states(setting, flight) is agrees, scale
    assert other_judge.is_found_by_states(setting_of(BY_ID["probe_offset"], 0.3), flight)
    found["lambda_alpha"]["std"] = 0.15  # of 0.2 before the flight: no witness
    assert other_judge.is_found_by_states(replace(setting_of(BY_ID["alpha_scale"], 1.14), nominal=1.0), flight)
    found.clear()  # a flight in pieces
    assert other_judge.is_found_by_states(replace(setting_of(BY_ID["alpha_scale"], 1.14), nominal=1.0), flight)


def test_calmer_air_is_looked_for_below_what_the_filter_found(aircraft, monkeypatch):
    """The filter has gone below its file: half of the file's walk is gustier than that, and less likely."""
    silent = aircraft_from_dict({k: v for k, v in aircraft.source.items() if k != "process_noise"})

    def likelier_in_still_air(changed, _):
        walk = 0.04 if changed is silent else changed.process_noise["wind"]
        return likelihood(-5e4 * walk**1.5, walk=0.04)

    put_law(monkeypatch, reconstruction, likelier_in_still_air)
    flown, calm = fit_wind_noise(silent, None)
    assert calm and silent.process_noise["wind"] == 0.2
    assert flown.process_noise["wind"] == pytest.approx(0.0025)


def valley(aircraft, place=0.15, lag=0.2):
    """A likelihood in which a probe ahead and a lag stand for each other, along a line that bends at the truth."""

    def likelihood_of(changed, _):
        x = changed.air_data_position[0] / changed.span - aircraft.air_data_position[0] / aircraft.span - place
        d = changed.sensors["airspeed"].delay - lag
        return likelihood(-4e4 * (d + 0.3 * x) ** 2 * 10.0 - 4e3 * (d - 0.3 * x) ** 2)

    return likelihood_of


def test_the_place_of_a_probe_is_looked_for_along_the_valley_of_its_lag(aircraft, monkeypatch):
    """With the lag that alone is best, no other place is better; with the lag moved along, the true one is."""
    of = valley(aircraft)
    put_law(monkeypatch, faults, of)
    monkeypatch.setattr(faults, "_in_both_halves", lambda *_: True)
    effect, late = BY_ID["probe_offset"], with_setting(aircraft, AIR_DATA_LAG, 0.245)
    flight = SimpleNamespace(aircraft=late)
    job = (flight, imu_at(100.0), effect, effect.variants[0], effect.inner[0], of(late, None), {}, True)
    found = try_setting(job)
    assert found.evidence > 1.0 and found.value == pytest.approx(0.15, abs=0.02)
    assert dict(found.beside)[AIR_DATA_LAG] == pytest.approx(0.2, abs=0.01)
    assert in_file(found, late).sensors["sideslip"].delay == dict(found.beside)[AIR_DATA_LAG]


def test_what_was_mended_is_worked_out_again_beside_what_was_mended_later(aircraft, monkeypatch):
    put_law(monkeypatch, faults, valley(aircraft, place=0.0))
    monkeypatch.setattr(faults, "stretch_of", lambda flight: flight.samples)
    lag, place = BY_ID["air_data_lag"], BY_ID["probe_offset"]
    flight = SimpleNamespace(aircraft=with_setting(aircraft, AIR_DATA_LAG, 0.21), samples=None)
    again = sharpened(Setting(lag, lag.variants[0], 0.0, 0.21, 100.0, 5.0, 0.01), flight)
    assert again.value == pytest.approx(0.2, abs=1e-3)
    late = with_setting(aircraft, AIR_DATA_LAG, 0.2)
    ahead = SimpleNamespace(aircraft=with_setting(late, ("air_data_position", "x"), 0.1), samples=None)
    moved = sharpened(Setting(place, place.variants[0], 0.0, 0.1, 100.0, 5.0, 0.01), ahead)
    assert moved.value == pytest.approx(0.0375)  # no further than half a step of the search from where it was found
