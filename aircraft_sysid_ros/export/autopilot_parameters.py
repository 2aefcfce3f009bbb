"""Parameters of autopilots from level flight and from rate loops: trims, airspeeds, feed-forward and gains.

PX4: src/modules/fw_rate_control/FixedwingRateControl.cpp at 3e1f68e5 and src/lib/rate_control/rate_control.cpp at
0155b3a8 of PX4/PX4-Autopilot. With s = FW_AIRSPD_TRIM / V and e = rate setpoint - rate [rad/s], the command is
``s^2 (P e + I int e dt) + s FF setpoint + trim``, -1 to 1, positive for a positive moment.

ArduPlane: libraries/APM_Control/AP_FW_Controller.cpp at b29a8cae of ArduPilot/ardupilot. With s = SCALING_SPEED / V the
output in degrees, of which 45 are the whole travel, is ``57.3 (s^2 (P e + I int e dt) + s FF setpoint / EAS2TAS)``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.export.learnt_model import SURFACES, LearntModel
from aircraft_sysid_ros.export.level_flight import LevelFlight, moment_signs
from aircraft_sysid_ros.export.rate_loops import ROLL, RateLoop
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.rounding import fixed, with_error

Array = npt.NDArray[np.float64]

#: Whole travel of a surface in ArduPlane's output, 4500 centidegrees.
_ARDUPLANE_TRAVEL = 45.0
#: MAV_PARAM_TYPE_REAL32 in a parameter file of QGroundControl.
_REAL32 = 9
_PX4_TRIM = {"de": "PITCH", "da": "ROLL", "dr": "YAW"}
_LETTER = {"PITCH": "P", "ROLL": "R", "YAW": "Y"}


@dataclass(frozen=True)
class Entry:
    """A parameter of an autopilot; ``std``: NaN where none is stated."""

    name: str
    value: float
    std: float = float("nan")
    what: str = ""
    doubt: str = ""  # what it rests on and is not to be used, in words


def with_std(entries: Sequence[Entry], std: Mapping[str, float]) -> list[Entry]:
    """Entries with standard errors by name; those that are no larger than rounding are left out."""
    return [replace(e, std=std[e.name]) if std.get(e.name, 0.0) > 1e-9 else e for e in entries]


#: Main derivatives that level flight rests on, by beginnings of names.
_RESTS_ON = {
    ("FW_AIRSPD_STALL", "FW_AIRSPD_MIN", "FW_PSP_OFF"): ("CZ_alpha",),
    ("TRIM_PITCH", "FW_DTRIM_P"): ("CZ_alpha", "Cm_alpha", "Cm_de"),
    ("TRIM_ROLL", "FW_DTRIM_R"): ("Cl_da",),
    ("TRIM_YAW", "FW_DTRIM_Y"): ("Cn_dr",),
}


def with_doubts(learnt: LearntModel, entries: Sequence[Entry]) -> list[Entry]:
    """Entries of which what they rest on is not to be used say so: they are written, but not set."""
    unsure = {p.name: f"{p.name} ({p.status})" for p in learnt.parameters if p.status != Trust.USE.name}
    found = []
    for entry in entries:
        rests_on = next((names for begins, names in _RESTS_ON.items() if entry.name.startswith(begins)), ())
        found.append(replace(entry, doubt=" and ".join(unsure[name] for name in rests_on if name in unsure)))
    return found


def doubt_notes(entries: Sequence[Entry]) -> list[str]:
    """Which entries are not set, in words."""
    if not (doubtful := [entry.name for entry in entries if entry.doubt]):
        return []
    return [
        f"{', '.join(doubtful)} rest on parameters that are not to be used, and stand in the file as comments: take "
        "the # of a line away once you have checked its value"
    ]


def not_set(doubt: str) -> str:
    """The end of the words of an entry that rests on what is not to be used; empty of others."""
    return f"; NOT SET, since it rests on {doubt}" if doubt else ""


def px4_trims(learnt: LearntModel, levels: Sequence[LevelFlight], full: Array) -> list[Entry]:
    """TRIM_* of the first level flight, and what is added at the lowest and the highest airspeed."""
    signs, found = moment_signs(learnt, levels[0].signals), []
    for k, surface in enumerate(SURFACES):
        name, sign = _PX4_TRIM[surface], signs[surface]
        if sign == 0.0:
            continue
        at, low, high = (sign * float(level.surfaces[k]) / float(full[k]) for level in levels)
        found.append(Entry(f"TRIM_{name}", at, what="command in level flight at FW_AIRSPD_TRIM"))
        for change, end in ((low - at, "VMIN"), (high - at, "VMAX")):
            what = f"is added at FW_AIRSPD_{end[1:]}"
            found.append(Entry(f"FW_DTRIM_{_LETTER[name]}_{end}", change, what=what))
    return found


def px4_gains(loops: Sequence[RateLoop], full: Mapping[str, float]) -> list[Entry]:
    """FW_RR_* and FW_PR_*; ``full`` [rad] by axis."""
    found = []
    for loop in loops:
        prefix, k = ("FW_RR" if loop.axis == ROLL else "FW_PR"), 1.0 / full[loop.axis]
        found += [
            Entry(f"{prefix}_FF", k * loop.ff, k * loop.ff_std, "command per rad/s of setpoint"),
            Entry(f"{prefix}_P", k * loop.p, what="command per rad/s of error"),
            Entry(f"{prefix}_I", k * loop.i, what="command per rad of error"),
            Entry(f"{prefix}_D", 0.0, what="the loop is designed without"),
        ]
    return found


def arduplane_gains(loops: Sequence[RateLoop], full: Mapping[str, float], level: LevelFlight) -> list[Entry]:
    """SCALING_SPEED, RLL_RATE_* and PTCH_RATE_*; ``full`` [rad] by axis."""
    to_true = level.airspeed / level.calibrated_airspeed
    found = [Entry("SCALING_SPEED", level.calibrated_airspeed, what="airspeed of the gains, m/s")]
    for loop in loops:
        prefix = "RLL_RATE" if loop.axis == ROLL else "PTCH_RATE"
        k = np.radians(_ARDUPLANE_TRAVEL) / full[loop.axis]
        found += [
            Entry(f"{prefix}_FF", k * to_true * loop.ff, k * to_true * loop.ff_std, "from demanded rate"),
            Entry(f"{prefix}_P", k * loop.p, what="from error"),
            Entry(f"{prefix}_I", k * loop.i, what="from integral of error"),
            Entry(f"{prefix}_D", 0.0, what="the loop is designed without"),
        ]
    return found


def px4_file(comments: Sequence[str], entries: Sequence[Entry], proposed: Sequence[Entry] = ()) -> str:
    """A parameter file of QGroundControl; ``proposed`` ones, which no release has, and doubtful ones are comments."""
    lines = [f"# {line}" for line in comments]
    lines += [f"# {_described(entry)}" for entry in (*entries, *proposed) if entry.what]
    lines.append("# Vehicle-Id Component-Id Name Value Type")
    lines += [f"{'#' * bool(e.doubt)}1\t1\t{e.name}\t{fixed(e.value, 6)}\t{_REAL32}" for e in entries]
    lines += [f"#1\t1\t{entry.name}\t{fixed(entry.value, 6)}\t{_REAL32}" for entry in proposed]
    return "\n".join(lines) + "\n"


def arduplane_file(comments: Sequence[str], entries: Sequence[Entry]) -> str:
    """A parameter file of ArduPilot's ground stations."""
    lines = [f"# {line}" for line in comments]
    lines += [f"# {_described(entry)}" for entry in entries if entry.what]
    lines += [f"{entry.name},{fixed(entry.value, 6)}" for entry in entries]
    return "\n".join(lines) + "\n"


def _described(entry: Entry) -> str:
    shown = with_error(entry.value, entry.std, "+-") if np.isfinite(entry.std) else f"{round(entry.value, 9) + 0.0:.5g}"
    return f"{entry.name} = {shown}: {entry.what}{not_set(entry.doubt)}"
