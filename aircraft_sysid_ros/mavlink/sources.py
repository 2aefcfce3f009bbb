"""Which source of each quantity counts: live the best that has not been silent, of a whole log the best throughout."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.mavlink.held_values import Held
from aircraft_sysid_ros.mavlink.quantities import (
    CLEARLY_MORE,
    FIX_STATUS,
    NEEDED,
    Array,
    Quantity,
    Reading,
    Stamps,
    Table,
    rank,
)
from aircraft_sysid_ros.mavlink.servo_mapping import ServoMapping
from aircraft_sysid_ros.ros_messages.conversion import NO_FIX
from aircraft_sysid_ros.stamps import NANOSECONDS

OWN_POSITION = "GLOBAL_POSITION_INT"  # of the autopilot's filter
#: Source of airspeed in a calibration file: there is no sensor.
NO_AIRSPEED = "none"
SILENCE = 2.0  # [s] after which the next best source takes over
#: Sources of one quality, of which that counts in a log which has clearly more samples: PX4 logs its receivers once in
#: a second, and the position that it chose of them as often as it comes.
ALIKE = {"sensor_gps", "vehicle_gps_position"}, {"airspeed", "airspeed_validated"}
_DESCENT_AGE = 0.5  # [s] of a down velocity that a velocity without it takes


def check_sources(table: Table, mapping: ServoMapping, path: str | Path) -> None:
    """Raises InputError, with the name of the calibration file, for a source that a table does not have."""
    try:
        Sources(table, mapping)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


class Sources:
    """The sources of one table, best first, and of each quantity the one that counts."""

    def __init__(self, table: Table, mapping: ServoMapping) -> None:
        self._mapping = mapping
        self._ranks = {quantity: rank(table, quantity) for quantity in Quantity}
        if mapping.filtered_velocity:
            names = self._ranks[Quantity.VELOCITY]
            self._ranks[Quantity.VELOCITY] = tuple(sorted(names, key=lambda name: name != OWN_POSITION))
        named = _named_airspeed(table, mapping)
        if named is not None:
            self._ranks[Quantity.AIRSPEED] = (named,)
        # pressures only by name: their zero is whatever the autopilot took it to be
        self._ranks[Quantity.IMPACT_PRESSURE] = (named,) if named in self._ranks[Quantity.IMPACT_PRESSURE] else ()
        self._active: dict[Quantity, tuple[str, int]] = {}

    @property
    def _corrects_airspeed(self) -> bool:
        """Whether the calibration file has numbers for an airspeed: they are for the one that is preferred live."""
        mapping = self._mapping
        return (mapping.airspeed_meaning, mapping.airspeed_scale, mapping.airspeed_offset) != (None, 1.0, 0.0)

    def choose(self, readings: Sequence[Reading]) -> None:
        """A whole log is at hand: of each quantity the best source of it that says something, throughout.

        Not one that does for less than half as long as another. But for positions: where a receiver has no fix, what
        its autopilot makes of that is dead reckoning. And for an airspeed for which the calibration file has numbers.
        """
        descent = self._descent_of(readings)
        usable: dict[tuple[Quantity, str], Stamps] = {}
        for reading in readings:
            key = reading.quantity, reading.source
            usable[key] = np.append(usable.get(key, np.empty(0, np.int64)), _usable(reading, descent))
        own, fixes = (Quantity.VELOCITY, OWN_POSITION), _fixes(usable)
        if own in usable and len(fixes):
            usable[own] = usable[own][np.isin(usable[own] // NANOSECONDS, fixes // NANOSECONDS)]
        count = {key: len(stamp) for key, stamp in usable.items()}
        seconds = {key: _seconds(stamp) for key, stamp in usable.items()}
        for quantity, order in self._ranks.items():
            there = [name for name in order if (quantity, name) in usable]
            is_free = quantity is not Quantity.AIRSPEED or not self._corrects_airspeed
            if quantity is not Quantity.POSITION:
                longest = max((seconds[quantity, name] for name in there), default=0) if is_free else 1
                there.sort(key=lambda name: 2 * seconds[quantity, name] < longest)
            best = there[:1]
            for name in there[1:] if is_free else ():
                if {name, *best} in ALIKE and count[quantity, name] > CLEARLY_MORE * count[quantity, best[0]]:
                    best = [name]
            self._ranks[quantity] = tuple(best)

    def _descent_of(self, readings: Iterable[Reading]) -> Held:
        """The down velocity of the best source that a log has."""
        held = {name: Held() for name in self._ranks[Quantity.DESCENT]}
        for reading in readings:
            if reading.quantity is Quantity.DESCENT:
                held[reading.source].add(reading.stamp, reading.values, None)
        seconds = {name: _seconds(each.stamp) for name, each in held.items()}
        longest = max(seconds.values(), default=0)
        return next((held[name] for name in held if 2 * seconds[name] >= longest), Held())

    def source(self, quantity: Quantity) -> str | None:
        """The source that counts now."""
        chosen = self._active.get(quantity)
        return None if chosen is None else chosen[0]

    def counts(self, reading: Reading) -> bool:
        """Whether the reading's source is the one that counts: the best that has not been silent."""
        order = self._ranks[reading.quantity]
        if reading.source not in order:
            return False
        newest = int(reading.stamp[-1])
        active, heard = self._active.get(reading.quantity, (reading.source, newest))
        is_better = order.index(reading.source) <= order.index(active)
        if is_better or not -SILENCE <= (newest - heard) / NANOSECONDS <= SILENCE:
            self._active[reading.quantity] = (reading.source, newest)
            return True
        return False


