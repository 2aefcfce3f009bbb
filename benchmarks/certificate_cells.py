"""The certificate of the default estimator, by air, vanes, rate of the IMU and what the aircraft file says.

    python benchmarks/certificate_cells.py [--each 40] [--first 6100000] [--jobs 2] [--only light,0.3,100,bare]

Flights of 90 s with the Ultra Stick 25e, wind and gusts as in certificate_flights. A cell is one of calm air, light and
moderate turbulence; vanes with noise of 0.1°, 0.3° and 0.7°; an IMU of 50, 100 and 400 Hz; and an aircraft file that
is complete, holds mass, shape and the places of the sensors, or mass and shape only. Each flight goes through what
`replay` does with its default options, and is a line in results/certificate_cells.jsonl; the cells take turns, and a
run that is stopped goes on. Seeds below JUDGED are for making rules; those from there on are looked at once.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy is loaded

import argparse
import json
import time
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import resumed
from accuracy import MAIN_DERIVATIVES
from certificate_flights import the_aircraft
from certificate_summary import EXCITED, NORMAL_95, shares_within, truth
from faults import SURE, WRONG, users_file

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.found_noise import with_vane
from aircraft_sysid_ros.samples import Samples
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

RESULTS = Path(__file__).parent / "results" / "certificate_cells.jsonl"
SUMMARY = RESULTS.with_suffix(".json")
JUDGED = 6_100_000
DURATION = 90.0  # [s]
AIRS, VANES, IMUS, FILES = ("none", "light", "moderate"), (0.1, 0.3, 0.7), (50, 100, 400), ("complete", "shape", "bare")
CELLS = tuple(product(AIRS, VANES, IMUS, FILES))
BLOCK = 400  # samples that are pushed at once


def flown_by(vane: float, imu: int) -> Aircraft:
    """The aeroplane with vanes of so much noise [deg], and so fast an IMU [Hz]."""
    source = the_aircraft().source
    sensors = {name: dict(of) for name, of in source["sensors"].items()}
    for name in ("angle_of_attack", "sideslip"):
        sensors[name]["noise"] = float(np.radians(vane))
    for name in ("accelerometer", "gyro", "attitude"):
        sensors[name]["rate"] = imu
    return aircraft_from_dict({**source, "sensors": sensors})


def fly(want: dict[str, Any]) -> dict[str, Any]:
    """One flight, and what is known at its end."""
    random = np.random.default_rng(want["seed"])
    speed, direction = random.uniform(0.0, 6.0), random.uniform(-np.pi, np.pi)
    wind = (speed * np.cos(direction), speed * np.sin(direction), 0.0)
    plane = flown_by(want["vane"], want["imu"])
    try:
        flight = simulate_samples(plane, want["seed"], DURATION, wind=wind, turbulence=want["air"])
        started = time.process_time()
        known = users_file(plane, want["file"])
        pipeline = replayed(known, flight.samples)
        right = pipeline.check.vane_place
        if right is not None:
            pipeline = replayed(with_vane(known, right), flight.samples)
    except InputError as error:
        return {**want, "failed": str(error)}
    final = pipeline.parameters.snapshot().parameters

    def short(numbers: Iterator[float]) -> list[float | None]:
        return [float(f"{x:.5g}") if np.isfinite(x) else None for x in numbers]

    return {
        **want, "right": right and right[0], "cpu": round(time.process_time() - started, 2),
        "by": pipeline.parameters.learning.published["published"],
        "value": short(p.value for p in final), "std": short(p.std for p in final),
        "excitation": short(p.excitation for p in final), "use": [int(p.status == Trust.USE) for p in final],
    }  # fmt: skip


def replayed(aircraft: Aircraft, samples: Samples) -> Pipeline:
    """After all samples of a flight."""
    pipeline = Pipeline(aircraft)
    for begin in range(0, len(samples), BLOCK):
        pipeline.push(samples[begin : begin + BLOCK])
    pipeline.flush()
    pipeline.check.finish(pipeline.state.epoch)
    return pipeline


def jobs(each: int, first: int, only: str) -> list[dict[str, Any]]:
    """Flights of all cells in turn, or of those whose words ``only`` has."""
    words = set(filter(None, only.split(",")))
    chosen = [(k, cell) for k, cell in enumerate(CELLS) if words <= set(map(str, cell))]
    return [
        {"seed": first + turn * len(CELLS) + k, "air": air, "vane": vane, "imu": imu, "file": file}
        for turn in range(each)
        for k, (air, vane, imu, file) in chosen
    ]


def summary_of(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Coverage of what is excited and of USE, by axis too, bias over its standard error, and what is wrong with USE."""
    names, true = truth()
    value, std, excitation = (
        np.array([r[key] for r in rows], dtype=np.float64) for key in ("value", "std", "excitation")
    )
    use = np.array([r["use"] for r in rows], dtype=np.bool_)
    z = (value - true) / std
    excited = np.isfinite(z) & (excitation >= EXCITED)
    main = np.array([names.index(name) for name in MAIN_DERIVATIVES])
    error, sure = np.abs(value / true - 1.0), std < SURE * np.abs(value)
    counts = use.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        covered = np.where(use, np.abs(z) <= NORMAL_95, 0).sum(axis=0) / counts
        means = np.array([np.nanmean(z[use[:, k], k]) if counts[k] else np.nan for k in range(len(names))])
    often = [k for k in range(len(names)) if counts[k] >= max(0.25 * len(rows), 1.0)]
    used = np.where(use, error, np.nan)
    return {
        "flights": len(rows),
        "by_rml": float(np.mean([r["by"] == "rml" for r in rows])),
        "excited": shares_within(z, excited),
        "use": shares_within(z, use),
        "use_share": float(use.mean()),
        "main_use_share": float(use[:, main].mean()),
        "axes": {axis: shares_within(z[:, part], use[:, part]) for axis, part in _axes().items()},
        "least_covered": [[names[k], float(covered[k])] for k in sorted(often, key=lambda k: covered[k])[:3]],
        "biased": [[names[k], float(means[k])] for k in sorted(often, key=lambda k: -abs(means[k]))[:3]],
        "uses": int(use.sum()), "wrong": int((used > WRONG).sum()), "sure_wrong": int((sure & (used > WRONG)).sum()),
        "main_uses": int(use[:, main].sum()), "main_wrong": int((used[:, main] > WRONG).sum()),
        "main_error": _quantile(used[:, main], 0.5), "main_error_90": _quantile(used[:, main], 0.9),
        "main_rms_error": float(np.sqrt(np.nanmean(used[:, main] ** 2))),
        "cpu": float(np.median([r["cpu"] for r in rows])),
    }  # fmt: skip


