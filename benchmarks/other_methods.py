"""The work of ``diagnose`` by the methods that one would use instead, on the same reconstructed flight.

Each method gets, axis by axis, what the model does not explain, and the terms of the library as regressors: the same
terms from which ``diagnose`` starts, inner numbers on a grid. Terms of the model stay in, unpunished: everything is
done on what they leave of measurement and regressors (Frisch, Waugh and Lovell). A method answers with the terms that
it selects at its usual threshold. An effect ranks by what its selected terms explain one after another, in ln of the
squared error; the verdict is "missing" when anything at all is selected, since none of the methods has another word.

- stepwise: regression with a partial F test at 5 % over the number of candidates, forward, then backward at each step.
- orthogonal: multivariate orthogonal functions in the order of what each explains, as many as make the predicted square
  error J/N + sigma_max^2 p/N least, sigma_max^2 the variance of the measured coefficient (Morelli, AIAA 95-3554; Klein
  and Morelli, Aircraft System Identification, 5.4).
- orthogonal_r2: the same order, for as long as each adds 0.5 % to R^2 (ibid.).
- stlsq: sequentially thresholded least squares of pysindy with its own threshold 0.1 and ridge 0.05, in which
  regressors and residual have unit rms (Brunton, Proctor and Kutz, PNAS 113, 2016).
- lasso: the weight that predicts held-out blocks of time best, scikit-learn; effects in the order of the path.
"""

from __future__ import annotations

import contextlib
import time
import warnings
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.stats import f as fisher

from aircraft_sysid_ros.aircraft.expression import parse_expression
from aircraft_sysid_ros.diagnosis.search.candidates import candidates_of
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator
from aircraft_sysid_ros.diagnosis.search.fit import AxisFit
from aircraft_sysid_ros.effects import LIBRARY
from aircraft_sysid_ros.effects.effect import MEASUREMENT
from aircraft_sysid_ros.errors import InputError

Array = npt.NDArray[np.float64]
#: Id of an effect, and name of its variant.
Owner = tuple[str, str]

LEVEL = 0.05
LEAST_R2 = 0.005
THRESHOLD, RIDGE = 0.1, 0.05
#: Values of an inner number, at most.
GRID = 9
#: Weights of the path of the LASSO.
WEIGHTS = 40
#: Terms that a forward search selects in one axis, at most.
MOST_TERMS = 30
#: What the model leaves of a regressor, as a share of its sum of squares, below which it is no candidate.
NEW = 1e-6
#: Share of the points at which a regressor must have a value.
PRESENT = 0.9


@dataclass(frozen=True)
class Pool:
    """Candidates of one axis: what the model leaves of them, z (N, k), and of the measurement, y (N,), of unit rms."""

    base: AxisFit
    texts: tuple[str, ...]
    owners: tuple[frozenset[Owner], ...]
    columns: Array  # (n, k) as they are, all points of the flight
    z: Array
    y: Array
    spread: float  # standard deviation of the measured coefficient, in the unit of y
    fold: npt.NDArray[np.int64]  # (N,)

    @property
    def points(self) -> int:
        """N."""
        return len(self.y)

    @property
    def terms_of_model(self) -> int:
        """Terms that are in already."""
        return self.base.basis.shape[1]

    @cached_property
    def triangle(self) -> tuple[Array, Array]:
        """z and y with no more rows than they need, all scalar products as they were."""
        r = np.linalg.qr(np.column_stack([self.z, self.y]), mode="r")
        return r[:, :-1], r[:, -1]


def pools_of(bench: CandidateEvaluator) -> dict[str, Pool]:
    """Candidates by axis."""
    owners: dict[str, dict[str, set[Owner]]] = {axis: defaultdict(set) for axis in bench.fits}
    for effect in LIBRARY:
        if effect.kind == MEASUREMENT:
            continue
        coarse = tuple(replace(number, count=min(number.count, GRID)) for number in effect.inner)
        for candidate in candidates_of(replace(effect, inner=coarse), bench.data, bench.base):
            for axis, terms in candidate.terms.items():
                for term in terms if axis in owners else ():
                    owners[axis][term].add((effect.identifier, candidate.variant))
    made = {}
    for axis, terms in owners.items():
        with contextlib.suppress(InputError):
            made[axis] = _pool(bench, axis, terms)
    return made


