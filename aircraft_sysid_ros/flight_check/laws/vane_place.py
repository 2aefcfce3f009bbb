"""Where the vane of the angle of attack sits, by how it moves when the wing rolls: (6.17) at a place beside the centre
of gravity, for steady wind,

    d(alpha)/dt = q - ... + (f_z + g_z)/V + y d((p cos(alpha) + r sin(alpha))/V)/dt - x d(q/V)/dt,

y to the right; x, which any delay looks like, is not found. A vane on a wing of which the aircraft file says nothing
spoils all that depends on the angle of attack.

Gusts, e, are what is left. As far as they come by turns with the roll, time takes them out. But a gust that is met
aslant lifts the vane and one wing, in phase with the roll's acceleration, and looks like a place beside, however long
the flight. So what of that acceleration follows neither the surfaces nor rates and sideslip is a term of its own: y is
found by the rest, which the surfaces command (two-stage least squares). Rates and an autopilot's surfaces follow
earlier gusts, by a correlation with e that nobody knows. ``_ASLANT`` is one sigma of it where nothing explains the
acceleration, and less by the root of the share 1 - R^2 that nothing does, which makes an error of y of

    _ASLANT |mean course| sqrt(1 - R^2) sd(e) / sd(acceleration by which y is found),

without the noise of the vane in e, which rolls nothing: in calm air nothing is left of it. Gusts that come aslant on
one course come from the other side on the way back: the mean of the unit vectors of the course is what is left of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.unsaid_places import MATTERS
from aircraft_sysid_ros.flight_check.finding import ERROR, Finding
from aircraft_sysid_ros.flight_check.grid import Grid, regress
from aircraft_sysid_ros.flight_check.motion import Motion
from aircraft_sysid_ros.samples import Kind

Array = npt.NDArray[np.float64]

#: Kind, severity and signal of the finding.
MARKS = ("offset", ERROR, "angle_of_attack")
_SHORT, _LONG = 0.25, 4.0
#: What covers less of the flight explains no roll.
_COVERED = 0.9
#: Root mean square of what stands still; the share from which on something is left.
_STILL, _ALL = 1e-12, 1e-9
#: Interval [s] between samples of the vane up to which its motion in that band is seen.
LONGEST = 0.2
#: By how many standard errors a vane surely is elsewhere.
_SURE = 5.0
#: One sigma of the correlation between gusts at the vane and the roll that earlier ones have made: 0.2 to 0.4 where all
#: gusts come aslant and nothing else rolls much.
_ASLANT = 0.2
#: One sigma of the share of the roll that a vane does not show, and by how far samples are apart [s] as much again: a
#: lag of 30 ms and means from sample to sample left 7 to 9 % of it out at 50 to 100 Hz, and 25 % at 10 Hz.
_LOST, _LOST_STEP = 0.06, 0.04
#: Beyond half of the span by more than so many standard errors, or than this share of the span, is no place.
_BEYOND, _TIP = 2.0, 0.05
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
    by_gusts, share = _unexplained(motion, short)
    with np.errstate(invalid="ignore", divide="ignore"):
        rolling = (p * np.cos(motion.alpha) + r * np.sin(motion.alpha)) / motion.speed
        terms = [grid.slope(rolling), grid.as_slope(q), grid.as_slope(motion.force[:, 2] / motion.speed)]
        terms += [grid.slope(-q / motion.speed)]
        columns = [grid.band(term, short, _LONG) for term in terms]
        columns += [by_gusts / motion.speed] if share > _ALL else []
    x, target = np.column_stack(columns), grid.band(grid.slope(motion.alpha), short, _LONG)
    solved = regress(target, x, grid.step)
    if solved is None:
        return None
    good = np.isfinite(target) & np.isfinite(x).all(axis=1)
    x, target = x - x[good].mean(axis=0), target - target[good].mean()
    left, alone = np.where(good, target - x @ solved[0], 0.0), np.zeros(grid.count)
    alone[good] = _rest(x[good, 0], x[good, 1:])
    count, power = int(good.sum()), float(alone @ alone)
    chance = max(float(solved[1][0]), _scatter(alone * left, round(_LONG / grid.step)) / power)
    gust = np.where(good, left + x[:, len(terms) :] @ solved[0][len(terms) :], 0.0)  # those that roll it are some, too
    gusts = max(float(gust @ gust) / count - _noise(motion, short), 0.0)
    aslant = _ASLANT * _one_way(motion) * np.sqrt(share * gusts * count / power)
    right = float(solved[0][0])
    lost = _LOST * (1.0 + grid.step / _LOST_STEP) * right
    return right, float(np.sqrt(chance**2 + aslant**2 + lost**2))


def _rest(y: Array, x: Array) -> Array:
    """What least squares of y (n,) on columns x (n, k) leaves (n,)."""
    scale = np.sqrt(np.mean(x**2, axis=0))
    x = x[:, scale > _STILL] / scale[scale > _STILL]
    return np.asarray(y - x @ np.linalg.lstsq(x, y, rcond=None)[0])


def _one_way(motion: Motion) -> float:
    """Length of the mean of the unit vectors of the course: 1 straight on, or where nothing shows it; 0 in circles."""
    horizontal = motion.velocity[:, :2]
    length = np.linalg.norm(horizontal, axis=1)
    flies = np.isfinite(length) & (length > 0.0)
    if not flies.any():
        return 1.0
    return float(np.linalg.norm(np.mean(horizontal[flies] / length[flies, None], axis=0)))


def _scatter(products: Array, longest: int) -> float:
    """Standard error of the sum of a series (n,) whose values hang together over ``longest`` (Newey and West, 1987)."""
    square = float(products @ products)
    for k in range(1, min(longest, len(products))):
        square += 2.0 * (1.0 - k / longest) * float(products[k:] @ products[:-k])
    return float(np.sqrt(max(square, 0.0)))


def _unexplained(motion: Motion, short: float) -> tuple[Array, float]:
    """The roll's acceleration (count,) in the band without what follows rates, sideslip and what the pilot moves.

    And which share of its mean square that is.
    """
    grid, (p, _, r) = motion.grid, motion.gyro.T
    whole = grid.band(grid.slope(p), short, _LONG)
    series = [p, r, motion.beta, *motion.controls[:, :3].T, *motion.inputs.T]
    x = np.column_stack([grid.band(grid.as_slope(one), short, _LONG) for one in series])
    flown = np.isfinite(whole)
    x = x[:, np.isfinite(x[flown]).mean(axis=0) > _COVERED] if flown.any() else x
    good = flown & np.isfinite(x).all(axis=1)
    rest, share = np.full(grid.count, np.nan), 1.0
    if good.any():
        y = whole[good] - whole[good].mean()
        rest[good] = _rest(y, x[good] - x[good].mean(axis=0))
        share = float(np.mean(rest[good] ** 2)) / max(float(np.mean(y**2)), 1e-300)
    return rest, share


def _noise(motion: Motion, short: float) -> float:
    """Mean square [rad^2/s^2] in the band of what third differences of the vane show as its white noise."""
    stream, grid = motion.flight.streams[Kind.ANGLE_OF_ATTACK], motion.grid
    values = stream.values[:, 0]
    rough = np.diff(values[np.isfinite(values)], 3)
    if not len(rough):
        return 0.0
    robust = float(np.median(np.abs(rough - np.median(rough)))) / 0.6745  # spikes and gaps are no noise
    of_one = Grid(0.0, grid.step, round(4.0 * _LONG / grid.step))
    time = np.arange(0.0, 4.0 * _LONG + stream.interval, stream.interval)
    single = of_one.put(time, (np.arange(len(time)) == len(time) // 2).astype(np.float64))[:, 0]
    answer = of_one.band(of_one.slope(single), short, _LONG)
    return float(np.nansum(answer**2)) * grid.step / stream.interval * robust**2 / 20.0


def taken(found: tuple[float, float] | None, vane: Vane) -> tuple[float, float] | None:
    """Where [m] to the right a vane is that nobody has placed, and one sigma; None: where the file has it."""
    place = _on_wing(found, vane.span)
    if place is None or abs(place[0] - vane.right) < max(_OUT * vane.span, _LIKELY * place[1]):
        return None
    return place


def _on_wing(found: tuple[float, float] | None, span: float) -> tuple[float, float] | None:
    """The place, not beyond the tip; None where it is by more than its error off the aeroplane."""
    if found is None or abs(found[0]) > 0.5 * span + min(_BEYOND * found[1], _TIP * span):
        return None
    return float(np.clip(found[0], -0.5 * span, 0.5 * span)), found[1]


def is_known(found: tuple[float, float] | None, span: float) -> bool:
    """Whether the place is known well enough to say that it is right."""
    return found is not None and found[1] < _KNOWN * MATTERS * span


def findings(found: tuple[float, float] | None, vane: Vane) -> list[Finding]:
    """That the vane is not where the aircraft file has it."""
    found = _on_wing(found, vane.span)
    if found is None or not abs(found[0] - vane.right) > max(MATTERS * vane.span, _SURE * found[1]):
        return []
    of_file = (
        f", which the aircraft file has at {vane.right:.2f} m: set y of air_data_position"
        if vane.is_said
        else f". The aircraft file does not say where it is: set air_data_position: [null, {found[0]:.2f}, null] there"
    )
    place = f"{found[0]:.2f} ± {found[1]:.2f} m to the right of the centre of gravity"
    return [Finding(MARKS[2:], *MARKS[:2], f"when the wing rolls it moves like one {place}{of_file}")]
