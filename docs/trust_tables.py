"""Tables of docs/trust.md from benchmarks/results/bad_minute.json: header and rows of each."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

from results import Rows

Result = dict[str, Any]

WORDS = {
    "airspeed_blocked": "airspeed stands still",
    "airspeed_blocked_noisy": "the same, with the noise of its electronics",
    "airspeed_lost": "no airspeed",
    "alpha_stuck": "vane of the angle of attack sticks",
    "alpha_stuck_noisy": "the same, with noise",
    "beta_stuck": "vane of the sideslip sticks",
    "beta_stuck_noisy": "the same, with noise",
    "gps_lost": "no GPS",
    "gps_spoofed": "GPS velocity 5 m/s wrong",
    "imu_bias_jump": "IMU biases jump",
    "elevator_record": "the record of the elevator stands still",
    "rudder_stuck": "rudder sticks, commands are recorded",
    "elevator_halved": "elevator loses half of its effect, for good",
}

AIR = {"none": "calm", "light": "turbulent"}


def delay(part: Result, key: str) -> str:
    """Median and worst, and how many flights are in it."""
    if part[f"{key}_median"] is None:
        return "never"
    count = "" if part[key] == part["flights"] else f", {part[key]} of {part['flights']} flights"
    return f"{part[f'{key}_median']:.1f} / {part[f'{key}_worst']:.1f} s{count}"


def failures(result: Result) -> Rows:
    """When what failed was held and used again, and how wrong what was used has been."""
    rows = [
        [WORDS[name], AIR[air], delay(part, "held"), delay(part, "back"), f"{100 * part['worst']:.0f} %",
         f"{100 * part['worst_plain']:.0f} %", part["reason"].partition(" since")[0]]
        for name in WORDS
        for air, parts in result["failures"].items()
        for part in [parts[name]]
    ]  # fmt: skip
    header = ["failure", "air", "HOLD after, median / worst", "USE again after its end", "largest error with USE",
              "without the monitor", "reason given"]  # fmt: skip
    return header, rows


def clean(result: Result) -> Rows:
    """What the integrity monitor costs where nothing fails."""
    rows = [
        [label, str(part["flights"]), f"{100 * part['use_plain']:.1f} %", f"{100 * part['use']:.1f} %",
         str(part["with_hold"]), f"{part['disagreeing']:.2f}"]
        for label, part in result["clean"].items()
    ]  # fmt: skip
    header = ["flights", "number", "USE without the monitor", "USE with it", "flights in which an axis was held",
              "parameters per flight on which two estimates disagree"]  # fmt: skip
    return header, rows


TABLES: dict[str, Callable[[Result], Rows]] = {"failures": failures, "clean": clean}


def faults(found: dict[str, Any]) -> tuple[list[str], list[list[str]]]:
    """The campaign of faults: all, and the kinds with a value that was confidently wrong or never held."""
    header = ["fault", "flights", "moved a main derivative", "held", "until HOLD, median / 95 %", "cause named"]
    header += ["confidently wrong", "although what failed had been moved", "at the end"]
    rows = [_of_faults("all of them", found["all"])]
    kinds = found["faults"].items()
    worst = [item for item in kinds if item[1]["sure_wrong"] or item[1]["held"] < item[1]["moved"]]
    rows += [_of_faults(name, each) for name, each in worst]
    healthy = found["healthy"]
    nothing = ["", "", "", "", str(healthy["sure_wrong"]), "", ""]
    rows.append([f"none; {healthy['held']} with an axis held", str(healthy["flights"]), *nothing])
    if (bare := found.get("bare")) is None:  # flown before that was asked
        return header, rows
    label = f"none, but the file has no place of a vane 0.4 m out on the wing; {bare['named']} named"
    rows.append([label, str(bare["flights"]), "", "", "", "", str(bare["sure_wrong"]), "", ""])
    return header, rows


def _of_faults(name: str, each: dict[str, Any]) -> list[str]:
    until = "" if each["median"] is None else f"{each['median']:.1f} / {each['slowest']:.1f} s"
    keys = ("named", "sure_wrong", "sure_wrong_though_moved", "sure_wrong_at_the_end")
    counts = [str(each.get(key, "")) for key in keys]  # the third was not asked of the first campaign
    return [name, str(each["flights"]), str(each["moved"]), str(each["held"]), until, *counts]


def stalls_in_flight(found: dict[str, Any]) -> Rows:
    """Flights through stalls, sound ones and of one that bends: without looking for two models, with, and as it is."""
    kinds = {
        "through stalls": [each for each in found["stalls"] if each["kind"] == "stall"],
        "recovered before them": [each for each in found["stalls"] if each["kind"] == "clean"],
        "sound, complete file": [each for each in found["sound"] if each["file"] == "complete"],
        "sound, mass and shape only": [each for each in found["sound"] if each["file"] == "shape"],
        "JSBSim's c182": found["bent"],
    }
    rows = []
    for name, flights in kinds.items():
        for way in ("without", "whole axes", "with"):
            each = [flight[way] for flight in flights]
            wrong = [len(one["wrong"]) for one in each] if not name.startswith("sound") else []
            covered = f"{sum(one['covered'] for one in each)} of {sum(one['use'] for one in each)}"
            rows.append([
                name, str(len(each)), way, str(sum(one["use"] for one in each)),
                f"{sum(wrong)} in {sum(map(bool, wrong))} flights" if wrong else "",
                "" if wrong else covered,
                f"{100 * sum(one['share'] for one in each) / len(each):.1f} %",
                f"{sum(one['until'] for one in each) / len(each):.1f} s",
            ])  # fmt: skip
    header = ["flights", "number", "looking for two models", "USE at the end", "wrong among them",
              "95 % intervals that hold the truth", "share of USE in time", "until first USE, median"]  # fmt: skip
    return header, rows


def airspeed_faults(found: list[dict[str, Any]]) -> Rows:
    """Airspeeds that are wrong in flights without vanes: with GPS and wind asked, and without."""
    rows = []
    airs = {"none": "calm air", "light": "light turbulence", "moderate": "moderate turbulence"}
    for name, air in itertools.product(sorted({flight["fault"] for flight in found}), airs):
        flights = [flight for flight in found if (flight["fault"], flight["air"]) == (name, air)]
        if not flights:
            continue
        named = [flight["with"]["named"] for flight in flights if flight["with"]["named"] is not None]
        after = sorted(flight["with"]["named"] - flight["begin"] for flight in flights if flight["with"]["named"])
        of_two = [[flight[way] for flight in flights] for way in ("without", "with")]
        rows.append([
            name or "none", airs[air], str(len(flights)), str(len(named)),
            f"{after[(len(after) - 1) // 2]:.0f} / {after[-1]:.0f} s" if after and name else "",
            *(f"{sum(one['wrong_seconds'] for one in each)} s" if name else "" for each in of_two),
            *(str(sum(one["wrong_at_the_end"] for one in each)) if name else "" for each in of_two),
            *(f"{sum(one['use_seconds'] for one in each)} s" for each in of_two),
            *(f"{sum(one['held_seconds'] for one in each)} s" for each in of_two),
        ])  # fmt: skip
    header = ["fault", "air", "flights", "named", "after, median / longest", "a wrong one in USE, without", "with",
              "at the end, without", "with", "USE, without", "with", "an axis held, without", "with"]  # fmt: skip
    return header, rows


def lost_samples(before: list[dict[str, Any]], now: list[dict[str, Any]]) -> Rows:
    """Values in USE of flights most of whose samples were lost for seconds, and how many were off."""
    rows = []
    for name, flights in (("before", before), ("now", now)):
        used, left = sum(f["used"] for f in flights), sum(f["left"] for f in flights) / len(flights)
        shares = [f"{100 * sum(f[key] for f in flights) / used:.2f} %" for key in ("beyond_3", "beyond_5")]
        largest = f"{max(f['largest'] for f in flights):.1f}"
        rows.append([name, str(len(flights)), f"{100 * left:.0f} %", str(used), *shares, largest])
    header = ["rules", "flights", "samples left", "values in USE", "beyond 3 standard errors", "beyond 5", "largest"]
    return header, rows


def small_airspeed_error(found: list[dict[str, Any]]) -> Rows:
    """Airspeeds that are off by a few per cent: said in flight, told after it, and how well they are known."""
    rows = []
    for one in found:
        flights = one["flights"]
        ranges = sorted(flight["range"] for flight in flights)
        rows.append([
            f"{one['speed']:.0f} m/s", f"{100 * one['error']:+.0f} %" if one["error"] else "none", str(len(flights)),
            *(str(sum(flight[key] for flight in flights)) for key in ("in_flight", "told", "within")),
            f"{100 * ranges[len(ranges) // 2]:.0f} %",
        ])  # fmt: skip
    header = ["speed", "error", "flights", "named in flight", "told after it", "in its range", "range, median"]
    return header, rows


def use_audit(found: dict[str, Any]) -> Rows:
    """Values in USE against the truth, by what was drawn; without what is in doubt of the sensors, and as it is."""
    rows = []
    for name, counts in found.items():
        for way in ("without", "with"):
            c, seconds = counts[way], counts[way]["seconds"]
            in_use = max(seconds.get("use", 0), 1)
            rows.append([
                name, str(counts["flights"]), way, f"{c['use']} of {c['parameters']}", f"{c['covered']}",
                f"{c['missed']}", f"{c['sure_wrong']}", f"{seconds.get('use', 0)} s",
                *(f"{100 * seconds.get(key, 0) / in_use:.2f} %" for key in ("outside", "missed", "sure_wrong")),
                f"{c['flights_sure_wrong']}", f"{c['lost']}",
            ])  # fmt: skip
    header = ["flights", "number", "sensors in doubt", "USE at the end", "in their 95 % interval",
              "off by more than 3.5 standard errors", "confidently wrong", "USE in time", "outside of 95 %",
              "off by more than 3.5", "confidently wrong", "flights in which one was",
              "right, but not in USE"]  # fmt: skip
    return header, rows
