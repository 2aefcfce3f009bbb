"""A surface that stands still in a flight that moves: its term is the constant's, and nothing may break on it."""

import warnings

import numpy as np
import pytest

from aircraft_sysid_ros.identification.parameter_set import _inflation, told_apart
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


def correlation_of(columns: list[np.ndarray]) -> np.ndarray:
    terms = np.stack(columns)
    scale = np.sqrt(np.sum(terms**2, axis=1))
    return terms @ terms.T / np.outer(scale, scale)


def test_a_term_in_closed_loop_is_told_with_what_it_follows_and_the_input_that_tells_them_apart() -> None:
    random = np.random.default_rng(5)
    beta, p, r, alpha = random.normal(size=(4, 3000))
    da = -0.4 * p + 0.05 * random.normal(size=3000)  # a roll damper
    names = ["Cl_0", "Cl_beta", "Cl_p", "Cl_r", "Cl_da"]
    found = correlation_of([np.ones(3000), beta, p, r, da])
    assert told_apart("Cl", names, found, 2) == "; it follows da: move the aileron by itself"
    assert told_apart("Cl", names, found, 4) == "; it follows p: move the aileron by itself"
    assert told_apart("Cl", names, found, 1) == "" == told_apart("Cl", names, found, 0)
    coordinated = correlation_of([beta, p, da, 0.5 * da + 0.02 * random.normal(size=3000)])
    names = ["Cn_beta", "Cn_p", "Cn_da", "Cn_dr"]
    assert told_apart("Cn", names, coordinated, 3) == "; it follows da: move the rudder by itself"
    assert (
        told_apart("Cl", ["Cl_p", "Cl_da"], correlation_of([p, -0.4 * p]), 0)
        == "; it follows da: move the aileron by itself"
    )
    narrow = 0.1 + 0.003 * alpha
    found = correlation_of([np.ones(3000), narrow, narrow**2])
    for j in (1, 2):
        said = told_apart("CX", ["CX_0", "CX_alpha", "CX_alpha2"], found, j)
        assert said.startswith("; it follows ") and said.endswith(": fly it over a wider range")


@pytest.mark.long
@pytest.mark.parametrize(
    ("surface", "begin"),
    [("elevator", 0.0), pytest.param("aileron", 20.0, marks=pytest.mark.long), ("rudder", 20.0)],
)
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
