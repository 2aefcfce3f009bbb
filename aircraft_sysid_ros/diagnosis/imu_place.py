"""Where the IMU sits, as the forces tell it where gusts hide that from the likelihood of the first step.

An accelerometer at r + d, of which the aircraft file says r, measures E d more than the force at the centre of
gravity, E d = ω' x d + ω x (ω x d), (6.3). The angular acceleration stands in the measured moments, (6.16)-(6.18): it
is averaged over the same windows as the forces are. So the numbers d are found beside the model's own parameters, by
least squares over all forces at once, and judged on held-out flight. What turns an aeroplane in gusts is mostly
sideslip, which drives r' by its yaw stiffness: an IMU a third of a metre to the side had been "C_X depends on beta".

A number of d stands in two forces, by the same amount. It is believed where two of them gain by it, and none loses: no
force of the air does that. An IMU ahead or behind is left to the likelihood: a gust that meets the tail alone makes a
force there and turns the aeroplane by it, and in C_Y and C_Z that is the same as an IMU behind the centre of gravity
(by I_zz / (m l_t): the tail is its centre of percussion).
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.diagnosis.flight.flight_data import GUARD, FlightData
from aircraft_sysid_ros.diagnosis.measurement import Setting
from aircraft_sysid_ros.diagnosis.search.evaluator import log_ratio, size_of
from aircraft_sysid_ros.diagnosis.search.fit import Gain, fits_of, tied_gains
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.effects.effect import Effect

Array = npt.NDArray[np.float64]

FORCES = ("CX", "CY", "CZ")
#: The coordinate that is left to the likelihood.
AHEAD = 0
#: Farthest place [spans] that is tried.
FARTHEST = 0.3


def turning_of(data: FlightData) -> Array:
    """Angular acceleration (n, 3) [rad/s²] that the measured moments (n,) are."""
    aircraft = data.aircraft
    made = data.measured * (data.signal("qbar") * aircraft.wing_area)[:, None]
    force, moment = made[:, :3], made[:, 3:]
    rates = np.column_stack([data.signal(name) for name in "pqr"])
    moment = moment * [aircraft.span, aircraft.chord, aircraft.span] + np.cross(aircraft.aerodynamic_reference, force)
    moment -= np.cross(rates, rates @ aircraft.inertia.T)
    return np.asarray(np.linalg.solve(aircraft.inertia, moment.T).T)


def columns_of(data: FlightData) -> dict[str, Array]:
    """By force, what each coordinate of d [m] adds to its coefficient, (n, 3)."""
    rates = np.column_stack([data.signal(name) for name in "pqr"])
    turning, unit = turning_of(data), np.eye(3)
    felt = np.stack([np.cross(turning, e) + np.cross(rates, np.cross(rates, e)) for e in unit], axis=2)
    scale = data.aircraft.mass / (data.signal("qbar") * data.aircraft.wing_area)
    return {axis: data.within(felt[:, k] * scale[:, None]) for k, axis in enumerate(FORCES)}


def place_of_forces(data: FlightData, unknown: Sequence[int] = (1, 2)) -> tuple[Array, float] | None:
    """How much farther the IMU is (3,) [spans] than the aircraft file says, and the evidence, of which 1 is needed.

    ``unknown``: which coordinates may be wrong. None where the forces do not tell, or speak against it.
    """
    fits, _ = fits_of(data, FORCES)
    columns = {axis: each for axis, each in columns_of(data).items() if axis in fits}
    best, most, number = None, 0.0, np.zeros(3)
    for chosen in _subsets(unknown):
        gains = tied_gains(fits, columns, dict.fromkeys(columns, np.eye(3)[:, chosen]))
        if len(gains) < 2:
            continue
        price = len(chosen) * _price_of_one(data, gains)
        worth = sum(map(log_ratio, gains.values())) - price
        if worth > most and _is_everywhere(gains):
            best, most = worth / price, worth
            number = next(iter(gains.values())).parameters / data.aircraft.span
    if best is None or not np.all(np.isfinite(number)) or np.max(np.abs(number)) > FARTHEST:
        return None
    return number, best


def settings_of(data: FlightData, effect: Effect, known: Collection[tuple[str, ...]] = ()) -> list[Setting]:
    """The same as settings of the effect "imu_offset", without what is ``known``; none where the forces do not tell."""
    unknown = [k for k, variant in enumerate(effect.variants) if k != AHEAD and variant.setting not in known]
    told = place_of_forces(data, unknown)
    if told is None:
        return []
    place, evidence = told
    return [
        Setting(effect, effect.variants[k], 0.0, float(f"{place[k]:.4g}"), 0.0, evidence, np.nan, of_coefficients=True)
        for k in np.flatnonzero(place).tolist()
    ]


def _subsets(unknown: Sequence[int]) -> Iterator[list[int]]:
    """Coordinates that may be wrong, fewest first."""
    for count in range(len(unknown)):
        yield from map(list, itertools.combinations(unknown, count + 1))


def _price_of_one(data: FlightData, gains: Mapping[str, Gain]) -> float:
    """Description length of a number, as of candidates (``Score.price``)."""
    n = max(float(np.sum(next(iter(gains.values())).count)) * data.step / GUARD, np.e)
    return float(np.log(n) / n)


def _is_everywhere(gains: Mapping[str, Gain]) -> bool:
    """One force gains by the least size, a second one by half of it, and none loses."""
    sizes: Sequence[float] = sorted(map(size_of, gains.values()), reverse=True)
    loses = any(log_ratio(gain) < -2.0 * THRESHOLDS.worse for gain in gains.values())
    return sizes[0] >= THRESHOLDS.size and sizes[1] >= 0.5 * THRESHOLDS.size and not loses
