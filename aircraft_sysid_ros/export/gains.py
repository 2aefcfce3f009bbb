"""Trim, feed-forward and first gains of the rate loops of an autopilot, with what they rest on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.export.autopilot_parameters import (
    Entry,
    arduplane_file,
    arduplane_gains,
    doubt_notes,
    px4_file,
    px4_gains,
    px4_trims,
    with_doubts,
    with_std,
)
from aircraft_sysid_ros.export.exported import header_lines
from aircraft_sysid_ros.export.learnt_model import LearntModel, standard_errors
from aircraft_sysid_ros.export.level_flight import level_words, time_notes
from aircraft_sysid_ros.export.px4 import levels_of
from aircraft_sysid_ros.export.rate_loops import (
    GAIN_MARGIN,
    PHASE_MARGIN,
    PITCH,
    ROLL,
    Actuator,
    RateLoop,
    design,
)

Array = npt.NDArray[np.float64]

PX4, ARDUPLANE = "px4", "arduplane"
AUTOPILOTS = (PX4, ARDUPLANE)
SUFFIXES = {PX4: ".params", ARDUPLANE: ".param"}


@dataclass(frozen=True)
class Gains:
    """Both loops, the parameters, and the file."""

    loops: tuple[RateLoop, ...]
    entries: tuple[Entry, ...]
    content: str
    notes: tuple[str, ...]


def gains(learnt: LearntModel, autopilot: str, full: Array, actuator: Actuator) -> Gains:
    """``full`` (3,) [rad]: elevator, aileron and rudder at full command.

    Raises InputError where there is no level flight, or where the covariance allows an unstable loop.
    """
    loops = tuple(design(learnt, axis, actuator) for axis in (ROLL, PITCH))
    levels = levels_of(learnt)
    reach = {ROLL: float(full[1]), PITCH: float(full[0])}
    notes = (
        *(_about(loop) for loop in loops),
        *(
            f"{lag.text} of the model is taken to follow at once: margins are smaller for it"
            for lag in learnt.model.lags
        ),
        *time_notes(learnt),
        f"asked: a gain margin of {20.0 * np.log10(GAIN_MARGIN):.0f} dB and a phase margin of "
        f"{np.degrees(PHASE_MARGIN):.0f} deg, with an actuator lag of {1e3 * actuator.lag:.0f} ms and a delay of "
        f"{1e3 * actuator.delay:.0f} ms; P no larger than half of FF",
        *(level_words(level) for level in levels),
        "full command is elevator {:.1f}, aileron {:.1f}, rudder {:.1f} deg".format(*np.degrees(full)),
        "first gains, for flights under supervision: attitude loops, filters and integrator limits are as they were",
    )
    comments = [*header_lines(learnt, autopilot, {}, ()), *notes]
    if autopilot == PX4:
        speed = Entry("FW_AIRSPD_TRIM", levels[0].calibrated_airspeed, what="airspeed of the gains, m/s")
        std = standard_errors(learnt, lambda model: _trims(model, full))
        trims = with_doubts(learnt, with_std(px4_trims(learnt, levels, full), std))
        entries = [speed, *trims, *px4_gains(loops, reach)]
        notes, comments = (*notes, *doubt_notes(trims)), [*comments, *doubt_notes(trims)]
        return Gains(loops, tuple(entries), px4_file(comments, entries), notes)
    entries = arduplane_gains(loops, reach, levels[0])
    return Gains(loops, tuple(entries), arduplane_file(comments, entries), notes)


def _trims(learnt: LearntModel, full: Array) -> dict[str, float]:
    levels = levels_of(learnt)
    return {e.name: e.value for e in px4_trims(learnt, levels, full)}


def _about(loop: RateLoop) -> str:
    crossover = f", crossover {loop.crossover:.1f} rad/s" if np.isfinite(loop.crossover) else ""
    phase = (
        f"phase margin {np.degrees(loop.phase_margin):.0f} deg" if np.isfinite(loop.phase_margin) else "gain below 1"
    )
    return (
        f"{loop.axis} rate loop: gain margin {20.0 * np.log10(loop.gain_margin):.1f} dB, {phase}{crossover}, stable in "
        f"{100.0 * loop.stable_share:.1f} % of draws from the covariance"
    )
