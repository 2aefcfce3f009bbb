"""Sensors that fail for some time of a recorded flight, and an actuator that sticks.

A fault changes the samples of a flight between two times; what was flown stays as it was. An actuator that sticks is
flown: its surface has no effect any more but that of its trim position, while the recording shows what was commanded.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.sensors.sensor_models import stamps_of
from aircraft_sysid_ros.simulation.dynamics import Effect

Array = npt.NDArray[np.float64]
Fault = Callable[[Samples, npt.NDArray[np.bool_]], Samples]

#: Jumps of the biases: accelerometer [m/s^2], gyro [rad/s]; the velocity [m/s] that a spoofed GPS adds.
ACCELEROMETER_JUMP, GYRO_JUMP = (0.5, 0.0, -0.8), (0.0, 0.03, 0.0)
SPOOFED = (4.0, -3.0, 0.0)
#: Noise that a blocked probe [m/s] and a vane that sticks [rad] still have.
BLOCKED_NOISE, VANE_NOISE = 0.2, 0.003


def _stuck(kind: Kind, column: int | None = None, noise: float = 0.0) -> Fault:
    """All of a sensor, or one column, stays as it was; ``noise`` is what its electronics add."""
    columns = slice(None) if column is None else slice(column, column + 1)

    def fault(samples: Samples, during: npt.NDArray[np.bool_]) -> Samples:
        chosen, values = np.flatnonzero(during & (samples.kind == kind)), samples.values.copy()
        if len(chosen):
            values[chosen, columns] = values[chosen[0], columns]
            values[chosen, 0] += noise * np.random.default_rng(len(chosen)).normal(size=len(chosen))
        return Samples(samples.stamp, samples.kind, values)

    return fault


def _lost(*kinds: Kind) -> Fault:
    return lambda samples, during: samples[~(during & np.isin(samples.kind, kinds))]


def _added(kind: Kind, addition: tuple[float, ...]) -> Fault:
    def fault(samples: Samples, during: npt.NDArray[np.bool_]) -> Samples:
        values = samples.values.copy()
        values[during & (samples.kind == kind), : len(addition)] += addition
        return Samples(samples.stamp, samples.kind, values)

    return fault


#: Faults by name.
FAULTS: Mapping[str, Fault] = {
    "airspeed_blocked": _stuck(Kind.AIRSPEED),
    "airspeed_blocked_noisy": _stuck(Kind.AIRSPEED, noise=BLOCKED_NOISE),
    "airspeed_lost": _lost(Kind.AIRSPEED),
    "alpha_stuck": _stuck(Kind.ANGLE_OF_ATTACK),
    "alpha_stuck_noisy": _stuck(Kind.ANGLE_OF_ATTACK, noise=VANE_NOISE),
    "beta_stuck": _stuck(Kind.SIDESLIP),
    "beta_stuck_noisy": _stuck(Kind.SIDESLIP, noise=VANE_NOISE),
    "gps_lost": _lost(Kind.GPS_POSITION, Kind.GPS_VELOCITY),
    "gps_spoofed": _added(Kind.GPS_VELOCITY, SPOOFED),
    "imu_bias_jump": _added(Kind.IMU, (*ACCELEROMETER_JUMP, *GYRO_JUMP)),
    "elevator_record": _stuck(Kind.CONTROLS, 0),
}


def with_fault(samples: Samples, name: str, begin: float, end: float) -> Samples:
    """Samples of a simulated flight with a fault of FAULTS from ``begin`` to ``end`` [s]."""
    first, last = stamps_of([begin, end])
    return FAULTS[name](samples, (samples.stamp >= first) & (samples.stamp < last))


def stuck_surface(
    coefficients: Mapping[str, float], surface: str, position: float, begin: float, end: float
) -> tuple[Effect, ...]:
    """Effects of a surface ("de", "da", "dr") that stands at ``position`` [rad] from ``begin`` to ``end`` [s]."""
    during = f"max(sign(time-{begin:g}),0)*max(sign({end:g}-time),0)"
    effects = []
    for name, value in coefficients.items():
        axis, _, term = name.partition("_")
        if term == surface:
            effects.append(Effect(axis, f"{during}*{surface}", -value))
            effects.append(Effect(axis, during, value * position))
    return tuple(effects)
