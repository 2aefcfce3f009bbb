"""Richer models of a five-hole probe than (36), (37) of the two-stage paper (docs/references.md), and which to use.

The curve of the angles may bend, for r = D / (K q_c), and the wind may change, linear in time between knots t_j:

    alpha = (1 + lambda_alpha) (r + kappa_alpha r^3) + b_alpha, and beta likewise,      W(t) = sum_j hat_j(t) W_j.

Both keep the form z = A(xi2) xi1 + b(xi2) + v: the wind at the knots is more of xi1, kappa more of xi2.

A richer model always fits better what it was fitted to. It is supported if it predicts better what it was not fitted
to: the flight is cut into blocks, the model fitted without some of them, and the squares of its residuals there must
be smaller, by more than SUPPORTED standard errors of the mean over the blocks. Slow errors of the navigation look like
a wind that changes a little: that must make them noticeably smaller, too. A curve of which the answer tells no kappa is
left out: in gusts, where (40) is averaged over seconds, little of it remains.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.calibration.five_hole_probe import (
    BOUNDS2,
    EXCITED_BY,
    NAMES1,
    NAMES2,
    UNITS,
    ProbeData,
    ProbeFlight,
    bounds1_of,
)
from aircraft_sysid_ros.calibration.procedure import SAMPLES, Answer, reduced_problem, residuals
from aircraft_sysid_ros.estimation.two_stage.conditions import Conditions
from aircraft_sysid_ros.estimation.two_stage.optimisation import alternate
from aircraft_sysid_ros.estimation.two_stage.problem import Problem
from aircraft_sysid_ros.estimation.two_stage.residual_sampling import Progress

Array = npt.NDArray[np.float64]

#: kappa [1/rad^2], and within what it is sought; that of the firmware of the probe of Thor is 1.1.
CURVE = ("kappa_alpha", "kappa_beta")
LARGEST_KAPPA = 4.0
#: ImuEpochs of a wind that changes are about so far apart [s].
KNOTS_APART = 60.0
#: Blocks of so many seconds are left out by turns, every FOLDS-th at a time.
BLOCK, FOLDS = 8.0, 4
#: Every fourth row is enough to choose a model.
THINNING = 4
#: A richer model must be better by so many standard errors.
SUPPORTED = 2.0
#: And by this share of the squares, the 5 % within which (26) holds R to be the same.
NOTICEABLE = {"curve": 0.0, "wind": 0.05}
#: The richer models begin at the answer of the paper's: conditions on samples say nothing there.
_ANY = Conditions(np.inf, np.inf, "none")
Curve = Literal["auto", "linear", "cubic"]
Wind = Literal["auto", "steady", "varying"]


@dataclass(frozen=True)
class ProbeModel:
    """(40) of data at times (n,) [s], with a bent curve or not, and with knots (k,) [s] of the wind or none."""

    data: ProbeData
    time: Array
    cubic: bool
    knots: Array | None

    @property
    def words(self) -> str:
        """What it assumes."""
        return f"{'cubic' if self.cubic else 'linear'} curve, {'steady' if self.knots is None else 'varying'} wind"

    @property
    def names1(self) -> tuple[str, ...]:
        """xi1: the wind by knot, if there are some."""
        if self.knots is None:
            return NAMES1
        return (*NAMES1[:2], *(f"{name}_{j}" for j in range(len(self.knots)) for name in NAMES1[2:]))

    @property
    def names2(self) -> tuple[str, ...]:
        """xi2."""
        return (*NAMES2, *CURVE) if self.cubic else NAMES2

    def problem(self) -> Problem:
        """Measurement equation."""
        kappa = np.array([[-LARGEST_KAPPA, LARGEST_KAPPA]] * (len(self.names2) - len(NAMES2))).reshape(-1, 2)
        knots = 1 if self.knots is None else len(self.knots)
        bounds1 = bounds1_of(self.data.velocity)
        return Problem(
            self.data.velocity, self.model, self.names1, self.names2,
            np.concatenate([bounds1[:2], *[bounds1[2:]] * knots]), np.concatenate([BOUNDS2, kappa]),
            gradient=self.gradient,
        )  # fmt: skip

    def model(self, xi2: Array) -> tuple[Array, Array]:
        """A (n, 3, n1) and b (n, 3)."""
        a, b = self._straight(xi2).model(xi2[: len(NAMES2)])
        return self._with_knots(a), b

    def gradient(self, xi2: Array) -> tuple[Array, Array]:
        """dA/dxi2 (n, 3, n1, n2) and db/dxi2 (n, 3, n2)."""
        da, db = self._straight(xi2).gradient(xi2[: len(NAMES2)])
        if self.cubic:
            cubes = [(1.0 + xi2[0]) * self.data.alpha_ratio**3, (1.0 + xi2[2]) * self.data.beta_ratio**3]
            more = [(da[..., b] * cube[:, None, None], db[..., b] * cube[:, None])
                    for b, cube in zip((1, 3), cubes, strict=True)]  # fmt: skip
            da = np.concatenate([da, *(part[..., None] for part, _ in more)], axis=-1)
            db = np.concatenate([db, *(part[..., None] for _, part in more)], axis=-1)
        if self.knots is not None:
            whole = np.zeros((len(da), 3, len(self.names1), da.shape[-1]))
            whole[:, :, :2] = da[:, :, :2]
            da = whole
        return da, db

    def instruments(self, xi: Array) -> Array:
        """d(A xi1 + b)/dxi (n, 3, n) at pressures without noise, for ``procedure.refined``."""
        xi1, xi2 = np.split(xi, [len(self.names1)])
        still = replace(self.data, velocity=self.data.velocity - self.wind(xi1))
        exact = still.predicted(np.array([*xi1[:2], 0.0, 0.0, 0.0]), xi2[: len(NAMES2)])
        if self.cubic:
            alpha, beta = (unbent(r, k) for r, k in zip((exact.alpha_ratio, exact.beta_ratio), xi2[-2:], strict=True))
            exact = replace(exact, alpha_ratio=alpha, beta_ratio=beta)
        made = replace(self, data=exact)
        a, _ = made.model(xi2)
        da, db = made.gradient(xi2)
        return np.concatenate([a, np.einsum("nmij,i->nmj", da, xi1) + db], axis=2)

    def by_attitude(self, xi: Array) -> Array:
        """d(A xi1 + b)/de (n, 3, 3) by a small rotation e of the attitude in body axes."""
        xi1, xi2 = np.split(xi, [len(self.names1)])
        return self._straight(xi2).by_attitude(np.concatenate([xi1[:2], np.zeros(3), xi2[: len(NAMES2)]]))

    def wind(self, xi1: Array) -> Array:
        """Wind NED (n, 3)."""
        return np.asarray(self._hats @ xi1[2:].reshape(-1, 3))

    def units(self) -> dict[str, str]:
        """Units by name."""
        return {**UNITS, **{name: "m/s" for name in self.names1[1:]}, **dict.fromkeys(CURVE, "1/rad²")}

    def excited_by(self) -> dict[str, str]:
        """What must be flown so that a parameter can be found."""
        winds = {name: EXCITED_BY[name[:3]] for name in self.names1[2:]}
        bend = {f"kappa_{angle}": f"larger angles: {EXCITED_BY['lambda_' + angle]}" for angle in ("alpha", "beta")}
        return {**EXCITED_BY, **winds, **bend}

    def _straight(self, xi2: Array) -> ProbeData:
        """Data whose ratios are r + kappa r^3."""
        if not self.cubic:
            return self.data
        alpha, beta = (
            r + kappa * r**3 for r, kappa in zip((self.data.alpha_ratio, self.data.beta_ratio), xi2[-2:], strict=True)
        )
        return replace(self.data, alpha_ratio=alpha, beta_ratio=beta)

    def _with_knots(self, a: Array) -> Array:
        if self.knots is None:
            return a
        hats = self._hats[:, None, :, None] * np.eye(3)[None, :, None, :]
        return np.concatenate([a[:, :, :2], hats.reshape(len(a), 3, -1)], axis=2)

    @cached_property
    def _hats(self) -> Array:
        """Share of each knot at each time (n, k)."""
        if self.knots is None:
            return np.ones((len(self.time), 1))
        return np.stack([np.interp(self.time, self.knots, one) for one in np.eye(len(self.knots))], axis=1)


def unbent(bent: Array, kappa: float) -> Array:
    """r of r + kappa r^3 = bent, by Newton; the nearest that there is where the curve turns back (kappa < 0)."""
    most = np.inf if kappa >= 0.0 else 1.0 / math.sqrt(-3.0 * kappa)
    r = np.clip(bent, -0.9 * most, 0.9 * most)
    for _ in range(20):
        r = np.clip(r - (r + kappa * r**3 - bent) / (1.0 + 3.0 * kappa * r**2), -0.99 * most, 0.99 * most)
    return np.asarray(r)


@dataclass(frozen=True)
class Judged:
    """A model, what it predicts of blocks that it was not fitted to, and whether the flight supports it."""

    model: ProbeModel
    held_out: float  # rms of the residuals [m/s]
    better: float  # than the one that it was tried against, in standard errors; NaN for the first
    supported: bool


@dataclass(frozen=True)
class ProbeAnswer:
    """The answer of the model that is used, the paper's, whether the wind was steady within seconds, and all models."""

    answer: Answer
    model: ProbeModel
    paper: Answer
    steady: bool
    judged: list[Judged]

    def told(self) -> list[dict[str, Any]]:
        """For a file: what each model predicts, in the order in which they were tried."""
        return [
            {"model": j.model.words, "held_out_rms": j.held_out, "better_by_standard_errors": j.better,
             "supported": j.supported, "used": j.model.words == self.model.words}
            for j in self.judged
        ]  # fmt: skip


