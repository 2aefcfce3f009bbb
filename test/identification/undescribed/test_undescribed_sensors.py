"""Vanes that no aircraft file describes: their scale and lag are found, and counted in what is published."""

import numpy as np
import pytest
from aircraft_files import of_shape

from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict
from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX
from aircraft_sysid_ros.identification.coefficients.layout import SIGNALS_OF_SAMPLE, TERMS_OF_SAMPLE, TIME
from aircraft_sysid_ros.identification.parameter_set import ParameterSet
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.identification.undescribed.sensors import UndescribedSensors
from aircraft_sysid_ros.identification.undescribed.vanes import estimate
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.sensors.sensor_models import first_order_lag
from aircraft_sysid_ros.simulation.simulated_flight import SimulatedFlight, default_aircraft, simulate_samples

VANES = (Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP)
TOO_SMALL, LATE = 0.9, 0.08


def poor(samples: Samples) -> Samples:
    values, rng = samples.values.copy(), np.random.default_rng(3)
    for kind in VANES:
        rows = np.flatnonzero(samples.kind == kind)
        rows = rows[np.argsort(samples.stamp[rows], kind="stable")]
        time = (samples.stamp[rows] - samples.stamp[rows[0]]) * 1e-9
        shown = TOO_SMALL * first_order_lag(time, values[rows, :1], LATE)[:, 0]
        values[rows, 0] = shown + np.radians(0.5) * rng.normal(size=len(rows))
    return Samples(samples.stamp, samples.kind, values)


def replayed(aircraft: Aircraft, samples: Samples, block: int = 10_000) -> Pipeline:
    pipeline = Pipeline(aircraft)
    for first in range(0, len(samples), block):
        pipeline.push(samples[first : first + block])
    pipeline.flush()
    return pipeline


@pytest.fixture(scope="module")
def flight() -> SimulatedFlight:
    return simulate_samples(default_aircraft(), 41, 60.0)


def z_of(found: ParameterSet, truth: dict[str, float]) -> dict[str, float]:
    return {p.name: abs(p.value - truth[p.name]) / p.std for p in found.parameters if p.status is Trust.USE}


@pytest.mark.long
def test_late_and_small_vanes_are_found_and_their_parameters_hold_the_truth(flight: SimulatedFlight) -> None:
    samples, truth = poor(flight.samples), dict(flight.coefficients)
    pipeline = replayed(of_shape(flight.aircraft), samples)
    mean, covariance = pipeline.parameters.learning.undescribed.errors()
    assert mean[1, 0] == pytest.approx(TOO_SMALL - 1.0, abs=3.0 * np.sqrt(covariance[1, 0, 0]))
    assert 0.01 < mean[1, 1] < LATE + 3.0 * np.sqrt(covariance[1, 1, 1])  # what the filter leaves of it
    sound = z_of(pipeline.parameters.snapshot(), truth)
    # the same where the file says that the vanes are as they should be: late sideslip is then a term in r
    described = aircraft_from_dict({**flight.aircraft.source, "coefficients": {}} | {"name": "believed"})
    believed = z_of(replayed(described, samples).parameters.snapshot(), truth)
    lateral = ("Cl_beta", "Cn_beta", "Cl_r", "Cn_r")
    assert max(believed[name] for name in lateral if name in believed) > 5.0
    assert len([name for name in lateral if name in sound]) >= 3
    assert max(sound[name] for name in lateral if name in sound) < 3.0


@pytest.mark.long
def test_where_the_imu_sits_is_no_error_of_a_vane() -> None:
    """Ahead of the centre of gravity it feels what q and r change: by x/V, 12 ms here, vanes had seemed early."""
    known = default_aircraft().source
    vanes = {name: {"noise": 0.0015, "rate": 50} for name in ("angle_of_attack", "sideslip")}
    sensors = {**known["sensors"], **vanes}
    ahead = aircraft_from_dict({**known, "imu_position": [0.2, 0.0, 0.0], "sensors": sensors})
    samples = simulate_samples(ahead, 43, 60.0).samples
    mean, covariance = replayed(of_shape(ahead), samples).parameters.learning.undescribed.errors()
    std = np.sqrt(np.einsum("aii->ai", covariance))
    assert np.all(np.abs(mean) < 2.0 * std) and np.all(std[:, 1] < 0.005)


@pytest.mark.long
def test_a_described_vane_is_as_it_says(flight: SimulatedFlight) -> None:
    pipeline = replayed(flight.aircraft, flight.samples)
    assert pipeline.parameters.learning.undescribed.doubt() is None


@pytest.mark.parametrize(("said", "described"), [({"noise": 0.004}, False), ({"noise": 0.004, "delay": 0.0}, True)])
def test_noise_alone_describes_no_sensor(flight: SimulatedFlight, said: dict[str, float], described: bool) -> None:
    sensors = dict.fromkeys(("angle_of_attack", "sideslip", "control_surfaces"), said)
    aircraft = of_shape(flight.aircraft, sensors=sensors)
    assert (UndescribedSensors(aircraft).doubt() is None) == described


