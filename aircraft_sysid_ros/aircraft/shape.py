"""Mass and shape of an aircraft file against each other: what no aeroplane has is a number in another unit."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError

Array = npt.NDArray[np.float64]

#: Wing area over span times chord: 0.8 to 1 of one wing, 2 of a biplane.
_AREAS = (0.1, 10.0)
#: Mass over wing area [kg/m²]: 1 of a human-powered aeroplane, 1000 of a rocket plane.
_LOADINGS = (0.1, 2000.0)
#: Radius of gyration over span: 0.1 to 0.3 of aeroplanes, 0.7 of a long fuselage with short wings.
_RADII = (0.01, 3.0)
#: Distance of a sensor from the centre of gravity over the span: 2 of a boom far ahead of short wings.
_FARTHEST = 10.0


def check_place(key: str, place: Array, span: float) -> None:
    """Raises InputError for a place (3,) [m] that is beyond any aeroplane of that span [m]."""
    away = float(np.linalg.norm(place))
    if away > _FARTHEST * span:
        raise InputError(
            f"{key} is {away:.3g} m from the centre of gravity of an aeroplane whose span is {span:g} m: give it in m"
        )


def check_shape(mass: float, wing_area: float, span: float, chord: float, inertia: Array) -> None:
    """Raises InputError with the numbers that contradict each other; mass [kg], lengths [m], inertia (3, 3) [kg m²]."""
    area = wing_area / (span * chord)
    if not _AREAS[0] <= area <= _AREAS[1]:
        raise InputError(
            f"wing_area is {area:.3g} times span times chord, and about 1 is usual: check the units of the three, "
            f"{wing_area:g} m², {span:g} m and {chord:g} m"
        )
    loading = mass / wing_area
    if not _LOADINGS[0] <= loading <= _LOADINGS[1]:
        raise InputError(
            f"mass over wing_area is {loading:.3g} kg/m², and {_LOADINGS[0]:g} to {_LOADINGS[1]:g} is usual: check "
            f"their units, {mass:g} kg and {wing_area:g} m²"
        )
    for key, moment in zip(("xx", "yy", "zz"), np.diag(inertia), strict=True):
        radius = float(np.sqrt(moment / mass))
        if not _RADII[0] <= radius / span <= _RADII[1]:
            raise InputError(
                f"inertia {key} is that of {mass:g} kg at {radius:.3g} m from the axis, and the span is {span:g} m: "
                f"check its unit, {moment:g} kg m²"
            )
