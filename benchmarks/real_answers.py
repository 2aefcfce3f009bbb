"""What diagnose says of real flights of which nobody knows an effect, whole and in halves.

    python benchmarks/real_answers.py [--data ../shared/data] [--place FOLDER]

Thor (University of Minnesota), with vanes and commands in place of deflections, and the Solar Surfer (MIT), with
neither. An answer that holds is the same for both halves. Each goes through import, replay and diagnose as a user types
them; runs that are in FOLDER are not made again.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
RESULTS = HERE / "results" / "real_answers.json"
#: Recording, aircraft file, and where in it the flight begins, is halved and ends [s].
FLIGHTS = {
    "thor": ("umn_thor_flight75/flight75.mat", HERE.parent / "config" / "umn_thor.yaml", (211.0, 395.0, 579.0)),
    "solar_surfer": ("mit_seaway", HERE / "aircraft" / "solar_surfer.yaml", (587.0, 708.0, 830.0)),
}


def said_of(name: str, data: Path, place: Path) -> dict[str, Any]:
    """The answers about a flight and about its halves."""
    source, aircraft, (begin, middle, end) = FLIGHTS[name]
    bag = place / name
    if not bag.exists():
        columns = []
        if (data / source).is_dir():
            _command("import", data / source, "--guess", place / f"{name}.yaml")
            columns = ["--map", place / f"{name}.yaml"]
        _command("import", data / source, *columns, "--out", bag)
    said = {}
    for part, span in (("whole", None), ("first half", (begin, middle)), ("second half", (middle, end))):
        run = place / f"{name}_{part.replace(' ', '_')}"
        if not (run / "diagnosis.json").exists():
            cut = place / "cut.yaml"
            cut.write_text(f"- {{start: {span[0]}, stop: {span[1]}, name: {part}}}\n" if span else "", encoding="utf8")
            segments = ["--segments", cut] if span else []
            _command("replay", bag, *segments, "--aircraft", aircraft, "--out", run, "--overwrite")
        said[part] = _answer(run)
    return said


def _answer(run: Path) -> dict[str, Any]:
    words = [sys.executable, "-m", "aircraft_sysid_ros.commands.main", "diagnose", str(run), "--json"]
    if not (run / "diagnosis.json").exists():
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        if done.returncode:
            return {"refused": done.stderr.strip().splitlines()[-1]}
    found = json.loads((run / "diagnosis.json").read_text(encoding="utf8"))
    return {
        "verdict": found["verdict"], "found": [each["label"] for each in found["candidates"] if each["found"]],
        "left": found.get("left", {}), "advice": found["advice"],
    }  # fmt: skip


def _command(*arguments: Any) -> None:
    words = [sys.executable, "-m", "aircraft_sysid_ros.commands.main", *map(str, arguments)]
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def main() -> None:
    """Ask, and keep the answers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=HERE.parents[1] / "shared" / "data")
    parser.add_argument("--place", type=Path)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        place = args.place or Path(folder)
        place.mkdir(parents=True, exist_ok=True)
        said = {name: said_of(name, args.data, place) for name in FLIGHTS}
    RESULTS.write_text(json.dumps(said, indent=1) + "\n", encoding="utf8")


if __name__ == "__main__":
    main()
