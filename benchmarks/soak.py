"""A long flight, accelerated: is the memory of the process flat, and what does a second of flight take?

    python benchmarks/soak.py [--hours 24] [--part 1800] [--seed 9900000] [--estimator auto]

Both steps as the live nodes hold them, with the journal of a flight in progress, samples a quarter of a second at a
time, parameters once a second. Flights of PART seconds, each in its own air, are drawn by another process and come one
after the other by the same clock, with two seconds between them in which nothing comes: the state starts over there,
what was learnt stays. Memory is that of the process that flies, without the pages of files. Writes results/soak.json.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import tempfile
import time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy is loaded

from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.run_reader import journal_path
from aircraft_sysid_ros.run_writer import RunWriter
from aircraft_sysid_ros.samples import Samples
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

RESULT = Path(__file__).parent / "results" / "soak.json"
AIR = ("none", "light", "moderate")
PIECE, PAUSE = 250_000_000, 2_000_000_000  # [ns]
#: Time of flight [s] from which memory is to be flat, and between two looks at it.
WARM, EVERY = 600.0, 10.0


def drawn(seed: int, part: float, path: str) -> None:
    """One flight of ``part`` [s] into a file."""
    sensors = SensorOptions(attitude=True, height_above_ground=True)
    air = AIR[seed % len(AIR)]
    samples = simulate_samples(default_aircraft(), seed, part, turbulence=air, sensors=sensors).samples
    np.savez(path, stamp=samples.stamp, kind=samples.kind, values=samples.values)


def memory() -> float:
    """Memory [MB] of this process that is its own: pages of files are the system's to drop."""
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text(encoding="utf8").splitlines())
    return float(status["RssAnon"].split()[0]) / 1024.0


def grown(times: list[float], found: list[float]) -> float:
    """Growth [MB/h] of memory at times [s], by the median of the slopes between the first and the second half."""
    half = len(times) // 2
    slopes = [(found[half + i] - found[i]) / (times[half + i] - times[i]) * 3600.0 for i in range(half)]
    return float(np.median(slopes)) if slopes else float("nan")


def fly(hours: float, part: float, seed: int, options: ParameterOptions, folder: Path) -> dict[str, Any]:
    """The whole flight; what it took."""
    aircraft, run, times, found = default_aircraft(), folder / "run", [], []
    pipeline = Pipeline(aircraft, None, options)
    pipeline.warm_up()
    in_progress = {"state": asdict(pipeline.state.options), "parameters": asdict(options)}
    flown, cpu, largest, used, next_stamp = 0.0, 0.0, 0.0, 0, None
    with RunWriter(run, aircraft, in_progress=in_progress) as writer:
        for k in range(round(hours * 3600.0 / part)):
            path = str(folder / "part.npz")
            child = multiprocessing.get_context("spawn").Process(target=drawn, args=(seed + k, part, path))
            child.start()
            child.join()
            with np.load(path) as content:
                samples = Samples(content["stamp"], content["kind"], content["values"])
            first = int(samples.stamp.min())
            shift = 0 if next_stamp is None else next_stamp - first
            samples = Samples(samples.stamp + shift, samples.kind, samples.values)
            next_stamp = int(samples.stamp.max()) + PAUSE
            edges = np.arange(samples.stamp[0], samples.stamp[-1] + PIECE, PIECE)
            for low, high in pairwise([*np.searchsorted(samples.stamp, edges).tolist(), len(samples)]):
                begun = time.process_time()
                piece = samples[low:high]
                rows, points = pipeline.push(piece)
                writer.add_samples(piece)
                writer.add_rows(rows)
                writer.add_points(points)
                flown += PIECE * 1e-9
                if flown % 1.0 < PIECE * 1e-9:
                    told = pipeline.parameters.snapshot()
                    writer.add_parameters(told, pipeline.parameters.model_error())
                    used = sum(p.status is Trust.USE for p in told.parameters)
                took = time.process_time() - begun
                cpu, largest = cpu + took, max(largest, took)
                if flown % EVERY < PIECE * 1e-9:
                    times.append(flown)
                    found.append(memory())
            print(f"{flown / 3600.0:.2f} h, {found[-1]:.1f} MB, USE {used}", flush=True)
        on_disk = sum(file.stat().st_size for file in journal_path(run).iterdir())
    warm = int(np.searchsorted(times, min(WARM, 0.5 * flown)))
    after = found[warm:]
    return {
        "hours": flown / 3600.0, "part": part, "seed": seed, "estimator": options.estimator,
        "warm": round(after[0], 1), "largest": round(max(after), 1), "end": round(found[-1], 1),
        "grown_per_hour": round(grown(times[warm:], after), 2),
        "on_disk_per_hour": round(on_disk / flown * 3600.0 / 1e6, 1),
        "realtime_factor": round(flown / cpu, 1), "longest_piece": round(largest, 3),
        "restarts": int(pipeline.state.order.counts.restarts), "use": used,
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--part", type=float, default=1800.0, help="[s]")
    parser.add_argument("--seed", type=int, default=9_900_000)
    parser.add_argument("--estimator", default="auto")
    parser.add_argument("--results", type=Path, default=RESULT)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        options = ParameterOptions(estimator=arguments.estimator)
        found = fly(arguments.hours, arguments.part, arguments.seed, options, Path(folder))
    print(json.dumps(found, indent=1))
    arguments.results.write_text(json.dumps(found, indent=1) + "\n", encoding="utf8")


if __name__ == "__main__":
    main()
