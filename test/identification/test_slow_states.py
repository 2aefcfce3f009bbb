"""Flights with a slow IMU, end to end: the truth is within the standard errors, or a sentence says why nothing is."""

from __future__ import annotations

import numpy as np
import pytest
from slow_flights import all_thinned, fast_flight, file_of_users, thinned

from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.identification.parameter_set import ParameterSet
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.samples import Kind, Samples, concatenate

MAIN = ("CZ_alpha", "Cm_alpha", "Cm_q", "Cm_de", "CY_beta", "Cl_beta", "Cl_p", "Cl_da", "Cn_beta", "Cn_r", "Cn_dr")
SEED = 7


def flown(samples: Samples, estimator: str = "rls", block: int = 1000) -> Pipeline:
    pipeline = Pipeline(file_of_users(), None, ParameterOptions(estimator=estimator))
    for at in range(0, len(samples), block):
        pipeline.push(samples[at : at + block])
    pipeline.flush()
    return pipeline


def errors(found: ParameterSet) -> tuple[np.ndarray, dict[str, float]]:
    """Errors over standard errors of the parameters with USE, and the relative errors of MAIN, which all have it."""
    truth = fast_flight(SEED).coefficients or file_of_users().coefficients
    used = {p.name: p for p in found.parameters if p.status == Trust.USE}
    assert set(MAIN) <= set(used), {p.name: p.reason for p in found.parameters if p.name in MAIN}
    z = np.array([(p.value - truth[name]) / p.std for name, p in used.items()])
    return z, {name: abs(used[name].value / truth[name] - 1.0) for name in MAIN}


CASES = {
    "10 Hz": (lambda s: thinned(s, 10.0), 0.05),
    "10 Hz, all": (lambda s: all_thinned(s, 10.0), 0.10),
    "10 Hz, all, jitter and lost samples": (lambda s: all_thinned(s, 10.0, 0.2, 0.1), 0.15),
    "12.5 Hz, jitter and lost samples": (lambda s: thinned(s, 12.5, jitter=0.2, lost=0.1), 0.05),
    "20 Hz": (lambda s: thinned(s, 20.0), 0.03),
    "25 Hz": (lambda s: thinned(s, 25.0), 0.02),
    "25 Hz, all, jitter and lost samples": (lambda s: all_thinned(s, 25.0, 0.2, 0.1), 0.03),
}


@pytest.mark.long
@pytest.mark.parametrize(
    "case", [c if i % 3 == 2 else pytest.param(c, marks=pytest.mark.long) for i, c in enumerate(CASES)]
)
def test_the_truth_is_within_the_standard_errors(case: str) -> None:
    """All within 3.5, nine in ten within 1.96, and the main derivatives within a stated share of the truth."""
    slow, largest = CASES[case]
    z, relative = errors(flown(slow(fast_flight(SEED).samples)).parameters.snapshot())
    assert np.mean(np.abs(z) < 1.96) >= 0.9, np.round(z, 1)
    assert np.abs(z).max() < 3.5, np.round(z, 1)
    assert max(relative.values()) < largest, relative


@pytest.mark.long
@pytest.mark.parametrize(
    ("estimator", "largest"), [("fourier", 0.06), pytest.param("rml", 0.06, marks=pytest.mark.long)]
)
def test_other_estimators_at_ten_hertz(estimator: str, largest: float) -> None:
    z, relative = errors(flown(thinned(fast_flight(SEED).samples, 10.0), estimator).parameters.snapshot())
    assert np.mean(np.abs(z) < 1.96) >= 0.85 and np.mean(np.abs(z) < 3.5) >= 0.95, np.round(z, 1)
    assert max(relative.values()) < largest, relative


