"""Which messages are asked for, how often, and what to do when they do not come."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.mavlink import esc_status
from aircraft_sysid_ros.stamps import NANOSECONDS


@dataclass
class Wish:
    """Messages one of which is wanted, best first, at a rate [Hz]."""

    names: tuple[str, ...]
    rate: float
    #: Stream of REQUEST_DATA_STREAM that has them, for autopilots that know no intervals.
    stream: int
    asked: int = 0
    due: int = 0  # [ns] when to look again
    wait: float = 0.0  # [s] from the last look to that
    heard: int = 0  # messages since then
    last: int = field(default=-(10**18))  # [ns] when one came


_RAW, _EXTENDED, _SERVOS, _POSITION = 1, 2, 3, 6
_EXTRA1, _EXTRA2, _EXTRA3 = 10, 11, 12
DEFAULT_WISHES: tuple[tuple[tuple[str, ...], float, int], ...] = (
    (("HIGHRES_IMU", "SCALED_IMU", "RAW_IMU"), 100.0, _RAW),
    (("GPS_RAW_INT",), 10.0, _EXTENDED),
    (("GLOBAL_POSITION_INT",), 25.0, _POSITION),
    (("SCALED_PRESSURE",), 10.0, _RAW),
    (("AIRSPEED", "VFR_HUD"), 25.0, _EXTRA2),
    (("SERVO_OUTPUT_RAW", "ACTUATOR_OUTPUT_STATUS"), 50.0, _SERVOS),
    (("ATTITUDE_QUATERNION", "ATTITUDE"), 10.0, _EXTRA1),
    (("AOA_SSA",), 50.0, _EXTRA1),
    (("RPM", "ESC_STATUS", "ESC_TELEMETRY_1_TO_4"), 10.0, _EXTRA3),
    (("WIND_COV", "WIND"), 1.0, _EXTRA3),
    (("SYSTEM_TIME",), 1.0, _EXTRA3),
    (("SYS_STATUS",), 1.0, _EXTENDED),
)
FIRST_LOOK, LONGEST_LOOK = 1.0, 60.0  # [s] between looks; longer each time that nothing came
#: Less than this share of the rate counts as not coming: the link loses some.
ENOUGH = 0.25


class Requests:
    """Wishes of one vehicle; ``due`` gives the messages to send now."""

    def __init__(self, rates: Mapping[str, float] | None = None) -> None:
        rates = dict(rates or {})
        self.wishes = [_with_rates(names, rate, stream, rates) for names, rate, stream in DEFAULT_WISHES]
        for name, rate in rates.items():  # what nobody has thought of
            self.wishes.append(Wish((name,), rate, 0))
        self.wishes = [wish for wish in self.wishes if wish.rate > 0.0]
        for wish in self.wishes:
            for name in wish.names:
                message_id(name)
        self._of_name = {name: wish for wish in self.wishes for name in wish.names}
        self.knows_intervals = False

    def heard(self, name: str, now: int) -> None:
        """A message came."""
        wish = self._of_name.get(name)
        if wish is not None:
            wish.heard += 1
            wish.last = now

    def acknowledged(self, command: int, result: int) -> None:
        """The answer to a command: one interval that was accepted tells that streams need not be asked for."""
        if command == dialect.MAV_CMD_SET_MESSAGE_INTERVAL and result == dialect.MAV_RESULT_ACCEPTED:
            self.knows_intervals = True

    def start(self, now: int) -> None:
        """Ask for everything anew: a vehicle was found, or it started again."""
        for wish in self.wishes:
            wish.asked, wish.due, wish.heard = 0, now, 0

    def clock_was_set(self, by: int) -> None:
        """Our clock was set by so much [ns]."""
        for wish in self.wishes:
            wish.due, wish.last = wish.due + by, wish.last + by

    def due(self, now: int, system: int, component: int) -> list[Any]:
        """Requests to send now [ns] to a vehicle."""
        messages: list[Any] = []
        for wish in self.wishes:
            if now < wish.due:
                continue
            if wish.asked and wish.heard >= ENOUGH * wish.rate * wish.wait:
                wish.asked, wish.wait = 1, FIRST_LOOK
            else:
                wish.wait = min(FIRST_LOOK * 2.0 ** max(wish.asked - 2, 0), LONGEST_LOOK)
                messages += _questions(wish, system, component)
                if wish.asked >= 2 and wish.stream and not self.knows_intervals:
                    messages.append(self._stream(wish.stream, system, component))
                wish.asked += 1
            wish.due, wish.heard = now + round(wish.wait * NANOSECONDS), 0
        return messages

    def _stream(self, number: int, system: int, component: int) -> Any:
        """Request of a stream, at the highest rate of what is in it: it sets the rate of all."""
        rate = max(round(wish.rate) for wish in self.wishes if wish.stream == number)
        return dialect.MAVLink_request_data_stream_message(system, component, number, max(rate, 1), 1)


def message_id(name: str) -> int:
    """Number of a message; raises InputError for a name that MAVLink does not have."""
    esc_status.register()
    number = getattr(dialect, f"MAVLINK_MSG_ID_{name}", None)
    if number is None:
        raise InputError(f"rates: MAVLink has no message {name}")
    return int(number)


def _with_rates(names: tuple[str, ...], rate: float, stream: int, rates: dict[str, float]) -> Wish:
    """A wish with the rate that the calibration gives to any of its messages, which then goes first."""
    given = [name for name in names if name in rates]
    for name in given:
        rate = rates.pop(name)
    return Wish((*given, *(name for name in names if name not in given)), rate, stream)


def _questions(wish: Wish, system: int, component: int) -> list[Any]:
    """First the best message alone, then all of them."""
    names = wish.names[:1] if wish.asked == 0 else wish.names
    interval = 1e6 / wish.rate  # [us]
    return [
        dialect.MAVLink_command_long_message(
            system, component, dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 0, message_id(name), interval, 0, 0, 0, 0, 0
        )
        for name in names
    ]
