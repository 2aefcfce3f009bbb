"""A slow IMU and slow controls: the record has times between their samples, and the truth is found all the same."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from slow_flights import all_thinned, fast_flight, file_of_users, thinned

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.refinement.record import record_of
from aircraft_sysid_ros.refinement.refine import RefineOptions, refine
from aircraft_sysid_ros.refinement.refined_file import FILTER_ERROR, OUTPUT_ERROR
from aircraft_sysid_ros.refinement.resampling import LONGEST_STEP
from aircraft_sysid_ros.refinement.segments import segments_of
from aircraft_sysid_ros.samples import Samples

MAIN = ("CZ_alpha", "Cm_alpha", "Cm_q", "Cm_de", "Cl_p", "Cl_da", "Cl_beta", "Cn_beta", "Cn_r", "Cn_dr", "CY_beta")
OPTIONS = RefineOptions(segment=8.0, held_out=2.0)
SEED = 4


@pytest.fixture(scope="module")
def run(make_run):
    return lambda samples: make_run(SimpleNamespace(aircraft=file_of_users(), samples=samples))


@pytest.fixture(scope="module")
def samples() -> Samples:
    """40 s without wind changes, all at 200 Hz."""
    return fast_flight(SEED, 40.0).samples


@pytest.mark.long
@pytest.mark.parametrize(
    ("rate", "lost"),
    [(10.0, 0.1), (33.0, 0.0), *(pytest.param(*s, marks=pytest.mark.long) for s in ((10.0, 0.0), (25.0, 0.1)))],
)
def test_the_grid_is_dense_and_the_imu_stands_at_its_own_times(samples: Samples, rate: float, lost: float) -> None:
    slow = all_thinned(samples, rate, jitter=0.2 if lost else 0.0, lost=lost)
    record = record_of(file_of_users(), slow, 50.0)
    steps = np.diff(record.time)
    assert np.all((steps > 0.0) & ((steps < 1.001 * LONGEST_STEP) | (steps > 3.5 / rate)))
    measured = np.isfinite(record.outputs[:, 0])
    times = record.time[measured]
    assert np.median(np.diff(times)) == pytest.approx(1.0 / rate, rel=0.1)
    nearest = np.abs(slow.stamp[:, None] - record.stamp[measured][None, ::20]).min(axis=0)
    assert np.all(nearest <= 2_000)  # [ns]
    fast = record_of(file_of_users(), thinned(samples, 200.0), 200.0)
    at = (fast.stamp - record.stamp[0]) * 1e-9 + record.time[0]
    for column in (1, 4, 5):  # side force, pitch and yaw rate: those of the fast sensors then, brisk motion included
        as_fast = np.interp(times, at, fast.outputs[:, column])
        assert np.std(record.outputs[measured, column] - as_fast) < 0.03 * np.ptp(as_fast)
        assert np.isfinite(record.outputs[measured, column]).all()
    pieces = [p for p in segments_of(record, 8.0, 2.0) if not p.held_out]
    assert sum(p.part.stop - p.part.start for p in pieces) * record.step > 0.6 * 40.0


@pytest.mark.long
@pytest.mark.parametrize(
    ("method", "slow", "largest"),
    [
        pytest.param(OUTPUT_ERROR, lambda s: thinned(s, 10.0), 0.02, marks=pytest.mark.long),
        (OUTPUT_ERROR, lambda s: all_thinned(s, 10.0, jitter=0.2, lost=0.1), 0.15),
        pytest.param(FILTER_ERROR, lambda s: thinned(s, 10.0, jitter=0.2, lost=0.1), 0.04, marks=pytest.mark.long),
    ],
    ids=["output error", "output error, all slow, jitter and lost samples", "filter error, jitter and lost samples"],
)
def test_the_truth_is_within_the_standard_errors_at_ten_hertz(run, samples: Samples, method, slow, largest) -> None:
    content = refine(run(slow(samples)), method, OPTIONS).content
    truth, found = file_of_users().coefficients, {p["name"]: p for p in content["parameters"]}
    z = {name: (p["value"] - truth[name]) / p["std"] for name, p in found.items() if p["std"]}
    assert content["converged"]
    assert max(abs(z[name]) for name in MAIN) < 3.5, z
    assert np.mean(np.abs(list(z.values())) < 2.0) > 0.75, z
    assert max(abs(found[name]["value"] / truth[name] - 1.0) for name in MAIN) < largest


@pytest.mark.long
def test_slow_controls_widen_the_standard_errors(run, samples: Samples) -> None:
    """By a share of each coefficient that goes with the square of the interval: 2.5 % at 10 Hz."""
    options = RefineOptions(segment=8.0, held_out=2.0, maximum_iterations=0)
    content = refine(run(thinned(samples, 100.0, controls=10.0)), OUTPUT_ERROR, options).content
    least = [p["std"] / abs(p["value"]) for p in content["parameters"] if p["std"]]
    assert min(least) >= 0.025
    fast = refine(run(thinned(samples, 100.0)), OUTPUT_ERROR, options).content
    assert min(p["std"] / abs(p["value"]) for p in fast["parameters"] if p["std"]) < 0.01


@pytest.mark.long_after_the_first
@pytest.mark.parametrize(
    ("rate", "controls", "words"),
    [
        (5.0, 50.0, "the IMU comes at 5 Hz: derivatives need at least 10 Hz"),
        (100.0, 3.0, "the controls come at 3 Hz: at least 10 Hz are needed"),
    ],
)
def test_what_is_too_slow_is_the_reason(run, samples: Samples, rate: float, controls: float, words: str) -> None:
    with pytest.raises(InputError) as error:
        refine(run(thinned(samples, rate, controls=controls)), OUTPUT_ERROR, OPTIONS)
    assert str(error.value) == f"the run cannot be refined: {words}"
