"""One message of ``~/parameters`` as an immutable, checked, consistent set."""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.physical_bounds import physical_bounds
from aircraft_sysid_ros.identification.trust import Trust

Array = npt.NDArray[np.float64]

#: Asymmetry of a correlation, and share of a negative eigenvalue, that is still rounding.
_ROUNDING = 1e-6
#: Share of a standard error by which the root of its variance may be off it.
_SLACK = 0.01
_LIMITS = ("airspeed", "alpha", "beta")


class Condition(NamedTuple):
    """A flight condition."""

    airspeed: float  # [m/s]
    alpha: float  # [rad]
    beta: float = 0.0  # [rad]


@dataclass(frozen=True)
class Snapshot:
    """n parameters of one message, which belong together; arrays cannot be written to."""

    stamp: int  # [ns] newest sample used
    model: str  # id of the model version
    names: tuple[str, ...]
    values: Array  # (n,) body axes, per rad; NaN when never learnt
    std: Array  # (n,) one sigma
    covariance: Array  # (n, n)
    status: npt.NDArray[np.int64]  # (n,) of Trust
    reasons: tuple[str, ...]
    age: Array  # (n,) [s] since each last learnt; NaN when never
    low: Array  # (3,) airspeed [m/s], alpha, beta [rad] that it was learnt between; NaN: not said
    high: Array  # (3,)

    @property
    def usable(self) -> npt.NDArray[np.bool_]:
        """Which parameters (n,) have USE."""
        return np.asarray(self.status == Trust.USE)

    def covariance_of(self, names: Sequence[str]) -> Array:
        """Covariance (k, k) of some parameters; KeyError for one that is not there."""
        rows = [self._index(name) for name in names]
        return np.asarray(self.covariance[np.ix_(rows, rows)])

    def _index(self, name: str) -> int:
        if name not in self.names:
            raise KeyError(f"the model {self.model} has no parameter {name}")
        return self.names.index(name)


def snapshot_of(stamp: int, content: Mapping[str, Any]) -> Snapshot:
    """A snapshot of the content of a message, as ``ros_messages.output_messages.parameters_content`` has it.

    Raises InputError, with one sentence, for what no estimator may send: something missing or of another type,
    repeated names, a covariance of another size, an unknown status, limits in the wrong order, and USE for what is not
    finite, is beyond what aeroplanes have by more than two standard errors (where the estimator says REJECT), or whose
    covariance is not symmetric, not positive semidefinite, or not that of the standard errors.
    """
    try:
        made = _read(stamp, content)
    except InputError:
        raise
    except KeyError as error:
        raise InputError(f"the message has no {error.args[0]}") from None
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"the message cannot be read: {error}") from None
    _check_content(made)
    _check_covariance(made)
    return made


def _read(stamp: int, content: Mapping[str, Any]) -> Snapshot:
    listed = content["parameters"]
    names = tuple(str(p["name"]) for p in listed)
    covariance = np.asarray(content["covariance"], dtype=np.float64).ravel()
    _check_shape(names, covariance)
    made = Snapshot(
        stamp=int(np.int64(stamp)),
        model=str(content["model"]),
        names=names,
        values=_column(listed, "value"),
        std=_column(listed, "standard_deviation"),
        covariance=_frozen(covariance.reshape(len(names), len(names)).copy()),
        status=np.array([operator.index(p["status"]) for p in listed], dtype=np.int64),
        reasons=tuple(str(p["reason"]) for p in listed),
        age=_column(listed, "age"),
        low=_frozen(np.array([content[f"{name}_min"] for name in _LIMITS], dtype=np.float64)),
        high=_frozen(np.array([content[f"{name}_max"] for name in _LIMITS], dtype=np.float64)),
    )
    made.status.flags.writeable = False
    return made


def _column(listed: Sequence[Mapping[str, Any]], key: str) -> Array:
    return _frozen(np.array([p[key] for p in listed], dtype=np.float64))


def _frozen(array: Array) -> Array:
    array.flags.writeable = False
    return array


def _check_shape(names: tuple[str, ...], covariance: Array) -> None:
    n = len(names)
    if not n:
        raise InputError("the message holds no parameters")
    if len(set(names)) < n:
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"the message holds {twice} more than once")
    if len(covariance) != n * n:
        raise InputError(f"the covariance of {n} parameters must have {n * n} numbers, not {len(covariance)}")


def _check_content(s: Snapshot) -> None:
    for name, status in zip(s.names, s.status, strict=True):
        if status not in tuple(Trust):
            raise InputError(f"{name} has the status {status}, which is not one of USE, HOLD and REJECT")
    for name, low, high in zip(_LIMITS, s.low, s.high, strict=True):
        if low > high:
            raise InputError(f"the learnt {name} begins at {low:g}, above its end {high:g}")
    for i in np.flatnonzero(s.usable):
        name, value, std = s.names[i], s.values[i], s.std[i]
        if not (np.isfinite(value) and np.isfinite(std) and std > 0.0):
            raise InputError(f"{name} has USE with the value {value:g} ± {std:g}")
        low, high = physical_bounds(name)
        surely = value - 2.0 * std > high or value + 2.0 * std < low or std > high - low
        if surely and not low <= value <= high:
            raise InputError(f"{name} has USE with {value:g} ± {std:g}, and aeroplanes have {low:g} to {high:g}")


def _check_covariance(s: Snapshot) -> None:
    used = np.flatnonzero(s.usable)
    block = s.covariance[np.ix_(used, used)]
    variance = np.diag(block)
    if not (np.all(np.isfinite(block)) and np.all(variance > 0.0)):
        raise InputError("the covariance of parameters with USE is not finite and positive")
    scale = np.sqrt(variance)
    correlation = block / scale / scale[:, None]  # of both in turn: their product may be 0
    if np.any(np.abs(correlation - correlation.T) > _ROUNDING):
        raise InputError("the covariance of parameters with USE is asymmetric")
    if len(used) and np.linalg.eigvalsh(correlation)[0] < -_ROUNDING * len(used):
        raise InputError("the covariance of parameters with USE is not positive semidefinite")
    off = np.flatnonzero(np.abs(scale - s.std[used]) > _SLACK * s.std[used])
    if len(off):
        i, root = used[off[0]], scale[off[0]]
        raise InputError(f"{s.names[i]} has the standard error {s.std[i]:g}, and {root:g} in the covariance")
