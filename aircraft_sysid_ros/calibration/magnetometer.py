"""Calibration of a magnetometer in flight: (B1)-(B3) of the two-stage paper (docs/references.md).

The sensor shows, of the field h^b in body axes, (B1):

    h^m = C_alpha C_eta C_lambda h^b + n + v

C_alpha = I + symmetric soft iron without diagonal, C_eta = I + [eta x] misalignment of (A2), C_lambda = diag(1 +
lambda) scale, n hard iron. The paper leaves open how many alpha there are: three beside eta and lambda make every
matrix near I exactly once. Linear, (B3): xi1 = [lambda, n] with A = [C_alpha C_eta diag(h^b), I] and
b = C_alpha C_eta h^b; xi2 = [alpha_ij, eta_i].

h^b = C_n^b h_n needs the attitude and the field of the place. Its strength is given or that of a model of the earth's,
and lambda is relative to it. Its inclination, and its declination unless the aircraft file has it, are two more
unknowns in xi2. Measured field and given strength in the same unit; body axes FRD, NED, radians.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.earth_field import FieldAtPlace, earth_field
from aircraft_sysid_ros.aircraft.frames import cross_matrix
from aircraft_sysid_ros.calibration.navigation import (
    Grid,
    Navigation,
    common_grid,
    in_span,
    navigate,
    require,
    series,
)
from aircraft_sysid_ros.calibration.procedure import Task
from aircraft_sysid_ros.calibration.segments import Segments, find_segments
from aircraft_sysid_ros.calibration.standard_errors import AttitudeErrors
from aircraft_sysid_ros.estimation.two_stage.problem import Problem
from aircraft_sysid_ros.samples import Kind, Samples

Array = npt.NDArray[np.float64]

AXES = ("x", "y", "z")
NAMES1 = (*(f"lambda_{axis}" for axis in AXES), *(f"n_{axis}" for axis in AXES))
NAMES2 = ("alpha_xy", "alpha_xz", "alpha_yz", *(f"eta_{axis}" for axis in AXES))
FIELD_NAMES = ("inclination", "declination")
UNITS = {**{f"eta_{axis}": "rad" for axis in AXES}, "inclination": "rad", "declination": "rad"}
#: Scale and iron are sought within these bounds; hard iron within so many field strengths.
LARGEST_SCALE, LARGEST_IRON, LARGEST_HARD_IRON = 0.5, 0.3, 3.0
#: The field of the place is taken to be within this [rad] of that of the model of the earth's.
FIELD_ANGLE = 0.35
_EXCITED = "banked turns to both sides through all headings, and pitching up and down"
EXCITED_BY = dict.fromkeys((*NAMES1, *NAMES2, *FIELD_NAMES), _EXCITED)


@dataclass(frozen=True)
class MagneticData:
    """What (B3) needs at n instants, and what is known of the field of the place."""

    measured: Array  # (n, 3) h^m
    rotation: Array  # (n, 3, 3) C_b^n
    field: FieldAtPlace
    declination_is_known: bool

    def __getitem__(self, keep: npt.NDArray[np.bool_]) -> MagneticData:
        return MagneticData(self.measured[keep], self.rotation[keep], self.field, self.declination_is_known)

    @property
    def names2(self) -> tuple[str, ...]:
        """NAMES2 and the unknown angles of the field."""
        return (*NAMES2, *FIELD_NAMES[: 1 if self.declination_is_known else 2])

    @property
    def nominal2(self) -> Array:
        """xi2 of a sensor without errors in the field of the model of the earth's."""
        angles = [self.field.inclination, self.field.declination]
        return np.concatenate([np.zeros(len(NAMES2)), angles[: len(self.names2) - len(NAMES2)]])

    def model(self, xi2: Array) -> tuple[Array, Array]:
        """A (n, 3, 6) and b (n, 3) of (B3)."""
        body, matrix = self._body(self._field_of(xi2).vector()), iron_matrix(xi2[:6])
        scale = matrix[None] * body[:, None, :]
        return np.concatenate([scale, np.broadcast_to(np.eye(3), scale.shape)], axis=2), body @ matrix.T

    def gradient(self, xi2: Array) -> tuple[Array, Array]:
        """dA/dxi2 (n, 3, 6, n2) and db/dxi2 (n, 3, n2)."""
        field, matrix = self._field_of(xi2), iron_matrix(xi2[:6])
        body = self._body(field.vector())
        da = np.zeros((len(body), 3, 6, len(xi2)))
        db = np.zeros((len(body), 3, len(xi2)))
        for j, change in enumerate(_iron_gradient(xi2[:6])):
            da[:, :, :3, j], db[:, :, j] = change[None] * body[:, None, :], body @ change.T
        for j, turned in enumerate(_field_gradient(field)[: len(xi2) - 6], start=6):
            moved = self._body(turned)
            da[:, :, :3, j], db[:, :, j] = matrix[None] * moved[:, None, :], moved @ matrix.T
        return da, db

    def by_attitude(self, xi: Array) -> Array:
        """d(A xi1 + b)/de (n, 3, 3) by a small rotation e of the attitude in body axes."""
        body = self._body(self._field_of(xi[6:]).vector())
        matrix = sensor_matrix(xi[:3], xi[6:])
        return np.stack([np.cross(body, axis) @ matrix.T for axis in np.eye(3)], axis=2)

    def problem(self) -> Problem:
        """Measurement equation (B3)."""
        scale, hard = LARGEST_SCALE, LARGEST_HARD_IRON * self.field.strength
        bounds1 = np.array([[-scale, scale]] * 3 + [[-hard, hard]] * 3)
        half = np.array([LARGEST_IRON] * 6 + [FIELD_ANGLE] * (len(self.names2) - 6))
        bounds2 = self.nominal2[:, None] + np.stack([-half, half], axis=1)
        return Problem(self.measured, self.model, NAMES1, self.names2, bounds1, bounds2, gradient=self.gradient)

    def _field_of(self, xi2: Array) -> FieldAtPlace:
        declination = self.field.declination if self.declination_is_known else float(xi2[7])
        return FieldAtPlace(self.field.strength, float(xi2[6]), declination)

    def _body(self, field: Array) -> Array:
        """The field NED (3,) in body axes (n, 3)."""
        return np.asarray(np.einsum("nji,j->ni", self.rotation, field))


