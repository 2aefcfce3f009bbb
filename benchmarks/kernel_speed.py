"""Speed of one step of both estimators against filterpy with statsmodels, and against plain C.

    python benchmarks/kernel_speed.py [--samples 4000] [--runs 15]

The work per IMU sample (100 Hz): a prediction, the share of air data (V, alpha, beta at 50 Hz) and GPS (position and
velocity at 5 Hz), three iterations each, and recursive least squares of six axes with the lagged sums that correct its
standard errors. All sides get the same arrays in the same process and take turns; their numbers are compared. Times are
processor times, so that a busy machine matters little. ``ours`` are the compiled kernels that replay and the live nodes
run, ``chain`` is the whole Pipeline with everything around them (time order, interpolation, signals, terms, monitors).
"""

from __future__ import annotations

import argparse
import ctypes
import json
import os
import platform
import statistics
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.aircraft.earth import ned_along
from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path
from aircraft_sysid_ros.estimation.lagged_moments import add_sample
from aircraft_sysid_ros.estimation.recursive_least_squares import rls_update
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.fusion import fuse
from aircraft_sysid_ros.reconstruction.process import propagate
from aircraft_sysid_ros.reconstruction.state import Setup, new_memory
from aircraft_sysid_ros.records import replaced
from aircraft_sysid_ros.samples import GPS_NED, WIDTH, Kind
from aircraft_sysid_ros.simulation.simulated_flight import SimulatedFlight, simulate_samples

Array = npt.NDArray[np.float64]

DT, LAGS, FORGETTING, ITERATIONS = 0.01, 50, float(np.exp(-0.04 / 120.0)), 3
SETTLED = 20.0  # [s] of flight before the step is timed
#: What is timed: samples between two predictions, air data, GPS fixes, updates of least squares and of its lagged sums
#: (0: never), and how many of the named thing happen per sample.
WORK: dict[str, tuple[tuple[int, ...], float]] = {
    "prediction": ((1, 0, 0, 0, 0), 1.0),
    "one air data update": ((0, 1, 0, 0, 0), 3.0),
    "one GPS update": ((0, 0, 1, 0, 0), 2.0),
    "six-axis least squares": ((0, 0, 0, 1, 0), 1.0),
    "its lagged sums": ((0, 0, 0, 0, 1), 1.0),
    "IMU sample, learning at 25 Hz": ((1, 2, 20, 4, 4), 1.0),
    "IMU sample, learning at 100 Hz": ((1, 2, 20, 1, 1), 1.0),
}
_POSITION, _VELOCITY = int(Kind.GPS_POSITION), int(Kind.GPS_VELOCITY)
_AIR_DATA = (int(Kind.AIRSPEED), int(Kind.ANGLE_OF_ATTACK), int(Kind.SIDESLIP))


@dataclass(frozen=True)
class Input:
    """Arrays as ``run`` of step.c takes them, and where the estimators stand at the first sample."""

    imu: Array
    air: Array
    fixes: Array
    terms: Array
    measured: Array
    offsets: npt.NDArray[np.int64]
    setup: Setup
    x: Array
    p: Array

    def state(self) -> list[Array]:
        """Fresh x, p, theta, P, lagged sums and recent rows."""
        longest = int(np.diff(self.offsets).max())
        return [
            self.x.copy(), self.p.copy(), np.zeros((6, longest)), np.tile(1e8 * np.eye(longest), (6, 1, 1)),
            np.zeros((6, LAGS, longest + 2, longest + 2)), np.full((6, LAGS, longest + 2), np.nan),
        ]  # fmt: skip


def make_input(flight: SimulatedFlight, n: int) -> Input:
    """n samples of the flight from SETTLED on; sensors between two IMU samples are moved to the second."""
    samples, pipeline = flight.samples, Pipeline(flight.aircraft)
    early = int(np.searchsorted(samples.stamp, samples.stamp[0] + int(SETTLED * 1e9)))
    pipeline.push(samples[:early])
    estimator = pipeline.state
    begin = samples.stamp[early]
    x, p, setup = estimator.state_vector, estimator.covariance, estimator.setup
    assert setup is not None
    points = np.vstack([pipeline.push(samples[early:])[1], pipeline.flush()[1]])
    points = points[np.all(np.isfinite(points[:, CoefficientSample.MEASURED]), axis=1)]

    def at(kind: Kind, times: npt.NDArray[np.int64], width: int) -> Array:
        chosen = samples.kind == kind
        return samples.values[chosen][np.searchsorted(samples.stamp[chosen], times, side="right") - 1, :width]

    stamps = samples.stamp[(samples.kind == Kind.IMU) & (samples.stamp >= begin)][: n + 1]
    if len(stamps) < n + 1:
        raise SystemExit(f"the flight has {len(stamps) - 1} IMU samples, not {n}")
    model, repeat = flight.aircraft.model, np.arange(n + 1) % len(points)
    return Input(
        imu=np.ascontiguousarray(at(Kind.IMU, stamps, 6)),
        air=np.hstack([at(Kind(kind), stamps, 1) for kind in _AIR_DATA]),
        fixes=np.hstack(
            [ned_along(at(Kind.GPS_POSITION, stamps, 3), setup.origin), at(Kind.GPS_VELOCITY, stamps, 3)]
        ),
        terms=np.ascontiguousarray(points[repeat, CoefficientSample.TERMS :]),
        measured=np.ascontiguousarray(points[repeat, CoefficientSample.MEASURED]),
        offsets=model.offsets,
        # every update makes three iterations, and none is rejected
        setup=replaced(setup, maximum_iterations=ITERATIONS, tolerance=0.0, gate=np.inf),
        x=x,
        p=p,
    )  # fmt: skip


