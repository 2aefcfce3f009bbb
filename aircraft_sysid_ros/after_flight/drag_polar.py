"""The drag polar of a flight from its energy: what is lost is drag, what is gained is power.

Over a window of some seconds the energy in the frame of the air changes by what propulsion brings and drag takes,

    m Δ(V²/2 + g h) = η ∫ (P - P₀) dt + ∫ T V dt - ∫ q̄ S V (C_D0 + k C_L²) dt

(Anderson, Aircraft Performance and Design, 1999, §5.2 and §6.6; that efficiency and polar can be fitted together to a
log is shown by Sharpe and Hansman, AIAA SciTech 2024). No angle of attack is needed: lift is m times the normal
specific force. Least squares over windows that overlap; standard errors by leaving out stretches of two windows in
turn, since gusts up and down last longer than a window.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter1d
from scipy.special import stdtrit

from aircraft_sysid_ros.aircraft.atmosphere import STANDARD_GRAVITY, air_density, density_at
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.diagnosis.model_versions.versions import folder_to_write, open_run
from aircraft_sysid_ros.errors import InputError, echo
from aircraft_sysid_ros.flight_model.modes import THRUST as THRUST_COLUMN
from aircraft_sysid_ros.identification.coefficients.as_loaded import as_loaded
from aircraft_sysid_ros.identification.coefficients.signals import INPUT_HELD, interpolate
from aircraft_sysid_ros.reconstruction.absences import has_airspeed
from aircraft_sysid_ros.reconstruction.drift import Drift
from aircraft_sysid_ros.run_writer import write_json
from aircraft_sysid_ros.samples import Kind, Samples, flight_at, manoeuvres
from aircraft_sysid_ros.stamps import NANOSECONDS, seconds

Array = npt.NDArray[np.float64]
#: Draws what was found into a file; returns the file and no note, or None and why there is none.
Draw = Callable[[Path, dict[str, Any]], tuple[str | None, list[str]]]

POWER, THRUST, GLIDING = "power", "thrust", "gliding"
#: Length of a window and from one to the next, step of the integrals [s].
WINDOW, BETWEEN, STEP = 10.0, 1.0, 0.1
#: Number of windows that are left out together: gusts up and down, and windows that overlap, are correlated for less.
_BLOCK = round(2.0 * WINDOW / BETWEEN)
#: How far apart windows overlap, or one ends where the other begins.
_SHARING = round(WINDOW / BETWEEN)
#: Least flight [s], number of windows that do not overlap, and range of C_L² of which anything is said.
LEAST_FLIGHT, _LEAST_RANGE = 8.0 * WINDOW, 0.02
#: A value of which more than this share is doubt is not to be used, nor any where less is explained, as of parameters.
_MOST_DOUBT, LEAST_EXPLAINED = 0.25, 0.5
_FOLDS, _DRAWS = 5, 2000
#: A best glide is told where enough is explained, and drag without lift and of lift are each so many standard errors
#: above nothing.
_KNOWN = 2.0
#: Width [s] of the bell under which samples are averaged.
_BELL = 0.7
_LONGEST_GAP, _MOST_IDLE = 1.0, 1e6


@dataclass(frozen=True)
class Windows:
    """Mean powers [W] over windows (n,): of energy, of propulsion, and of drag per coefficient (n, 2)."""

    gained: Array
    brought: Array  # electric or shaft power beyond that of standing still; zero where it is not fitted
    pushed: Array  # of thrust that is measured
    drag: Array  # q̄ S V, and the same times C_L²
    number: npt.NDArray[np.int64]  # of the stretch of flight
    lift: Array  # all C_L (m,)
    speed: Array  # all airspeeds (m,) [m/s]
    density: Array  # (m,) [kg/m^3]

    @staticmethod
    def joined(parts: Sequence[Windows]) -> Windows:
        """Those of several manoeuvres, at least one, as one."""
        return Windows(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(Windows)))


@dataclass(frozen=True)
class DragPolar:
    """C_D = C_D0 + k C_L² and the efficiency of propulsion, where it is fitted, with their covariance."""

    names: tuple[str, ...]
    values: Array
    covariance: Array
    explained: float  # share of the held-out variance of the power that goes
    windows: int
    time: float  # [s] of flight
    lift: tuple[float, float]
    speed: tuple[float, float]
    density: float
    points: Array  # (n, 2) C_L and C_D of the windows, as the efficiency has it

    @property
    def std(self) -> Array:
        """Standard errors."""
        return np.sqrt(np.diag(self.covariance))

    def drag(self, lift: Array) -> tuple[Array, Array]:
        """Drag coefficient and its standard error."""
        columns = np.zeros((len(lift), len(self.names)))
        columns[:, -2], columns[:, -1] = 1.0, lift**2
        return columns @ self.values, np.sqrt(np.einsum("ij,jk,ik->i", columns, self.covariance, columns))

    def status(self, position: int) -> tuple[str, str]:
        """USE, or HOLD or REJECT with the reason."""
        doubt = self.std[position] / abs(self.values[position])
        if self.explained < LEAST_EXPLAINED:
            return "HOLD", f"the energy balance explains {max(self.explained, 0.0):.0%} of the power"
        if self.values[position] <= 0.0:
            return "REJECT", "it is not positive"
        if doubt > _MOST_DOUBT:
            return "HOLD", f"its standard error is {doubt:.0%} of its value"
        return "USE", ""


def drag_polar(
    path: str | Path, draw: Draw, power: str | None = None, idle: float = 0.0, gliding: bool = False
) -> dict[str, Any]:
    """The drag polar of the current version of a run, as JSON that is kept with a picture beside it. Raises InputError.

    ``power``: the input of the aircraft file that holds the power of propulsion [W], electric or at the shaft, of which
    ``idle`` [W] flows with the motor off; without it a thrust that was recorded is taken, and ``gliding`` says that
    nothing drives the aeroplane.
    """
    run = open_run(path)
    if run.samples is None:
        raise InputError(f"{path} holds no samples: replay the recording again")
    aircraft = as_loaded(run.current.aircraft, run.samples)  # as the coefficients of the run have it
    if not has_airspeed(run.samples):
        raise InputError("a drag polar needs airspeed, which was not measured")
    if not _has_height(run.samples):
        raise InputError("a drag polar needs the height: neither static pressure nor the GPS position was recorded")
    method = _method(aircraft, run.samples, power, gliding)
    if not 0.0 <= idle <= _MOST_IDLE:
        raise InputError(f"the idle power (--idle) must be from 0 to {_MOST_IDLE:g} W, not {idle:g}")
    folder = folder_to_write(run, run.current)
    found = fit(windows_of(aircraft, run.samples, method, power, idle, run.zero), method)
    content = {
        "model": run.current.identifier, "aircraft": aircraft.name, "method": method,
        **polar_json(found, aircraft.mass, aircraft.wing_area, idle),
    }  # fmt: skip
    figure, notes = draw(folder / "polar.png", content)
    write_json(folder / "polar.json", content)
    kept = {"file": str(folder / "polar.json"), "figure": figure}
    return {**content, **kept, "notes": [*run.notes, *_notes(method, idle), *notes]}


def _has_height(samples: Samples) -> bool:
    """Whether static pressure or GPS has told the height."""
    return any(
        np.isfinite(samples.values[samples.kind == kind, column]).any()
        for kind, column in ((Kind.AIR, 1), (Kind.GPS_POSITION, 2))
    )


def _method(aircraft: Aircraft, samples: Samples, power: str | None, gliding: bool) -> str:
    names = [item.name for item in aircraft.inputs]
    if power is not None:
        if gliding:
            raise InputError("--power and --gliding contradict each other")
        if power not in names:
            listed = ", ".join(names) or "none"
            raise InputError(
                f"the aircraft file has no input {echo(power)} (it has {listed}): name it there, as "
                f"'inputs: {{{echo(power)}: {{unit: W}}}}', and replay again"
            )
        values = samples.values[samples.kind == Kind.INPUTS, names.index(power)]
        if not np.isfinite(values).any():
            raise InputError(f"the recording holds no {echo(power)}")
        return POWER
    if gliding:
        return GLIDING
    thrust = samples.values[samples.kind == Kind.CONTROLS, THRUST_COLUMN]
    if np.isfinite(thrust).any():
        return THRUST
    raise InputError(
        "neither thrust nor power is known: name the input that holds the power of propulsion [W] (--power NAME), or "
        "give --gliding for a flight without propulsion"
    )


def _notes(method: str, idle: float) -> Iterator[str]:
    if method == POWER:
        yield "one efficiency for the whole flight: if it changes with speed and power, that goes into the polar"
        if not idle:
            yield "the power of the avionics counts as propulsion: give --idle W, the power with the motor off"
    if method == GLIDING:
        yield "the flight is taken as unpowered (--gliding): a propeller that turns counts as drag, or as less drag"
    yield "an airspeed that reads 1% too high makes CD0 3% too small, and k 1% too large"


def _smooth(part: Samples, kind: Kind, column: int, at: Array) -> Array:
    """A series of samples at times [s], as means under a bell of ``_BELL`` s; NaN where there is none near.

    What the sensors show and not the state of the filter, which shares a change of airspeed between gusts and motion.
    """
    chosen = (part.kind == kind) & np.isfinite(part.values[:, column])
    cell = np.round((part.stamp[chosen] / 1e9 - at[0]) / STEP).astype(np.int64)
    inside = (cell >= 0) & (cell < len(at))
    values = part.values[chosen, column]
    middle = float(np.median(values)) if len(values) else 0.0
    sums = np.bincount(cell[inside], values[inside] - middle, len(at))
    counts = np.bincount(cell[inside], minlength=len(at)).astype(np.float64)
    bell = [gaussian_filter1d(series, _BELL / STEP, mode="constant", truncate=3.0) for series in (sums, counts)]
    near = gaussian_filter1d(counts, _LONGEST_GAP / STEP, mode="constant", truncate=1.0) > 0.0
    return np.where(near & (bell[1] > 0.0), middle + bell[0] / np.maximum(bell[1], 1e-300), np.nan)


def _held(part: Samples, kind: Kind, column: int, at: Array) -> Array:
    """What was told, linear between samples and held for a while."""
    chosen = (part.kind == kind) & np.isfinite(part.values[:, column])
    times = part.stamp[chosen] / 1e9
    order = np.argsort(times, kind="stable")
    values = part.values[chosen, column : column + 1]
    return interpolate(times[order], values[order], at, _LONGEST_GAP, INPUT_HELD)[:, 0]


def _height(part: Samples, at: Array, density: Array) -> Array:
    """Height [m] above some level, of static pressure where it is measured, or of GPS."""
    pressure = _smooth(part, Kind.AIR, 1, at)
    if np.isfinite(pressure).any():
        return np.asarray(-np.nanmean(pressure / density) / STANDARD_GRAVITY * np.log(pressure / np.nanmean(pressure)))
    return _smooth(part, Kind.GPS_POSITION, 2, at)


def _density(part: Samples, at: Array) -> Array:
    """Air density [kg/m^3] as it was measured, else that of the standard atmosphere at the static pressure, or at the
    height of GPS."""
    density, pressure = _smooth(part, Kind.AIR, 0, at), _smooth(part, Kind.AIR, 1, at)
    if np.isfinite(density).any():
        return density
    if np.isfinite(pressure).any():
        return np.asarray(density_at(pressure))
    return np.full(len(at), air_density(float(np.nanmedian(_smooth(part, Kind.GPS_POSITION, 2, at)))))


def _as_measured(aircraft: Aircraft, samples: Samples, zero: int | None) -> Samples:
    """Samples without the errors of the air data that the aircraft file states; a drift begins at the stamp ``zero``
    [ns], at which the filter started, and where another flight begins.
    """
    drift, values = Drift(aircraft), samples.values.copy()
    flight = flight_at(samples)
    origin = int(samples.stamp[0])
    for number in range(int(flight.max(initial=0)) + 1):
        own = flight == number
        drift.since = (max(int(samples.stamp[own][0]), zero or 0) - origin) / NANOSECONDS
        values[own] = drift.corrected(seconds(samples.stamp[own], origin), samples.kind[own], values[own])
    return Samples(samples.stamp, samples.kind, values)


def windows_of(
    aircraft: Aircraft, samples: Samples, method: str, power: str | None, idle: float, zero: int | None = None
) -> Windows:
    """Sums over windows of the flight in the air; ``zero`` [ns]: the stamp at which the filter started.

    Raises InputError where there is too little of it.
    """
    samples = _as_measured(aircraft, samples, zero)
    stretches = (
        _of_stretch(aircraft, part, number, method, power, idle) for number, part in enumerate(manoeuvres(samples))
    )
    parts = [stretch for stretch in stretches if stretch is not None]
    flown = sum(len(part.gained) for part in parts) * BETWEEN
    if flown < LEAST_FLIGHT - WINDOW:
        raise InputError(
            f"{flown:.0f} s of windows above {aircraft.minimum_airspeed:.3g} m/s with all signals are too few for a "
            f"drag polar: {LEAST_FLIGHT:g} s of flight are needed"
        )
    windows = Windows.joined(parts)
    low, high = np.percentile(windows.lift**2, (5.0, 95.0))
    if high - low < _LEAST_RANGE:
        raise InputError(
            f"the lift coefficient stays near {np.median(windows.lift):.2f}: drag at one speed is not a polar, fly "
            "slow and fast"
        )
    return windows


def _of_stretch(
    aircraft: Aircraft, part: Samples, number: int, method: str, power: str | None, idle: float
) -> Windows | None:
    """Those of one manoeuvre; None where it is too short."""
    if not len(part.stamp):
        return None
    at = np.arange(part.stamp[0] / 1e9, part.stamp[-1] / 1e9, STEP)
    width = round(WINDOW / STEP)
    if len(at) < width + 2:
        return None
    density = _density(part, at)
    speed, height = _smooth(part, Kind.AIRSPEED, 0, at), _height(part, at, density)
    normal = -_smooth(part, Kind.IMU, 2, at)  # along z of the body, which is across the flow to within some per cent
    dynamic = 0.5 * density * speed**2 * aircraft.wing_area
    lift = aircraft.mass * normal / dynamic
    brought, pushed = np.zeros(len(at)), np.zeros(len(at))
    if method == POWER:
        brought = _held(part, Kind.INPUTS, [item.name for item in aircraft.inputs].index(str(power)), at) - idle
    elif method == THRUST:
        pushed = speed * _held(part, Kind.CONTROLS, THRUST_COLUMN, at)
    energy = aircraft.mass * (0.5 * speed**2 + STANDARD_GRAVITY * height)
    flies = (speed > aircraft.minimum_airspeed) & np.isfinite(brought + pushed + lift + energy)
    first = np.arange(0, len(at) - width, round(BETWEEN / STEP))
    first = first[_sums(flies.astype(float), first, width) > width - 0.5]
    if not len(first):
        return None
    brought, pushed, area, induced = (
        _sums(np.where(flies, series, 0.0), first, width) / width
        for series in (brought, pushed, dynamic * speed, dynamic * speed * lift**2)
    )
    gained = (energy[first + width] - energy[first]) / WINDOW
    return Windows(
        gained, brought, pushed, np.column_stack([area, induced]), np.full(len(first), number),
        lift[flies], speed[flies], density[flies],
    )  # fmt: skip


def _sums(series: Array, first: npt.NDArray[np.int64], width: int) -> Array:
    """Trapezoidal sums over windows from each of ``first`` on."""
    middle = np.concatenate([[0.0], np.cumsum(0.5 * (series[1:] + series[:-1]))])
    return np.asarray(middle[first + width] - middle[first])


def fit(windows: Windows, method: str) -> DragPolar:
    """Least squares over the windows, with standard errors that allow for what is correlated."""
    wanted = windows.gained - windows.pushed
    columns = -windows.drag
    names: tuple[str, ...] = ("CD0", "k")
    if method == POWER:
        columns, names = np.column_stack([windows.brought, columns]), ("efficiency", *names)
    if np.linalg.matrix_rank(columns / np.linalg.norm(columns, axis=0)) < len(names):
        raise InputError("power and drag change together all the time: fly at several speeds, with power and without")
    values = _solved(columns, wanted)
    efficiency = values[0] if method == POWER else 1.0
    drag = windows.pushed + efficiency * windows.brought - windows.gained
    points = np.column_stack([np.sqrt(windows.drag[:, 1] / windows.drag[:, 0]), drag / windows.drag[:, 0]])
    return DragPolar(
        names, values, _covariance(columns, wanted, windows.number),
        _explained(columns, wanted, windows.number), len(wanted),
        len(windows.speed) * STEP, _range(windows.lift), _range(windows.speed), float(np.mean(windows.density)), points,
    )  # fmt: skip


def _solved(columns: Array, wanted: Array) -> Array:
    return np.asarray(np.linalg.lstsq(columns, wanted, rcond=None)[0])


def _covariance(columns: Array, wanted: Array, number: npt.NDArray[np.int64]) -> Array:
    """By leaving out each stretch of ``_BLOCK`` s in turn (Efron and Stein 1981), as wide as its few numbers make it.

    That counts what is correlated within a stretch, and that few stretches bend the fit towards themselves.
    """
    block = np.cumsum(np.concatenate([[0], np.diff(number) != 0])) * len(number) + np.arange(len(number)) // _BLOCK
    names = np.unique(block)
    without = np.array([_solved(columns[block != name], wanted[block != name]) for name in names])
    spread = without - without.mean(axis=0)
    free = max(len(names) - columns.shape[1], 1)
    wider = float(stdtrit(free, 0.975) / 1.96)
    return np.asarray(wider**2 * (len(names) - 1) / len(names) * spread.T @ spread)


def _explained(columns: Array, wanted: Array, number: npt.NDArray[np.int64]) -> float:
    """Share of the variance that goes, on a fifth of the flight at a time, without windows that share data with it.

    Around an event that comes once, such windows would fit what they are judged by.
    """
    at = np.arange(len(wanted))
    fold = at * _FOLDS // len(wanted)
    left = np.empty_like(wanted)
    for part in range(_FOLDS):
        held = fold == part
        first, last = np.flatnonzero(held)[[0, -1]]
        nearest = np.clip(at, first, last)  # of those that are held out
        fitted = ~held & ((np.abs(at - nearest) > _SHARING) | (number != number[nearest]))
        left[held] = wanted[held] - columns[held] @ _solved(columns[fitted], wanted[fitted])
    return 1.0 - float(np.mean(left**2) / np.var(wanted))


def _range(values: Array) -> tuple[float, float]:
    low, high = np.percentile(values, (5.0, 95.0))
    return float(low), float(high)


def polar_json(found: DragPolar, mass: float, area: float, idle: float) -> dict[str, Any]:
    """What is said of a polar: its numbers, the polar and level flight over what was flown."""
    lift, speed = np.linspace(*found.lift, 21), np.linspace(*found.speed, 21)
    drag, drag_std = found.drag(lift)
    draws = np.random.default_rng(0).multivariate_normal(found.values, found.covariance, _DRAWS)
    level = _level(found.values[None], speed, found.density, mass, area, idle)[0]
    spread = _spread(_level(draws, speed, found.density, mass, area, idle))
    parameters = [
        {"name": name, "value": float(value), "std": float(std), "status": status, "reason": reason}
        for name, value, std, (status, reason) in zip(
            found.names, found.values, found.std, map(found.status, range(len(found.names))), strict=True
        )
    ]
    zero, induced = found.values[-2:]
    ratios = 0.5 / np.sqrt(np.maximum(draws[:, -2] * draws[:, -1], 1e-12))
    glide = None
    if found.explained >= LEAST_EXPLAINED and np.all(found.values[-2:] > _KNOWN * found.std[-2:]):
        best = float(np.sqrt(zero / induced))
        glide = {
            "ratio": float(0.5 / np.sqrt(zero * induced)),
            "std": _spread(ratios[:, None])[0],
            "lift": best,
            "airspeed": float(np.sqrt(2.0 * mass * STANDARD_GRAVITY / (found.density * area * best))),
            "inside": bool(found.lift[0] <= best <= found.lift[1]),
        }
    return {
        "parameters": parameters,
        "covariance": found.covariance.tolist(),
        "explained": found.explained,
        "windows": found.windows,
        "time": found.time,
        "lift": list(found.lift),
        "airspeed": list(found.speed),
        "density": found.density,
        "polar": {"lift": lift.tolist(), "drag": drag.tolist(), "std": drag_std.tolist()},
        "level": {"airspeed": speed.tolist(), "power": level.tolist(), "std": spread},
        "best_glide": glide,
        "points": found.points.tolist(),
    }


def _level(values: Array, speed: Array, density: float, mass: float, area: float, idle: float) -> Array:
    """Power [W] that level flight takes from its source, (draws, speeds)."""
    dynamic = 0.5 * density * speed**2 * area
    drag = values[:, -2:-1] + values[:, -1:] * (mass * STANDARD_GRAVITY / dynamic) ** 2
    efficiency = values[:, :1] if values.shape[1] > 2 else np.ones((len(values), 1))
    return np.asarray(dynamic * speed * drag / np.maximum(efficiency, 1e-3) + (idle if values.shape[1] > 2 else 0.0))


def _spread(draws: Array) -> list[float]:
    """Half of the width in which 68 % of the draws are."""
    low, high = np.percentile(draws, (15.87, 84.13), axis=0)
    return [float(half) for half in 0.5 * (high - low)]
