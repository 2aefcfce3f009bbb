"""What an effect is: a physical cause that a model may lack, as data.

An effect in the forces and moments is terms per axis: ``C_axis += sum_j value_j * term_j``. A term is an
expression over the signals of ``aircraft.expression`` in which ``{name}`` stands for an inner number (a stall
onset, the time of a change), ``{CZ}`` for what the present model says of that coefficient, so that a change
of mass or of the centre of gravity is a term as well, and ``{CZ_alpha}`` for its slope in that signal. An effect in
the measurement is a change of one number of the aircraft file that says how a sensor measures. With either, the model
stays an aircraft file: a new version is a new file.

Several variants (the elevator, the aileron or the rudder is damaged) share one name; the best one counts.
"""

from __future__ import annotations

import copy
import string
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict
from aircraft_sysid_ros.aircraft.expression import parse_expression
from aircraft_sysid_ros.aircraft.sensor_settings import SENSOR_GROUPS, by_name
from aircraft_sysid_ros.aircraft.signals import SURFACE_WORDS

AERODYNAMIC, CHANGE, MEASUREMENT = "aerodynamic", "change in flight", "measurement"
KINDS = (AERODYNAMIC, CHANGE, MEASUREMENT)

#: Axes of what changes lift, drag and the pitching moment.
LONGITUDINAL = ("CZ", "CX", "Cm")
#: Ranges of inner numbers that come from the flight: the time of the flight, a signal that is in it.
OF_TIME = "time"
#: What is there from the inner number t0 on, what is there from t0 to t1, and what grows from t0 on and stays as it is
#: from ``full`` on.
STEP = "max(sign(time-{t0}),0)"
PULSE = "(max(sign(time-{t0}),0)-max(sign(time-{t1}),0))"
RAMP = "min(max((time-{t0})/({full}-{t0}),0),1)"


@dataclass(frozen=True)
class ShapeParameter:
    """A number inside an effect that is fitted too: tried on ``count`` values between two limits, then refined.

    ``signal`` names a signal of the flight whose range limits the number, so that nothing is tried where no
    data are; low and high are then shares of that range (0.5 is its middle).
    """

    name: str
    unit: str
    low: float
    high: float
    count: int = 9
    signal: str | None = None


#: When a change begins, when one that does not stay ends, and when one that takes its time is complete.
BEGIN = ShapeParameter("t0", "s", 0.08, 0.92, 22, OF_TIME)
END = ShapeParameter("t1", "s", 0.08, 0.98, 22, OF_TIME)
FULL = ShapeParameter("full", "s", 0.08, 0.98, 22, OF_TIME)


@dataclass(frozen=True)
class Tie:
    """What a term's parameter is: a number of the effect, times a factor, times ``of``, which is a derivative of the
    present model to a surface, such as "Cm_de", or CHORD_BY_SPAN.
    """

    number: int
    factor: float = 1.0
    of: str = ""


#: The one length ratio of ties: mean chord over span.
CHORD_BY_SPAN = "chord/span"


@dataclass(frozen=True)
class Variant:
    """One form of an effect: terms by axis, or a key of the aircraft file that changes.

    ``ties`` of every term, by axis, where the terms have fewer numbers than parameters; without them each has its own.
    """

    name: str = ""
    terms: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    #: Key of the aircraft file, such as ("sensors", "sideslip", "scale"), that the inner number changes.
    setting: tuple[str, ...] = ()
    ties: Mapping[str, tuple[Tie, ...]] = field(default_factory=dict)
    #: Its inner numbers, where they are not those of the effect.
    inner: tuple[ShapeParameter, ...] = ()

    @property
    def numbers(self) -> int:
        """How many numbers its terms have, besides inner ones."""
        if not self.ties:
            return sum(len(terms) for terms in self.terms.values())
        return 1 + max(tie.number for ties in self.ties.values() for tie in ties)

    @property
    def passing(self) -> Variant | None:
        """The same change, undone at a time t1; None of what is no change."""
        return self._in_time(PULSE)

    @property
    def growing(self) -> Variant | None:
        """The same change, complete at a time ``full``, as of fuel that is moved; None of what is no change."""
        return self._in_time(RAMP)

    def _in_time(self, course: str) -> Variant | None:
        if not all(term.startswith(STEP) for term in _terms(self.terms.values())) or not self.terms:
            return None
        terms = {axis: tuple(term.replace(STEP, course) for term in terms) for axis, terms in self.terms.items()}
        return replace(self, terms=terms)


@dataclass(frozen=True)
class Domain:
    """Where an effect acts at all: a flight that never gets there cannot have it, whatever fits."""

    signal: str
    low: float = -np.inf
    high: float = np.inf
    in_spans: bool = False  # limits are shares of the span


