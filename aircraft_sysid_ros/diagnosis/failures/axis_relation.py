"""One axis of a flight as a linear relation with residuals of a colour, and what an input does in it.

Residuals are not white: gusts and what the model lacks last for seconds. They are taken for autoregressive; the filter
that makes them white is applied to both sides (Cochrane and Orcutt), so that sums of squares say what they seem to.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.expression import parse_expression
from aircraft_sysid_ros.diagnosis.failures.coloured_fit import whitened_rows
from aircraft_sysid_ros.diagnosis.failures.force_balance import ForceBalance
from aircraft_sysid_ros.sensors.sensor_models import first_order_lag

Array = npt.NDArray[np.float64]

#: Time [s] that residuals remember.
MEMORY = 3.0
#: Signals that may stop acting, besides the named inputs.
INPUTS = ("de", "da", "dr", "flaps")
#: And the engine, by whichever of its signals is there.
ENGINE = "engine"
_ENGINE_SIGNALS = frozenset({"throttle", "Tc"})
#: What a flight may lack: the term is left out.
_PROXY_AXIS = {"CZ": "alpha", "CY": "beta"}
#: The motion that a balance of moments makes. Solved for it, with the acceleration on the other side, it is right where
#: noise of gyros, differentiated, is most of the acceleration; solved for the acceleration it is right where the motion
#: is that of gusts, or where lift stands for an angle of attack badly.
_MOTION = {"Cl": "p", "Cm": "alpha", "Cn": "beta"}
#: The rate of a turn, by axis, and the time [s] in whose mean it is one.
_TURN, _STEADY = {"Cl": "r", "Cm": "q", "Cn": "r"}, 2.0
#: Time constant [s] with which power follows a throttle, about.
_SPOOL = 1.0
#: Terms of C_X that any flight with changes of lift needs.
_POLAR = ("alpha", "alpha**2")
#: Thrust falls with speed and is not in proportion to the throttle.
_PROPELLER = ("Tc*V", "Tc*throttle")


@dataclass(frozen=True)
class Acting:
    """What one input does in an axis."""

    columns: tuple[int, ...]  # of the relation, that read it
    frozen: Array  # (n, len(columns)) the same with the input at its mean
    idle: Array  # (n, len(columns)) and at 0
    per_unit: Array  # (n, len(columns)) what a unit of the input changes
    mean: float  # of the input
    values: Array  # (n,) of the input


@dataclass(frozen=True)
class AxisRelation:
    """``response = columns @ parameters + residual``, all weighted."""

    axis: str
    response: Array  # (n,)
    columns: Array  # (n, k)
    texts: tuple[str, ...]
    acting: dict[str, Acting]
    lacking: tuple[str, ...]  # terms of the model whose signals the flight does not have


def relations_of(balance: ForceBalance, *, of_motion: bool = True) -> dict[str, AxisRelation]:
    """The axes of the model that the flight can judge; balances of moments are solved for motion or acceleration."""
    found = {}
    for axis in AXES:
        if axis in _PROXY_AXIS and _PROXY_AXIS[axis] not in balance.angles:
            continue
        relation = _relation(balance, axis, of_motion)
        if relation is not None:
            found[axis] = relation
    return found


def without_engine(balance: ForceBalance) -> AxisRelation:
    """C_X without what the throttle does, and the engine as a constant of it: thrust by the forces alone."""
    known = _relation(balance, "CX", of_motion=True)
    assert known is not None
    texts = [text for text in known.texts if not _ENGINE_SIGNALS & _signals(balance, text)]
    bias = 1.0 / balance.signal("qbar")
    columns = np.column_stack([balance.columns(texts), bias]) * balance.weight[:, None]
    nothing = np.empty((len(columns), 0))
    constant = Acting((), nothing, nothing, balance.weight[:, None], 0.0, input_values(balance, ENGINE))
    return AxisRelation("CX", known.response, columns, tuple(texts), {ENGINE: constant}, ())


def _relation(balance: ForceBalance, axis: str, of_motion: bool) -> AxisRelation | None:
    texts, lacking = _terms(balance, axis)
    if not texts:
        return None
    measured = balance.measured[:, AXES.index(axis)]
    response = measured
    extra: list[Array] = []
    if of_motion and axis in _MOTION:
        state = _MOTION[axis]
        reads = [t for t in texts if state in _signals(balance, t)]
        texts = [t for t in texts if t not in reads]
        response, extra = balance.signal(state), [measured]
    bias = 1.0 / balance.signal("qbar")  # of the accelerometer, in what is measured and in what stands for angles
    columns = np.column_stack([balance.columns(texts), *extra, bias])
    weight = balance.weight
    acting = {}
    for name in (*INPUTS, ENGINE, *balance.aircraft.model.inputs):
        found = _acting(balance, texts, name)
        if found is not None:
            acting[name] = found
    return AxisRelation(axis, response * weight, columns * weight[:, None], tuple(texts), acting, tuple(lacking))


def _terms(balance: ForceBalance, axis: str) -> tuple[list[str], list[str]]:
    """Terms that can be read, those of C_X with the polar and the thrust, and those that cannot."""
    model = balance.aircraft.model
    listed = list(model.terms[axis])
    if not listed:
        return [], []
    if axis == "CX":
        listed += [text for text in _POLAR if text not in listed]
        thrust = {"throttle", "Tc"} & {s for t in listed for s in _signals(balance, t) if _is_there(balance, s)}
        unnamed = not any(_signals(balance, t) & set(model.inputs) for t in listed)
        if not thrust and unnamed and _is_there(balance, "Tc"):
            listed.append("Tc")
        if "Tc" in listed and _is_there(balance, "throttle"):
            listed += [text for text in _PROPELLER if text not in listed]
    kept = [t for t in listed if all(_is_there(balance, s) for s in _signals(balance, t))]
    kept = [t for t in kept if t == "1" or _varies(balance.columns([t])[:, 0])]
    lacking = [t for t in listed if t not in kept]
    return (kept, lacking) if kept else ([], lacking)


def _varies(values: Array) -> bool:
    return bool(np.isfinite(values).all() and np.ptp(values) > 1e-9)


def _signals(balance: ForceBalance, text: str) -> frozenset[str]:
    return parse_expression(text, balance.aircraft.model.inputs).signals


def _is_there(balance: ForceBalance, name: str) -> bool:
    return bool(np.isfinite(balance.signal(name)).all())


def _acting(balance: ForceBalance, texts: list[str], name: str) -> Acting | None:
    """What an input does in some terms; None where it does nothing or stands still."""
    read_by = _ENGINE_SIGNALS if name == ENGINE else frozenset({name})
    at = [j for j, text in enumerate(texts) if read_by & _signals(balance, text)]
    if not at:
        return None
    values = input_values(balance, name)
    mean, spread = float(np.mean(values)), float(np.std(values))
    if not spread > 1e-6:
        return None
    read = [texts[j] for j in at]
    made = [
        balance.columns(read, _held(balance, name, level)) * balance.weight[:, None]
        for level in (mean, mean + spread, 0.0)
    ]
    return Acting(tuple(at), made[0], made[2], (made[1] - made[0]) / spread, mean, values)


def with_turns(relation: AxisRelation, balance: ForceBalance) -> AxisRelation:
    """The relation with a derivative of its own for the rate of a steady turn.

    That is not the one of quick motion where lift stands for the angle of attack, or where a log has smoothed.
    """
    from scipy.ndimage import gaussian_filter1d

    if relation.axis not in _TURN:
        return relation
    turn = gaussian_filter1d(balance.signal(_TURN[relation.axis]), _STEADY / balance.step) * balance.weight
    return replace(relation, columns=np.column_stack([relation.columns, turn]))


def with_power(relation: AxisRelation, balance: ForceBalance) -> AxisRelation:
    """The relation with a moment that comes with the throttle, as slowly as an engine does, and not in proportion.

    Thrust off the axis, engines that are unlike, a slipstream: what is there at full power only is no change in time.
    """
    throttle = balance.signal("throttle")
    if not np.isfinite(throttle).all():
        return relation
    power = first_order_lag(balance.time, throttle[:, None], _SPOOL)
    return replace(relation, columns=np.column_stack([relation.columns, power, power**2]))


def with_bend(relation: AxisRelation, name: str, balance: ForceBalance) -> AxisRelation:
    """The relation with what an input does bent, at 0 and further out: a surface may do more to one side.

    Without such an input it stays as it is.
    """
    acting = relation.acting.get(name)
    if acting is None:
        return relation
    weight, spread = balance.weight[:, None], float(np.std(acting.values))
    bent, frozen = (weight * _bent(values) for values in (acting.values, acting.mean))
    per_unit = weight * (_bent(acting.mean + spread) - _bent(acting.mean)) / spread
    columns = np.column_stack([relation.columns, bent])
    new = range(relation.columns.shape[1], columns.shape[1])
    changed = replace(
        acting, columns=(*acting.columns, *new), frozen=np.column_stack([acting.frozen, frozen]),
        idle=np.column_stack([acting.idle, np.zeros_like(frozen)]),
        per_unit=np.column_stack([acting.per_unit, per_unit]),
    )  # fmt: skip
    return replace(relation, columns=columns, acting={**relation.acting, name: changed})


def _bent(values: Array | float) -> Array:
    """Values (n,) or one, bent (…, 2)."""
    size = np.abs(values)
    return np.stack([size, values * size], axis=-1)


def input_values(balance: ForceBalance, name: str) -> Array:
    """An input (n,); of the engine the throttle, or else the thrust in units of the mean dynamic pressure."""
    if name != ENGINE:
        return balance.signal(name)
    throttle = balance.signal("throttle")
    return throttle if np.isfinite(throttle).all() else balance.signal("Tc") * balance.weight


def _held(balance: ForceBalance, name: str, level: float) -> Array:
    """The signals with an input that stands still."""
    signals, index = balance.signals.copy(), balance.aircraft.model.signal_names.index
    if name != ENGINE:
        signals[:, index(name)] = level
        return signals
    if not np.isfinite(balance.signal("throttle")).all():
        signals[:, index("Tc")] = level / balance.weight
        return signals
    signals[:, index("throttle")] = level
    if np.isfinite(balance.full_thrust).all():
        signals[:, index("Tc")] = level * balance.full_thrust
    return signals


def whitened(values: Array, filtering: Array) -> Array:
    """Series (n, …) through the filter, without its beginning."""
    rows = np.ascontiguousarray(values.reshape(len(values), int(np.prod(values.shape[1:]))).T, np.float64)
    found = whitened_rows(rows, filtering)
    return found.T.reshape(found.shape[1], *values.shape[1:])
