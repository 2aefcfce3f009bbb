"""Trims and airspeed limits of PX4, and FW_W_* of its open pull request 25966.

Meaning of the parameters: src/modules/fw_rate_control/fw_rate_control_params.c at 0290a619 (airspeeds),
src/modules/fw_att_control/fw_att_control_params.c (FW_PSP_OFF) of PX4/PX4-Autopilot. FW_W_*: the description of pull
request 25966 and src/modules/fw_wind_estimator/fw_wind_estimator_params.c at 4854b965; all are at least 0 there, so
C_L = A0 + A1 alpha and C_Y = -B1 beta.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.export.autopilot_parameters import (
    Entry,
    doubt_notes,
    px4_file,
    px4_trims,
    with_doubts,
    with_std,
)
from aircraft_sysid_ros.export.exported import Exported, header_lines
from aircraft_sysid_ros.export.learnt_model import LearntModel, fitted, percent, standard_errors
from aircraft_sysid_ros.export.level_flight import (
    LevelFlight,
    airspeeds_of,
    level_flight,
    level_words,
    lift_coefficient,
    slowest,
    time_notes,
)

Array = npt.NDArray[np.float64]

PULL_REQUEST = "pr25966"
VERSIONS = ("main", PULL_REQUEST)
#: Share of FW_AIRSPD_MIN that FW_AIRSPD_STALL may be in releases with fw_pos_control_l1 (``parameters_update``).
_LARGEST_STALL = 0.9
_NOT_HELD = ("the coefficients but for those of FW_W_*: PX4 has no model of the aeroplane",)


def export_px4(learnt: LearntModel, full: Array | None, version: str = VERSIONS[0]) -> Exported:
    """``full`` (3,) [rad]: elevator, aileron and rudder at a command of 1; None: not known, and no trims.

    Raises InputError where the model has no level flight.
    """
    levels = levels_of(learnt)
    notes = [*(level_words(level) for level in levels), *time_notes(learnt)]
    stall, low, *_ = airspeeds(learnt, levels)
    if stall.value > _LARGEST_STALL * low.value:
        notes.append(
            f"FW_AIRSPD_STALL is more than {_LARGEST_STALL} of FW_AIRSPD_MIN, which older releases of PX4 refuse: with "
            f"these raise FW_AIRSPD_MIN to {stall.value / _LARGEST_STALL:.1f} m/s"
        )
    if full is None:
        notes.append("no TRIM_*: give --full-deflection, the degrees of elevator, aileron and rudder at full command")
    notes.append("gains: aircraft-sysid gains RUN --to px4 --full-deflection E,A,R")
    std = standard_errors(learnt, lambda model: {e.name: e.value for e in _entries(model, full)})
    std |= standard_errors(learnt, lambda model: {e.name: e.value for e in wind_estimator(model)[0]})
    proposed, misses = wind_estimator(learnt)
    entries, proposed = with_doubts(learnt, with_std(_entries(learnt, full), std)), with_std(proposed, std)
    notes += doubt_notes(entries)
    of_side = "how C_Y goes with the sideslip is not known, so that FW_W_C_B1 is left out"
    if "CY" in misses:
        of_side = f"C_Y = -FW_W_C_B1 beta within {percent(misses['CY'])}"
    notes.append(
        "FW_W_* are of PX4's open pull request 25966, not of a release: C_L = FW_W_C_A0 + FW_W_C_A1 alpha within "
        f"{percent(misses['CL'])} of its spread over the flight, {of_side}"
    )
    comments = [*header_lines(learnt, "PX4", {}, _NOT_HELD), *notes]
    if version == PULL_REQUEST:
        text = px4_file(comments, [*entries, *proposed])
    else:
        text = px4_file(comments, entries, proposed)
    return Exported(text, {}, _NOT_HELD, tuple(notes))


def _entries(learnt: LearntModel, full: Array | None) -> list[Entry]:
    levels = levels_of(learnt)
    pitch = Entry("FW_PSP_OFF", float(np.degrees(levels[0].alpha)), what="deg, pitch at trim")
    return [*airspeeds(learnt, levels), pitch, *([] if full is None else px4_trims(learnt, levels, full))]


def levels_of(learnt: LearntModel) -> list[LevelFlight]:
    """Level flight at FW_AIRSPD_TRIM, MIN and MAX.

    Raises InputError where the model has none.
    """
    return [level_flight(learnt, airspeed) for airspeed in airspeeds_of(learnt)]


def airspeeds(learnt: LearntModel, levels: list[LevelFlight]) -> list[Entry]:
    """Calibrated airspeeds [m/s] of ``levels_of``, and that of the stall, which is not above the lowest."""
    trim, low, high = (level.calibrated_airspeed for level in levels)
    stall = min(slowest(learnt) or low, low)
    return [
        Entry("FW_AIRSPD_STALL", stall, what="m/s, level flight at the largest lift flown: no stall was seen"),
        Entry("FW_AIRSPD_MIN", low, what="m/s, the slowest that was learnt and that the lift flown carries"),
        Entry("FW_AIRSPD_TRIM", trim, what="m/s, the median of the flight"),
        Entry("FW_AIRSPD_MAX", high, what="m/s, the fastest that was learnt"),
    ]


def wind_estimator(learnt: LearntModel) -> tuple[list[Entry], dict[str, float]]:
    """FW_W_* and the rms error of C_L and C_Y over their spread; those of C_Y where it goes with the sideslip."""
    flown = learnt.flown
    lift, alpha = lift_coefficient(flown), flown.signal("alpha")
    of_lift = fitted({"1": np.ones(len(alpha)), "alpha": alpha}, lift, {"1", "alpha"})
    entries = [
        Entry("FW_W_MASS", learnt.aircraft.mass, what="kg"),
        Entry("FW_W_AREA", learnt.aircraft.wing_area, what="m^2"),
        Entry("FW_W_C_A0", of_lift["1"], what="C_L at zero angle of attack"),
        Entry("FW_W_C_A1", of_lift["alpha"], what="C_L per rad of angle of attack"),
    ]
    misses = {"CL": _missed(lift - of_lift["1"] - of_lift["alpha"] * alpha, lift)}
    if "beta" in flown.reads("CY"):
        side, beta = flown.coefficients[:, 1], flown.signal("beta")
        slope = fitted({"beta": beta}, side, {"beta"})["beta"]
        entries.insert(2, Entry("FW_W_C_B1", -slope, what="-C_Y per rad of sideslip"))
        misses["CY"] = _missed(side - slope * beta, side)
    return entries, misses


def _missed(error: Array, of: Array) -> float:
    """Root mean square of an error (n,) over the spread of what it is an error of (n,)."""
    return float(np.sqrt(np.mean(error**2)) / max(np.std(of), 1e-12))
