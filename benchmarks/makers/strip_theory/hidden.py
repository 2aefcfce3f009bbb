"""What is drawn for a flight, what may be wrong in it, and what a diagnosis should call that."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from . import aeroplane as parts
from .aeroplane import CLEAN, FAMILIES, STALL, STALL_WIDTH, Aeroplane, drawn_aeroplane
from .flight import RATE, Motion, flown, rotation, smoothed
from .log import recorded

Array = npt.NDArray[np.float64]

SECONDS = 120.0
#: What may be wrong with sensors and file, and what they are when nothing is.
SENSORS = {
    "airspeed_scale": 1.0, "alpha_scale": 1.0, "alpha_offset": 0.0, "beta_offset": 0.0, "alpha_drift": 0.0,
    "air_delay": 0.0, "imu_delay": 0.0, "mass": 1.0,
}  # fmt: skip
#: What is wrong, and the ids of the library that say so.
EFFECTS: dict[str, tuple[str, ...]] = {
    "alpha_offset": ("alpha_offset",),
    "alpha_drift": ("alpha_drift",),
    "airspeed_scale": ("airspeed_scale",),
    "alpha_scale": ("alpha_scale",),
    "late_imu": ("imu_lag",),
    "late_air_data": ("air_data_lag",),
    "wrong_mass": ("mass_change",),
    "stuck_aileron": ("stuck_control",),
    "stuck_elevator": ("stuck_control",),
    "half_elevator": ("control_damage",),
    "aft_cg": ("cg_shift",),
    "ice": ("icing",),
    "flaps": ("flaps",),
    "engine_cut": ("loss_of_thrust",),
    "ground": ("ground_effect",),
    "propeller_wash": ("propwash",),
    "half_fin": ("parameter_change",),
}
#: And what was thought of later, which no list of seeds drawn before has.
FURTHER: dict[str, tuple[str, ...]] = {
    "one_aileron": ("stuck_control",),
}


def setting_of(rng: np.random.Generator) -> dict[str, Any]:
    """Air, sensors and manoeuvres of a flight, which no file says."""
    family = str(rng.choice(list(FAMILIES)))
    gusts = float(rng.choice([0.0, 0.0, 0.02, 0.05]))
    return {
        "family": family,
        "seconds": SECONDS,
        "style": str(rng.choice(["level", "speeds", "speeds", "mission"])),
        "air": {0.0: "calm", 0.02: "light", 0.05: "moderate"}[gusts],
        "gust_share": gusts,
        "rate": float(rng.choice([10.0, 10.0, 20.0, 50.0])),
        "beta": bool(rng.random() < 0.6),
        "attitude": bool(rng.random() < 0.7),
        "wind_share": rng.uniform(-0.15, 0.15, 2).tolist(),
        "imu_place": (rng.uniform(0.0, 0.05, 3) * rng.choice([0.0, 1.0])).tolist(),
        "boom": float(rng.choice([0.0, 0.15, 0.3])),
        "smoothing": float(rng.choice([0.0, 0.0, 0.015])),
        "gps_delay": float(rng.choice([0.0, 0.0, 0.1])),
    }


#: What of the aeroplane is otherwise from one moment on, or all the time.
_FROM_THEN_ON = {
    "half_elevator": (parts.ELEVATOR, 0.5),
    "engine_cut": (parts.THRUST, 0.0),
    "half_fin": (parts.FIN_PART, 0.5),
}
#: Height of the ground below the lowest point of low passes, in spans: a wing is as high when the wheels touch it.
_CLEAR, _TRIES = 0.1, 6
_ALWAYS = {"ground": (parts.GROUND, 1.0), "propeller_wash": (parts.WASH, 3.0)}
#: What of the sensors or of the file is wrong, and by how much, to either side; and what is late [s].
_WRONG = {"alpha_offset": 0.04, "airspeed_scale": 0.09, "alpha_scale": 0.2, "wrong_mass": 0.15, "alpha_drift": 0.05}
_LATE = {"late_imu": ("imu_delay", 0.12), "late_air_data": ("air_delay", 0.2)}
_STUCK = {"stuck_elevator": 0, "stuck_aileron": 1}


def _hide(
    rng: np.random.Generator, effect: str | None, time: Array, chord: float
) -> tuple[Array, npt.NDArray[np.bool_], dict[str, float], Array, float]:
    """Changes of the aeroplane, stuck surfaces, what is wrong with sensors, flaps, and when something begins [s]."""
    n = len(time)
    changes, stuck, sensors, flaps = np.tile(CLEAN, (n, 1)), np.zeros((n, 3), np.bool_), dict(SENSORS), np.zeros(n)
    begin, size = float(rng.uniform(0.4, 0.6) * SECONDS), float(rng.choice([-1.0, 1.0]))
    after = time >= begin
    if effect in _WRONG:
        sensors["mass" if effect == "wrong_mass" else effect] += size * _WRONG[effect]
    if effect in _LATE:
        sensors[_LATE[effect][0]] = _LATE[effect][1]
    if effect in _FROM_THEN_ON:
        changes[after, _FROM_THEN_ON[effect][0]] = _FROM_THEN_ON[effect][1]
    if effect in _ALWAYS:
        changes[:, _ALWAYS[effect][0]] = _ALWAYS[effect][1]
    if effect in _STUCK:
        stuck[after & (time < begin + rng.uniform(25.0, 40.0)), _STUCK[effect]] = True
    if effect == "one_aileron":  # of two, which stays at an angle
        changes[after, parts.LEFT_FOLLOWS] = 0.0
        changes[after, parts.LEFT_AT] = float(rng.choice([0.0, 1.0])) * rng.uniform(-0.12, 0.12)
    if effect == "aft_cg":
        changes[after, parts.CG_AFT] = 0.06 * chord
    if effect == "ice":
        changes[:, parts.ICE] = np.clip((time - begin) / 30.0, 0.0, 1.0)
    if effect == "flaps":
        for start in rng.uniform(0.1, 0.85, 3) * SECONDS:
            flaps[(time > start) & (time < start + 22.0)] = 0.35
        flaps = smoothed(flaps, 1.0)
        changes[:, parts.FLAPS] = flaps
    return changes, stuck, sensors, flaps, begin


def make(seed: int, effect: str | None, folder: Path) -> dict[str, Any]:
    """A flight of one seed as a log in a folder; what it was."""
    return made(seed, effect, folder)[0]


def made(seed: int, effect: str | None, folder: Path) -> tuple[dict[str, Any], Aeroplane, Motion]:
    """The same, with the aeroplane and what happened."""
    rng = np.random.default_rng(seed)
    setting = setting_of(rng)
    plane = drawn_aeroplane(rng, setting["family"])
    time = np.arange(int(SECONDS * RATE)) / RATE
    changes, stuck, sensors, flaps, begin = _hide(rng, effect, time, plane.chord)
    low = 1.5 * plane.span if effect == "ground" else 0.0  # that much below the cruise are low passes
    setting |= {
        "gusts": setting["gust_share"] * plane.cruise,
        "wind": [share * plane.cruise for share in setting["wind_share"]],
        "above_ground": plane.altitude,
        "low": low,
    }
    motion = _low_passes(rng, plane, setting, changes, stuck) if low else flown(rng, plane, setting, changes, stuck)
    recorded(rng, folder, plane, motion, setting, sensors, flaps)
    told = {"seed": seed, "effect": effect, "begin": round(begin, 1), **setting}
    return told | {"stalled": _stalled(plane, motion)}, plane, motion


def _low_passes(
    rng: np.random.Generator, plane: Aeroplane, setting: dict[str, Any], changes: Array, stuck: npt.NDArray[np.bool_]
) -> Motion:
    """A flight of which the ground lies a little below the lowest point: that of one over none, then of itself."""
    for _ in range(_TRIES):
        motion = flown(deepcopy(rng), plane, setting, changes, stuck)
        lowest = float(np.min(-motion.states[:, 12])) - (plane.altitude - setting["above_ground"])
        if 0.5 * _CLEAR * plane.span < lowest < 2.0 * _CLEAR * plane.span:
            break
        setting["above_ground"] += _CLEAR * plane.span - lowest
    return flown(rng, plane, setting, changes, stuck)


def _stalled(plane: Aeroplane, motion: Motion) -> bool:
    """Whether the flow leaves the middle of the wing somewhere in a flight: a pilot without thrust holds his height."""
    to_ned = np.array([rotation(q) for q in motion.columns(slice(6, 10))])
    air = motion.columns(slice(0, 3)) - np.einsum("nij,ni->nj", to_ned, motion.wind)
    strip = plane.strips[parts.WING // 2]
    angle = np.arctan2(air[:, 2], air[:, 0]) + strip[parts.INCIDENCE]
    return bool(np.max(angle) / (1.0 + strip[parts.SLOPE] / (np.pi * strip[parts.ASPECT])) > STALL - 2.0 * STALL_WIDTH)
