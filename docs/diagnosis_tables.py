"""Tables of docs/diagnosis.md from the results of benchmarks/hidden_effects.py: header and rows by name."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
from results import RESULTS, Rows, load, table
from scipy.stats import binomtest

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.diagnosis.significance.whiteness import FALSE_ALARM
from aircraft_sysid_ros.effects.aliases import ALIASES, aliases_of

#: Sets of flights, and what stands in the tables for them.
SETS = {"tuned": "tuned on", "fresh": "fresh, flown once"}
_PARTS = {
    "relevant": "all", "relevant_textbook": "own simulator", "relevant_jsbsim": "JSBSim", "relevant_calm": "calm",
    "relevant_light": "light turbulence",
}  # fmt: skip


#: Shortest time [s] before the end of a flight in which a failure that begins can be seen.
LEAST_SEEN = 3.0
_SHARES = ("detected", "right_first", "right_or_alias", "in_first_three", "within_confounded")
_METHODS = {
    "diagnose": "`diagnose`", "stepwise": "stepwise regression, partial F test at 5 % (Bonferroni)",
    "orthogonal": "orthogonal functions, predicted square error", "orthogonal_r2": "the same, 0.5 % of R² each",
    "stlsq": "STLSQ of pysindy", "lasso": "LASSO, cross-validated on blocks",
}  # fmt: skip

#: Before the name of a control that keeps part of its effect; and the signal of each control that fails.
PART = "part of "
_INPUTS = {"elevator": "de", "aileron": "da", "rudder": "dr", "engine": "engine"}


def percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def counted(share: float, flights: int) -> str:
    """A share with its 95 % interval, that of Wilson (1927)."""
    low, high = binomtest(round(share * flights), flights).proportion_ci(method="wilson")
    return f"{100 * share:.0f} % ({100 * low:.0f} to {100 * high:.0f})"


def fine(share: float) -> str:
    return f"{100 * share:.1f} %"


def hidden(sets: dict[str, dict[str, Any]]) -> Rows:
    """How often the right effect was named, and what became of the error."""
    header = [
        "flights with a hidden effect", "number", "detected", "right first", "or of its stated set", "in first three",
        "named or said to be confounded", "error: base", "diagnosed", "truth added", "floor", "within 10 % of truth",
    ]  # fmt: skip
    rows = []
    for name, found in sets.items():
        for key, words in _PARTS.items():
            r = found[key]
            if r["flights"]:
                shares = [counted(r[k], r["flights"]) for k in _SHARES]
                errors = [fine(r[k]) for k in ("base", "diagnosed", "oracle", "floor")]
                row = [f"{SETS[name]}, {words}", str(r["flights"]), *shares, *errors]
                rows.append([*row, percent(r["within_ten_percent"])])
    return header, rows


def other(sets: dict[str, dict[str, Any]]) -> Rows:
    """Clean flights, small effects, and effects that were taken out of the library."""
    rows = []
    for name, found in sets.items():
        for words, r in {"all": found["false_verdicts"], **found["clean_by"]}.items():
            if r["flights"]:
                said = f"a verdict other than none in {counted(r['share'], r['flights'])}"
                rows.append([f"{SETS[name]}, clean, {words}", str(r["flights"]), said])
        r = found["small"]
        if r["flights"]:
            said = f"detected in {percent(r['detected'])}, right first in {percent(r['right_first'])}"
            rows.append([f"{SETS[name]}, effect too small to matter", str(r["flights"]), said])
        r = found["without"]
        if r["flights"]:
            said = (
                f"unexplained in the right axis {counted(r['unexplained_right_axis'], r['flights'])}, in another "
                f"{percent(r['unexplained'] - r['unexplained_right_axis'])}, a name of its stated set "
                f"{percent(r['alias'])}, another name {percent(r['wrong_name'])}, "
                f"none {percent(r['none'])}"
            )
            rows.append([f"{SETS[name]}, the effect taken out of the library", str(r["flights"]), said])
    return ["flights", "number", "what was said"], rows


def slow(by_rate: dict[float, dict[str, Any]]) -> Rows:
    """Clean flights with a slow IMU, by its rate [Hz]."""
    rows = []
    for rate, found in sorted(by_rate.items()):
        for words, r in {"all": found["false_verdicts"], **found["clean_by"]}.items():
            if r["flights"]:
                said = f"a verdict other than none in {counted(r['share'], r['flights'])}"
                rows.append([f"IMU at {rate:g} Hz, {words}", str(r["flights"]), said])
    return ["clean flights", "number", "what was said"], rows


def jet(records: list[dict[str, Any]]) -> tuple[list[str], list[list[str]]]:
    """What was said of each flight of a jet at 10 Hz."""
    header = ["seed", "flight", "true times", "named", "its times", "error of the axis"]
    words = {
        "calm": "clean, calm",
        "gusts": "clean, gusts",
        "cg_shift": "a passenger walks",
        "landing_gear": "gear down",
    }
    rows = []
    for record in records:
        clean = record["kind"] in ("calm", "gusts")
        true = "" if clean else "{:.0f} to {:.0f} s".format(*record["span"])
        found = record["found"]
        times = ["{t0:.0f} to {t1:.0f} s".format(**f["inner"]) if "t1" in f["inner"] else "" for f in found]
        errors = [f"{100 * f['error_before']:.0f} to {100 * f['error_after']:.0f} %" for f in found]
        named = [f["label"] for f in found] or [record["verdict"]]
        rows.append([str(record["seed"]), words[record["kind"]], true, *map(", ".join, (named, times, errors))])
    return header, rows


def _named(record: dict[str, Any]) -> tuple[str, str]:
    """What was named in a flight, and the errors without and with each."""
    found = record["found"]
    errors = [f"{100 * f['error_before']:.0f} to {100 * f['error_after']:.0f} %" for f in found]
    return ", ".join([f["label"] for f in found] or [record["verdict"]]), ", ".join(errors)


def trimmed_jet(records: list[dict[str, Any]]) -> Rows:
    """What was said of each long flight of a jet in trim."""
    header = ["seed", "flight", "thrust", "true times", "named", "its times", "error of the axis"]
    rows = []
    for record in sorted(records, key=lambda record: int(record["seed"])):
        kind = {"clean": "clean", "cg_shift": "a passenger walks"}.get(record["kind"])
        words = kind or ("gear down" if record["gear"] else "flaps out")
        true = "" if kind == "clean" else "{:.0f} to {:.0f} s".format(*record["span"])
        found = record["found"]
        spans = [[value for name, value in f["inner"].items() if name in ("t0", "t1")] for f in found]
        times = [" to ".join(f"{value:.0f}" for value in span) + " s" for span in spans if span]
        known = "recorded" if record["thrust"] else "not recorded"
        named, errors = _named(record)
        rows.append([str(record["seed"]), words, known, true, named, ", ".join(times), errors])
    return header, rows


def stalls(records: list[dict[str, Any]]) -> Rows:
    """What was said of each flight of a transport that is stalled slowly."""
    header = ["seed", "flight", "GPS", "named", "error of the axis"]
    rows = []
    for record in sorted(records, key=lambda record: int(record["seed"])):
        named, errors = _named(record)
        flight = "stalled" if record["kind"] == "stall" else "clean"
        rows.append([str(record["seed"]), flight, "yes" if record["gps"] else "no", named, errors])
    return header, rows


def strangers(flown: list[dict[str, Any]]) -> Rows:
    """What was said of flights whose file has mass and shape only, by the air."""
    rows = []
    airs = {"steady wind": ("steady",), "wind that walks slowly": ("slow",), "light turbulence": ("light",)}
    for words, kinds in {**airs, "all": sum(airs.values(), ())}.items():
        of_air = [flight for flight in flown if flight["air"] in kinds and "failed" not in flight]
        clean = [flight for flight in of_air if not flight["effect"]]
        hidden = [flight for flight in of_air if flight["effect"]]
        false = sum(flight["verdict"] != "none" for flight in clean)
        right = sum(flight["first"] in {flight["effect"], *aliases_of(flight["effect"])} for flight in hidden)
        rows.append(
            [words, str(len(clean)), counted(false / max(len(clean), 1), len(clean)), str(len(hidden)),
             counted(right / max(len(hidden), 1), len(hidden))]
        )  # fmt: skip
    return ["air", "clean flights", "given a verdict", "flights with an effect", "named first"], rows


def third_maker(flown: list[dict[str, Any]]) -> Rows:
    """What was said of flights from strip theory, by the rules at that time, and by the pace of the log."""
    outcomes = ("first", "in its set", "later", "unexplained", "none", "wrong")
    when = {
        1: "rules of before",
        2: "rules frozen since",
        3: "rules since then, fresh seeds",
        4: "rules since that look",
        5: "twenty replicas, the rest",
        6: "rules of late vanes, fresh seeds",
        7: "rules of 2026-11-29, the same seeds",
        8: "rules of the same day, the rest of them",
        9: "one aileron of two, fresh seeds",
    }
    judged = [flight for flight in flown if "failed" not in flight]
    unnamed = {flight.get("rules", 1) for flight in judged} - when.keys()
    assert not unnamed, f"rules without words: {unnamed}"
    groups = {words: [f for f in judged if f.get("rules", 1) == number] for number, words in when.items()}
    groups |= {f"all at {rate:g} Hz": [f for f in judged if f["rate"] == rate] for rate in (10.0, 20.0, 50.0)}
    rows = []
    for words, flights in groups.items():
        clean = [flight for flight in flights if flight["effect"] is None]
        hidden = [flight for flight in flights if flight["effect"] is not None]
        false = sum(flight["outcome"] != "none" for flight in clean)
        counts = [str(sum(flight["outcome"] == outcome for flight in hidden)) for outcome in outcomes]
        others = sum(bool(flight["besides"]) for flight in hidden if flight["outcome"] != "wrong")
        said = sum(flight["outcome"] == "none" and flight["effect"] in flight.get("unseen", ()) for flight in hidden)
        counts.insert(-1, str(said))
        rows.append([words, f"{false} of {len(clean)}", str(len(hidden)), *counts, str(others)])
    heads = [
        "named first",
        "in its stated set",
        "named later",
        "unexplained",
        "none",
        "of these said to be out of reach",
        "another name",
        "and a name more",
    ]
    return ["judged by", "clean, given what is not true", "with an effect", *heads], rows


def other_aeroplanes(flown: list[dict[str, Any]]) -> Rows:
    """What was said of flights of JSBSim's aeroplanes, with the share that a name takes off the truth's remainder."""
    rows = []
    for flight in sorted(flown, key=lambda f: (f["effect"] or "", f["aeroplane"], f["seed"])):
        if "failed" in flight:
            continue
        names = []
        for found in flight["found"]:
            share = (
                ""
                if found["taken"] is None
                else f", {percent(found['taken'])} of the remainder of {found['main_axis']}"
            )
            names.append(f"`{found['label']}`{share}")
        air = f"gusts of {flight['gusts']:g} m/s at 20 ft" if flight["gusts"] else "no gusts"
        rows.append(
            [flight["aeroplane"], flight["plan"], air, flight["effect"] or "nothing", "; ".join(names) or "nothing"]
        )
    return ["aeroplane", "manoeuvres", "air", "hidden", "named"], rows


def further_effects(flown: list[dict[str, Any]]) -> Rows:
    """What is named in flights with one effect and with two."""

    def names(effect: str, finding: dict[str, Any]) -> bool:
        return effect in {finding["effect"], *finding["confounded_with"]} or finding["effect"] in aliases_of(effect)

    rows = []
    for words, count in {"one effect": 1, "two effects": 2}.items():
        own = [f for f in flown if "failed" not in f and len(f["hidden"]) == len(f["relevant"]) == count]
        whole = sum(all(any(names(e, said) for said in f["found"]) for e in f["hidden"]) for f in own)
        more = sum(any(not any(names(e, said) for e in f["hidden"]) for said in f["found"]) for f in own)
        rows.append(
            [
                words,
                str(len(own)),
                counted(whole / max(len(own), 1), len(own)),
                counted(more / max(len(own), 1), len(own)),
            ]
        )
    return ["hidden", "flights in which all are relevant", "all named", "a name more that is not there"], rows


def failures(flown: list[dict[str, Any]]) -> Rows:
    """Inputs that fail in flights without vanes, by what the log holds and by how they fail."""
    judged = [flight for flight in flown if "found" in flight and flight["where"] != "again"]
    parts = {name: [f for f in judged if f["layout"] == name] for name in dict.fromkeys(f["layout"] for f in judged)}
    failed_so = {"held": "held where it was", "moved": "put elsewhere", "part": "keeps 0.3 to 0.6 of its effect"}
    for where, words in failed_so.items():
        parts[f"all, {words}"] = [f for f in judged if f["where"] == where and f["failure"] != "none"]
    rows = []
    for words, own in {**parts, "all": judged}.items():
        clean = [flight for flight in own if flight["failure"] == "none"]
        failed = [flight for flight in own if flight["failure"] != "none"]
        answered = [flight for flight in failed if flight["found"]]
        named = [flight for flight in answered if _is_named(flight)]
        changed = [flight for flight in failed if flight["changed"]]
        said = [(f["found"][0], f) for f in named] + [(f["changed"], f) for f in changed]
        near = sum(abs(found["begin"] - flight["begin"]) < 2.0 for found, flight in said)
        within = sum(abs(found["begin"] - flight["begin"]) <= found["errors"][0] for found, flight in said)
        false = sum(bool(flight["found"] or flight["changed"] or flight["unexplained"]) for flight in clean)
        unexplained = sum(bool(flight["unexplained"]) for flight in failed)
        numbers = (len(clean), false, len(failed), len(named), len(changed), unexplained, len(answered) - len(named))
        rows.append([words, *map(str, (*numbers, near, within))])
    head = ["log", "clean flights", "given a verdict", "with a failure", "named", "a moment that no input shows",
            "unexplained", "named another", "dated within 2 s", "within its error"]  # fmt: skip
    return head, rows


def failures_again(flown: list[dict[str, Any]]) -> Rows:
    """Inputs that fail several times in a flight: how many of the times are found, and how many said that are none."""
    again = [flight for flight in flown if "found" in flight and flight["where"] == "again"]
    kinds = {"put elsewhere": [f for f in again if not f["failure"].startswith("part of")]}
    kinds["keeps 0.3 to 0.6 of its effect"] = [f for f in again if f["failure"].startswith("part of")]
    rows = []
    for words, own in kinds.items():
        named = [flight for flight in own if flight["found"] and _is_named(flight)]
        true = near = false = 0
        for flight in named:
            last, begin = flight["last"] - LEAST_SEEN, flight["begin"]
            begins = [begin + k * flight["every"] for k in range(int((last - begin) // flight["every"]) + 1)]
            said = [times[0] for times in flight["found"][0]["times"]]
            true += len(begins)
            near += sum(min(abs(at - b) for b in said) < 2.0 for at in begins)
            false += sum(min(abs(at - b) for b in begins) >= 2.0 for at in said)
        other = sum(bool(flight["found"]) for flight in own) - len(named)
        changed = sum(bool(flight["changed"]) for flight in own)
        rows.append([words, *map(str, (len(own), len(named), changed, other, true, near, false))])
    head = ["control that fails", "flights", "named", "a moment that no input shows", "named another",
            "times that it begins to fail, where named", "said within 2 s",
            "said and more than 2 s from any"]  # fmt: skip
    return head, rows


def _is_named(flight: dict[str, Any]) -> bool:
    """Whether the input and how it failed are right."""
    failure, found = flight["failure"].removeprefix(PART), flight["found"][0]
    is_part = flight["failure"].startswith(PART)
    return found["name"] == _INPUTS.get(failure, failure) and (found["kind"] == "part") == is_part


def missions(flown: list[dict[str, Any]]) -> Rows:
    """Missions of JSBSim's aeroplanes by what fails: what `diagnose` says, and whether `check` finds a fault.

    A lag of the downwash is in all of these aeroplanes, and in no file of their users.
    """
    judged = [flight for flight in flown if "verdict" in flight]
    rows = []
    for failure, moved in dict.fromkeys((flight["failure"], "moved" in flight) for flight in judged):
        own = [flight for flight in judged if (flight["failure"], "moved" in flight) == (failure, moved)]
        signal = _INPUTS.get(failure.removeprefix(PART), "")
        named = [f for f in own if f["verdict"] == "missing" and f["input"] == signal]
        right = [f for f in named if (f["first"] == "control_damage") == failure.startswith(PART)]
        has = sum(f["verdict"] == "missing" and f["first"] == "alpha_dot" for f in own)
        unsure = [f for f in own if f["verdict"] == "unexplained"]
        of_it = sum(f["input"] == signal for f in unsure)
        none = sum(f["verdict"] == "none" for f in own)
        unseen = [f for f in own if failure != "none" and f["first"] == "parameter_change"]
        other = len(own) - len(right) - len(unseen) - len(unsure) - none - has
        near = sum(abs(f["times"]["t0"] - f["begin"]) < 2.0 for f in (*right, *unseen))
        checked = sum(bool(f["check"]) for f in own)
        what = "nothing" if failure == "none" else failure + ", put elsewhere" * moved
        unexplained = f"{len(unsure)} ({of_it} that control)" if unsure else "0"
        counts = (len(own), none, len(right), len(unseen), near, unexplained, has, other, checked)
        rows.append([what, *map(str, counts)])
    head = [
        "fails",
        "flights",
        "none",
        "named",
        "a moment that no input shows",
        "dated within 2 s",
        "unexplained",
        "the lag of the downwash that it has",
        "something else",
        "a fault by `check`",
    ]
    return head, rows


def lags(flown: list[dict[str, Any]]) -> Rows:
    """Lags that `check` works out in flights in which nothing is late, over their standard errors."""
    told: dict[str, list[tuple[float, float]]] = {}
    for flight in flown:
        for first, words, lag, std in flight.get("lags", ()):
            if first in _INPUTS:  # their standard error is that of the law
                continue
            kind, words = first.split(".")[0].replace("_", " "), words.replace("|", "\\|")
            told.setdefault(f"{kind}: {words}", []).append((lag, std))
    rows = []
    for words, pairs in told.items():
        times = [lag / std for lag, std in pairs]
        rms = (sum(t * t for t in times) / len(times)) ** 0.5
        usual = sorted(std for _, std in pairs)[len(pairs) // 2]
        rows.append([words, str(len(pairs)), f"{usual:.3f}", f"{rms:.2f}", f"{max(map(abs, times)):.1f}"])
    return ["relation", "lags", "usual standard error [s]", "rms of lag over it", "largest"], rows


def late_records(flown: list[dict[str, Any]]) -> Rows:
    """Flights whose controls are recorded late or early, and such in time: what is named, and how well."""
    rows = []
    for air, late in itertools.product(("calm", "light"), (False, True)):
        flights = [f for f in flown if f["air"] == air and f["late"] == late]
        told = [f for f in flights if f["told"] is not None]
        errors = [1e3 * abs(f["told"] - f["delay"]) for f in told]
        others = sum(len(f["named"]) - (f["told"] is not None) for f in flights)
        largest = f"{max(errors):.1f} ms" if late and errors else ""
        rows.append(
            ["late or early" if late else "in time", air, str(len(flights)), str(len(told)), largest, str(others)]
        )
    header = ["controls", "air", "flights", "a delay named", "largest error of it", "other settings named"]
    return header, rows


def by_effect(sets: dict[str, dict[str, Any]]) -> Rows:
    """Each effect, over the relevant flights that were flown last; flown are all of either set."""
    last = list(sets.values())[-1]["by_effect"]
    rows = []
    for effect in sorted({name for found in sets.values() for name in found["flown"]}):
        flown = " + ".join(str(found["flown"].get(effect, 0)) for found in sets.values())
        r = last.get(effect, {"flights": 0})
        told = ["", "", "", "", "", ""]
        if r["flights"]:
            told = [percent(r[k]) for k in ("right_first", "right_or_alias", "in_first_three")]
            told += [fine(r[k]) for k in ("base", "diagnosed", "oracle")]
        rows.append([effect, flown, str(r["flights"]), *told])
    header = ["effect", f"seeds flown ({' + '.join(SETS[name] for name in sets)})", "fresh and relevant", "right first"]
    return [*header, "or of its stated set", "in first three", "error: base", "diagnosed", "truth added"], rows


def methods(sets: dict[str, dict[str, Any]]) -> Rows:
    """`diagnose` beside the methods that one would use instead."""
    rows = []
    for name, found in sets.items():
        for method, r in found["methods"].items():
            shares = [percent(r[k]) for k in ("right_first", "right_or_alias", "in_first_three", "false_verdicts")]
            ratio = f"{r['to_oracle_median']:.2f} ({r['to_oracle_90']:.2f})"
            row = [_METHODS[method], f"{SETS[name]}, {r['hidden']} and {r['clean']}", *shares, ratio]
            rows.append([*row, f"{r['seconds_median']:.1f}"])
    header = [
        "method", "flights: hidden effect and clean", "right first", "or of its stated set", "in first three",
        "clean flights with a verdict", "error over truth added: median (90 % of flights)", "processor seconds",
    ]  # fmt: skip
    return header, rows


def alias_sets() -> Rows:
    """Effects that differ by name only in some flights."""
    rows = [[", ".join(f"`{name}`" for name in sorted(ids)), why] for ids, why in ALIASES]
    return ["set", "why"], rows


def speed(measured: dict[str, Any]) -> Rows:
    """Time of a diagnosis."""
    flight = f"{measured['duration'] / 60:g} minutes, IMU at {measured['imu_rate']:g} Hz, {measured['samples']} samples"
    parts = ", ".join(f"{words} {seconds:.1f} s" for words, seconds in measured["parts"].items())
    row = [flight, f"{measured['cores']}", "< 30 s", f"{measured['seconds']:.1f} s"]
    processor = measured.get("processor_seconds")
    row += [f"{processor:.1f} s" if processor else "not measured", parts]
    header = ["flight", "cores", "asked", "`diagnose`, whole library, median", "processor time", "of which"]
    return [*header, "load of the machine before"], [[*row, f"{measured['load_average']:.1f}"]]


def clean_residuals(results: list[dict[str, Any]]) -> Rows:
    """What `compare` says of flights that lack nothing, by axis."""
    flights = [r for r in results if "p_value" in r]
    airs = {"none": "calm", "light": "light turbulence", "moderate": "moderate turbulence"}
    rows = []
    for axis in AXES:
        middle, low, high = np.quantile([r["over_floor"][axis] for r in flights], [0.5, 0.05, 0.95])
        row = [f"C_{axis[1]}", f"{middle:.2f}", f"{low:.2f} to {high:.2f}"]
        for air in airs:
            p_values = np.array([r["p_value"][axis] for r in flights if r["air"] == air])
            row.append(f"{np.sum(p_values < FALSE_ALARM)} of {np.sum(np.isfinite(p_values))}")
        rows.append(row)
    header = ["axis", "held out ÷ floor, median", "5 to 95 % of the flights"]
    return [*header, *(f'"more than noise", {air}' for air in airs.values())], rows


def _of_sets(make: Callable[[dict[str, dict[str, Any]]], Rows]) -> Callable[[], str]:
    """Writes a table over the sets of flights that have been flown."""

    def made() -> str:
        files = {key: f"hidden_effects_{key}" for key in SETS}
        sets = {key: load(name) for key, name in files.items() if (RESULTS / f"{name}.json").exists()}
        return table(*make(sets)) if sets else "Not flown yet: `make hidden-effects`.\n"

    return made


def _of_slow_imus() -> str:
    """False alarms with a slow IMU, by its rate."""
    paths = RESULTS.glob("hidden_effects_fresh_imu_*_hz.json")
    return table(*slow({float(path.stem.split("_")[-2]): load(path.stem) for path in paths}))


HIDDEN_EFFECTS: dict[str, Callable[[], str]] = {
    "hidden_effects": _of_sets(hidden),
    "hidden_effects_other": _of_sets(other),
    "hidden_effects_by_effect": _of_sets(by_effect),
    "hidden_effects_methods": _of_sets(methods),
    "hidden_effects_slow": _of_slow_imus,
}