def with_vertical(reading: Reading, descent: Held) -> Array:
    """Velocity NED (n, 3) [m/s] of a reading, its vertical part where it has none by what was held just before."""
    velocity = reading.values.copy()
    without = np.isnan(velocity[:, 2])
    velocity[without, 2] = descent.at(reading.stamp[without], _DESCENT_AGE)
    return velocity


def _named_airspeed(table: Table, mapping: ServoMapping) -> str | None:
    """The source of airspeed that the calibration file names, as the table has it.

    Raises InputError for none, and for an offset [m/s] of one that is a pressure.
    """
    named = mapping.airspeed_source
    if named is None or named.lower() == NO_AIRSPEED:
        return named
    known = (*rank(table, Quantity.AIRSPEED), *rank(table, Quantity.IMPACT_PRESSURE))
    found = next((name for name in known if name.lower() == named.lower()), None)
    if found is None:
        raise InputError(
            f"source: {named} of airspeed in the calibration file is not one of a log or link of this kind, which "
            f"may have {', '.join(known)}: name one of these, {NO_AIRSPEED}, or leave it out for the best that is "
            "there"
        )
    if mapping.airspeed_offset and found not in rank(table, Quantity.AIRSPEED):
        raise InputError(
            f"offset of airspeed in the calibration file is a speed, and {found} measures a pressure: leave the "
            "offset out, or name a source of airspeed"
        )
    return found


def _seconds(stamp: Stamps) -> int:
    """Seconds in which something was said."""
    return len(np.unique(stamp // NANOSECONDS))


def _fixes(usable: dict[tuple[Quantity, str], Stamps]) -> Stamps:
    """Stamps at which a receiver has a fix."""
    of_each = [
        stamp for (quantity, name), stamp in usable.items() if quantity is Quantity.POSITION and name != OWN_POSITION
    ]
    return np.concatenate(of_each) if of_each else np.empty(0, np.int64)


def _usable(reading: Reading, descent: Held) -> Stamps:
    """Stamps at which all that is needed is a number, of positions those with a fix, or of which nobody says.

    None of a velocity that lacks the vertical part of most, by ``descent`` too.
    """
    rows = np.all(np.isfinite(reading.values[:, : NEEDED.get(reading.quantity, 0)]), axis=1)
    if reading.quantity is Quantity.POSITION:
        rows = np.all(np.isfinite(reading.values[:, :2]), axis=1) & (reading.values[:, FIX_STATUS] != NO_FIX)
    if reading.quantity is Quantity.VELOCITY:
        whole = np.isfinite(with_vertical(reading, descent)).all(axis=1)
        rows &= 2 * whole.sum() >= len(reading.stamp)
    return reading.stamp[rows]
