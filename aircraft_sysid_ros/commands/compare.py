"""``compare``: how good the model of a run is on flight that it was not fitted to, and where it fails.

With another run it says, too, which parameters differ by more than chance and how well each model does on each
flight; of two fleets, or of two airframes of one, what differs by more than their flights do.
"""

from __future__ import annotations

import argparse
import math
from typing import Any

from aircraft_sysid_ros.after_flight.compare import compare_run, compare_runs
from aircraft_sysid_ros.commands.pictures import picture, picture_lines
from aircraft_sysid_ros.commands.progress import telling
from aircraft_sysid_ros.diagnosis.compare import left_in_words
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.fleet.folder import is_fleet
from aircraft_sysid_ros.report.diagnosis_figures import comparison_figure
from aircraft_sysid_ros.rounding import fixed, rounded_to_error, with_error

FIGURE = "compare.png"


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "compare", help="how good the model is, and where it fails", description=__doc__
    )
    parser.add_argument("run", metavar="RUN", help="folder written by replay or live, or by fleet")
    what = "another run, or the id of another version of this one: both side by side"
    parser.add_argument("second", nargs="?", metavar="RUN2", help=what)
    parser.add_argument("--with", dest="other", metavar="RUN2", help="the same")
    parser.add_argument("--airframes", nargs=2, metavar=("A", "B"), help="of a fleet: two airframes side by side")
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Compare and draw; returns what ``--json`` prints with the model and the figure. Raises InputError."""
    args.other = _other(args)
    if is_fleet(args.run):
        from aircraft_sysid_ros.commands import compare_fleets  # here: no run needs it

        return compare_fleets.run(args)
    if args.airframes:
        raise InputError(f"--airframes is for the folder of a fleet, and {args.run} is not one")
    with telling("compare") as tell:
        beside = None
        if args.other is None:
            found = compare_run(args.run, tell)
        else:
            found, beside = compare_runs(args.run, args.other, tell)
    path, title = found.run.path, f"{found.comparison.flight.aircraft.name}, model {found.run.current.identifier}"
    figure, notes = picture(lambda: comparison_figure(found.comparison, path / FIGURE, title))
    result = {**found.json, "figure": figure, "notes": [*found.notes, *notes]}
    return result if beside is None else {**result, "with": beside.json}


def _other(args: argparse.Namespace) -> str | None:
    """What is set beside the run, with or without ``--with``. Raises InputError where there are two."""
    if args.second and args.other:
        raise InputError(f"two are compared, and {args.second} and {args.other} come with {args.run}: leave one out")
    other: str | None = args.other or args.second
    return other


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    if "between" in result:
        from aircraft_sysid_ros.commands import compare_fleets

        return compare_fleets.render(result)
    lines = [f"model {result['model']}, errors in % of the spread of each coefficient", ""]
    header = f"{'axis':<6}{'fit':>8}{'validation':>12}{'noise floor':>13}  residual"
    lines += [header, "-" * (len(header) + 12)]
    for name, axis in result["axes"].items():
        if axis["nrmse_held_out"] is None:
            lines.append(f"{name:<6}{axis['reason']}")
            continue
        left = left_in_words(axis["fails"], axis["white"])
        fit, held_out, floor = (percent(axis[key]) for key in ("nrmse_fit", "nrmse_held_out", "noise_floor"))
        lines.append(f"{name:<6}{fit:>8}{held_out:>12}{floor:>13}  {left}")
    lines.append("")
    if result["worst"]:
        lines.append("where it fails, worst first (error there, times the noise):")
        lines += [f"  {w['text']}: {percent(w['nrmse'])} %, {w['times_noise']:.1f} times" for w in result["worst"]]
    elif any(axis.get("fails") is False for axis in result["axes"].values()):
        lines.append("no stretch of time and no part of the flight envelope is worse than noise")
    lines += _responses(result["frequency_responses"])
    lines += picture_lines(result)
    return "\n".join([*lines, "", *_beside(result["with"])] if "with" in result else lines)


def _responses(responses: list[dict[str, Any]]) -> list[str]:
    """Where the rates follow the deflections coherently, for people."""
    lines = []
    for each in responses:
        if each["band"] is None:
            continue
        low, high = each["band"]
        at = min(range(len(each["frequency"])), key=lambda i: each["std"][i] if _is_inside(each, i) else math.inf)
        gain, error = each["magnitude"][at], each["magnitude"][at] * each["std"][at]
        best = f"{with_error(gain, error)} rad/s per rad, phase {fixed(each['phase'][at], 0)}°"
        lines.append(
            f"  {each['output']} to {each['input']}: {low:.1f} to {high:.1f} Hz; at {each['frequency'][at]:.1f} Hz "
            f"{best}, coherence {each['coherence'][at]:.2f}"
        )
    if not lines:
        return []
    return ["", "frequency responses, where the coherence is 0.6 or more (all of them with --json):", *lines]


def _is_inside(each: dict[str, Any], i: int) -> bool:
    return bool(each["band"][0] <= each["frequency"][i] <= each["band"][1])


def _beside(both: dict[str, Any]) -> list[str]:
    """Two runs side by side, for people."""
    names = [f"{run} ({model})" for run, model in zip(both["runs"], both["models"], strict=True)]
    lines = [f"a: {names[0]}", f"b: {names[1]}", ""]
    width = max([14, *(len(p["name"]) + 1 for p in both["parameters"])])
    header = f"{'parameter':<{width}}{'a':>12}{'b':>12}{'b - a':>12}{'std. error':>12}"
    lines += [header, "-" * len(header)]
    for p in both["parameters"]:
        values = [rounded_to_error(value, std)[0] for value, std in zip(p["value"], p["std"], strict=True)]
        numbers = (*values, *rounded_to_error(p["difference"], p["std_difference"]))
        lines.append(
            f"{p['name']:<{width}}{''.join(f'{x:>12}' for x in numbers)}{_verdict(p, p['name'] in both['doubtful'])}"
        )
    for run, only in zip("ab", both["only_values"], strict=True):
        if only:
            each = (f"{name} {with_error(*number)}" for name, number in only.items())
            lines.append(f"only in {run}: {', '.join(each)}")
    held_out = "on flight that was not fitted"
    if both["same_flight"]:
        held_out = "on its own states held out, on those of the other run as it was fitted to this flight"
    lines += ["", f"error in % of the spread, {held_out}: of the model of a on a, on b; of b on a, on b"]
    for axis, ((aa, ab), (ba, bb)) in both["errors"].items():
        lines.append(f"{axis:<6}" + "".join(f"{percent(x):>8}" for x in (aa, ab, ba, bb)))
    return [*lines, "", *(f"note: {note}" for note in both["notes"]), *both["told"]]


def _verdict(p: dict[str, Any], is_doubtful: bool) -> str:
    """What stands behind the numbers of a parameter."""
    held = [(run, why.split(":")[0]) for run, why in zip("ab", p["held"], strict=True) if why]
    where = " and ".join(f"{run} on {status}" for run, status in held)
    if not p["differs"] and not is_doubtful:
        return f"  {where}" if held else ""
    differs = f"  differs, p {p['p_value']:.1g}"
    return f"{differs}, but {where}" if is_doubtful else differs


def percent(value: float) -> str:
    """A share as a number of %; a dash where it is not known."""
    return "-" if math.isnan(value) else f"{100.0 * value:.1f}"
