"""Is `make test` green every time, on a machine that does other work too? As in issue 12: 20 times in a row.

    python benchmarks/suite_runs.py [--runs 20] [--busy 2]

Runs `make test` of this checkout again and again beside processes that do nothing but count, and writes a line for
each run to results/suite_runs.jsonl: what pytest said at its end, the seconds, and the load of the machine. It goes on
after a run that failed, and keeps the output of that run in build/.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
RESULTS = Path(__file__).parent / "results" / "suite_runs.jsonl"


def run(number: int) -> dict[str, Any]:
    """One `make test`, and what came of it."""
    start = time.monotonic()
    done = subprocess.run(
        ["make", "test"], check=False, cwd=ROOT, stdin=subprocess.DEVNULL, capture_output=True, text=True
    )
    seconds = time.monotonic() - start
    said = re.findall(r"(?m)^\d+ \w+.* in [0-9.]+s.*$", done.stdout)
    if done.returncode != 0:
        (ROOT / "build" / f"suite_run_{number}.txt").write_text(done.stdout + done.stderr)
    return {
        "run": number,
        "green": done.returncode == 0,
        "pytest": said[-1] if said else "did not end",
        "seconds": round(seconds),
        "load": round(os.getloadavg()[2], 1),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--busy", type=int, default=2, help="processes beside it; 0 where others are there")
    asked = parser.parse_args()
    (ROOT / "build").mkdir(exist_ok=True)
    commit = subprocess.check_output(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, text=True).strip()
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(asked.busy)]
    try:
        for number in range(1, asked.runs + 1):
            result = {"commit": commit, "busy": asked.busy, **run(number)}
            print(json.dumps(result), flush=True)
            with RESULTS.open("a") as file:
                file.write(json.dumps(result) + "\n")
    finally:
        for process in busy:
            process.kill()


if __name__ == "__main__":
    main()
