"""``explain``: what a log means, in one go: import, check, replay, compare, diagnose, to one page.

DIR gets the run and explain.html, and the recording where the log was one of another program. Without --aircraft mass
and shape are enough; on a terminal they are asked for.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from aircraft_sysid_ros import api
from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict
from aircraft_sysid_ros.commands.notes import note_lines
from aircraft_sysid_ros.commands.options import add_option, add_servos
from aircraft_sysid_ros.commands.progress import telling
from aircraft_sysid_ros.diagnosis.significance.parametric_bootstrap import COUNT
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.option import options_of
from aircraft_sysid_ros.reconstruction.options import StateOptions
from aircraft_sysid_ros.rounding import with_error
from aircraft_sysid_ros.run_reader import AIRCRAFT

#: Keys of the aircraft file with unit and words, as they are asked for.
_SHAPE = {
    "mass": ("kg", "mass"),
    "wing_area": ("m²", "wing area"),
    "span": ("m", "wing span"),
    "chord": ("m", "mean aerodynamic chord"),
    "inertia": ("kg m²", "moments of inertia Ixx,Iyy,Izz[,Ixz]"),
}


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "explain", help="what a log means, in one go, on one page", description=__doc__
    )
    add = parser.add_argument
    add("log", metavar="LOG", help="a recording, a log that `import` takes by itself, or tables with --map")
    add("--aircraft", metavar="FILE", help="aircraft file (YAML)")
    for key, (unit, words) in _SHAPE.items():
        add(
            _flag(key), metavar="NUMBERS" if key == "inertia" else "X", help=f"{words} [{unit}], in place of --aircraft"
        )
    add("--out", required=True, metavar="DIR", help="folder to write: the run, and explain.html")
    add("--map", metavar="MAP", help="for tables, which column is which signal (YAML, docs/import.md)")
    add_servos(parser, "what servo outputs and airspeed of an autopilot mean (YAML)")
    add_option(parser, "calm_air", options_of(StateOptions)["calm_air"])
    add("--overwrite", action="store_true", help="replace an explanation that is there")
    add("--replicas", type=int, default=COUNT, metavar="N",
        help="simulated flights without the effect, to compare the evidence with (default %(default)s)")  # fmt: skip
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Explain; returns what ``--json`` prints with what is said first. Raises InputError."""
    if not args.log.strip():
        raise InputError("LOG is empty: give a recording, or a log of another program")
    if not args.out.strip():
        raise InputError("--out is empty: give the name of a folder")
    if not Path(args.log).exists():
        raise InputError(f"there is no log {args.log}")
    aircraft = _aircraft(args)
    with telling("explain") as tell:
        found = api.explain(
            args.log, aircraft, args.out, columns=args.map, calibration=args.servos, overwrite=args.overwrite,
            replicas=args.replicas, calm_air=args.calm_air, tell=tell,
        )  # fmt: skip
    result = dict(found.json)
    if not args.aircraft and result["run"]:
        file = Path(result["run"]) / AIRCRAFT
        copy = "add what else is known to a copy of it, and give that with --aircraft"
        result["notes"] = [*result["notes"], f"no aircraft file was given; {file} holds the numbers you gave: {copy}"]
    return result


def _flag(key: str) -> str:
    return f"--{key.replace('_', '-')}"


def _aircraft(args: argparse.Namespace) -> str | Aircraft:
    """The aircraft file, or an aeroplane of the numbers that were given or are asked for. Raises InputError."""
    given = {key: getattr(args, key) for key in _SHAPE if getattr(args, key) is not None}
    if args.aircraft:
        if given:
            raise InputError(f"{_flag(next(iter(given)))} does not go with --aircraft: that file says it already")
        return str(args.aircraft)
    lacking = [key for key in _SHAPE if key not in given]
    if lacking and not (sys.stdin.isatty() and sys.stderr.isatty()):
        raise InputError(
            "which aeroplane is it? Give --aircraft FILE, or its mass and shape: "
            + " ".join(f"{_flag(key)} {'Ixx,Iyy,Izz' if key == 'inertia' else 'X'}" for key in lacking)
        )
    content = {key: _value(key, text) for key, text in given.items()}
    for key in lacking:
        content[key] = _asked(key)
    return aircraft_from_dict({"name": Path(args.log).stem, **content})


def _asked(key: str) -> float | dict[str, float]:
    """One number, on the terminal, again until it is one; standard output stays for the answer."""
    unit, words = _SHAPE[key]
    while True:
        print(f"{words} [{unit}]: ", end="", file=sys.stderr, flush=True)
        text = sys.stdin.readline()
        try:
            return _value(key, text.strip())
        except InputError as error:
            if not text:  # the terminal was closed, or Ctrl-D
                raise
            print(error, file=sys.stderr)


def _value(key: str, text: str) -> float | dict[str, float]:
    return _inertia(text) if key == "inertia" else _number(key, text)


def _number(key: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{_flag(key)} must be a number in {_SHAPE[key][0]}, not '{text}'") from None


def _inertia(text: str) -> dict[str, float]:
    parts = [part for part in text.replace(",", " ").split() if part]
    if len(parts) not in (3, 4):
        raise InputError(f"--inertia must be Ixx,Iyy,Izz or Ixx,Iyy,Izz,Ixz in kg m², not '{text}'")
    return dict(zip(("xx", "yy", "zz", "xz"), (_number("inertia", part) for part in [*parts, "0"][:4]), strict=True))


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    lines = [result["first"], *(f"  {said['sentence']}" for said in result["said"][1:]), ""]
    lines += [_fact_line(fact) for fact in result["aeroplane"] if not fact["reason"]]
    lines += [_mode_line(mode) for mode in result["modes"] if not mode["reason"]]
    unknown = [
        each.get("title", each.get("name")) for each in (*result["aeroplane"], *result["modes"]) if each["reason"]
    ]
    lines += [f"not known: {', '.join(unknown)}"] if unknown else []
    lines += ["", "what to fly next", *(f"  {sentence}" for sentence in result["next"]), ""]
    lines += note_lines(result["notes"])
    return "\n".join([*lines, *([f"run {result['run']}"] if result["run"] else []), f"page {result['page']}"])


def _fact_line(fact: dict[str, Any]) -> str:
    return f"{fact['title']:<34}{_known(fact['value'], fact['std'])} {fact['unit']}: {fact['words']}"


def _known(value: float, std: float | None) -> str:
    """A number as far as its standard error says something of it, where that is known."""
    return f"{value:.2g}" if std is None or std != std else with_error(value, std).replace("-", "−")


def _mode_line(mode: dict[str, Any]) -> str:
    std, seconds = mode["std"], mode["time_constant"]
    if seconds is not None:
        spread = seconds * std["frequency"] / mode["frequency"]
        return f"{mode['name']:<34}time constant {_known(seconds, spread)} s: {mode['words']}"
    if mode["frequency"] is None:
        return f"{mode['name']:<34}{mode['words']}"
    frequency, damping = (_known(mode[name], std[name]) for name in ("frequency", "damping"))
    return f"{mode['name']:<34}{frequency} rad/s, damping {damping}: {mode['words']}"
