"""M filters or simulations with different parameters, side by side: derivatives by finite differences.

What the parameters do to innovations and to their variances goes through state, covariance and gain of every step
before; a filter that runs with slightly moved parameters holds all of it. A batch asks for a whole record
(``filter_bank``, ``simulation_bank``), a recursion for one step at a time (``bank_step``).
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.flight_model.filter import filter_step, simulation_step
from aircraft_sysid_ros.flight_model.layout import OUTPUT_SIZE, FlightModel
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]


@njit(cache=True, nogil=True, error_model="numpy")
def bank_step(
    states: Array,
    covariances: Array,
    inputs0: Array,
    inputs1: Array,
    dt: float,
    y: Array,
    thetas: Array,
    model: FlightModel,
    innovations: Array,
    variances: Array,
) -> None:
    """``filter_step`` of M filters, in place.

    states (M, 16), covariances (M, 15, 15), thetas (M, parameters); innovations and variances (M, 18).
    """
    for m in range(len(states)):
        filter_step(states[m], covariances[m], inputs0, inputs1, dt, y, thetas[m], model, innovations[m], variances[m])


@njit(cache=True, nogil=True, error_model="numpy")
def run_filter(
    x: Array,
    p: Array,
    times: Array,
    inputs: Array,
    y: Array,
    theta: Array,
    model: FlightModel,
    innovations: Array,
    variances: Array,
) -> None:
    """One filter over a record from x (16,), p (15, 15) before its first outputs, which change to those at its end.

    times (N,) [s], inputs (N, INPUT_SIZE), y (N, 18); innovations and variances (N, 18).
    """
    for k in range(len(times)):
        before = max(k - 1, 0)
        dt = times[k] - times[before]
        filter_step(x, p, inputs[before], inputs[k], dt, y[k], theta, model, innovations[k], variances[k])


@njit(cache=True, nogil=True, error_model="numpy")
def run_simulation(x: Array, times: Array, inputs: Array, theta: Array, model: FlightModel, out: Array) -> None:
    """Outputs (N, 18) without noise from the state x (16,) at the first time, which changes to that at the last."""
    for k in range(len(times)):
        before = max(k - 1, 0)
        simulation_step(x, inputs[before], inputs[k], times[k] - times[before], theta, model, out[k])


def filter_bank(
    state: Array,
    covariance: Array,
    times: Array,
    inputs: Array,
    y: Array,
    thetas: Array,
    model: FlightModel,
) -> tuple[Array, Array]:
    """Innovations and variances, each (M, N, 18), of the parameters ``thetas`` (M, parameters) over one record.

    All filters begin with ``state`` (16,) and ``covariance`` (15, 15); shapes as in ``run_filter``.
    """
    innovations = np.empty((len(thetas), len(times), OUTPUT_SIZE))
    variances = np.empty_like(innovations)

    def one(m: int) -> None:
        x, p = state.copy(), covariance.copy()
        run_filter(x, p, times, inputs, y, thetas[m], model, innovations[m], variances[m])

    _side_by_side(one, len(thetas))
    return innovations, variances


def simulation_bank(states: Array, times: Array, inputs: Array, thetas: Array, model: FlightModel) -> Array:
    """Outputs (M, N, 18) from states (M, 16) with parameters (M, parameters): both may differ."""
    out = np.empty((len(thetas), len(times), OUTPUT_SIZE))

    def one(m: int) -> None:
        run_simulation(states[m].copy(), times, inputs, thetas[m], model, out[m])

    _side_by_side(one, len(thetas))
    return out


def _side_by_side(work: Callable[[int], None], count: int) -> None:
    """``work(m)`` for all m on all processors: the compiled loops leave Python's lock."""
    if count == 1:
        work(0)
        return
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        list(pool.map(work, range(count)))
