"""Fuzz for long: each target in a process of its own, new inputs every time, until the time is over.

    python test/fuzz/long.py [--minutes 10] [--seed N] [TARGET …]

An exception, a crash, a hang of a minute or more than 8 GB of memory is a fault: the input is kept in build/fuzz and
the exit status is 1.
"""

from __future__ import annotations

import argparse
import faulthandler
import pickle
import resource
import subprocess
import sys
import time
import traceback
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, Phase, Verbosity, given, seed, settings

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[2])]
from targets import TARGETS  # noqa: E402

KEPT = Path("build/fuzz")
LONGEST, MEMORY, ROUND = 60, 8 << 30, 200


def fuzzed(name: str, seconds: float, first: int) -> int:
    """Rounds of inputs for one target, in this process; how many were tried."""
    found, current, count = TARGETS[name], KEPT / f"{name}.current", 0
    inputs, began, number = found.inputs(), time.monotonic(), first
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    while time.monotonic() - began < seconds:

        @seed(number)
        @settings(
            max_examples=ROUND, deadline=None, database=None, suppress_health_check=list(HealthCheck),
            phases=[Phase.generate, Phase.shrink], verbosity=Verbosity.normal, report_multiple_bugs=False,
        )  # fmt: skip
        @given(inputs)
        def tried(item: Any) -> None:
            nonlocal count
            count += 1
            current.write_bytes(pickle.dumps(item))
            faulthandler.dump_traceback_later(LONGEST, exit=True)
            found.run(item)
            faulthandler.cancel_dump_traceback_later()

        tried()
        number += 1
    return count


def main() -> int:
    """All targets, or those that are named."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"of {' '.join(TARGETS)}; default: all")
    parser.add_argument("--minutes", type=float, default=10.0, help="for all of them together (default: 10)")
    parser.add_argument("--seed", type=int, default=None, help="of the inputs (default: another one each time)")
    parser.add_argument("--in-process", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if unknown := set(args.targets) - set(TARGETS):
        parser.error(f"no target {' '.join(sorted(unknown))}")
    KEPT.mkdir(parents=True, exist_ok=True)
    names = args.targets or list(TARGETS)
    first = time.time_ns() % 10**9 if args.seed is None else args.seed
    seconds = 60.0 * args.minutes / len(names)
    if args.in_process:
        try:
            print(f"{names[0]}: {fuzzed(names[0], seconds, first)} inputs, nothing found", flush=True)
        except BaseException:
            traceback.print_exc()
            return 1
        return 0
    faults = []
    for name in names:
        options = ["--minutes", str(seconds / 60.0), "--seed", str(first), "--in-process", name]
        if subprocess.run([sys.executable, __file__, *options], check=False).returncode:
            kept = (KEPT / f"{name}.current").rename(KEPT / f"{name}-{first}.pickle")
            print(f"{name}: FOUND SOMETHING, the input is in {kept}", flush=True)
            faults.append(name)
    print(f"seed {first}: {f'faults in {chr(32).join(faults)}' if faults else 'nothing found'}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
