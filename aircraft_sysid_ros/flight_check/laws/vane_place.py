"""Where the vane of the angle of attack sits, by how it moves when the wing rolls: (6.17) at a place beside the centre
of gravity, for steady wind,

    d(alpha)/dt = q - ... + (f_z + g_z)/V + y d((p cos(alpha) + r sin(alpha))/V)/dt - x d(q/V)/dt,

y to the right. Gusts have no part in the roll, so that y is found in any air; x, which any delay looks like, is not.
A vane on a wing of which the aircraft file says nothing spoils all that depends on the angle of attack.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aircraft_sysid_ros.flight_check.finding import ERROR, Finding
from aircraft_sysid_ros.flight_check.grid import regress
from aircraft_sysid_ros.flight_check.motion import Motion

#: Kind, severity and signal of the finding.
MARKS = ("offset", ERROR, "angle_of_attack")
_SHORT, _LONG = 0.25, 4.0
#: Interval [s] between samples of the vane up to which its motion in that band is seen.
LONGEST = 0.2
#: Share of the span by which a vane is elsewhere that matters, and by how many standard errors it surely is.
_MATTERS, _SURE = 0.1, 5.0
#: Where no file says it, it is taken there if that is farther out than this share of the span, and so many standard
#: errors.
_OUT, _LIKELY = 0.03, 3.0
#: Standard error over what matters from which the place is known to be right, if it is not found to be wrong.
_KNOWN = 0.5


class Vane(NamedTuple):
    """What an aircraft file has of the vane."""

    right: float  # [m] of the centre of gravity
    span: float  # [m]
    is_said: bool  # the file says it, and does not leave it out


def sideways(motion: Motion) -> tuple[float, float] | None:
    """How far [m] the vane sits to the right of the centre of gravity, and its standard error; None without motion."""
    grid, (p, q, r) = motion.grid, motion.gyro.T
    short = max(_SHORT, 4.0 * grid.step)
    with np.errstate(invalid="ignore", divide="ignore"):
        rolling = (p * np.cos(motion.alpha) + r * np.sin(motion.alpha)) / motion.speed
        terms = [grid.as_slope(q), grid.as_slope(motion.force[:, 2] / motion.speed)]
        terms += [grid.slope(rolling), grid.slope(-q / motion.speed)]
    columns = np.column_stack([grid.band(term, short, _LONG) for term in terms])
    solved = regress(grid.band(grid.slope(motion.alpha), short, _LONG), columns, grid.step)
    return None if solved is None else (float(solved[0][2]), float(solved[1][2]))


def taken(found: tuple[float, float] | None, vane: Vane) -> tuple[float, float] | None:
    """Where [m] to the right a vane is that nobody has placed, and one sigma; None: where the file has it."""
    if found is None or abs(found[0] - vane.right) < max(_OUT * vane.span, _LIKELY * found[1]):
        return None
    return found


def is_known(found: tuple[float, float] | None, span: float) -> bool:
    """Whether the place is known well enough to say that it is right."""
    return found is not None and found[1] < _KNOWN * _MATTERS * span


def findings(found: tuple[float, float] | None, vane: Vane) -> list[Finding]:
    """That the vane is not where the aircraft file has it."""
    if found is None or not abs(found[0] - vane.right) > max(_MATTERS * vane.span, _SURE * found[1]):
        return []
    of_file = (
        f", which the aircraft file has at {vane.right:.2f} m: set y of air_data_position"
        if vane.is_said
        else f". The aircraft file does not say where it is: set air_data_position: [null, {found[0]:.2f}, null] there"
    )
    place = f"{found[0]:.2f} ± {found[1]:.2f} m to the right of the centre of gravity"
    return [Finding(MARKS[2:], *MARKS[:2], f"when the wing rolls it moves as one {place}{of_file}")]
