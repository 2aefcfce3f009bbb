"""Plans of test flights that differ from seed to seed: order, sizes, speeds, and what some effects need to be seen.

A plan is a chain of segments of manoeuvres.Planner, of random kind, sign, size and speed. Some kinds of flight add
slow flight at high angles of attack, low passes over the ground, flaps, or large sideslips.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.simulation.calibration_plan import CALIBRATION, calibration_plan
from aircraft_sysid_ros.simulation.manoeuvres import (
    AILERON,
    ELEVATOR,
    RUDDER,
    THROTTLE,
    Excitation,
    Plan,
    Planner,
    doublet,
    flight_plan,
    three_two_one_one,
)

Array = npt.NDArray[np.float64]
Segment = tuple[float, Callable[[slice, Array, float, float], None]]

STANDARD = "standard"
#: Kinds of flights that ``plan_of`` knows besides the standard one.
VARIED = ("varied", "speeds", "high_alpha", "low_passes", "flaps", "sideslips")
PLANS = (STANDARD, *VARIED)
#: Reference of slow flight as a share of the airspeed at trim, and throttle that is taken off: what the autopilot
#: adds with the nose up must not hold the speed.
SLOW, SLOW_THROTTLE = 0.4, -0.5
#: How far [m] low passes are below the height of the beginning, and how fast [share of airspeed] it descends.
DESCENT, SLOPE = 25.0, 0.09
FLAP_SETTINGS = (0.17, 0.35)  # [rad]


@dataclass(frozen=True)
class _Kind:
    """What a kind of flight is made of."""

    own: str | None  # segment of its own kind, flown in every third place
    speeds: tuple[float, float]  # range of the airspeed of segments, as shares of that at trim
    sizes: tuple[float, float] = (0.6, 1.2)


_KINDS = {
    "varied": _Kind(None, (0.95, 1.15)),
    "speeds": _Kind("speed_ramp", (0.65, 1.45)),
    "high_alpha": _Kind("slow_flight", (0.85, 1.15), (0.5, 1.0)),
    "low_passes": _Kind("low_pass", (0.95, 1.1), (0.4, 0.8)),
    "flaps": _Kind("flap_cycle", (0.9, 1.1), (0.5, 1.0)),
    "sideslips": _Kind("steady_sideslip", (0.85, 1.15)),
}


def plan_of(name: str, time: Array, excitation: Excitation, seed: int) -> Plan:
    """Plan of a kind of PLANS at n times [s] (n,) from 0, drawn from a seed; InputError for another name."""
    if name == STANDARD:
        return flight_plan(time, excitation)
    if name == CALIBRATION:
        return calibration_plan(time, excitation)
    if name not in _KINDS:
        raise InputError(f"unknown manoeuvres '{name}': use one of {' '.join(PLANS)}")
    kind, rng = _KINDS[name], np.random.default_rng([seed, 0x91A7])
    planner = VariedPlanner(time, excitation)
    ordinary = list(planner.segments)
    begin, count = 6.0, 0
    rng.shuffle(ordinary)
    while begin < time[-1] - 8.0:
        own = kind.own is not None and count % 3 == 1
        chosen = kind.own if own and kind.own else ordinary[count % len(ordinary)]
        nominal, fly = planner.segments.get(chosen) or planner.special[chosen]
        length = min(nominal * float(rng.choice([0.8, 1.0, 1.25])), time[-1] - begin)
        window = slice(*np.searchsorted(time, (begin, begin + length)))
        planner.size = _scaled(excitation, rng.uniform(*kind.sizes, 4))
        planner.plan.airspeed[window] = rng.uniform(*kind.speeds) * excitation.airspeed
        fly(window, time[window] - begin, length, float(rng.choice([-1.0, 1.0])))
        begin, count = begin + length, count + 1
    return planner.plan


def _scaled(excitation: Excitation, factors: Array) -> Excitation:
    size = excitation
    return replace(
        size,
        elevator=size.elevator * float(factors[0]),
        aileron=size.aileron * float(factors[1]),
        rudder=size.rudder * float(factors[2]),
        throttle=size.throttle * float(factors[3]),
    )


class VariedPlanner(Planner):
    """A planner that knows more segments; ``size`` may be drawn, ``full`` is what suits the aeroplane."""

    def __init__(self, time: Array, excitation: Excitation) -> None:
        super().__init__(time, excitation)
        self.full = excitation
        self.segments: dict[str, Segment] = {
            "elevator_3211": (10.0, self.elevator_3211),
            "lateral_doublets": (14.0, self.lateral_doublets),
            "throttle_steps": (10.0, self.throttle_steps),
            "multisines": (20.0, self.multisines),
            "turns": (16.0, self.turns),
            "pushover_pullup": (8.0, self.pushover_pullup),
            "sweeps": (8.0, self.sweeps),
        }
        self.special: dict[str, Segment] = {
            "speed_ramp": (28.0, self.speed_ramp),
            "slow_flight": (36.0, self.slow_flight),
            "low_pass": (44.0, self.low_pass),
            "flap_cycle": (24.0, self.flap_cycle),
            "steady_sideslip": (16.0, self.steady_sideslip),
        }

    def speed_ramp(self, window: slice, t: Array, length: float, sign: float) -> None:
        """Slower and faster, or the other way round, with elevator and rudder doublets at both ends."""
        phase = t / length
        wave = sign * np.sin(2.0 * np.pi * phase)
        self.plan.airspeed[window] = self.size.airspeed * (1.0 + 0.4 * wave)
        self.plan.controls[window, THROTTLE] += 0.45 * wave
        for at in (0.25, 0.75):
            self._small_doublets(window, t - at * length, 1.0)

    def slow_flight(self, window: slice, t: Array, length: float, sign: float) -> None:
        """Deceleration to a high angle of attack, pulses there, and back."""
        profile = np.interp(t / length, [0.0, 0.3, 0.85, 0.95], [1.0, SLOW, SLOW, 1.0])
        self.plan.airspeed[window] = self.size.airspeed * profile
        self.plan.controls[window, THROTTLE] += np.interp(
            t / length, [0.0, 0.05, 0.85, 0.9], [0.0, SLOW_THROTTLE, SLOW_THROTTLE, 0.0]
        )
        up = np.interp(t / length, [0.1, 0.3, 0.8, 0.9], [0.0, 1.3, 1.3, 0.0])
        self.plan.controls[window, ELEVATOR] += self.full.elevator * up
        wave = three_two_one_one(t - 0.45 * length, self.size.pitch_pulse)
        wave -= three_two_one_one(t - 0.65 * length, self.size.pitch_pulse)
        self.plan.controls[window, ELEVATOR] += sign * self.size.elevator * wave
        self._lateral(window, t - 0.55 * length, 0.5)

    def low_pass(self, window: slice, t: Array, length: float, sign: float) -> None:
        """Down to the ground, along it with small pulses, and up again."""
        slope = SLOPE * self.size.airspeed
        down = min(DESCENT, slope * 0.4 * length)
        leg = down / slope
        profile = np.interp(t, [0.0, leg, length - leg, length], [0.0, -down, -down, 0.0])
        self.plan.height[window] = DESCENT - down + profile - (DESCENT - down)
        self.plan.airspeed[window] = self.size.airspeed
        for at in np.arange(leg + 3.0, length - leg - 1.0, 5.0):
            self._small_doublets(window, t - at, 0.35)

    def flap_cycle(self, window: slice, t: Array, length: float, sign: float) -> None:
        """Flaps out to a setting and in again, with small pulses at either; half a rate of 0.1 rad/s."""
        setting = FLAP_SETTINGS[0] if sign > 0.0 else FLAP_SETTINGS[1]
        moving = setting / 0.1
        self.plan.flaps[window] = np.interp(
            t, [2.0, 2.0 + moving, length - 6.0 - moving, length - 6.0], [0.0, setting, setting, 0.0]
        )
        for at in (0.3, 0.55, 0.85):
            self._small_doublets(window, t - at * length, 0.7)

    def steady_sideslip(self, window: slice, t: Array, length: float, sign: float) -> None:
        """Rudder held to one side and to the other, bank held by the autopilot."""
        half = 0.4 * length
        self.plan.controls[window, RUDDER] += 2.0 * sign * self.size.rudder * doublet(t, half)
        self.plan.controls[window, ELEVATOR] += (
            0.5 * self.size.elevator * doublet(t - 0.2 * length, self.size.pitch_pulse)
        )

    def _small_doublets(self, window: slice, t: Array, share: float) -> None:
        elevator = doublet(t, self.size.pitch_pulse)
        self.plan.controls[window, ELEVATOR] += share * self.size.elevator * elevator
        self._lateral(window, t - 3.0 * self.size.pitch_pulse, share)

    def _lateral(self, window: slice, t: Array, share: float) -> None:
        self.plan.controls[window, AILERON] += share * self.size.aileron * doublet(t, self.size.roll_pulse)
        rudder = doublet(t - 2.0 * self.size.roll_pulse, self.size.yaw_pulse)
        self.plan.controls[window, RUDDER] += share * self.size.rudder * rudder
