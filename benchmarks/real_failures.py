"""Two real flights in which something fails: what is said, and a figure of each for docs/.

    python benchmarks/real_failures.py [--data ../shared/data]

ALFA (Carnegie Mellon): an engine that is cut. Paparazzi (ENAC): an elevon that is held by software, read as commanded
and as its servo was told. Each goes through import, replay and diagnose as a user types them. What a model makes of the
elevon's flight before and after the diagnosis is in results/real_story.json.
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
RESULTS = Path(__file__).parent / "results" / "real_story.json"
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
    command("import", data / source, "--map", MAPS / columns, "--out", recording)
    command("replay", recording, "--aircraft", config_path(aircraft), "--out", run, *more)
    return command("diagnose", run)


def command(*arguments: Any) -> dict[str, Any]:
    """What a command of the command line says, as JSON."""
    words = [sys.executable, "-m", "aircraft_sysid_ros.commands.main", *map(str, arguments), "--json"]
    result: dict[str, Any] = json.loads(subprocess.run(words, capture_output=True, text=True, check=True).stdout)
    return result


def balance_of(name: str, folder: Path, widest: float) -> ForceBalance:
    """The forces of a run that ``said_of`` has made."""
    run = open_run(folder / f"{name}_run")
    assert run.samples is not None
    return force_balance(run.root, run.samples, widest)


def times_in(flight: ForceBalance, found: dict[str, Any]) -> dict[str, float]:
    """When what was found begins and ends, as the times of ``flight`` count [s]."""
    return {name: (stamp - flight.begin) * 1e-9 for name, stamp in found["stamps"].items()}


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
    _mark(axes, alfa, said["alfa"])
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
    _mark(axes, commands, said["commands"])
    figure.savefig(figures / "paparazzi_elevon.png", dpi=100)


#: What is shown of the roll rate, from where it is simulated on, how far from the failure the model is fitted [s].
_SHOWN, _BEFORE, _AWAY = (70.0, 79.0), 2.0, 1.0


def story(flight: ForceBalance, said: dict[str, Any], figures: Path) -> dict[str, Any]:
    """The roll rate that a model makes of the elevons as commanded, and with what was found in it; rms errors [deg/s].

    The model, one roll mode with an effect of each elevon, is fitted to the flight before and after the failure and
    simulated through it without looking at the motion.
    """
    (found,) = (each for each in said["candidates"] if each["found"])
    begin, end = (times_in(flight, found)[key] for key in ("t0", "t1"))
    position = found["level"]
    rate = np.degrees(flight.signal("p") * 2.0 * flight.signal("V") / flight.aircraft.span)
    time, pressure = flight.time, flight.signal("qbar") / np.mean(flight.signal("qbar"))
    right, left = flight.signal("elevon_right"), flight.signal("elevon_left")
    held = np.where((time >= begin) & (time <= end), position, right)
    outside = (time[:-1] < begin - _AWAY) | (time[:-1] > end + _AWAY)
    steps = np.isclose(np.diff(time), flight.step, rtol=0.2)

    def columns(elevon: Any, rates: Any) -> Any:
        return np.column_stack([rates, pressure * elevon, pressure * left, np.ones(len(time))])

    chosen = outside & steps & np.isfinite(columns(right, rate)[:-1]).all(axis=1) & np.isfinite(rate[1:])
    gains = np.linalg.lstsq(columns(right, rate)[:-1][chosen], rate[1:][chosen], rcond=None)[0]
    through = np.flatnonzero((time >= begin - _BEFORE) & (time <= end))
    errors, flown = {}, {}
    for name, elevon in (("before", right), ("after", held)):
        rates = rate.copy()
        for k in through[:-1]:
            rates[k + 1] = columns(elevon, rates)[k] @ gains
        flown[name] = rates
        inside = (time >= begin) & (time <= end)
        errors[name] = float(np.sqrt(np.mean((rates[inside] - rate[inside]) ** 2)))
    import matplotlib.pyplot as plt

    figure, plot = plt.subplots(figsize=(10, 3.4), layout="constrained")
    plot.plot(time, rate, color="k", lw=2.0, label="measured")
    plot.plot(time[through], flown["before"][through], color="#D55E00", label="model, elevons as commanded")
    plot.plot(time[through], flown["after"][through], color="#0072B2", label="model, with what diagnose found")
    for edge in (begin, end):
        plot.axvline(edge, color="#0072B2", ls="--", lw=1.0)
    plot.set_xlim(*_SHOWN)
    plot.set_xlabel("time in log [s]")
    plot.set_ylabel("roll rate [deg/s]")
    plot.legend(fontsize=9, loc="upper left")
    plot.grid(alpha=0.3)
    figure.savefig(figures / "real_story.png", dpi=100)
    return {"begin": begin, "end": end, "position": position, "rms": errors, "label": found["label"]}


def _mark(axes: Any, flight: ForceBalance, said: dict[str, Any]) -> None:
    for candidate in said["candidates"]:
        for time in times_in(flight, candidate).values():
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
        told = story(balance_of("commands", folder, 4.0), said["commands"], ROOT / "docs" / "figures")
    RESULTS.write_text(json.dumps(told, indent=1) + "\n", encoding="utf8")
    for name, answer in said.items():
        print(f"{name}: {answer['verdict']}\n  {answer['advice']}")


if __name__ == "__main__":
    main()
