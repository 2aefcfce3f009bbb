"""What a flight shows of how late surfaces are recorded, in words."""

from __future__ import annotations

import numpy as np

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.sensor_settings import CONTROLS
from aircraft_sysid_ros.identification.identifier import Identifier

#: So probable is one way of being late where the other is not named.
_SURE_OF_WAY = 0.95


def delay_notes(parameters: Identifier) -> list[str]:
    """By how much motion is recorded after the surfaces that make it, where the flight shows it.

    Nothing where the IMU is late, which is of all that is compared with motion.
    """
    if parameters.learning.imu_is_late:
        return []
    sensors = parameters.learning.undescribed
    if (contradicted := sensors.contradicted) is not None:
        return [_contradicted(parameters.aircraft, *contradicted)]
    found, late = parameters.learning.late_surfaces, sensors.late_motion
    if not found or late is None:
        return []
    size = f"{1e3 * abs(late.time):.0f} ± {1e3 * 2.0 * float(np.sqrt(late.variance)):.0f} ms"
    if late.course.is_lag:
        after = f"{1e3 * late.course.dead_time:.0f} ms later and " if late.course.dead_time else ""
        what = f"surfaces follow what is recorded of them {after}with a lag of {size} (servos)"
    elif late.time > 0.0:
        what = f"motion comes {size} later than the recorded surfaces (servos, filters, stamps)"
    else:
        what = f"motion comes {size} before the recorded surfaces (filters, stamps)"
    doubt = "" if late.probability > _SURE_OF_WAY else ", or as well in another way as late"
    freed = "parameters are freed of it"
    if parameters.learning.lends:
        freed = f"those of {parameters.learning.published['published']} are not freed of it, but the surer only by it"
    said = ", ".join(f"{key}: {value:.3f}" for key, (value, _) in found.items())
    return [
        f"{what}{doubt}, and {freed}; `{said}` of control_surfaces under `sensors` of the aircraft file says so from "
        "the start, `replay --learn-sensors` writes it as found, and `diagnose` tells a delay from a lag more finely"
    ]


def _contradicted(aircraft: Aircraft, late: float, std: float) -> str:
    """Said where an aircraft file says how late surfaces are, and the flight shows another."""
    surfaces = aircraft.sensors[CONTROLS]
    said = [f"a {key} of {value:g} s" for key in ("delay", "lag") if (value := getattr(surfaces, key))]
    shown = f"{1e3 * abs(late):.0f} ± {1e3 * 2.0 * std:.0f} ms {'later' if late > 0.0 else 'earlier'}"
    return (
        f"the aircraft file gives the control surfaces {' and '.join(said) or 'no delay and no lag'}, and this flight "
        f"shows them {shown} than that: what the file says is used, and parameters are wrong by it; `diagnose` says "
        "which it is, or say nothing of the IMU and of control_surfaces but their noise, to have it found"
    )
