"""The aerodynamic model as data: regressor expressions per axis, (6.8)-(6.13) of docs/references.md by default.

``C_axis = sum_j parameter_j * term_j(signals)``, coefficients in body axes, per rad, rates normalised.
Nothing in the code knows the textbook terms specially: they are the default of the aircraft file and no more.
(6.9) is printed with C_X,da and C_X,dr: C_Y,da and C_Y,dr are meant. (6.11) is printed with a C_l,alpha term
that the parameter vector (6.25) does not have: it is left out, which gives 6+6+4+6+4+6 = 32 parameters.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.expression import Lag, Program, parse_expression
from aircraft_sysid_ros.aircraft.postfix import MAX, MIN, SIGN, evaluate_rows
from aircraft_sysid_ros.aircraft.signals import SIGNALS
from aircraft_sysid_ros.aircraft.term_values import evaluate, lags_of, link, with_lags
from aircraft_sysid_ros.errors import InputError, echo

AXES: tuple[str, ...] = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")
FORCES, MOMENTS = AXES[:3], AXES[3:]
AXIS_WORDS = {
    "CX": "axial force", "CY": "side force", "CZ": "normal force",
    "Cl": "rolling moment", "Cm": "pitching moment", "Cn": "yawing moment",
}  # fmt: skip
#: Terms of one axis. No flight tells more of them apart.
MOST_TERMS = 60
#: Points at which a term is tried before any flight reads it: small and large values of all signals, of either sign.
_TRIED, _TRIED_POWERS = 4096, (-3.0, 4.5)
#: Operations that make a term 0 but in a part of the flight, which no point may be in.
_FLAT = {MAX, MIN, SIGN}
_LONGITUDINAL = ("1", "alpha", "q", "de")
_LATERAL = ("1", "beta", "p", "r", "da", "dr")
TEXTBOOK_TERMS: dict[str, tuple[str, ...]] = {
    "CX": ("1", "alpha", "alpha**2", "q", "de", "Tc"),
    "CY": _LATERAL,
    "CZ": _LONGITUDINAL,
    "Cl": _LATERAL,
    "Cm": _LONGITUDINAL,
    "Cn": _LATERAL,
}


def term_label(term: str) -> str:
    """Name of a term inside a parameter name: ``1`` is 0, ``alpha**2`` is alpha2, others stay as they are."""
    if term == "1":
        return "0"
    base, power, exponent = term.partition("**")
    return base + exponent if power and base in SIGNALS and exponent.isdigit() else term


@dataclass(frozen=True)
class AerodynamicModel:
    """Terms per axis, in the order of AXES. Build it with ``model_from_terms``."""

    programs: tuple[tuple[Program, ...], ...]
    inputs: tuple[str, ...] = ()  # names that the aircraft file gives to further signals

    @cached_property
    def terms(self) -> dict[str, tuple[str, ...]]:
        """Canonical text of the terms, by axis."""
        texts = [tuple(program.text for program in programs) for programs in self.programs]
        return dict(zip(AXES, texts, strict=True))

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """The published names ``CX_0 CX_alpha …``, axis by axis."""
        return tuple(f"{axis}_{term_label(t)}" for axis, terms in self.terms.items() for t in terms)

    @cached_property
    def offsets(self) -> npt.NDArray[np.int64]:
        """Where each axis starts among the parameters, shape (7,)."""
        return np.cumsum([0, *(len(programs) for programs in self.programs)]).astype(np.int64)

    @cached_property
    def identifier(self) -> str:
        """Id of this version: the same terms have the same id."""
        return hashlib.sha256(repr(self.terms).encode()).hexdigest()[:8]

    @cached_property
    def lags(self) -> tuple[Lag, ...]:
        """The ``lag(…)`` that its terms read, in the order of their signals."""
        return lags_of([p for programs in self.programs for p in programs])

    @cached_property
    def linked(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
        """Code and offsets of all terms for ``expression.evaluate_programs``."""
        return link([p for programs in self.programs for p in programs])

    @cached_property
    def constants(self) -> tuple[npt.NDArray[np.float64], ...]:
        """Of each axis (n,): 1 for the constant term, 0 for others."""
        return tuple(np.array([p.text == "1" for p in programs], dtype=np.float64) for programs in self.programs)

    @cached_property
    def signals_of_axes(self) -> tuple[tuple[str, ...], ...]:
        """Names of the signals that the terms of each axis read, in the order of ``signal_names``."""
        read = [{name for program in programs for name in program.signals} for programs in self.programs]
        return tuple(tuple(name for name in self.signal_names if name in signals) for signals in read)

    @property
    def signal_names(self) -> tuple[str, ...]:
        """Names of what a signal row holds: SIGNALS and the inputs of the aircraft."""
        return (*SIGNALS, *self.inputs)

    @cached_property
    def signals_used(self) -> frozenset[str]:
        """Names of the signals that any term reads."""
        return frozenset(name for signals in self.signals_of_axes for name in signals)

    def axis_slice(self, axis: str) -> slice:
        """Where the parameters of an axis stand among all."""
        return self._slices[axis]

    @cached_property
    def _slices(self) -> dict[str, slice]:
        return {axis: slice(*pair) for axis, pair in zip(AXES, pairwise(self.offsets.tolist()), strict=True)}

    def regressors(self, axis: str, signals: Mapping[str, npt.ArrayLike]) -> npt.NDArray[np.float64]:
        """Regressor matrix of one axis, shape (n, terms), for arrays of signals by name."""
        return evaluate(self.programs[AXES.index(axis)], signals, self.inputs)

    def steady_terms(self, rows: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """All terms, shape (n, parameters), on signal rows (n, SIGNAL_COUNT), with lags in the steady state."""
        return self.terms_along(np.zeros(len(rows)), rows, np.inf)

    def terms_along(
        self, times: npt.NDArray[np.float64], rows: npt.NDArray[np.float64], longest: float
    ) -> npt.NDArray[np.float64]:
        """All terms, shape (n, parameters), on signal rows (n, SIGNAL_COUNT) of a flight in order of ``times`` [s]; a
        pause of more than ``longest`` [s] starts the lags over.
        """
        values = np.empty((len(rows), int(self.offsets[-1])))
        evaluate_rows(*self.linked, with_lags(self.lags, times, rows, longest), values)
        return values

    def coefficients(
        self, parameters: Mapping[str, float], signals: Mapping[str, npt.ArrayLike]
    ) -> npt.NDArray[np.float64]:
        """C_X … C_n, shape (n, 6), for parameters by name and arrays of signals by name."""
        values = np.array([parameters[name] for name in self.parameter_names])
        columns = [self.regressors(axis, signals) @ values[self.axis_slice(axis)] for axis in AXES]
        return np.stack(columns, axis=1)


def model_from_terms(terms: Mapping[str, Sequence[str | int]], inputs: tuple[str, ...] = ()) -> AerodynamicModel:
    """Model from terms per axis; an axis that is left out has no terms. InputError for bad axes or terms.

    ``inputs``: names of the signals that the aircraft file adds to SIGNALS.
    """
    unknown = [axis for axis in terms if axis not in AXES]
    if unknown:
        raise InputError(f"the model names the axis '{echo(str(unknown[0]))}': the axes are {' '.join(AXES)}")
    programs = []
    for axis in AXES:
        listed = terms.get(axis, ())
        if isinstance(listed, str) or not isinstance(listed, Sequence):
            raise InputError(f"the terms of {axis} must be a list such as [1, alpha, q, de]")
        if len(listed) > MOST_TERMS:
            raise InputError(f"{axis} has {len(listed)} terms: at most {MOST_TERMS} in an axis can be learnt")
        parsed = tuple(parse_expression(str(term), inputs) for term in listed)
        labels = [term_label(program.text) for program in parsed]
        twice = next((p.text for p, name in zip(parsed, labels, strict=True) if labels.count(name) > 1), None)
        if twice is not None:
            raise InputError(f"the model has the term '{echo(twice)}' twice in {axis}: remove one")
        for program in parsed:
            _check_values(program.source, inputs)
        programs.append(parsed)
    lags_of([p for parsed in programs for p in parsed])  # not too many
    return AerodynamicModel(tuple(programs), inputs)


@lru_cache(maxsize=4096)
def _check_values(source: str, inputs: tuple[str, ...]) -> None:
    """InputError for a term that no flight can give a value: no number wherever it is tried, or 0, or a constant."""
    program, names = parse_expression(source, inputs), (*SIGNALS, *inputs)
    text = echo(program.text)
    if not program.signals and program.text != "1":
        raise InputError(f"the term '{text}' reads no signal: the constant of an axis is written 1")
    rng = np.random.default_rng(0)
    tried = 10.0 ** rng.uniform(*_TRIED_POWERS, (len(names), _TRIED)) * rng.choice([-1.0, 1.0], (len(names), _TRIED))
    tried[:, ::2] = abs(tried[:, ::2])
    signals = {**dict(zip(names, tried, strict=True)), "time": np.sort(tried[names.index("time")])}
    values = evaluate((program,), signals, inputs)
    if not np.any(np.isfinite(values)):
        raise InputError(f"the term '{text}' is never a number, whatever the aeroplane does: correct it")
    if not np.any(values) and not _FLAT & set(program.code[:, 0].astype(int).tolist()):
        raise InputError(f"the term '{text}' is 0, whatever the aeroplane does: correct or remove it")


def textbook_model() -> AerodynamicModel:
    """The 32 terms of (6.25)."""
    return model_from_terms(TEXTBOOK_TERMS)