def model_of(flight: ProbeFlight, cubic: bool, varying: bool) -> ProbeModel:
    """A model of a flight; knots have as much of it between them."""
    time = flight.grid.time
    count = max(round(len(time) * flight.grid.step / KNOTS_APART), 1) + 1
    knots = time[np.linspace(0, len(time) - 1, count).round().astype(np.int64)]
    return ProbeModel(flight.data, time, cubic, knots if varying else None)


def solve_probe(
    flight: ProbeFlight,
    samples: int = SAMPLES,
    seed: int = 0,
    progress: Progress | None = None,
    curve: Curve = "auto",
    wind: Wind = "auto",
) -> ProbeAnswer:
    """The paper's model by both stages, and from its answer the richer one that is asked for or supported."""
    paper, paper_steady = flight.solve(samples, seed, progress)
    found, judged = _supported(flight, paper, progress, curve, wind)
    while found.cubic or found.knots is not None:
        begin = _moved(paper, found)[len(found.names1) :]
        answer, steady = flight.solve(begin[None], seed, progress, model=found, conditions=_ANY)
        if not found.cubic or curve == "cubic" or _tells_a_curve(answer):
            return ProbeAnswer(_with_samples_of(answer, paper), found, paper, steady, judged)
        judged = [replace(j, supported=j.supported and not j.model.cubic) for j in judged]
        found = replace(found, cubic=False)
    return ProbeAnswer(paper, found, paper, paper_steady, judged)


