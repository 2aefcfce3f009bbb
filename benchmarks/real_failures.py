"""Two real flights in which something fails: what is said, and a figure of each for docs/.

    python benchmarks/real_failures.py [--data ../shared/data]

ALFA (Carnegie Mellon): an engine that is cut. Paparazzi (ENAC): an elevon that is held by software, read as commanded
and as its servo was told. Each goes through import, replay and diagnose as a user types them.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.diagnosis.failures.force_balance import ForceBalance, force_balance
from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run

ROOT = Path(__file__).resolve().parents[1]
MAPS = Path(__file__).parent / "maps"
#: Folder of the data, map, aircraft file, and what replay is told besides.
FLIGHTS = {
    "alfa": ("alfa_engine_failure", "alfa.yaml", "alfa_carbon_z.yaml", ()),
    "commands": ("paparazzi_fault", "paparazzi_commands.yaml", "paparazzi_wing.yaml", ("--calm-air",)),
    "actuators": ("paparazzi_fault", "paparazzi_actuators.yaml", "paparazzi_wing.yaml", ("--calm-air",)),
}


def said_of(name: str, data: Path, folder: Path) -> dict[str, Any]:
    """The answer of diagnose, by real processes."""
    source, columns, aircraft, more = FLIGHTS[name]
    recording, run = folder / name, folder / f"{name}_run"
    _command("import", data / source, "--map", MAPS / columns, "--out", recording)
    _command("replay", recording, "--aircraft", config_path(aircraft), "--out", run, *more)
    return _command("diagnose", run)


def _command(*arguments: Any) -> dict[str, Any]:
    words = [sys.executable, "-m", "aircraft_sysid_ros.commands.main", *map(str, arguments), "--json"]
    result: dict[str, Any] = json.loads(subprocess.run(words, capture_output=True, text=True, check=True).stdout)
    return result


def balance_of(name: str, folder: Path, widest: float) -> ForceBalance:
    """The forces of a run that ``said_of`` has made."""
    run = open_run(folder / f"{name}_run")
    assert run.samples is not None
    return force_balance(run.root, run.samples, widest)


def draw(said: dict[str, dict[str, Any]], folder: Path, figures: Path) -> None:
    """What the inputs were told, and the motion, with the times that were found."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    alfa = balance_of("alfa", folder, 1.0)
    figure, axes = plt.subplots(3, 1, figsize=(10, 6), sharex=True, layout="constrained")
    thrust = alfa.measured[:, 0] * alfa.signal("qbar") * alfa.aircraft.wing_area / alfa.aircraft.mass
    for plot, values, label in zip(
        axes, (alfa.signal("throttle"), alfa.signal("V"), thrust),
        ("throttle", "airspeed [m/s]", "specific force\nalong the body [m/s²]"), strict=True,
    ):  # fmt: skip
        plot.plot(alfa.time, values, "k", lw=0.8)
        plot.set_ylabel(label)
    _mark(axes, said["alfa"])
    axes[-1].set_xlabel("time in log [s]")
    figure.savefig(figures / "alfa_engine.png", dpi=100)
    commands, actuators = (balance_of(name, folder, 4.0) for name in ("commands", "actuators"))
    figure, axes = plt.subplots(3, 1, figsize=(10, 6), sharex=True, layout="constrained")
    for flight, label, colour in ((commands, "commanded", "#D55E00"), (actuators, "servo", "k")):
        axes[0].plot(flight.time, np.degrees(flight.signal("elevon_right")), color=colour, lw=0.9, label=label)
        axes[1].plot(flight.time, np.degrees(flight.signal("elevon_left")), color=colour, lw=0.9, label=label)
    speed = commands.signal("V")
    axes[2].plot(commands.time, np.degrees(commands.signal("p") * 2.0 * speed / commands.aircraft.span), "k", lw=0.8)
    for plot, label in zip(axes, ("right elevon [deg]", "left elevon [deg]", "roll rate [deg/s]"), strict=True):
        plot.set_ylabel(label)
    axes[0].legend(fontsize=8)
    axes[-1].set_xlim(60.0, 95.0)
    axes[-1].set_xlabel("time in log [s]")
    _mark(axes, said["commands"])
    figure.savefig(figures / "paparazzi_elevon.png", dpi=100)


def _mark(axes: Any, said: dict[str, Any]) -> None:
    for candidate in said["candidates"]:
        for time in candidate["inner"].values():
            for plot in axes:
                plot.axvline(time, color="#0072B2", ls="--", lw=1.0)


def main() -> None:
    """Fly all of them through the program."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    data = parser.parse_args().data
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        said = {name: said_of(name, data, folder) for name in FLIGHTS}
        draw(said, folder, ROOT / "docs" / "figures")
    for name, answer in said.items():
        print(f"{name}: {answer['verdict']}\n  {answer['advice']}")


if __name__ == "__main__":
    main()