@njit(cache=True)
def run_ours(n, every, imu, air, fixes, terms, measured, offsets, dt, forgetting, setup, memory,
             x, p, theta, rls_p, sums, recent):  # fmt: skip
    """The kernels of the estimators in the order of ``run`` in step.c."""
    values = np.full(WIDTH, np.nan)
    density = np.empty(6)
    density[:3], density[3:] = setup.accelerometer_variance * dt, setup.gyro_variance * dt
    for k in range(1, n + 1):
        rate = imu[k, 3:]
        if every[0] and k % every[0] == 0:
            middle = imu[k - 1] + 0.5 * (imu[k] - imu[k - 1])
            propagate(x, p, middle[:3], middle[3:], dt, density, setup.wind_walk, setup)
        if every[1] and k % every[1] == 0:
            for i in range(3):
                values[0] = air[k, i]
                fuse(_AIR_DATA[i], values, x, p, rate, 0.0, setup, memory)
        if every[2] and k % every[2] == 0:
            values[GPS_NED] = fixes[k, :3]
            fuse(_POSITION, values, x, p, rate, 0.0, setup, memory)
            values[:3] = fixes[k, 3:]
            fuse(_VELOCITY, values, x, p, rate, 0.0, setup, memory)
        for axis in range(6):
            first, last = offsets[axis], offsets[axis + 1]
            m = last - first
            if every[3] and k % every[3] == 0:
                x_axis, y = terms[k, first:last], measured[k, axis]
                rls_update(theta[axis, :m], rls_p[axis, :m, :m], x_axis, y, forgetting)
            if every[4] and k % every[4] == 0:
                row = np.ones(m + 2)
                row[:m], row[m] = terms[k, first:last], measured[k, axis]
                add_sample(sums[axis, :, : m + 2, : m + 2], recent[axis, :, : m + 2], row, forgetting)


class SetupOfC(ctypes.Structure):
    """Setup of step.c."""

    _fields_ = [
        *((name, ctypes.c_double) for name in (
            "dt", "gravity", "accelerometer_variance", "gyro_variance", "accelerometer_walk", "gyro_walk", "wind_walk"
        )),
        ("probe", ctypes.c_double * 3), ("gps", ctypes.c_double * 3),
        ("variance", ctypes.c_double * 9), ("forgetting", ctypes.c_double),
        ("iterations", ctypes.c_long), ("lags", ctypes.c_long), ("offsets", ctypes.c_long * 7),
    ]  # fmt: skip


def setup_of_c(data: Input) -> SetupOfC:
    s = data.setup
    variance = [*(s.variance[k, 0] for k in _AIR_DATA), *s.variance[_POSITION], *s.variance[_VELOCITY]]
    three, nine = ctypes.c_double * 3, ctypes.c_double * 9
    return SetupOfC(
        DT, s.gravity, s.accelerometer_variance, s.gyro_variance, s.accelerometer_walk, s.gyro_walk, s.wind_walk,
        three(*s.probe_from_imu), three(*s.gps_from_imu), nine(*variance), FORGETTING,
        ITERATIONS, LAGS, (ctypes.c_long * 7)(*data.offsets),
    )  # fmt: skip


def compile_c(folder: str) -> tuple[Any, str]:
    """The C step as a library, and the version of the compiler."""
    source, library = Path(__file__).with_name("step.c"), Path(folder) / "step.so"
    flags = ["-O3", "-march=native", "-Wall", "-shared", "-fPIC"]
    subprocess.run(["cc", *flags, "-o", library, source, "-lm"], check=True)
    version = subprocess.run(["cc", "--version"], check=True, capture_output=True, text=True).stdout.splitlines()[0]
    loaded = ctypes.CDLL(str(library))
    loaded.run.restype = ctypes.c_double
    return loaded, f"{version}, -O3 -march=native"


