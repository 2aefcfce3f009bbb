"""Drag polars against a known one: how wrong they are, and how often their standard errors hold it.

    python benchmarks/polar.py [--seeds 1000 1001 …] [--jobs 1] [--seaway ../shared/data/mit_seaway]

Flights of a point mass (``makers/point_mass.py``), driven or gliding, through import, replay and polar as a user types
them. Each is a line of results/polar.jsonl; a run that is stopped goes on where it was. The method was made before any
was flown, the seeds 1 to 20 were looked at, and the default ones once. With --seaway the Solar Surfer of MIT is told
in results/polar_seaway.json, with its picture in docs/.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import tempfile

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy is loaded

from pathlib import Path
from typing import Any

import resumed
from walked import walked

sys.path.insert(0, str(Path(__file__).parent / "makers"))

from point_mass import make

HERE = Path(__file__).parent
RESULTS = HERE / "results" / "polar.jsonl"
PICTURE = HERE.parent / "docs" / "figures" / "polar_seaway.png"
JUDGING = tuple(range(1000, 1040))
#: In the air [s] from the beginning of the recording, as its notes say, without the first and last 10 s; half of it.
SEAWAY, HALF = (587.0, 830.0), 708.0


def fly(seed: int) -> dict[str, Any]:
    """One flight and what is said of its polar."""
    with tempfile.TemporaryDirectory() as name:
        log, bag, run = (Path(name) / part for part in ("log", "bag", "run"))
        truth = make(seed, log)
        how = ["--power", "electric_power", "--idle", truth["idle"]] if truth["driven"] else ["--gliding"]
        failed = walked(
            ["import", log, "--map", log / "map.yaml", "--out", bag],
            ["replay", bag, "--aircraft", log / "plane.yaml", "--out", run],
            ["polar", run, *how],
        )
        if failed:
            return {"seed": seed, **truth, "failed": failed}
        said = json.loads((run / "polar.json").read_text(encoding="utf8"))
    middle = len(said["polar"]["lift"]) // 2
    lift = said["polar"]["lift"][middle]
    return {
        "seed": seed, **truth, "explained": said["explained"], "time": said["time"],
        "parameters": {p["name"]: [p["value"], p["std"], p["status"]] for p in said["parameters"]},
        "middle": [said["polar"]["drag"][middle], said["polar"]["std"][middle], truth["CD0"] + truth["k"] * lift**2],
    }  # fmt: skip


def seaway(data: Path) -> dict[str, Any]:
    """The real flight, whole and in halves."""
    aircraft, said = HERE / "aircraft" / "solar_surfer.yaml", {}
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        failed = walked(["import", data, "--guess", place / "map.yaml"],
                        ["import", data, "--map", place / "map.yaml", "--out", place / "bag"])  # fmt: skip
        for part, (start, stop) in {"whole": SEAWAY, "first": (SEAWAY[0], HALF), "second": (HALF, SEAWAY[1])}.items():
            cut = place / f"{part}.yaml"
            cut.write_text(f"- {{start: {start}, stop: {stop}, name: {part}}}\n", "utf8")
            run = place / part
            failed = failed or walked(
                ["replay", place / "bag", "--segments", cut, "--aircraft", aircraft, "--out", run],
                ["polar", run, "--power", "electric_power", "--idle", 5],
            )
            if failed:
                raise SystemExit(failed)
            found = json.loads((run / "polar.json").read_text(encoding="utf8"))
            said[part] = {key: value for key, value in found.items() if key != "points"}
        shutil.copy(place / "whole" / "polar.png", PICTURE)
    return said


def main() -> None:
    """Fly what is not flown yet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="*", default=JUDGING)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--seaway", type=Path, help="folder of the real flight")
    args = parser.parse_args()
    if args.seaway:
        file = RESULTS.with_name("polar_seaway.json")
        file.write_text(json.dumps(seaway(args.seaway), indent=1) + "\n", encoding="utf8")
        return
    for found in resumed.flown(fly, args.seeds, args.results, args.jobs):
        print(json.dumps(found))


if __name__ == "__main__":
    main()