def _axes() -> dict[str, slice]:
    model = the_aircraft().model
    return {axis: model.axis_slice(axis) for axis in AXES}


def _quantile(values: Any, share: float) -> float | None:
    return None if np.isnan(values).all() else float(np.nanquantile(values, share))


def summaries(records: list[dict[str, Any]]) -> dict[str, Any]:
    """Of all flights, of each value of a dimension, and of each cell."""
    done = [r for r in records if "failed" not in r]
    cells: dict[str, list[dict[str, Any]]] = {"all": done}
    for key, values in (("air", AIRS), ("vane", VANES), ("imu", IMUS), ("file", FILES)):
        cells |= {f"{key} {value}": [r for r in done if r[key] == value] for value in values}
    for air, vane, imu, file in CELLS:
        cells[f"{air},{vane},{imu},{file}"] = [
            r for r in done if (r["air"], r["vane"], r["imu"], r["file"]) == (air, vane, imu, file)
        ]
    found = {name: summary_of(rows) for name, rows in cells.items() if rows}
    return {"duration": DURATION, "failed": len(records) - len(done), "cells": found}


def lines_of(summary: dict[str, Any]) -> Iterator[str]:
    """A line for each part."""
    for name, part in summary["cells"].items():
        use, excited = part["use"], part["excited"]
        yield (
            f"{name:26s} {part['flights']:4d} by rml {part['by_rml']:4.0%}  excited {excited['share'] or 0:6.1%}"
            f"  USE {use['share'] or 0:6.1%} (rms z {use['rms_z'] or 0:.2f}) of {part['use_share']:4.0%}, main"
            f" {part['main_use_share']:4.0%}  wrong {part['wrong']}/{part['uses']} sure {part['sure_wrong']}"
            f" main {part['main_wrong']}/{part['main_uses']}  rms {100 * part['main_rms_error']:.2f} %"
            f"  error {100 * (part['main_error'] or 0):.2f} % / {100 * (part['main_error_90'] or 0):.1f} %"
            f"  least {' '.join(f'{n} {c:.0%}' for n, c in part['least_covered'])}"
            f"  bias {' '.join(f'{n} {m:+.2f}' for n, m in part['biased'])}  {part['cpu']:.1f} s"
        )


def main() -> None:
    """Fly what is not flown yet, and sum up."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--each", type=int, default=40, help="flights of a cell (default: %(default)s)")
    parser.add_argument("--first", type=int, default=JUDGED, help="first seed (default: %(default)s)")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument(
        "--only", default="", metavar="WORDS", help="cells that have these words, as light,0.3,100,bare"
    )
    parser.add_argument("--results", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    wanted = jobs(arguments.each, arguments.first, arguments.only)
    records = list(resumed.flown(fly, wanted, arguments.results, arguments.jobs))
    summary = summaries(records)
    arguments.results.with_suffix(".json").write_text(json.dumps(summary, indent=1) + "\n", encoding="utf8")
    print("\n".join(lines_of(summary)))


if __name__ == "__main__":
    main()
