"""Back to the autopilot: the wind as WIND_COV, and chosen parameters, not faster than the link can bear."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aircraft_sysid_ros.mavlink.back_options import ARRAY_LENGTH, NAME_LENGTH, BackOptions
from aircraft_sysid_ros.stamps import NANOSECONDS

ARRAY_NAME = "SYSID"
#: [ms] 49.7 days: more a message cannot hold.
_WRAP = 2**32
#: Id of the array with the values, and of that with their standard errors.
VALUES_ARRAY, ERRORS_ARRAY = 1, 2


@dataclass(frozen=True)
class Wind:
    """Wind NED (3,) [m/s], the direction the air moves to, its variances (3,) and the altitude [m] (NaN: not known)."""

    velocity: tuple[float, float, float]
    variance: tuple[float, float, float]
    altitude: float = float("nan")


@dataclass(frozen=True)
class Known:
    """One parameter; ``usable`` is its status USE."""

    name: str
    value: float
    std: float
    usable: bool


class BackChannel:
    """The newest wind and parameters, and what of them is due."""

    def __init__(self, options: BackOptions | None = None) -> None:
        self.options = options or BackOptions()
        self.wind: Wind | None = None
        self.parameters: Sequence[Known] = ()
        self.sent = 0
        self._wind_due = self._parameters_due = 0

    def due(self, now: int, boot: int | None) -> list[Any]:
        """Messages to send now [ns]; ``boot`` is the autopilot's time [ns], 0 in the messages while it is not known.

        What was sent is sent again only when it came anew.
        """
        messages: list[Any] = []
        if self.wind is not None and self.options.wind_rate > 0.0 and now >= self._wind_due:
            self._wind_due = now + round(NANOSECONDS / self.options.wind_rate)
            messages.append(_wind_message(self.wind, boot or 0))
            self.wind = None
        if self.parameters and self.options.parameter_rate > 0.0 and now >= self._parameters_due:
            self._parameters_due = now + round(NANOSECONDS / self.options.parameter_rate)
            messages += self._parameter_messages(boot or 0)
            self.parameters = ()
        self.sent += len(messages)
        return messages

    def clock_was_set(self) -> None:
        """Our clock was set: what is new is due."""
        self._wind_due = self._parameters_due = 0

    def _parameter_messages(self, boot: int) -> list[Any]:
        """Values that may be used; an array has NaN for those that may not."""
        by_name = {p.name: p for p in self.parameters}
        wanted = [by_name.get(name, Known(name, np.nan, np.nan, False)) for name in self.options.parameters]
        if self.options.form == "named":
            return [
                dialect.MAVLink_named_value_float_message(
                    boot // 1_000_000 % _WRAP, p.name[:NAME_LENGTH].encode(), p.value
                )
                for p in wanted
                if p.usable
            ]
        columns = {
            VALUES_ARRAY: [p.value if p.usable else np.nan for p in wanted],
            ERRORS_ARRAY: [p.std if p.usable else np.nan for p in wanted],
        }
        return [
            dialect.MAVLink_debug_float_array_message(
                boot // 1000, ARRAY_NAME.encode(), number, values + [0.0] * (ARRAY_LENGTH - len(values))
            )
            for number, values in columns.items()
        ]


def _wind_message(wind: Wind, boot: int) -> Any:
    """WIND_COV: its var_ fields are the variability of the wind; what is known of it are the accuracies, one sigma."""
    north, east, down = wind.velocity
    level, vertical = np.sqrt(0.5 * (wind.variance[0] + wind.variance[1])), np.sqrt(wind.variance[2])
    return dialect.MAVLink_wind_cov_message(
        boot // 1000, north, east, down, np.nan, np.nan, wind.altitude, float(level), float(vertical)
    )
