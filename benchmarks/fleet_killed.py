"""A worker killed every 20 s: the same tables to the bit.

    python benchmarks/fleet_killed.py [--flights 5] [--every 20] [--place FOLDER]

The first flights of each airframe of the whole fleet of `fleet.py`, and its damaged files, once undisturbed with one
worker, and once with two of which one or the other is killed (SIGKILL) every so many seconds. Without diagnosis, and
without the file that hangs: its flight ends when the time limit is over, which starts over with each worker.
A worker needs about 5 s of processor time to start: where it gets less than that in --every seconds, no flight
is ever flown to its end.
"""

from __future__ import annotations

import argparse
import itertools
import json
import random
import subprocess
import time
from pathlib import Path
from typing import Any

import psutil
import yaml
from fleet import PROGRAM, RESULTS, ROOT, WHOLE, damage, simulate

PATIENCE = 3600.0  # [s]


def workers_of(process: psutil.Process) -> list[psutil.Process]:
    """The workers of a fleet, oldest first."""
    found = []
    for child in process.children():
        try:
            if "spawn_main" in " ".join(child.cmdline()):
                found.append(child)
        except psutil.Error:
            continue
    return sorted(found, key=lambda child: child.create_time())


def flown(source: Path, out: Path, workers: int, every: float | None) -> dict[str, Any]:
    """Fly a fleet; counts of what was killed."""
    words = ["--aircraft", str(ROOT / "config" / "ultra_stick_25e.yaml"), "--out", str(out), "--no-diagnosis"]
    command = [*PROGRAM, "fleet", str(source), *words, "--workers", str(workers), "--json"]
    began, kills, draw = time.perf_counter(), 0, random.Random(1)
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        for number in itertools.count(1):
            try:
                text, _ = process.communicate(timeout=every or PATIENCE)
                break
            except subprocess.TimeoutExpired:
                if every is None or number * every > PATIENCE:
                    process.kill()
                    raise
                if there := workers_of(psutil.Process(process.pid)):
                    draw.choice(there).kill()
                    kills += 1
        assert process.returncode == 0, process.returncode
    answer = json.loads(text)
    return {"flights": answer["flights"], "ok": answer["ok"], "kills": kills, "wall": time.perf_counter() - began}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=5, metavar="N", help="of each airframe (default %(default)s)")
    parser.add_argument("--every", type=float, default=20.0, metavar="S")
    parser.add_argument("--place", type=Path, default=ROOT / "build" / "fleet")
    args = parser.parse_args()
    place = args.place / "whole"
    jobs = [(frame, flight, 1000 * k + flight) for k, frame in enumerate(WHOLE) for flight in range(args.flights)]
    entries = [simulate(*job, place) for job in jobs]
    listed = place / "killed.yaml"
    listed.write_text(yaml.safe_dump([*entries, *damage(entries, place)[:-1]]), encoding="utf8")
    outs = [args.place / f"{name}-{time.time_ns()}" for name in ("undisturbed", "killed")]
    undisturbed = flown(listed, outs[0], 1, None)
    killed = flown(listed, outs[1], 2, args.every)
    tables = sorted(path.name for path in outs[0].glob("*.parquet"))
    same = [name for name in tables if (outs[0] / name).read_bytes() == (outs[1] / name).read_bytes()]
    result = {"every": args.every, "undisturbed": undisturbed, "killed": killed, "tables": tables, "same": same}
    (RESULTS / "fleet_killed.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf8")


if __name__ == "__main__":
    main()
