"""A controller that flies on the live estimates, against the same on fixed and on true parameters.

    python benchmarks/closed_loop.py [--seeds 50] [--only elevator,aileron] [--jobs 1]

Every flight is one line of benchmarks/results/closed_loop.jsonl: a stopped benchmark goes on where it was. The summary
is benchmarks/results/closed_loop.json, with one flight as an example. Flights of one seed have the same air, sensors
and task, whoever flies; the wind at 20 ft of MIL-F-8785C is drawn evenly between TURBULENCE.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from closed_loop_figure import draw

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "examples" / "adaptive_controller"))

from one_process import CASES, CONTROLLERS, Flight, fly, truth_of  # noqa: E402

from aircraft_sysid_ros.commands.progress import progress_bar  # noqa: E402
from aircraft_sysid_ros.errors import InputError  # noqa: E402
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft  # noqa: E402

RESULTS = ROOT / "benchmarks" / "results"
RUNS, SUMMARY = RESULTS / "closed_loop.jsonl", RESULTS / "closed_loop.json"
TURBULENCE = (2.0, 7.7)  # [m/s]
#: The end [s] of a flight, when what can be learnt again has been.
LATE = 15.0
#: Case and seed of the example, and the parameters that it shows.
EXAMPLE, SHOWN = ("elevator", 3), ("Cm_de", "Cm_alpha")
Key = tuple[str, str, int]


def turbulence_of(seed: int) -> float:
    """Wind [m/s] at 20 ft of the flights of a seed."""
    return float(np.random.default_rng([seed, 17]).uniform(*TURBULENCE))


def flown(case: str, controller: str, seed: int, watched: tuple[str, ...] = ()) -> Flight:
    """One flight of the benchmark."""
    return fly(default_aircraft(), CASES[case], controller, seed, turbulence=turbulence_of(seed), watched=watched)


def degrees(angle: float) -> float | None:
    """Degrees of an angle [rad], None of one that is not known."""
    return float(np.degrees(angle)) if np.isfinite(angle) else None


def run(key: Key) -> dict[str, Any]:
    """One flight as a line of the file; angles in degrees."""
    began = time.process_time()
    case, controller, seed = key
    flight, at = flown(case, controller, seed), CASES[case]
    line: dict[str, Any] = {
        "case": case, "controller": controller, "seed": seed,
        "before": degrees(flight.tracking_error(5.0, at.time)),
        "after": degrees(flight.tracking_error(at.time)),
        "late": degrees(flight.tracking_error(at.duration - LATE)),
        "lost_at": None if np.isnan(flight.lost_at) else flight.lost_at,
        "processor_time": time.process_time() - began,
    }  # fmt: skip
    p = flight.published
    if p is not None:
        line |= {
            "messages": p.messages, "uses": p.uses, "out_of_bounds": p.out_of_bounds,
            "wrong": {name: n for name, n in p.wrong.items() if n},
            "after_messages": p.after, "uses_after": p.uses_after, "parameters": len(default_aircraft().coefficients),
            "relearnt": None if np.isnan(p.relearnt) else p.relearnt,
        }  # fmt: skip
    return line


def known() -> dict[Key, dict[str, Any]]:
    """Flights that are flown already."""
    if not RUNS.exists():
        return {}
    lines = map(json.loads, RUNS.read_text(encoding="utf8").splitlines())
    return {(line["case"], line["controller"], line["seed"]): line for line in lines}


def flown_by(case: str, controller: str) -> str:
    """Without damage the fixed parameters are the truth, and are not flown twice."""
    return "fixed" if controller == "truth" and CASES[case].damage == "none" else controller


def compared(runs: dict[Key, dict[str, Any]], case: str) -> dict[str, Any]:
    """Numbers of one case, over the seeds that all controllers have flown; errors over those that none lost."""
    by = {
        c: {seed: line for (name, who, seed), line in runs.items() if (name, who) == (case, flown_by(case, c))}
        for c in CONTROLLERS
    }
    seeds = sorted(set.intersection(*(set(lines) for lines in by.values())))
    whole = [seed for seed in seeds if all(by[c][seed]["lost_at"] is None for c in CONTROLLERS)]
    of = lambda c, key: np.array([by[c][seed][key] for seed in whole])  # noqa: E731
    result: dict[str, Any] = {"flights": len(seeds), "compared": len(whole), "controllers": {}}
    for c in CONTROLLERS:
        lost = sum(by[c][seed]["lost_at"] is not None for seed in seeds)
        means = {key: float(of(c, key).mean()) if whole else None for key in ("before", "after", "late")}
        spent = [by[c][seed]["processor_time"] for seed in seeds]
        result["controllers"][c] = {"lost": lost, **means, "processor_time": float(np.median(spent)) if spent else None}
    if whole:
        for key in ("after", "late"):
            difference = of("live", key) - of("fixed", key)
            error = float(difference.std(ddof=1) / np.sqrt(len(whole))) if len(whole) > 1 else None
            result[key] = {
                "live_better": int(np.sum(difference < 0.0)), "difference": float(difference.mean()), "error": error,
                "worst": float(difference.max()),
            }  # fmt: skip
    result["published"] = published([by["live"][seed] for seed in seeds])
    return result


def published(lines: list[dict[str, Any]]) -> dict[str, Any]:
    """What the estimator published over the live flights of a case."""
    total = lambda key: sum(line[key] for line in lines)  # noqa: E731
    again = [line["relearnt"] for line in lines if line["relearnt"] is not None]
    wrong: Counter[str] = Counter()
    for line in lines:
        wrong.update(line["wrong"])
    slots = sum(line["after_messages"] * line["parameters"] for line in lines)
    return {
        "uses": total("uses"), "out_of_bounds": total("out_of_bounds"), "wrong": dict(wrong.most_common()),
        "use_share_after": total("uses_after") / slots if slots else None,
        "relearnt": len(again), "relearnt_median": float(np.median(again)) if again else None,
    }  # fmt: skip


def example() -> dict[str, Any]:
    """Time histories of one flight by all controllers, at 4 Hz, and what was published in it."""
    case, seed = EXAMPLE
    result: dict[str, Any] = {"case": case, "seed": seed, "time_of_change": CASES[case].time, "controllers": {}}
    truth = truth_of(default_aircraft(), CASES[case])
    result["truth"] = {name: [truth(time)[name] for time in (0.0, np.inf)] for name in SHOWN}
    for controller in CONTROLLERS:
        flight = flown(case, controller, seed, SHOWN)
        rows = flight.log[::5]
        columns = {"time": rows[:, 0], "pitch": np.degrees(rows[:, 2]), "reference": np.degrees(rows[:, 4])}
        columns["elevator"] = np.degrees(rows[:, 9])
        result["controllers"][controller] = {name: np.round(v, 3).tolist() for name, v in columns.items()}
        if flight.published is not None:
            result["published"] = {name: np.round(rows, 5).tolist() for name, rows in flight.published.series.items()}
    return result


def main() -> int:
    """Fly what is not flown yet, and write the summary."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=50, help="flights per case and controller")
    parser.add_argument("--only", default="", help="cases, separated by commas")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    args = parser.parse_args()
    cases = [name for name in args.only.split(",") if name] or list(CASES)
    unknown = [name for name in cases if name not in CASES]
    if unknown:
        raise InputError(f"unknown case '{unknown[0]}': use some of {','.join(CASES)}")
    runs = known()
    wanted = [(case, c, seed) for seed in range(args.seeds) for case in cases for c in CONTROLLERS]
    todo = [key for key in wanted if key not in runs and key[1] == flown_by(*key[:2])]
    with progress_bar() as progress, RUNS.open("a", encoding="utf8") as file:
        task = progress.add_task("flying", total=len(todo))
        with multiprocessing.get_context("spawn").Pool(args.jobs) if args.jobs > 1 else _Here() as pool:
            for key, line in zip(todo, pool.imap(run, todo), strict=True):
                runs[key] = line
                file.write(json.dumps(line) + "\n")
                file.flush()
                progress.update(task, advance=1, description=" ".join(map(str, key)))
    there = {case for case, _, _ in runs}
    summary = {"turbulence": TURBULENCE, "late": LATE, "cases": {c: compared(runs, c) for c in CASES if c in there}}
    summary["example"] = example()
    SUMMARY.write_text(json.dumps(summary, indent=1) + "\n", encoding="utf8")
    draw(summary, ROOT / "docs" / "figures" / "closed_loop.png")
    print(f"written to {SUMMARY}")
    return 0


class _Here:
    """A pool of this process alone."""

    imap = staticmethod(map)

    def __enter__(self) -> _Here:
        return self

    def __exit__(self, *_: object) -> None:
        return None


if __name__ == "__main__":
    try:
        sys.exit(main())
    except InputError as error:
        print(error, file=sys.stderr)
        sys.exit(2)
