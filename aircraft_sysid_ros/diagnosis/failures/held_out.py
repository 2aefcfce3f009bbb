"""The error of an axis with and without a hypothesis, on flight that was held out."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.diagnosis.failures.axis_relation import whitened
from aircraft_sysid_ros.diagnosis.failures.failure_search import FailureSearch, Hypothesis, columns_of
from aircraft_sysid_ros.diagnosis.flight.flight_data import BLOCK, FOLDS

Array = npt.NDArray[np.float64]


def held_out_errors(search: FailureSearch, hypothesis: Hypothesis, axis: str) -> tuple[float, float]:
    """Error of an axis without and with a hypothesis, over the spread of its coefficient.

    All without the slow part of noise: what the second before does not foretell.
    """
    relation, filtering = search.relations[axis], search.fitted(axis, hypothesis).filtering
    columns = columns_of(relation, hypothesis)
    response, known, tried = (whitened(s, filtering) for s in (relation.response, relation.columns, columns))
    return _held_out(response, known, search.step), _held_out(response, tried, search.step)


def _held_out(response: Array, columns: Array, step: float) -> float:
    """Error on blocks of time that take turns at being left out, over the spread of the response."""
    fold = (np.arange(len(response)) * step / BLOCK).astype(int) % FOLDS
    error = np.empty(len(response))
    for number in range(FOLDS):
        known, out = fold != number, fold == number
        size = np.sqrt(np.mean(columns[known] ** 2, axis=0))
        size = np.where(size > 0.0, size, 1.0)
        theta = np.linalg.lstsq(columns[known] / size, response[known], rcond=1e-8)[0]
        error[out] = response[out] - columns[out] / size @ theta
    return float(np.sqrt(np.mean(error**2)) / np.std(response))
