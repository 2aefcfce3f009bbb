"""A candidate that is significant, with its evidence, and the rules of size by which it is a verdict."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import numpy as np

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.search.candidates import TIMES_OF_CHANGE, limits
from aircraft_sysid_ros.diagnosis.search.evaluator import Score, errors_of, log_ratio, size_of
from aircraft_sysid_ros.diagnosis.search.fit import Gain
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.effects.aliases import aliases_of
from aircraft_sysid_ros.identification.conditions import listed

#: A number so near to a limit of its own, as a share of the room, is at it.
_EDGE = 0.02
#: Axes whose model reads a signal of the air data.
_RESTING = {"V": AXES, "alpha": ("CX", "CZ", "Cm"), "beta": ("CY", "Cl", "Cn")}


@dataclass(frozen=True)
class NestedValidation:
    """What is named without a part of the flight, part by part, and the error on these parts."""

    names: tuple[str, ...]  # families; empty: nothing
    error: float  # NRMSE of the main axis of what was named on the whole flight


@dataclass(frozen=True)
class Finding:
    """A significant candidate, with its evidence."""

    trial: Score
    flight: FlightData = field(repr=False)  # under the model that lacks it: with what was found before
    excess: float  # of the score over that in replicas
    evidence: float  # the same in standard deviations over replicas
    p_value: float  # allowing for the number of candidates
    size: float  # share of the held-out rms error of its main axis, before anything was found, that goes
    above_floor: float  # error of its main axis without it, over that of the replicas
    confounded_with: tuple[str, ...] = ()
    blocks: tuple[int, ...] = ()  # numbers of the blocks of time that hold most of the evidence
    outdone_by: str = ""  # what explains clearly more of its main axis, but is ruled out by its own physics
    amid: tuple[str, ...] = ()  # axes on which it does not act and of which most is left
    #: By axis the term that explains most of what the effect leaves since it has another shape, if that has size.
    shape: Mapping[str, str] = field(default_factory=dict)
    nested: NestedValidation | None = None  # of what is named in a search of the flight
    late_vane: float = np.nan  # [s] by how much a vane that nobody has described may be late instead; NaN: it may not
    told_by: str = ""  # in words, of what is no held-out error of the whole flight

    @property
    def matters(self) -> bool:
        """It has size, moves the coefficient, and explains more than its numbers cost."""
        return not self._weakness

    @property
    def _weakness(self) -> str:
        """The first rule of size that refuses it, in words; empty where none does."""
        gain = self.trial.gains[self.trial.main_axis]
        moved = np.sqrt(max(gain.nrmse_before**2 - gain.nrmse_after**2, 0.0))
        if impossible := self.impossible:
            return impossible
        if self._must_show_in and not self._shown:
            return f"it cannot be seen in {self._must_show_in}, where it must show"
        if self.outdone_by:
            return f"{self.outdone_by} explains clearly more, but is ruled out too: the cause is something else"
        if np.isfinite(self.late_vane):
            way = "late" if self.late_vane > 0.0 else "early"
            return (
                f"a vane that is {1e3 * abs(self.late_vane):.0f} ms {way} explains it as well, and the "
                "vane is not described: give its delay under sensors of the aircraft file"
            )
        if self.size < THRESHOLDS.size:
            axis = self.trial.main_axis
            return f"that is less than {THRESHOLDS.size:.0%} of the error that {axis[0]}_{axis[1]} had at first"
        if moved < THRESHOLDS.least_moved:
            return f"it moves the coefficient by less than {THRESHOLDS.least_moved:.0%} of its spread"
        if self.above_floor < THRESHOLDS.above_floor:
            return f"the error is only {self.above_floor:.2g} times its noise"
        if len(self.amid) >= THRESHOLDS.left_axes and self._share_above_noise() < THRESHOLDS.left_share:
            return (
                f"it explains only {self._share_above_noise():.0%} of the error above the noise, while most of "
                f"{listed([f'{axis[0]}_{axis[1]}' for axis in self.amid])} is unexplained: replicas of a model this "
                "wrong say little about chance"
            )
        return "" if self.excess > self.trial.price else "it explains no more than its parameters cost"

    @property
    def impossible(self) -> str:
        """Why its physics rules it out, in words; empty where it does not."""
        shown = self._shown
        if shown and max(shown) < 0.5 * THRESHOLDS.size:
            return f"it does not show in {self._must_show_in}, where it must show"
        if wrong := self._wrong_sign:
            return f"its part of {wrong[0]}_{wrong[1]} has an impossible sign"
        if wrong := self._out_of_range:
            return f"its derivative of {wrong[0]}_{wrong[1]} is outside its possible range"
        if len(edges := self._at_edges) > 1:
            return f"its {listed(edges)} are at their limits: it is something else that resembles it"
        if self._has_wrong_share:
            return "its share of the effect of the surface has an impossible sign"
        return ""

    @property
    def _must_show_in(self) -> str:
        """The axes where its physics cannot be absent, in words."""
        return " and ".join(f"{axis[0]}_{axis[1]}" for axis in self.trial.candidate.shows_in)

    @property
    def _shown(self) -> list[float]:
        """Share of the error of each of these axes that goes, where the flight can judge it."""
        gains = self.trial.gains
        return [size_of(gains[axis]) for axis in self.trial.candidate.shows_in if axis in gains]

    @property
    def _wrong_sign(self) -> str:
        """The first axis in which the mean of what it adds has not the sign that its physics gives; empty: none has."""
        trial, effect = self.trial, self.trial.candidate.effect
        for axis, sign in effect.signs.items() if effect else ():
            if axis in trial.gains:
                columns = self.flight.columns(self.flight.parsed(trial.candidate.terms[axis]))
                if sign * np.nanmean(columns @ np.nan_to_num(trial.gains[axis].parameters)) < 0.0:
                    return axis
        return ""

    @property
    def _out_of_range(self) -> str:
        """The first axis, of those in which it shows, whose derivative is beyond what physics gives; empty: none is."""
        trial, effect = self.trial, self.trial.candidate.effect
        for axis, (low, high) in effect.ranges.items() if effect else ():
            gain = trial.gains.get(axis)
            shown = gain is not None and (axis == trial.main_axis or size_of(gain) >= 0.5 * THRESHOLDS.size)
            if gain is not None and shown and not low <= float(gain.parameters[0]) <= high:
                return axis
        return ""

    @property
    def _at_edges(self) -> list[str]:
        """Names of its inner numbers, of those that are no times, that are at a limit of theirs."""
        effect, values = self.trial.candidate.effect, dict(self.trial.candidate.inner)
        numbers = [n for n in effect.inner if n.name in values and n.name not in TIMES_OF_CHANGE] if effect else []
        found = []
        for number in numbers:
            low, high = limits(number, self.flight)
            share = (values[number.name] - low) / max(high - low, 1e-12)
            found += [number.name] if min(share, 1.0 - share) < _EDGE else []
        return found

    @property
    def _has_wrong_share(self) -> bool:
        """Whether its share of a surface's derivative has the wrong sign in its main axis: it leads, or makes more.

        A surface that an autopilot moves against the motion tells of it: in gusts what is late seems to lead.
        """
        effect, axis = self.trial.candidate.effect, self.trial.main_axis
        ties = self.trial.candidate.ties.get(axis, ())
        if effect is None or not effect.share_sign or not ties:
            return False
        gain = self.trial.gains[axis]
        derivative = dict(zip(gain.fit.names, gain.fit.parameters, strict=True)).get(ties[0].of, 0.0)
        return bool(effect.share_sign * derivative * gain.parameters[0] < 0.0)

    def refusal(self, first: bool) -> str:
        """Why it is no verdict, in words; empty where nothing but what was found before it is in the way."""
        if self._weakness:
            return self._weakness
        if self.is_unsure and self.nested is not None:  # it was sure enough to be chosen again
            return (
                f"chosen again with each quarter of the flight left out, it comes in {self.times_again} of "
                f"{len(self.nested.names)}"
            )
        level = THRESHOLDS.verdict if first else THRESHOLDS.further
        return f"chance explains as much (p = {self.p_value:.2g})" if self.p_value >= level else ""

    def is_again(self, family: str) -> bool:
        """Whether a family is this one, what the flight cannot tell from it, or what differs from it by name only.

        What no effect of the library has goes by its axis: of many expressions another one is the best in each part.
        """
        candidate = self.trial.candidate
        alike = {candidate.family, *self.confounded_with, *aliases_of(candidate.family)}
        return family in alike or (candidate.effect is None and f"{self.trial.main_axis}:" in family)

    @property
    def not_told_from(self) -> tuple[str, ...]:
        """Families that this flight cannot tell from it, and those of its name in parts of the flight."""
        names = self.nested.names if self.nested is not None else ()
        own, known = self.trial.candidate.family, aliases_of(self.trial.candidate.family)
        return tuple(dict.fromkeys([*self.confounded_with, *(name for name in names if name in known and name != own)]))

    @property
    def times_again(self) -> int:
        """In how many parts of the nested validation it comes again."""
        return 0 if self.nested is None else sum(map(self.is_again, self.nested.names))

    @property
    def comes_again(self) -> bool:
        """Whether it comes again in most of the parts."""
        return self.nested is not None and self.times_again > THRESHOLDS.again * len(self.nested.names)

    @property
    def is_unsure(self) -> bool:
        """Whether it was chosen, and does not come again."""
        return self.nested is not None and not self.comes_again

    def _share_above_noise(self) -> float:
        """Share of the variance of what is left of its main axis, beyond that of the replicas, that goes."""
        goes = 1.0 - (1.0 - size_of(self.trial.gains[self.trial.main_axis])) ** 2
        return goes / max(1.0 - self.above_floor**-2.0, goes)

    def lowers_the_error(self) -> bool:
        """Whether what is left falls as ``add`` adds it: the search has shapes of what was found before besides."""
        before, after = errors_of(self.flight, self.trial, self.trial.main_axis)
        return after <= (1.0 - THRESHOLDS.size) * before


def resting_on(inferred: Collection[str]) -> set[str]:
    """Axes that rest on signals of the air data that no sensor measures."""
    return {axis for name in inferred for axis in _RESTING[name]}


def explains_more(outside: Score, inside: Score) -> bool:
    """An expression explains clearly more than an effect: in some axis where it has size, and in all."""
    if outside.score - outside.price <= inside.score - inside.price + max(
        THRESHOLDS.preference, THRESHOLDS.preference_share * inside.score
    ):
        return False
    return any(clearly_more(gain, inside.gains.get(axis)) for axis, gain in outside.gains.items())


def clearly_more(gain: Gain, other: Gain | None) -> bool:
    """Whether what is gained in an axis has size, and another one gains clearly less there."""
    if size_of(gain) < THRESHOLDS.size:
        return False
    if other is None:
        return True
    return (
        explained(other) < THRESHOLDS.enough * explained(gain)
        or log_ratio(gain) > log_ratio(other) + THRESHOLDS.clearly
    )


def is_simpler(other: Finding, named: Finding) -> bool:
    """Whether a rival explains more of the axis of what is named with fewer numbers.

    What is there explains its own axis best. What has more numbers may explain more in all, since it stands for a
    second effect in another axis as well.
    """
    gain, axis = other.trial.gains.get(named.trial.main_axis), named.trial.main_axis
    if gain is None or other.trial.candidate.numbers >= named.trial.candidate.numbers:
        return False
    return log_ratio(gain) > log_ratio(named.trial.gains[axis]) + THRESHOLDS.preference


def explained(gain: Gain) -> float:
    """Share of the held-out sum of squares that goes."""
    return 1.0 - float(np.sum(gain.after)) / float(np.sum(gain.before))


def share_of_first(gain: Gain, now: float, first: float) -> float:
    """Share of the error that an axis had at first that goes; ``now`` is what it has now."""
    return size_of(gain) * min(now / first, 1.0) if first > 0.0 else 0.0