def _pool(bench: CandidateEvaluator, axis: str, owners: dict[str, set[Owner]]) -> Pool:
    base, texts = bench.fits[axis], list(owners)
    columns = bench.data.columns([parse_expression(text) for text in texts])
    known = np.mean(np.isfinite(columns[base.rows]), axis=0) > PRESENT
    base = base.on(np.all(np.isfinite(columns[:, known]), axis=1))
    z = np.where(known, columns, 0.0)[base.rows]
    size = np.sum(z**2, axis=0)
    z -= base.basis @ (base.basis.T @ z)
    left = np.sum(z**2, axis=0)
    use = left > NEW * np.maximum(size, np.finfo(float).tiny)
    y = base.y - base.basis @ (base.basis.T @ base.y)
    rms = float(np.sqrt(np.mean(y**2)))
    return Pool(
        base,
        tuple(text for text, kept in zip(texts, use, strict=True) if kept),
        tuple(frozenset(owners[text]) for text, kept in zip(texts, use, strict=True) if kept),
        columns[:, use],
        z[:, use] / np.sqrt(left[use] / len(y)),
        y / rms,
        base.spread / rms,
        bench.data.fold[base.rows],
    )


# -- the methods: columns that each selects, most important first ----------------------------------------------


def stepwise(pool: Pool) -> list[int]:
    """Forward and backward by the partial F test."""
    z, y = pool.triangle
    chosen: list[int] = []
    for _ in range(2 * MOST_TERMS):
        freedom = pool.points - pool.terms_of_model - len(chosen) - 1
        limit = float(fisher.isf(LEVEL / z.shape[1], 1, freedom))
        weakest = _weakest(z[:, chosen], y, freedom + 1) if len(chosen) > 1 else None
        if weakest is not None and weakest[1] < limit:
            chosen.pop(weakest[0])
            continue
        if len(chosen) == MOST_TERMS:
            break
        best, before, after = _strongest(z, y, chosen)
        if best is None or (before - after) * freedom < limit * after:
            break
        chosen.append(best)
    return chosen


def _weakest(z: Array, y: Array, freedom: int) -> tuple[int, float]:
    """The selected column with the least partial F, and that."""
    q, r = np.linalg.qr(z)
    theta = np.linalg.solve(r, q.T @ y)
    rest = y - z @ theta
    spread = np.sum(np.linalg.inv(r) ** 2, axis=1) * (rest @ rest) / freedom
    partial = theta**2 / spread
    return int(np.argmin(partial)), float(np.min(partial))


def _strongest(z: Array, y: Array, chosen: Sequence[int]) -> tuple[int | None, float, float]:
    """The column that explains most beside the chosen ones, and the squared error without and with it."""
    q = np.linalg.qr(z[:, chosen])[0]
    rest, left = y - q @ (q.T @ y), z - q @ (q.T @ z)
    power = np.sum(left**2, axis=0)
    least = NEW * np.sum(z**2, axis=0)
    gain = np.where(power > least, (left.T @ rest) ** 2 / np.maximum(power, least), 0.0)
    best, before = int(np.argmax(gain)), float(rest @ rest)
    return (best if gain[best] > 0.0 else None), before, before - float(gain[best])


def in_order(pool: Pool) -> tuple[list[int], Array]:
    """Columns, each the one that explains most beside those before it, and the squared errors without and with each."""
    z, y = pool.triangle
    order: list[int] = []
    errors = [float(y @ y)]
    while len(order) < MOST_TERMS:
        best, _, after = _strongest(z, y, order)
        if best is None:
            break
        order.append(best)
        errors.append(after)
    return order, np.array(errors)


def orthogonal(pool: Pool) -> list[int]:
    """As many orthogonal functions as make the predicted square error least."""
    order, errors = in_order(pool)
    penalty = pool.spread**2 * (pool.terms_of_model + np.arange(len(errors)))
    return order[: int(np.argmin(errors + penalty))]


def orthogonal_r2(pool: Pool) -> list[int]:
    """Orthogonal functions for as long as each raises R^2 by LEAST_R2."""
    order, errors = in_order(pool)
    falls = -np.diff(errors) / (pool.points * pool.spread**2)
    small = np.flatnonzero(falls < LEAST_R2)
    return order[: int(small[0])] if len(small) else order


