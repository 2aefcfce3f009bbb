"""The methods that the diagnosis is compared with, on columns whose answer is known and on one flight."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

import hidden_effects
import other_methods
from other_methods import METHODS, Pool, credits_of, in_order, orthogonal, ranked, stepwise

from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.effects.aliases import ALIASES, aliases_of
from aircraft_sysid_ros.simulation.simulated_flight import hidden_flight

N, K = 400, 30


def pool_of(rng, signal, owners=None, spread=3.0, k=K):
    """Candidates of white noise, unit rms, and a measurement that ``signal`` makes of them and of unit noise."""
    z = rng.standard_normal((N, k)) @ (np.eye(k) + 0.1 * rng.standard_normal((k, k)))
    z /= np.sqrt(np.mean(z**2, axis=0))
    y = signal(z) + rng.standard_normal(N)
    base = SimpleNamespace(basis=np.ones((N, 1)) / np.sqrt(N), axis="Cn")
    owners = owners or [frozenset()] * k
    return Pool(base, tuple(map(str, range(k))), tuple(owners), z, z, y, spread, np.arange(N) // 50 % 4)


@pytest.mark.long
def test_stepwise_regression_selects_nothing_of_white_noise_in_95_of_100_cases():
    """Bonferroni: at most 5 %, and not much less for 30 candidates; three sigma of 300 draws are 3.8 %."""
    rng = np.random.default_rng(1)
    hits = np.mean([bool(stepwise(pool_of(rng, lambda z: 0.0))) for _ in range(300)])
    assert 0.01 < hits < 0.09


@pytest.mark.long
def test_stepwise_regression_selects_what_is_there_and_drops_what_it_replaces():
    """A sum of two columns enters first and goes when both have entered; by chance it stays, rarely."""
    right = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        pool = pool_of(rng, lambda z: 2.0 * z[:, 3] + 2.0 * z[:, 5])
        pool.z[:, 7] = pool.z[:, 3] + pool.z[:, 5] + 0.5 * rng.standard_normal(N)
        assert in_order(pool)[0][0] == 7
        right += sorted(stepwise(pool)) == [3, 5]
    assert right >= 17


def test_orthogonal_functions_are_ordered_as_refits_say():
    pool = pool_of(np.random.default_rng(3), lambda z: z[:, :4] @ np.array([1.0, 0.7, -0.5, 0.3]))
    order, errors = in_order(pool)
    for count in range(5):
        others = [j for j in range(K) if j not in order[:count]]
        fits = [np.linalg.lstsq(pool.z[:, order[:count] + [j]], pool.y)[1][0] for j in others]
        assert errors[count + 1] == pytest.approx(min(fits), rel=1e-9)
    falls = np.log(errors[:-1] / errors[1:])
    np.testing.assert_allclose(credits_of(pool, order), falls, rtol=1e-6)


@pytest.mark.parametrize("size", [0.8, 1.2])
def test_the_predicted_square_error_asks_of_a_term_the_variance_of_the_measurement(size):
    """A term enters when it lowers the sum of squares by sigma_max^2, not by that of the residual."""
    rng = np.random.default_rng(4)
    spread = 6.0
    pool = pool_of(rng, lambda z: 0.0, spread=spread)
    pool.z[:, 2] -= pool.z[:, 2] @ pool.y / (pool.y @ pool.y) * pool.y
    pool.z[:, 2] /= np.sqrt(np.mean(pool.z[:, 2] ** 2))
    pool.y[:] = pool.y + size * spread / np.sqrt(N) * pool.z[:, 2]
    assert orthogonal(pool)[:1] == ([2] if size > 1.0 else [])


@pytest.mark.parametrize("name", ["stlsq", "lasso"])
def test_sparse_methods_find_two_strong_terms(name):
    pytest.importorskip("pysindy" if name == "stlsq" else "sklearn")
    found = METHODS[name](pool_of(np.random.default_rng(5), lambda z: 2.0 * z[:, 4] - 1.5 * z[:, 9]))
    assert found[:2] == [4, 9]


def test_a_term_of_two_effects_goes_to_the_one_that_it_explains_whole():
    """alpha da in C_n alone is adverse yaw; control power of the ailerons has a part in C_l."""
    owners = [frozenset()] * K
    owners[6] = frozenset({("adverse_yaw", "with lift"), ("control_effectiveness_alpha", "aileron")})
    pool = pool_of(np.random.default_rng(6), lambda z: z[:, 6], owners)
    assert ranked({"Cn": pool}, {"Cn": [6]}) == ["adverse_yaw", "control_effectiveness_alpha"]


def test_a_large_effect_is_named_by_all_methods_but_one():
    pytest.importorskip("pysindy")
    flight = hidden_flight("textbook", "dihedral_alpha", seed=1001, duration=60.0)
    bench = hidden_effects._bench(flight.aircraft, flight)
    said = other_methods.answers(bench)
    assert list(said) == list(METHODS)
    for name, answer in said.items():
        assert answer["verdict"] == "missing", name
        if name != "stlsq":  # which keeps the largest of columns that are alike, whatever they are
            assert "dihedral_alpha" in answer["effects"], name
    for name in ("orthogonal", "orthogonal_r2"):  # which select few terms: those that also predict
        assert said[name]["effects"][0] == "dihedral_alpha"
        assert said[name]["errors"]["Cl"] < 0.95 * bench.fits["Cl"].nrmse_held_out


def test_alias_sets_are_of_effects_and_are_counted_beside_the_strict_rate():
    for ids, why in ALIASES:
        assert ids <= BY_ID.keys() and len(ids) > 1 and why.endswith(".")
    assert aliases_of("stuck_control") == {"control_damage"} and not aliases_of("icing")
    flights = [
        {"effect": "stuck_control", "verdict": "missing", "axis": "Cl", "floor": {"Cl": 0.1},
         "candidates": [{"effect": name, "confounded_with": []}],
         "errors": {key: {"Cl": 0.2} for key in ("base", "diagnosed", "oracle")}}
        for name in ("stuck_control", "control_damage", "control_damage", "stall")
    ]  # fmt: skip
    found = hidden_effects.rates(flights)
    assert (found["right_first"], found["right_or_alias"]) == (0.25, 0.75)
    for flight, name in zip(flights, ("control_damage", "stall", None, None), strict=True):
        verdict = "missing" if name else "unexplained"
        flight["without"] = {"verdict": verdict, "effect": name, "axis": "Cl"}
    found = hidden_effects.without(flights)
    assert (found["alias"], found["wrong_name"], found["unexplained_right_axis"]) == (0.25, 0.25, 0.5)