@pytest.mark.long
@pytest.mark.parametrize("estimator", ["rls", *(pytest.param(e, marks=pytest.mark.long) for e in ("fourier", "rml"))])
def test_blocks_of_any_size_give_the_same_bits_at_ten_hertz(estimator: str) -> None:
    samples = all_thinned(fast_flight(SEED).samples, 10.0, jitter=0.2, lost=0.1)
    samples = samples[: 2 * len(samples) // 3] if estimator == "rml" else samples[: len(samples) // 3]
    first, *others = (flown(samples, estimator, block).parameters for block in (1, 41, 10**6))
    expected = first.estimates()
    assert np.isfinite([p.value for p in expected.parameters]).sum() > 20
    for other in others:
        found = other.estimates()
        assert repr(found.parameters) == repr(expected.parameters)
        np.testing.assert_array_equal(found.covariance, expected.covariance)


@pytest.mark.long
def test_another_rate_in_flight_is_followed() -> None:
    """100 Hz, 10 Hz, 100 Hz by thirds: as good as the slowest of them, in blocks of any size."""
    samples = fast_flight(SEED).samples
    edges = np.quantile(samples.stamp, [1 / 3, 2 / 3])
    slow, fast = all_thinned(samples, 10.0), thinned(samples, 100.0)
    middle = (slow.stamp >= edges[0]) & (slow.stamp < edges[1])
    mixed = concatenate([fast[fast.stamp < edges[0]], slow[middle], fast[fast.stamp >= edges[1]]])
    pipeline = flown(mixed)
    assert pipeline.state.realignments == 0
    z, relative = errors(pipeline.parameters.snapshot())
    assert np.mean(np.abs(z) < 1.96) >= 0.9 and np.abs(z).max() < 3.5, np.round(z, 1)
    assert max(relative.values()) < 0.05, relative
    in_small_blocks = flown(mixed, block=97).parameters.estimates()
    assert repr(in_small_blocks.parameters) == repr(pipeline.parameters.estimates().parameters)


@pytest.mark.parametrize("estimator", ["rls", "fourier", "rml"])
def test_at_five_hertz_the_reason_is_the_rate(estimator: str) -> None:
    samples = fast_flight(SEED).samples
    found = flown(thinned(samples[: len(samples) // 2], 5.0), estimator).parameters.snapshot()
    words = "the IMU comes at 5 Hz: derivatives need at least 10 Hz"
    assert {(p.status, p.reason) for p in found.parameters} == {(Trust.HOLD, words)}


@pytest.mark.long
def test_what_was_learnt_stays_when_the_imu_becomes_too_slow() -> None:
    samples = fast_flight(SEED).samples
    half = samples.stamp[len(samples) // 2]
    fast, slow = thinned(samples, 100.0), thinned(samples, 5.0)
    pipeline = flown(concatenate([fast[fast.stamp < half], slow[slow.stamp >= half]]))
    found = pipeline.parameters.snapshot()
    assert all(p.age > 40.0 for p in found.parameters if p.status == Trust.USE)
    z, _ = errors(found)
    assert np.mean(np.abs(z) < 1.96) >= 0.85 and np.abs(z).max() < 3.5, np.round(z, 1)


@pytest.mark.parametrize(("rate", "controls"), [(100.0, 3.0), (10.0, 5.0)])
def test_controls_that_are_too_slow_are_named(rate: float, controls: float) -> None:
    samples = fast_flight(SEED).samples
    found = flown(thinned(samples[: len(samples) // 2], rate, controls=controls)).parameters.snapshot()
    reasons = {p.name: p.reason for p in found.parameters}
    assert reasons["Cm_q"] == f"needs de, which comes at {controls:g} Hz: at least 10 Hz are needed"
    assert reasons["Cl_p"] == f"needs da and dr, which come at {controls:g} Hz: at least 10 Hz are needed"


def test_of_slow_controls_nothing_wrong_is_said_before_their_rate_is_known() -> None:
    """A rate counts after 24 intervals: that the surfaces are not measured was the reason for so long."""
    samples = thinned(fast_flight(SEED).samples, 100.0, controls=1.0)
    said = []
    for seconds in (6.0, 8.0, 10.0, 14.0, 20.0):
        begun = samples[samples.stamp < samples.stamp[0] + round(1e9 * seconds)]
        said.append({p.name: p.reason for p in flown(begun).parameters.snapshot().parameters}["Cl_p"])
    assert not any("not measured" in reason for reason in said), said
    assert said[-2:] == ["needs da and dr, which come at 1 Hz: at least 10 Hz are needed"] * 2


def test_no_motion_is_still_said_of_a_slow_flight_without_motion() -> None:
    """Level flight at 10 Hz: the rate is not to blame."""
    samples = all_thinned(fast_flight(SEED).samples, 10.0)
    still = samples[samples.stamp < samples.stamp[0] + int(4e9)]
    assert np.any(still.kind == Kind.IMU)
    found = flown(still).parameters.snapshot()
    assert {p.reason for p in found.parameters} == {"not enough motion yet"}
