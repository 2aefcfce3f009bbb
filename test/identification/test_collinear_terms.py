"""A surface that stands still in a flight that moves: its term is the constant's, and nothing may break on it."""

import warnings

import numpy as np
import pytest

from aircraft_sysid_ros.identification.parameter_set import _inflation
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

SURFACES = {"elevator": 0, "aileron": 1, "rudder": 2}


def test_inflation_of_terms_that_are_alone_and_of_some_that_are_not() -> None:
    assert _inflation(np.eye(3)) == pytest.approx(np.ones(3), rel=1e-9)
    r = 0.8
    assert _inflation(np.array([[1.0, r], [r, 1.0]])) == pytest.approx(1.0 / (1.0 - r * r), rel=1e-9)


@pytest.mark.parametrize("size", [2, 4, 6])
def test_collinear_terms_are_inflated_beyond_use_and_the_rest_is_not(size) -> None:
    for seed in range(20):
        x = np.random.default_rng(seed).normal(size=(400, size))
        x[:, 0] = -x[:, 1]
        moments = x.T @ x
        scale = np.sqrt(np.diag(moments))
        found = _inflation(moments / np.outer(scale, scale))
        assert np.all(found[:2] > 1e10)
        assert found[2:] == pytest.approx(np.ones(size - 2), abs=0.2)


@pytest.mark.parametrize(("surface", "begin"), [("elevator", 0.0), ("aileron", 20.0), ("rudder", 20.0)])
def test_a_surface_that_is_never_recorded_to_move(surface, begin) -> None:
    """All looks at what is known go through, without a warning, and its effect is not to be used as new."""
    aircraft = default_aircraft()
    samples = simulate_samples(aircraft, 4, 60.0, turbulence="light").samples
    values = samples.values.copy()
    still = (samples.kind == Kind.CONTROLS) & (samples.stamp >= samples.stamp[0] + int(begin * 1e9))
    values[still, SURFACES[surface]] = values[np.argmax(still), SURFACES[surface]]
    pipeline = Pipeline(aircraft)
    frozen = Samples(samples.stamp, samples.kind, values)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for low in range(0, len(frozen), 200):
            pipeline.push(frozen[low : low + 200])
            found = pipeline.parameters.snapshot().parameters
            assert all(np.isfinite([p.value, p.std]).all() for p in found if p.status == Trust.USE)
        pipeline.flush()
    if begin == 0.0:
        by_name = {p.name: p for p in pipeline.parameters.snapshot().parameters}
        assert by_name["Cm_de"].status != Trust.USE
