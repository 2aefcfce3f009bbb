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
        what = f"surfaces follow their records {after}with a lag of {size} (servos)"
    elif late.time > 0.0:
        what = f"motion comes {size} later than the recorded surfaces (servos, filters, stamps)"
    else:
        what = f"motion comes {size} before the recorded surfaces (filters, stamps)"
    doubt = "" if late.probability > _SURE_OF_WAY else ", or another mix of delay and lag, which fits as well"
    freed = "parameters are corrected for it"
    if parameters.learning.lends:
        by = parameters.learning.published["published"]
        freed = f"the parameters of {by} are not corrected for it, their standard errors allow for it"
    said = ", ".join(f"{key}: {value:.3f}" for key, (value, _) in found.items())
    return [
        f"{what}{doubt}, and {freed}; `{said}` of control_surfaces under `sensors` of the aircraft file says so from "
        "the start, `replay --learn-sensors` writes what was found, and `diagnose` separates a delay from a lag better"
    ]


def _contradicted(aircraft: Aircraft, late: float, std: float) -> str:
    """Said where an aircraft file says how late surfaces are, and the flight shows another."""
    surfaces = aircraft.sensors[CONTROLS]
    said = [f"a {key} of {value:g} s" for key in ("delay", "lag") if (value := getattr(surfaces, key))]
    shown = f"{1e3 * abs(late):.0f} ± {1e3 * 2.0 * std:.0f} ms {'later' if late > 0.0 else 'earlier'}"
    return (
        f"the aircraft file gives the control surfaces {' and '.join(said) or 'no delay and no lag'}, and this flight "
        f"shows them {shown} than that: the value of the file is used, and if it is wrong, so are parameters; "
        "`diagnose` says which is right, or give only the noise of the IMU and of control_surfaces, to have it found"
    )
