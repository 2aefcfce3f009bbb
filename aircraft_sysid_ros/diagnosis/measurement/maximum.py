"""The largest of a smooth function of one number, with few looks at it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

#: Steps towards the best value after the first look to both sides.
_STEPS = 4


def maximum(
    gain: Callable[[float], float], start: float, low: float, high: float, least: float
) -> tuple[float, float, float]:
    """Place and value of the largest of a smooth function between limits, looked for from ``start``, and its curvature.

    Parabolas through the three best points, as long as they promise more than ``least``. A start beyond a limit is one.
    """
    low, high = min(low, start), max(high, start)
    width = (high - low) / 8.0
    places = sorted({float(np.clip(p, low, high)) for p in (start - width, start, start + width)})
    if len(places) < 3:  # the start is at a limit
        places = sorted({*places, float(np.clip(start + (2 * width if start <= low else -2 * width), low, high))})
    known = {place: gain(place) for place in places}
    curvature = 0.0
    for _ in range(_STEPS):
        top = max(known, key=lambda p: known[p])
        near = _around(sorted(known), top)
        vertex, height, curvature = _parabola(near, [known[p] for p in near])
        if not np.isfinite(vertex):
            vertex, height = (2.0 * top - start if top != start else start), np.inf
        vertex = float(np.clip(vertex, max(low, top - 2 * width), min(high, top + 2 * width)))
        if max(height, known[top]) < least or any(abs(vertex - place) < 0.02 * width for place in known):
            break
        known[vertex] = gain(vertex)
    top = max(known, key=lambda p: known[p])
    return top, known[top], curvature


def _around(places: list[float], top: float) -> list[float]:
    """Three of the places: the top with its neighbours."""
    middle = min(max(places.index(top), 1), len(places) - 2)
    return places[middle - 1 : middle + 2]


def _parabola(x: Sequence[float], y: Sequence[float]) -> tuple[float, float, float]:
    """Vertex, value there and negative second derivative of the parabola through three points; NaN without a top."""
    if not np.all(np.isfinite(y)):
        return np.nan, np.nan, 0.0
    a, b, c = np.polyfit(np.asarray(x) - x[1], y, 2)
    if not a < 0.0:
        return np.nan, np.nan, 0.0
    return float(x[1] - 0.5 * b / a), float(c - 0.25 * b * b / a), float(-2.0 * a)