@dataclass(frozen=True)
class Effect:
    """A physical effect in the words of flight dynamics."""

    identifier: str
    name: str
    kind: str
    physics: str  # two plain sentences
    source: str
    formula: str
    variants: tuple[Variant, ...]
    residuals: str  # what it looks like in the residuals
    manoeuvre: str  # which manoeuvre shows it
    inner: tuple[ShapeParameter, ...] = ()
    domain: Domain | None = None
    #: Axes of which it must explain a part to be what it says: flow that separates loses lift. Where none of them is
    #: judged (ice, in a flight whose thrust nobody recorded) it is not named.
    shows_in: tuple[str, ...] = ()
    #: Signs of its mean part by axis where physics leaves no choice: flow that separates takes lift away, C_Z is down.
    signs: Mapping[str, float] = field(default_factory=dict)
    #: Sign of its share of a surface's derivative where physics leaves no choice: what comes late does not lead, and
    #: what is lost of a surface does not make it stronger.
    share_sign: float = 0.0
    #: Lowest and highest value of its derivative by axis, where physics bounds it.
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    #: It begins beyond the usual angles of attack, with its inner number "onset" less the "width" where it has one: a
    #: wing whose flow has left it in half of a flight is no wing that stalls.
    beyond_ordinary: bool = False
    #: Where another one explains as much with as many numbers, that one is named.
    rare: bool = False
    #: A change that may take minutes: fuel is moved, a load runs out. Others happen at once.
    takes_time: bool = False
    #: Of an effect in the measurement, what it makes of coefficients that are told by what the sensor shows; the one
    #: number of its terms is the value of the setting.
    in_coefficients: Variant | None = None

    def setting_number(self, variant: Variant) -> ShapeParameter:
        """The number that a setting of an effect in the measurement is."""
        return (variant.inner or self.inner)[0]

    @property
    def as_terms(self) -> Effect | None:
        """The same as an effect in forces and moments; None of what they do not show."""
        if self.in_coefficients is None:
            return None
        return replace(self, variants=(self.in_coefficients,), inner=(), in_coefficients=None)

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes that any variant enters."""
        found = {axis: None for variant in self.variants for axis in variant.terms}
        return tuple(found)

    @property
    def reads(self) -> tuple[str, ...]:
        """Axes whose present model stands in a term or a tie."""
        terms = (term for variant in self.variants for term in _terms(variant.terms.values()))
        read = [name for term in terms for name in placeholders(term)]
        read += [tie.of[:2] for variant in self.variants for ties in variant.ties.values() for tie in ties if tie.of]
        return tuple(dict.fromkeys(name[:2] for name in read if name[:2] in AXES))

    @property
    def signals(self) -> frozenset[str]:
        """Signals that every variant needs, besides those of the model."""
        needed = self.signals_by_variant
        return frozenset.intersection(*needed) if needed else frozenset()

    @property
    def signals_by_variant(self) -> list[frozenset[str]]:
        """Signals that each variant needs, besides those of the model."""
        return [_signals_of(variant) for variant in self.variants]


def surface(name: str, axes: Iterable[str], terms: Iterable[str], besides: Iterable[str] = ()) -> Variant:
    """What becomes of one surface (elevator, aileron, rudder): the same shares of its part in all of its axes.

    Each term has one number, which multiplies the derivative C_axis,δ of the present model. ``besides``: axes in which
    it has another, since what is lost of a rudder's height or of one side has an arm of its own.
    """
    words, listed = name.split(",", 1)[0], tuple(terms)
    symbol = next(signal for signal, named in SURFACE_WORDS.items() if named == words)
    ties = {axis: tuple(Tie(k, of=f"{axis}_{symbol}") for k in range(len(listed))) for axis in axes}
    for n, axis in enumerate(besides, 1):
        ties[axis] = tuple(Tie(n * len(listed) + k) for k in range(len(listed)))
    return Variant(name, dict.fromkeys(ties, listed), ties=ties)


@lru_cache(maxsize=4096)
def placeholders(term: str) -> tuple[str, ...]:
    """Names in braces of a term, in order."""
    return tuple(name for _, name, _, _ in string.Formatter().parse(term) if name)


def fill(term: str, values: Mapping[str, float | str]) -> str:
    """The term with numbers and texts in place of its braces, in brackets so that signs and powers hold."""
    read = {name: values[name] for name in placeholders(term)}
    shown = {k: f"({v})" if isinstance(v, str) else f"({v:.6g})" for k, v in read.items()}
    return term.format(**shown)


def with_setting(aircraft: Aircraft, setting: tuple[str, ...], value: float, std: float = 0.0) -> Aircraft:
    """The aircraft with one number of its file changed, as a measurement effect does; ``std``: one sigma of a number
    that was found, 0: it is as it is said.

    A position such as ("imu_position", "x") is moved by value * span [m]; anything else, such as
    ("sensors", "air_data", "delay") or ("process_noise", "wind"), becomes the value. Raises InputError where the
    file may not hold it. What nobody has said, nobody has said then.
    """
    source = copy.deepcopy(aircraft.source)
    if setting[0].endswith("_position"):
        at = "xyz".index(setting[1])
        source[setting[0]] = [*(source.get(setting[0]) or [None] * 3)]
        source[setting[0]][at] = float(getattr(aircraft, setting[0])[at] + value * aircraft.span)
    else:
        if setting[0] == "sensors":
            source["sensors"] = by_name(source.get("sensors"))
        for name in SENSOR_GROUPS.get(setting[1], (setting[1],)):
            place = source
            for key in (setting[0], name)[: len(setting) - 1]:
                place[key] = dict(place.get(key) or {})
                place = place[key]
            place[setting[-1]] = f"{value:.4g} ± {std:g}" if std else float(value)
    return replace(aircraft_from_dict(source), unsaid=aircraft.unsaid)


def _signals_of(variant: Variant) -> frozenset[str]:
    used: set[str] = set()
    for term in _terms(variant.terms.values()):
        neutral = dict.fromkeys(placeholders(term), 0.5)
        used |= parse_expression(fill(term, neutral)).signals
    return frozenset(used)


def _terms(lists: Iterable[tuple[str, ...]]) -> Iterator[str]:
    for terms in lists:
        yield from terms