def _supported(
    flight: ProbeFlight, paper: Answer, progress: Progress | None, curve: Curve, wind: Wind
) -> tuple[ProbeModel, list[Judged]]:
    """The model whose predictions are best, from the simplest that is allowed on, and all that were tried."""
    found = model_of(flight, curve == "cubic", wind == "varying")
    scores = _left_out(flight, found, paper)
    judged, open_questions = [Judged(found, _rms(scores), np.nan, True)], []
    open_questions += ["curve"] if curve == "auto" else []
    open_questions += ["wind"] if wind == "auto" else []
    while open_questions:  # the better addition first: one that is missing hides the other
        tried = []
        for what in open_questions:
            if progress is not None:
                progress(f"which {what}", 0, 0)
            richer = model_of(flight, found.cubic or what == "curve", found.knots is not None or what == "wind")
            left_out = _left_out(flight, richer, paper)
            better, gain = _advantage(scores, left_out)
            tried.append((better > SUPPORTED and gain > NOTICEABLE[what], better, what, richer, left_out))
            judged.append(Judged(richer, _rms(left_out), better, tried[-1][0]))
        supported, _, what, richer, left_out = max(tried, key=lambda each: each[:2])
        if not supported:
            break
        found, scores = richer, left_out
        open_questions.remove(what)
    return found, judged