@pytest.mark.long
def test_blocks_do_not_matter(flight: SimulatedFlight) -> None:
    samples = poor(flight.samples)
    few = samples[samples.stamp < samples.stamp.min() + 25 * 10**9]
    one, other = (replayed(of_shape(flight.aircraft), few, block).parameters.snapshot() for block in (len(few), 37))
    assert np.array_equal(one.covariance, other.covariance, equal_nan=True)
    assert [repr(p.value) for p in one.parameters] == [repr(p.value) for p in other.parameters]


def test_gusts_that_the_aeroplane_answers_bias_no_scale() -> None:
    """An angle that answers gusts by its opposite: least squares is off by a half, what the surface moves is not."""
    rng, n, step, scale, lag = np.random.default_rng(5), 30_000, 0.04, 1.1, 0.05
    surface = first_order_lag(np.arange(n) * step, rng.normal(size=(n, 1)), 0.4)[:, 0]
    gust = first_order_lag(np.arange(n) * step, rng.normal(size=(n, 1)), 0.4)[:, 0]
    motion = first_order_lag(np.arange(n) * step, (surface - gust)[:, None], 0.3)[:, 0]
    rate = np.gradient(motion, step)
    shown = scale * motion - scale * lag * rate + gust
    later = first_order_lag(np.arange(n) * step, surface[:, None], 0.3)[:, 0]
    much_later = first_order_lag(np.arange(n) * step, surface[:, None], 1.0)[:, 0]
    series = np.stack([shown, motion, rate, surface, later, much_later], axis=1)
    mean, covariance = estimate(series.T @ series, float(n), np.array([3, 4, 5]))
    assert mean == pytest.approx([scale - 1.0, scale * lag], abs=3.0 * np.sqrt(np.diag(covariance)).max())
    assert (
        np.sqrt(covariance[0, 0]) < 0.7 * THRESHOLDS.vane_scale
        and np.sqrt(covariance[1, 1]) < 0.7 * THRESHOLDS.vane_lag
    )
    plain = np.linalg.lstsq(series[:, 1:3], shown, rcond=None)[0]
    assert abs(plain[0] - scale) > 0.2


def test_without_motion_a_vane_is_as_vanes_are_built() -> None:
    mean, covariance = estimate(np.zeros((12, 12)), 0.0, np.array([3, 4, 5]))
    assert np.array_equal(mean, np.zeros(2))
    assert np.sqrt(np.diag(covariance)) == pytest.approx([THRESHOLDS.vane_scale, THRESHOLDS.vane_lag])


@pytest.mark.long
def test_until_the_roll_has_shown_where_a_vane_is_it_may_be_out_on_the_wing() -> None:
    """Live had published 60 % of the lift slope to use in its first 20 s, of a vane 0.4 m out that no file places."""
    known = default_aircraft()
    bare = of_shape(known, places=False)
    samples, pipeline = simulate_samples(known, 31, 70.0, turbulence="moderate").samples, Pipeline(bare)
    early = samples.stamp < samples.stamp.min() + 24 * 10**9
    undescribed = pipeline.parameters.learning.undescribed
    for part, most in ((samples[early], 0.4), (samples[~early], 0.05)):
        for first in range(0, len(part), 500):
            pipeline.push(part[first : first + 500])
            found = {p.name: p for p in pipeline.parameters.snapshot().parameters}["CZ_alpha"]
            apart = abs(found.value - known.coefficients["CZ_alpha"]) / found.std  # 3 to 5.5, had been used
            assert not (found.status is Trust.USE and apart > 2.5)
        doubt = undescribed.doubt()
        assert doubt is not None and doubt.vane_place[1] == pytest.approx(most * bare.span)


@pytest.mark.parametrize(("rate", "most"), [(0.02, THRESHOLDS.vane_aside), (0.5, 0.05)])
def test_a_vane_out_on_the_wing_is_in_doubt_as_long_as_nothing_rolls(rate: float, most: float) -> None:
    """After 30 s of quiet flight the doubt had been dropped, though nothing had shown where the vane is."""
    bare = of_shape(default_aircraft(), places=False)
    undescribed, samples = UndescribedSensors(bare), np.zeros((1550, TERMS_OF_SAMPLE))
    samples[:, TIME], samples[:, SIGNALS_OF_SAMPLE + SIGNAL_INDEX["V"]] = 0.04 * np.arange(1550), 20.0
    samples[:, SIGNALS_OF_SAMPLE + SIGNAL_INDEX["p"]] = rate * bare.span / (2.0 * 20.0)
    before = np.nan
    for part in np.array_split(samples, 70):
        undescribed._roll(part, before)
        before = part[-1, TIME]
    assert undescribed._rolled == pytest.approx(62.0 * rate**2, rel=0.01)
    undescribed._flown = 62.0
    doubt = undescribed.doubt()
    assert doubt is not None and doubt.vane_place[1] == pytest.approx(most * bare.span)