class Sides:
    """The same work by each side; every method returns its time [s] and the state that it ends with."""

    def __init__(self, data: Input, n: int, library: Any) -> None:
        self.data, self.n, self._library, self._setup_of_c = data, n, library, setup_of_c(data)

    def ours(self, every: tuple[int, ...]) -> tuple[float, list[Array]]:
        d, state, memory = self.data, self.data.state(), new_memory(len(Kind), 0.0)
        arrays = (d.imu, d.air, d.fixes, d.terms, d.measured, d.offsets)
        started = time.process_time()
        run_ours(self.n, every, *arrays, DT, FORGETTING, d.setup, memory, *state)
        return time.process_time() - started, state

    def c(self, every: tuple[int, ...]) -> tuple[float, list[Array]]:
        d, state = self.data, self.data.state()
        pointers = [a.ctypes.data_as(ctypes.c_void_p) for a in (d.imu, d.air, d.fixes, d.terms, d.measured)]
        outputs = [a.ctypes.data_as(ctypes.c_void_p) for a in state]
        rates = (ctypes.c_long * 5)(*every)
        started = time.process_time()
        self._library.run(ctypes.c_long(self.n), rates, *pointers, ctypes.byref(self._setup_of_c), *outputs)
        return time.process_time() - started, state

    def peers(self, every: tuple[int, ...]) -> tuple[float, list[Array]]:
        from peers import run_filterpy, run_statsmodels

        d = self.data
        state = [d.x, d.p]
        started = time.process_time()
        if any(every[:3]):
            state = [*run_filterpy(self.n, every, d.imu, d.air, d.fixes, d.setup, d.x, d.p, DT)]
        if every[3]:
            rows = slice(every[3], self.n + 1, every[3])
            run_statsmodels(d.terms[rows], d.measured[rows], d.offsets)
        return time.process_time() - started, state


def difference(a: list[Array], b: list[Array]) -> float:
    """Largest relative difference of two lists of arrays; of covariances in standard deviations."""
    worst = 0.0
    for one, other in zip(a, b, strict=False):
        if one.shape == (18, 18):
            sigma = np.sqrt(np.diag(one))
            scale: Any = np.outer(sigma, sigma)
        else:
            scale = np.max(np.abs(np.nan_to_num(one)))
        gap = np.where(np.isnan(one) & np.isnan(other), 0.0, np.abs(one - other)) / np.maximum(scale, 1e-300)
        worst = max(worst, float(np.max(gap)))
    return worst


def compare(sides: Sides) -> dict[str, float]:
    """Largest relative difference of C and filterpy to ours over all kinds of work; raises if they differ."""
    worst = {"c": 0.0, "peers": 0.0}
    for every, _ in WORK.values():
        ours = sides.ours(every)[1]
        worst["c"] = max(worst["c"], difference(ours, sides.c(every)[1]))
        if any(every[:3]):
            worst["peers"] = max(worst["peers"], difference(ours[:2], sides.peers(every)[1]))
    if worst["c"] > 1e-9 or worst["peers"] > 1e-6:
        raise SystemExit(f"the sides do not compute the same: {worst}")
    return worst


def chain(flight: SimulatedFlight, runs: int) -> list[float]:
    """Times [s] per IMU sample of the whole Pipeline, fed a thousand samples at a time as by replay."""
    samples, times = flight.samples, []
    for _ in range(runs + 1):
        pipeline = Pipeline(flight.aircraft)
        started = time.process_time()
        for begin in range(0, len(samples), 1000):
            pipeline.push(samples[begin : begin + 1000])
        pipeline.flush()
        times.append((time.process_time() - started) / np.sum(samples.kind == Kind.IMU))
    return times[1:]


def spread(times: list[float]) -> dict[str, Any]:
    """Median, least and quartiles [µs]."""
    low, middle, high = (1e6 * float(q) for q in np.percentile(times, [25, 50, 75]))
    return {"median": middle, "least": 1e6 * min(times), "quartiles": [low, high]}


def measure(samples: int, runs: int) -> dict[str, Any]:
    """All figures: times per piece of work [µs] and ratios of their medians."""
    load = os.getloadavg()[0]
    aircraft = load_aircraft(config_path(DEFAULT_AIRCRAFT))
    flight = simulate_samples(aircraft, duration=SETTLED + samples * DT + 2.0)
    work: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        library, compiler = compile_c(folder)
        sides = Sides(make_input(flight, samples), samples, library)
        differences = compare(sides)
        for name, (every, share) in WORK.items():
            count = samples * share
            times: dict[str, list[float]] = {"ours": [], "c": []}
            if any(every[:4]):  # no peer has lagged sums
                times["peers"] = []
            for i in range(runs):
                for side, values in times.items():
                    if side != "peers" or i < max(runs // 5, 2):  # seconds each
                        values.append(getattr(sides, side)(every)[0] / count)
            middle = {side: statistics.median(values) for side, values in times.items()}
            work[name] = {side: spread(values) for side, values in times.items()}
            work[name]["over_c"] = middle["ours"] / middle["c"]
            if "peers" in middle:
                work[name]["faster_than_peers"] = middle["peers"] / middle["ours"]
    return {
        "samples": samples,
        "runs": runs,
        "work": work,
        "chain": spread(chain(flight, max(runs // 3, 2))),
        "largest_relative_difference": differences,
        "compiler": compiler,
        "machine": f"{platform.machine()}, {platform.python_implementation()} {platform.python_version()}",
        "load_average": [load, os.getloadavg()[0]],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=4000)
    parser.add_argument("--runs", type=int, default=15)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "results" / "kernel_speed.json")
    arguments = parser.parse_args()
    result = measure(arguments.samples, arguments.runs)
    arguments.out.write_text(json.dumps(result, indent=1) + "\n", encoding="utf8")
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