def stlsq(pool: Pool) -> list[int]:
    """Least squares again and again, without what is below the threshold."""
    from pysindy.optimizers import STLSQ

    z, y = pool.triangle
    found = np.ravel(STLSQ(threshold=THRESHOLD, alpha=RIDGE).fit(z, y[:, None]).coef_)
    size = np.abs(found)
    return [int(j) for j in np.argsort(-size) if size[j] > 0.0]


def lasso(pool: Pool) -> list[int]:
    """L1 with the weight that predicts held-out blocks of time best."""
    from sklearn.linear_model import LassoCV, lasso_path

    every = np.arange(pool.points)
    folds = [(every[pool.fold != k], every[pool.fold == k]) for k in np.unique(pool.fold)]
    settings = {"eps": 1e-3, "max_iter": 300, "tol": 1e-3}
    model = LassoCV(alphas=WEIGHTS, cv=folds, fit_intercept=False, precompute=True, **settings).fit(pool.z, pool.y)
    weights = model.alphas_[model.alphas_ >= model.alpha_]
    _, path, _ = lasso_path(pool.z, pool.y, alphas=weights, precompute=True, max_iter=300, tol=1e-3)
    entry = [(int(np.argmax(row != 0.0)), -abs(row[-1]), j) for j, row in enumerate(path) if row[-1] != 0.0]
    return [j for _, _, j in sorted(entry)]


METHODS: dict[str, Callable[[Pool], list[int]]] = {
    "stepwise": stepwise,
    "orthogonal": orthogonal,
    "orthogonal_r2": orthogonal_r2,
    "stlsq": stlsq,
    "lasso": lasso,
}


# -- their answers ---------------------------------------------------------------------------------------------


def answers(bench: CandidateEvaluator) -> dict[str, dict[str, Any]]:
    """By method: verdict, first three effects, held-out NRMSE of the axes in which terms were selected, seconds."""
    started = time.process_time()
    pools = pools_of(bench)
    preparing = time.process_time() - started
    said = {}
    for name, method in METHODS.items():
        started = time.process_time()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that a path has not converged, or that a threshold has left nothing
            chosen = {axis: method(pool) for axis, pool in pools.items()}
        chosen = {axis: columns for axis, columns in chosen.items() if columns}
        said[name] = {
            "verdict": "missing" if chosen else "none",
            "effects": ranked(pools, chosen)[:3],
            "errors": {axis: _error(bench, pools[axis], columns) for axis, columns in chosen.items()},
            "terms": sum(map(len, chosen.values())),
            "seconds": time.process_time() - started + preparing,
        }
    return said


def _error(bench: CandidateEvaluator, pool: Pool, columns: list[int]) -> float:
    return bench.fits[pool.base.axis].gain(pool.columns[:, columns]).nrmse_after


def ranked(pools: dict[str, Pool], chosen: dict[str, list[int]]) -> list[str]:
    """Effects, best first: by what the terms of their best variant explain, then by its share that was selected."""
    explained: dict[Owner, float] = defaultdict(float)
    selected: dict[Owner, int] = defaultdict(int)
    for axis, columns in chosen.items():
        for column, credit in zip(columns, credits_of(pools[axis], columns), strict=True):
            for owner in pools[axis].owners[column]:
                explained[owner] += credit
                selected[owner] += 1
    best: dict[str, tuple[float, float]] = {}
    for owner, credit in explained.items():
        share = min(1.0, selected[owner] / _size(owner))
        best[owner[0]] = max(best.get(owner[0], (0.0, 0.0)), (round(credit, 9), share))
    return sorted(best, key=lambda name: best[name], reverse=True)


def _size(owner: Owner) -> int:
    """Terms of a variant."""
    effect = next(e for e in LIBRARY if e.identifier == owner[0])
    variant = next(v for v in effect.variants if v.name == owner[1])
    return sum(map(len, variant.terms.values()))


def credits_of(pool: Pool, columns: Sequence[int]) -> list[float]:
    """Fall of ln of the squared error with each column after those before it."""
    z, y = pool.triangle
    parts = (np.linalg.qr(z[:, columns])[0].T @ y) ** 2
    errors = np.maximum(float(y @ y) - np.concatenate([[0.0], np.cumsum(parts)]), 1e-12 * float(y @ y))
    return [float(x) for x in -np.diff(np.log(errors))]
