"""What a calibration flight flies: the manoeuvres of Table 5 of the two-stage paper (docs/references.md).

Wind circles at three airspeeds and pushover-pullups, then multisines, pitch and yaw chirps, a rudder doublet.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.simulation.manoeuvres import ELEVATOR, RUDDER, Excitation, Plan, Planner, doublet, sweep

Array = npt.NDArray[np.float64]

#: Name of this kind of flight. It is not one of varied_plan.PLANS, among which flights are drawn.
CALIBRATION = "calibration"
BANK = np.radians(35.0)
#: Airspeeds of the circles, as shares of that at trim.
SLOW, FAST = 0.85, 1.25


def calibration_plan(time: Array, excitation: Excitation) -> Plan:
    """Manoeuvres of Table 5 at n times [s] (n,) from 0."""
    planner = _CalibrationPlanner(time, excitation)
    segments = [
        (6.0, planner.cruise), (24.0, planner.circle), (4.0, planner.cruise), (29.0, planner.fast_circle),
        (4.0, planner.cruise), (9.0, planner.pushover_pullup), (9.0, planner.pushover_pullup),
        (20.0, planner.multisines), (20.0, planner.fast_multisines), (4.0, planner.cruise),
        (18.0, planner.pitch_chirp), (4.0, planner.cruise), (28.0, planner.yaw_chirp), (4.0, planner.cruise),
        (20.0, planner.multisines), (8.0, planner.rudder_doublet), (24.0, planner.slow_circle), (15.0, planner.cruise),
    ]  # fmt: skip
    stretch, begin = float(time[-1]) / sum(length for length, _ in segments), 0.0
    for number, (nominal, fly) in enumerate(segments):
        length = nominal * stretch
        window = slice(*np.searchsorted(time, (begin, begin + length)))
        fly(window, time[window] - begin, length, -1.0 if number % 2 else 1.0)
        begin += length
    return planner.plan


class _CalibrationPlanner(Planner):
    """A planner that knows the manoeuvres of Table 5."""

    def circle(self, window: slice, t: Array, length: float, sign: float) -> None:
        self.plan.bank[window] = sign * BANK

    def fast_circle(self, window: slice, t: Array, length: float, sign: float) -> None:
        self.plan.airspeed[window] = FAST * self.size.airspeed
        self.circle(window, t, length, -sign)

    def slow_circle(self, window: slice, t: Array, length: float, sign: float) -> None:
        self.plan.airspeed[window] = SLOW * self.size.airspeed
        self.circle(window, t, length, sign)

    def pitch_chirp(self, window: slice, t: Array, length: float, sign: float) -> None:
        top = np.clip(0.4 / self.size.pitch_pulse, 0.5, 2.0)
        self.plan.controls[window, ELEVATOR] += sign * self.size.elevator * sweep(t, 0.9 * length, 0.2, top)

    def yaw_chirp(self, window: slice, t: Array, length: float, sign: float) -> None:
        top = np.clip(0.5 / self.size.yaw_pulse, 0.5, 2.0)
        self.plan.controls[window, RUDDER] += sign * self.size.rudder * sweep(t, 0.9 * length, 0.2, top)

    def rudder_doublet(self, window: slice, t: Array, length: float, sign: float) -> None:
        self.plan.controls[window, RUDDER] += 1.5 * sign * self.size.rudder * doublet(t, self.size.yaw_pulse)
