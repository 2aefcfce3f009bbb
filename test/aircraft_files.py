"""Aircraft files as users have them, for tests of several folders."""

from __future__ import annotations

from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict

_SHAPE = ("name", "mass", "wing_area", "span", "chord", "inertia")
_PLACES = ("imu_position", "air_data_position", "gps_position")


def of_shape(aircraft: Aircraft, places: bool = True, **more: object) -> Aircraft:
    """Mass and shape alone, and where the sensors are unless ``places`` is False; ``more``: keys besides."""
    known = _SHAPE + _PLACES * places
    return aircraft_from_dict({key: aircraft.source[key] for key in known} | more)