def _tells_a_curve(answer: Answer) -> bool:
    """Whether the flight tells some kappa."""
    return bool(np.any(answer.determined[[answer.problem.names.index(name) for name in CURVE]]))


def _moved(paper: Answer, model: ProbeModel) -> Array:
    """Unknowns of a richer model that say what the paper's answer says."""
    values = {**paper.values, **dict.fromkeys(CURVE, 0.0)}
    return np.array([values[name[:3] if name.startswith("W_") else name] for name in (*model.names1, *model.names2)])


def _left_out(flight: ProbeFlight, model: ProbeModel, paper: Answer) -> Array:
    """Mean squares (blocks, 3) of residuals in blocks that are predicted without them; what is not told is nominal."""
    thinned = replace(model, data=model.data[::THINNING], time=model.time[::THINNING])
    whole, start = thinned.problem(), _moved(paper, model)
    known = set(np.array(paper.problem.names)[~paper.determined])
    free = np.array([(name[:3] if name.startswith("W_") else name) not in known for name in whole.names])
    problem = reduced_problem(whole, start, free)
    block = np.floor((thinned.time - thinned.time[0]) / BLOCK).astype(np.int64)
    one, two = start[: whole.n1][free[: whole.n1]], start[whole.n1 :][free[whole.n1 :]]
    squares = np.empty((len(block), 3))
    for fold in range(FOLDS):
        out = block % FOLDS == fold
        found = alternate(replace(problem, usable=~out), one, two, alone=False)
        squares[out] = residuals(replace(problem, usable=out), np.concatenate([found.xi1, found.xi2])) ** 2
    return np.array([squares[block == number].mean(axis=0) for number in np.unique(block)])


def _rms(scores: Array) -> float:
    return float(np.sqrt(scores.mean()))


def _advantage(simple: Array, rich: Array) -> tuple[float, float]:
    """By how many standard errors, and what share, the mean is lower; outputs count by what the simple model leaves."""
    gain = np.mean((simple - rich) / simple.mean(axis=0), axis=1)
    error = gain.std(ddof=1) / np.sqrt(len(gain)) if len(gain) > 1 else np.inf
    return float(gain.mean() / max(error, np.finfo(float).tiny)), float(gain.mean())


def _with_samples_of(answer: Answer, paper: Answer) -> Answer:
    """The answer with the samples of stage 1, which had straight curves."""
    free, had = (a.determined[a.problem.n1 :] for a in (answer, paper))
    had_names = list(np.array(paper.problem.names2)[had])
    columns = [had_names.index(n) if n in had_names else -1 for n in np.array(answer.problem.names2)[free]]

    def of(xi2: Array) -> Array:
        return np.concatenate([xi2, np.zeros((*xi2.shape[:-1], 1))], axis=-1)[..., columns]

    minima = tuple(replace(minimum, xi2=of(minimum.xi2)) for minimum in paper.decision.minima)
    samples = replace(paper.samples, xi2=of(paper.samples.xi2))
    return replace(answer, samples=samples, decision=replace(paper.decision, minima=minima))
