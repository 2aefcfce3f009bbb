"""Speed of replay with reading and writing: a bag with 100 Hz IMU, 5 Hz GPS, 50 Hz air data and controls.

    python benchmarks/replay_speed.py [--duration 600] [--runs 5]

Two figures: the factor that ``replay`` itself reports (reading, both steps, writing), and that of the whole
process, which includes starting Python and loading compiled code. Medians over the runs; on a busy machine look at the
third, the whole process by its processor time.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path


def command(*arguments: Any) -> dict[str, Any]:
    """Run a command of ours; returns its JSON."""
    line = [sys.executable, "-m", "aircraft_sysid_ros.commands.main", *map(str, arguments), "--json"]
    return json.loads(subprocess.run(line, check=True, stdout=subprocess.PIPE).stdout)


def measure(duration: float, runs: int) -> dict[str, Any]:
    """Figures of ``runs`` replays after one that loads the caches."""
    factors, walls, processor = [], [], []
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "bag"
        flight = command("simulate", "--out", bag, "--duration", duration)
        for i in range(runs + 1):
            started, before = time.perf_counter(), os.times()
            aircraft, run = config_path(DEFAULT_AIRCRAFT), Path(folder) / "run"
            result = command("replay", bag, "--aircraft", aircraft, "--out", run, "--overwrite")
            if i:
                walls.append(duration / (time.perf_counter() - started))
                after = os.times()
                used = after.children_user + after.children_system - before.children_user - before.children_system
                processor.append(duration / used)
                factors.append(result["state"]["realtime_factor"])
    return {
        "duration": duration,
        "messages": sum(flight["messages"].values()),
        "runs": runs,
        "realtime_factor": statistics.median(factors),
        "realtime_factor_whole_process": statistics.median(walls),
        "realtime_factor_processor_time": statistics.median(processor),
        "load_average": os.getloadavg()[0],
        "machine": f"{platform.machine()}, {platform.python_implementation()} {platform.python_version()}",
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=600.0)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "results" / "replay_speed.json")
    arguments = parser.parse_args()
    result = measure(arguments.duration, arguments.runs)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(json.dumps(result, indent=1) + "\n", encoding="utf8")
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
