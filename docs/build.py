"""Fill the tables of README.md and docs/*.md from benchmarks/results, and copy the pictures of the demo.

    python docs/build.py

A table stands between ``<!-- table NAME -->`` and ``<!-- end -->``; its numbers are never typed. With --check nothing
is written and a table that is out of date is an error.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results"
MARKER = re.compile(r"(<!-- table (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def load(name: str) -> dict[str, Any]:
    return json.loads((RESULTS / f"{name}.json").read_text(encoding="utf8"))


def table(header: list[str], rows: list[list[str]]) -> str:
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)]) + "\n"


def figures() -> str:
    """What the README quotes."""
    accuracy, speed = load("accuracy"), load("replay_speed")
    worst = max(accuracy["median_relative_error"].items(), key=lambda item: item[1])
    nees, nis = accuracy["nees"], accuracy["nis"]
    outside = [name.lower() for name, v in nis.items() if not v["low"] <= v["mean"] <= v["high"]]
    return table(
        ["figure", "asked", "measured"],
        [
            [f"parameters within 3 standard errors of truth ({accuracy['pairs']} pairs, {accuracy['seeds']} flights "
             f"of {accuracy['duration']:g} s)", "≥ 95 %", f"{100 * accuracy['within_3_sigma']:.1f} %"],
            ["the same within 1.96 standard errors", "", f"{100 * accuracy['within_2_sigma']:.1f} %"],
            ["median relative error of the main derivatives, all / worst", "< 5 %",
             f"{100 * accuracy['median_relative_error_all']:.2f} % / {100 * worst[1]:.2f} % ({worst[0]})"],
            ["biases and air velocity within 3 standard deviations", "≥ 95 %",
             f"{100 * accuracy['bias_and_wind_within_3_sigma']:.1f} %"],
            [f"NEES at the end, 18 states (95 % bounds {nees['low']:.1f} to {nees['high']:.1f})", "inside",
             f"{nees['mean']:.1f}"],
            ["NIS per sensor from 20 s on inside its 95 % bounds", "all",
             "all" if not outside else "not: " + ", ".join(outside)],
            [f"replay of {speed['duration']:g} s ({speed['messages']} messages), reading and writing included",
             "≥ 100×", f"{speed['realtime_factor']:.0f}× real time"],
            ["the same for the whole process, start of Python included", "",
             f"{speed['realtime_factor_whole_process']:.0f}×"],
        ],
    )  # fmt: skip


def errors() -> str:
    """Median relative error by derivative."""
    accuracy = load("accuracy")
    rows = [[name, f"{100 * value:.2f} %"] for name, value in accuracy["median_relative_error"].items()]
    return table(["derivative", "median relative error"], rows)


def turbulence() -> str:
    """Coverage in turbulence."""
    accuracy = load("accuracy")
    rows = []
    for level in ("light", "moderate"):
        t = accuracy[level]
        worst = ", ".join(f"{name} {100 * share:.0f} %" for name, share in t["worst"].items())
        derivative, error = max(t["median_relative_error"].items(), key=lambda item: item[1])
        rows.append(
            [level, str(t["seeds"]), f"{100 * t['use_share']:.0f} %", f"{100 * t['use_within_3_sigma']:.1f} %", worst,
             f"{100 * t['median_relative_error_all']:.1f} % / {100 * error:.1f} % ({derivative})",
             f"{t['nees_mean']:.1f}"]
        )  # fmt: skip
    header = ["turbulence", "flights", "USE", "of those within 3 standard errors", "least covered",
              "median relative error, all / worst", "NEES (18 is honest)"]  # fmt: skip
    return table(header, rows)


def start() -> str:
    """Consistency of the state early and late."""
    accuracy = load("accuracy")
    names = ("velocity", "position", "attitude", "accelerometer bias", "gyro bias", "air velocity")
    rows = [
        [name, *(", ".join(f"{v:.2f}" for v in accuracy[key][3 * i : 3 * i + 3]) for key in ("z_early", "z_late"))]
        for i, name in enumerate(names)
    ]
    return table(["state (three axes)", "10 s after the start", "at the end"], rows)


def consistency() -> str:
    """NIS by sensor."""
    rows = [
        [name.lower().replace("_", " "), f"{v['mean']:.4f}", f"{v['low']:.4f} to {v['high']:.4f}"]
        for name, v in load("accuracy")["nis"].items()
    ]
    return table(["sensor", "mean NIS per degree of freedom", "95 % bounds"], rows)


def thor_state() -> str:
    """State of Thor against its references."""
    thor = load("real_flights")["thor"]
    vector = lambda values, digits: ", ".join(f"{v:.{digits}f}" for v in values)  # noqa: E731
    return table(
        ["quantity", "ours", "reference", "difference", "asked"],
        [
            ["mean wind NED in the air [m/s]", vector(thor["wind_mean"], 2), vector(thor["wind_reference"], 2),
             f"{thor['wind_horizontal_difference']:.2f} horizontal", "< 1.5"],
            ["gyro biases [rad/s]", vector(thor["gyro_bias_mean"], 4), vector(thor["gyro_bias_onboard"], 4),
             f"{max(thor['gyro_bias_difference']):.4f} at most", "< 0.005"],
            ["roll, pitch, yaw [deg]", "", "onboard filter", vector(thor["attitude_rms_deg"], 2) + " rms", "< 3"],
        ],
    )  # fmt: skip


def thor_parameters() -> str:
    """Parameters of Thor against the lab's model."""
    rows = []
    for p in load("real_flights")["thor"]["parameters"]:
        reference = "" if p["reference"] is None else f"{p['reference']:.4g}"
        rows.append([p["name"], f"{p['value']:.3f}", f"{p['std']:.3f}", reference, p["status"], p["reason"]])
    return table(["parameter", "estimate", "std. error", "reference", "status", "reason"], rows)


def inertialnav() -> str:
    """Innovations of the InertialNav logs."""
    rows = []
    for name, variants in load("real_flights")["inertialnav"].items():
        for label, v in variants.items():
            nis = v["innovation_consistency"]
            rows.append(
                [name, label, *(f"{nis[kind]:.2f}" for kind in ("gps_velocity", "gps_position", "airspeed")),
                 str(sum(v["rejected"].values())), f"{v['largest_roll_deg']:.0f}°"]
            )  # fmt: skip
    header = ["log", "sensors", "GPS velocity", "GPS position", "airspeed", "rejected", "largest roll"]
    return table(header, rows)


TABLES: dict[str, Callable[[], str]] = {
    "figures": figures,
    "errors": errors,
    "start": start,
    "turbulence": turbulence,
    "consistency": consistency,
    "thor_state": thor_state,
    "thor_parameters": thor_parameters,
    "inertialnav": inertialnav,
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="only say whether a table is out of date")
    arguments = parser.parse_args()
    stale = []
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        text = page.read_text(encoding="utf8")
        new = MARKER.sub(lambda match: match[1] + TABLES[match[2]]() + match[3], text)
        if new != text:
            stale.append(page.name)
            if not arguments.check:
                page.write_text(new, encoding="utf8")
    for name in ("learning", "coefficients"):
        picture = ROOT / "runs" / "demo" / f"{name}.png"
        if picture.exists() and not arguments.check:
            shutil.copy(picture, ROOT / "docs" / "figures" / f"demo_{name}.png")
    verb = "out of date: " if arguments.check else "written: "
    print(verb + ", ".join(stale) if stale else "every table is up to date")
    return int(bool(stale) and arguments.check)


if __name__ == "__main__":
    sys.exit(main())