def iron_matrix(xi2: Array) -> Array:
    """C_alpha C_eta of (B1), (3, 3), from alpha_xy, alpha_xz, alpha_yz, eta_x, eta_y, eta_z."""
    return np.asarray(_soft(xi2[:3]) @ (np.eye(3) + cross_matrix(xi2[3:6])))


def sensor_matrix(scale: Array, xi2: Array) -> Array:
    """C_alpha C_eta C_lambda of (B1), (3, 3)."""
    return iron_matrix(xi2) * (1.0 + scale)


def _soft(alpha: Array) -> Array:
    xy, xz, yz = alpha
    return np.array([[1.0, xy, xz], [xy, 1.0, yz], [xz, yz, 1.0]])


def _iron_gradient(xi2: Array) -> list[Array]:
    turn, soft = np.eye(3) + cross_matrix(xi2[3:6]), _soft(xi2[:3])
    unit = np.eye(3)
    return [
        *((_soft(unit[j]) - unit) @ turn for j in range(3)),
        *(soft @ cross_matrix(unit[j]) for j in range(3)),
    ]


def _field_gradient(field: FieldAtPlace) -> list[Array]:
    """d h_n by inclination and declination, each (3,)."""
    north, east, _ = field.vector()
    up = FieldAtPlace(field.strength, field.inclination + 0.5 * np.pi, field.declination)
    return [up.vector(), np.array([-east, north, 0.0])]


@dataclass(frozen=True)
class MagneticFlight:
    """The data of a flight for this calibration, its grid and what was flown."""

    data: MagneticData
    grid: Grid
    segments: Segments
    navigation: Navigation

    def task(self) -> Task:
        """Everything for ``procedure.solve``."""
        nominal = np.concatenate([np.zeros(len(NAMES1)), self.data.nominal2])
        return Task(self.data.problem(), self.grid.piece, nominal, attitude=self._attitude)

    def _attitude(self, xi: Array) -> AttitudeErrors:
        return AttitudeErrors(self.grid.time, self.navigation.attitude_std, self.data.by_attitude(xi))


def magnetic_flight(
    samples: Samples,
    aircraft: Aircraft,
    span: tuple[float, float] | None = None,
    strength: float | None = None,
) -> MagneticFlight:
    """Field and attitude on a common grid; ``span`` [s] from the first sample, ``strength`` of the field if known.

    Raises InputError where a topic is missing or the flight is too short.
    """
    require(samples, (Kind.MAGNETIC_FIELD,))
    whole = navigate(samples, aircraft)
    time, field = series(samples, Kind.MAGNETIC_FIELD, whole.epoch, 3, aircraft.sensors["magnetometer"].delay)
    time, field = time[np.any(field != 0.0, axis=1)], field[np.any(field != 0.0, axis=1)]  # zeros: not yet awake
    grid = common_grid(whole.time, time)
    navigation = whole.at(grid, time)
    measured = grid.means(time, field)
    moving = np.linalg.norm(navigation.velocity, axis=1) > 0.8 * aircraft.minimum_airspeed
    segments = find_segments(navigation, moving & in_span(samples, navigation, span), grid.step)
    used = segments.used
    at_place = earth_field(float(whole.origin[0]), float(whole.origin[1]))
    declination = aircraft.magnetic_declination
    place = FieldAtPlace(
        at_place.strength if strength is None else strength,
        at_place.inclination,
        at_place.declination if declination is None else declination,
    )
    data = MagneticData(measured[used], navigation.rotation[used], place, declination is not None)
    return MagneticFlight(data, grid[used], segments, navigation[used])
