"""Fill the tables of README.md and docs/*.md from benchmarks/results, to which the story of the last demo is copied.

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

import calibration_tables
import certificate_tables
import check_tables
import closed_loop_tables
import diagnosis_tables
import export_tables
import fleet_tables
import gusts_tables
import mavlink_tables
import node_tables
import paper_tables
import polar_tables
import topic_tables
import trust_tables
from params_file import params_file

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results"
PARAMS = ROOT / "config" / "params.yaml"
MARKER = re.compile(r"(<!-- table (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def load(name: str) -> dict[str, Any]:
    return json.loads((RESULTS / f"{name}.json").read_text(encoding="utf8"))


def load_lines(name: str) -> list[dict[str, Any]]:
    lines = (RESULTS / f"{name}.jsonl").read_text(encoding="utf8").splitlines()
    return [json.loads(line) for line in lines]


def table(header: list[str], rows: list[list[str]]) -> str:
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)]) + "\n"


def percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def import_guess() -> str:
    """How often the first MAP of a stranger's columns is right."""
    found = load("import_guess")
    rows = [
        ["right", f"{found['right']} ({percent(found['share_right'])})"],
        ["undecided, commented out", str(found["undecided"])],
        ["not named at all", str(found["missed"])],
        ["wrong in signal, unit or sign", str(found["wrong"])],
    ]
    return table([f"{found['layouts']} layouts", f"of {found['columns']} columns"], rows)


def campaign() -> str:
    """Parameters of short manoeuvres without GPS."""
    found = load("campaign")
    header = [f"{found['campaigns']} campaigns of {found['manoeuvres']} manoeuvres of {found['length']:g} s"]
    header += ["main derivatives", "error, median", "worst", "within 5 %", "within 3 standard errors"]
    rows = [
        [
            said, f"{r['known']} of {r['main']}", percent(r["median"]), percent(r["worst"]),
            str(r["within_5_percent"]), str(r["within_3_sigma"]),
        ]
        for said, r in (("`replay`", found["replay"]), ("`compare`, `add`", found["afterwards"]))
    ]  # fmt: skip
    return table(header, rows)


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


def thor_live() -> str:
    """Thor played through the live nodes."""
    live = load("real_flights")["thor"]["live"]
    late = sum(live["late"].values())
    heard = {topic: pair for topic, pair in live["messages"].items() if pair[1]}
    sent, received = (sum(pair[i] for pair in heard.values()) for i in (0, 1))
    row = [f"{live['rate']:g}× real time, horizon {live['horizon']:g} s", f"{sent}", f"{received}"]
    said = "the same to the last digit" if live["same"] else "NOT the same"
    header = ["played", "sent on topics that are listened to", "received", "late", "files of live and replay"]
    return table(header, [[*row, f"{late}", said]])


def thor_parameters() -> str:
    """Parameters of Thor against the lab's model."""
    rows = []
    for p in load("real_flights")["thor"]["parameters"]:
        reference = "" if p["reference"] is None else f"{p['reference']:.4g}"
        why = p["reason"].partition("on the ground since")[0].rstrip("; ")  # which is said of all
        rows.append([p["name"], f"{p['value']:.3f}", f"{p['std']:.3f}", reference, p["status"], why])
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


def jsbsim_summary() -> str:
    """JSBSim aeroplanes: models and estimators against the projection, and on flights that were held out."""
    rows = []
    for name, a in load("jsbsim_truth")["aircraft"].items():
        models = [(f"32 terms, {estimator}", m) for estimator, m in a["textbook"].items()]
        for label, m in [*models, (f"{len(a['added']['parameters'])} terms, rls", a["added"])]:
            main = f"{100 * m['median_relative_error']:.1f} %" if "median_relative_error" in m else ""
            errors = [f"{100 * m['held_out'][x]:.1f} / {100 * m['held_out_projection'][x]:.1f}" for x in m["held_out"]]
            rows.append(
                [
                    name,
                    label,
                    f"{100 * m['within_3_sigma']:.1f} % of {m['pairs']}",
                    f"{100 * m['use_share']:.0f} %",
                    f"{100 * m['use_within_3_sigma']:.1f} %",
                    main,
                    *errors,
                ]
            )
    header = ["aeroplane", "model", "within 3 standard errors of (b)", "USE", "of those", "main derivatives",
              "CX", "CY", "CZ", "Cl", "Cm", "Cn"]  # fmt: skip
    return table(header, rows)


def jsbsim_parameters() -> str:
    """Main derivatives of the JSBSim aeroplanes: both truths and the estimate."""
    rows = []
    for name, a in load("jsbsim_truth")["aircraft"].items():
        found = a["textbook"]["rls"]["parameters"]
        for key in a["main_derivatives"]:
            p, (low, high) = found[key], a["local_range"][key]
            rows.append(
                [
                    name,
                    key,
                    f"{a['local'][key]:.4f}",
                    f"{low:.4f} to {high:.4f}",
                    f"{p['projection']:.4f}",
                    f"{p['value']:.4f} ± {p['std']:.4f}",
                    f"{100 * p['relative_error']:.1f} %",
                ]
            )
    header = ["aeroplane", "derivative", "(a) at trim", "(a) over the flown range", "(b)", "estimate ± standard error",
              "median distance to (b)"]  # fmt: skip
    return table(header, rows)


def jsbsim_added() -> str:
    """Terms beyond the 32, and what becomes of the pitching moment."""
    rows = []
    for name, a in load("jsbsim_truth")["aircraft"].items():
        textbook = a["textbook"]["rls"]["parameters"]
        for key, p in a["added"]["parameters"].items():
            if key not in textbook or key in ("Cm_alpha", "Cm_q"):
                rows.append(
                    [
                        name,
                        f"`{key}`",
                        f"{p['projection']:.3g}",
                        f"{p['value']:.3g} ± {p['std']:.2g}",
                        f"{100 * p['within_3_sigma']:.0f} %",
                        f"{100 * p['use']:.0f} %",
                    ]
                )
    return table(["aeroplane", "term", "(b)", "estimate ± standard error", "within 3", "USE"], rows)


def kernel_speed() -> str:
    """Time of one step against C and the peers."""
    speed = load("kernel_speed")
    time = lambda side: f"{side['median']:.2f} ({side['quartiles'][0]:.2f} to {side['quartiles'][1]:.2f})"  # noqa: E731
    rows = []
    for name, work in speed["work"].items():
        peers = [time(work["peers"]), f"{work['faster_than_peers']:.1f}×"] if "peers" in work else ["", ""]
        rows.append([name, time(work["ours"]), time(work["c"]), f"{work['over_c']:.1f}×", *peers])
    rows.append(["IMU sample, whole chain", time(speed["chain"]), "", "", "", ""])
    header = ["µs of processor time, median (quartiles)", "ours", "C", "ours over C", "filterpy and statsmodels",
              "ours is faster by"]  # fmt: skip
    return table(header, rows)


def replay_speed() -> str:
    """Speed of replay."""
    speed = load("replay_speed")
    return table(
        ["replay", "asked", "measured"],
        [
            [f"{speed['duration']:g} s, {speed['messages']} messages, reading and writing included", "≥ 600×",
             f"{speed['realtime_factor']:.0f}× real time"],
            ["the whole process, start of Python included", "", f"{speed['realtime_factor_whole_process']:.0f}×"],
        ],
    )  # fmt: skip


def live_load() -> str:
    """The live nodes under load, and what they cost when they do less."""
    rows = []
    for name, run in load("live_load")["runs"].items():
        latency, load_average = run["latency_ms"], run["load_average_before_and_after"]
        count = sum(run["published"].values())
        per_message = 1e6 * run["cpu_share"] * run["duration_published"] / count
        rows.append(
            [name, f"{run['duration']:g} s", f"{run['lost']} of {count}",
             " / ".join(f"{latency[p]:.2f}" for p in ("p50", "p99", "p99.9")), f"{100 * run['cpu_share']:.0f} %",
             f"{per_message:.0f}", f"{load_average[0]:.1f}, {load_average[1]:.1f}"]
        )  # fmt: skip
    header = ["nodes do", "for", "messages lost", "latency p50 / p99 / p99.9 [ms]", "of one core", "µs per message",
              "load of the machine before, after"]  # fmt: skip
    return table(header, rows)


def recursive_likelihood() -> str:
    """Recursive maximum likelihood beside recursive least squares."""
    result = load("recursive_likelihood")
    rows = []
    for air, name in (("none", "calm"), ("light", "light turbulence")):
        flights = result[air]
        for estimator in ("rls", "rml"):
            r = flights[estimator]
            shares = [percent(r[key]) for key in ("within_95", "within_3_sigma", "use_share", "use_within_95")]
            least = ", ".join(f"{n} {percent(v)}" for n, v in list(r["least_covered"].items())[:3])
            rows.append([f"{name}, {estimator}", *shares, f"{100 * r['median_relative_error']:.2f} %", least])
    header = ["flights", "within 1.96", "within 3", "USE", "USE within 1.96", "median error", "least within 1.96"]
    return table(header, rows)


def recursive_likelihood_speed() -> str:
    """What the recursion costs."""
    rows = [
        [f"{s['rate']:g} Hz", str(s["filters"]), f"{s['microseconds_per_step']:.0f} µs", percent(s["share_of_a_core"])]
        for s in load("recursive_likelihood")["speed"]
    ]
    return table(["rml_rate", "filters", "per step, air data included", "share of a core"], rows)


def effects() -> str:
    """The library of effects, kind by kind."""
    from aircraft_sysid_ros.effects import LIBRARY

    cell = lambda text: text.replace("|", "\\|")  # noqa: E731
    rows = [
        [
            f"`{e.identifier}`",
            e.name,
            e.kind,
            cell(e.physics),
            cell(e.formula),
            cell(e.residuals),
            e.manoeuvre,
            e.source,
        ]
        for e in LIBRARY
    ]
    header = ["id", "name", "kind", "physics", "formula", "in the residuals", "manoeuvre that shows it", "source"]
    return table(header, rows)


def effect_terms() -> str:
    """Variants, terms by axis and inner numbers of every effect."""
    from aircraft_sysid_ros.effects import LIBRARY

    rows = []
    for effect in LIBRARY:
        shown = (effect.in_coefficients,) if effect.in_coefficients is not None else ()
        for variant in (*effect.variants, *shown):
            terms = [f"{axis}: `{', '.join(texts)}`" for axis, texts in variant.terms.items()]
            what = "; ".join(terms) or f"file: `{'.'.join(variant.setting)}`"
            numbers = str(variant.numbers) if variant.terms else "1"
            rows.append([f"`{effect.identifier}`", variant.name, what.replace("|", "\\|"), numbers])
    return table(["id", "variant", "terms, or key of the aircraft file", "numbers"], rows)


def commands() -> str:
    """Every command with its purpose."""
    from aircraft_sysid_ros.commands.main import COMMANDS

    return table(["command", "what it does"], [[f"`{name}`", purpose] for name, (_, purpose) in COMMANDS.items()])


def story() -> str:
    """The demo: errors of every axis before and after what diagnose named was added."""
    told = load("story")
    cases = {"the model as it was": "error_before", f"with `{', '.join(told['found'])}`": "error_after",
             "noise of the sensors": "noise_floor"}  # fmt: skip
    rows = [[words, *(percent(errors[key]) for errors in told["axes"].values())] for words, key in cases.items()]
    return table(["error on held-out flight", *(f"C_{axis[1]}" for axis in told["axes"])], rows)


def real_story() -> str:
    """A real flight before and after its diagnosis."""
    told = load("real_story")
    before, after = (f"{told['rms'][key]:.0f}°/s" for key in ("before", "after"))
    found = f"`{told['label']}`, {told['begin']:.1f} to {told['end']:.1f} s, near {told['position']:.3f} rad"
    return table(["found by `diagnose`", "error of the roll rate, elevons as commanded", "with what was found"],
                 [[found, before, after]])  # fmt: skip


def real_answers() -> str:
    """What is said of real flights whose truth nobody knows."""
    rows = []
    for flight, parts in load("real_answers").items():
        for part, said in parts.items():
            if "refused" in said:
                rows.append([flight, part, "refused: " + said["refused"].removeprefix("aircraft-sysid diagnose: "), ""])
                continue
            left = ", ".join(
                f"{100 * e['error']:.0f} % of C_{axis[1]} ({e['times_noise']:.0f})" for axis, e in said["left"].items()
            )
            rows.append([flight, part, ", ".join(said["found"]) or said["verdict"], left])
    return table(["flight", "part", "answer", "left unexplained (times noise)"], rows)


def story_truth() -> str:
    """The demo against the truth."""
    told = load("story")
    value = lambda p, key: f"{p[key]:.4f}"  # noqa: E731
    rows = [["hidden", ", ".join(f"`{name}`" for name in told["hidden"])],
            ["named by `diagnose`", ", ".join(f"`{name}`" for name in told["found"])]]  # fmt: skip
    for p in told["parameters"]:
        if p["name"] in told["new_parameters"]:
            rows.append([f"`{p['name']}`", f"{value(p, 'value')} ± {value(p, 'std')}, truth {value(p, 'truth')}"])
    within, judged = told["within_3_standard_errors"], told["judged"]
    rows.append([f"{told['duration']:.0f} s of flight, flown and explained in", f"{told['elapsed']:.0f} s"])
    rows.append(["parameters within 3 standard errors of truth", f"{within} of {judged}"])
    return table(["the demo", ""], rows)


def certificate(name: str) -> Callable[[], str]:
    """A table of the Monte Carlo certificate."""
    return lambda: table(*certificate_tables.TABLES[name](load("certificate")))


def certificate_cells(of_cells: bool) -> Callable[[], str]:
    """The default estimator by air, vanes, IMU and aircraft file."""
    return lambda: table(*certificate_tables.by_cell(load("certificate_cells"), of_cells))


def diagnosis(name: str) -> Callable[[], str]:
    """A table of docs/diagnosis.md, over the sets of flights that have been flown."""

    def made() -> str:
        files = {key: f"hidden_effects_{key}" for key in diagnosis_tables.SETS}
        sets = {key: load(name) for key, name in files.items() if (RESULTS / f"{name}.json").exists()}
        return table(*diagnosis_tables.TABLES[name](sets)) if sets else "Not flown yet: `make hidden-effects`.\n"

    return made


def diagnosis_slow() -> str:
    """False alarms of the diagnosis with a slow IMU."""
    found = {}
    for path in RESULTS.glob("hidden_effects_fresh_imu_*_hz.json"):
        found[float(path.stem.split("_")[-2])] = load(path.stem)
    return table(*diagnosis_tables.slow(found))


def strangers() -> str:
    """The diagnosis on flights whose file has mass and shape only."""
    return table(*diagnosis_tables.strangers(load_lines("strangers")))


def strangers_placed() -> str:
    """The same with sensors where the aeroplane has them."""
    return table(*diagnosis_tables.strangers(load_lines("strangers_placed")))


def third_maker() -> str:
    """The diagnosis on flights of the maker from strip theory."""
    if not (RESULTS / "third_maker.jsonl").exists():
        return "Not flown yet: `python benchmarks/third_maker.py --judging`.\n"
    return table(*diagnosis_tables.third_maker(load_lines("third_maker")))


def other_aeroplanes() -> str:
    """The diagnosis on aeroplanes of JSBSim that no rule was made on."""
    return table(*diagnosis_tables.other_aeroplanes(load_lines("other_aeroplanes")))


def polar_truth() -> str:
    """Drag polars of another maker's flights."""
    return table(*polar_tables.truth(load_lines("polar")))


def further_effects() -> str:
    """Flights with one hidden effect, and with two."""
    return table(*diagnosis_tables.further_effects(load_lines("further_effects")))


def jet() -> str:
    """A jet at 10 Hz, of another maker."""
    return table(*diagnosis_tables.jet(load_lines("jet")))


def trimmed_jet() -> str:
    """The same in minutes of trim."""
    return table(*diagnosis_tables.trimmed_jet(load_lines("trimmed_jet")))


def faults(name: str = "faults") -> str:
    """A campaign of faults."""
    return table(*trust_tables.faults(load(name)))


def stalls() -> str:
    """A transport that is stalled slowly, of another maker."""
    return table(*diagnosis_tables.stalls(load_lines("stalls")))


def failures() -> str:
    """Inputs that fail in flights without vanes."""
    return table(*diagnosis_tables.failures(load_lines("failures")))


def missions() -> str:
    """The table ``missions`` of diagnosis.md."""
    return table(*diagnosis_tables.missions(load_lines("missions")))


def missions_strangers() -> str:
    """The same of aeroplanes that are flown nowhere else."""
    return table(*diagnosis_tables.missions(load_lines("missions_strangers")))


def lags() -> str:
    """The table ``lags`` of check.md."""
    return table(*diagnosis_tables.lags(load_lines("missions")))


def failures_again() -> str:
    """Inputs that fail several times in a flight without vanes."""
    return table(*diagnosis_tables.failures_again(load_lines("failures")))


def choice() -> str:
    """Every estimator, and the one that chooses itself, by what the sensors are."""
    header = ["air", "sensors", "estimator", "published at the end", "inside 1.96 standard errors", "USE"]
    header += ["error of main derivatives with USE, median", "off by > 25 %"]
    rows = [
        [
            {"none": "calm", "light": "light turbulence"}[c["air"]], c["sensors"], f"`{c['estimator']}`",
            " ".join(f"`{name}`" for name in c["published"]), f"{c['inside']} of {c['excited']}",
            str(c["use"]), "-" if c["error"] is None else percent(c["error"]), f"{c['far']} of {c['use_main']}",
        ]
        for c in load("choice")["cells"]
    ]  # fmt: skip
    return table(header, rows)


def lack_of_fit() -> str:
    """How far errors of coefficients are above their noise, with right models and with others."""
    header = [
        "flights",
        "number",
        "model",
        "estimator",
        "error over noise at the end, worst axis",
        "largest on the way",
    ]
    header += ["axes in HOLD for it", "USE", "without"]
    rows = [
        [
            r["name"], str(r["flights"]), r["model"], f"`{r['estimator']}`", f"{r['end']:.1f} ({r['axis']})",
            f"{r['ever']:.1f}", " ".join(r["held"]) or "-", str(r["use"]), str(r["use_without"]),
        ]
        for r in load("lack_of_fit")["rows"]
    ]  # fmt: skip
    return table(header, rows)


def clean_residuals() -> str:
    """What `compare` says of flights that lack nothing."""
    return table(*diagnosis_tables.clean_residuals(load_lines("clean_residuals")))


def slow_imu() -> str:
    """What a slow IMU costs."""
    header = ["rate of the IMU", "estimator", "inside 1.96 standard errors", "main derivatives with USE"]
    header += ["their error, median", "90 % of them within"]
    rows = [
        [
            f"{r['rate']:g} Hz", f"`{r['estimator']}`", f"{100 * r['inside']:.0f} % of {r['used']}",
            f"{r['main_used']} of {r['main']}", percent(r["median"]), percent(r["most"]),
        ]
        for r in load("slow_imu")["rates"]
    ]  # fmt: skip
    return table(header, rows)


def sensor_noise() -> str:
    """What an aircraft file without noise costs."""
    result = load("sensor_noise")
    header = [
        "simulator",
        "true noise / default",
        "IMU",
        "turbulence",
        "file",
        "error",
        "intervals that hold the truth",
    ]
    header += ["USE", "of them off by > 25 %", "rejected", "tilt", "NEES", "NIS"]
    rows = []
    for cell in result["cells"]:
        where = [
            cell["simulator"],
            f"{cell['factor']:g}" if cell["factor"] else "mixed",
            f"{cell['rate']:g} Hz",
            cell["air"],
        ]
        for name in ("defaults", "found", "stated"):
            r = cell[name]
            inside = f"{100 * r['inside']:.0f} % of {r['seen']}" if r["seen"] else "-"
            rows.append([
                *where, name, "-" if r["main_error"] is None else percent(r["main_error"]), inside, str(r["used"]),
                str(r["wrong"]), percent(r["rejected"]),
                f"{r['tilt_error']:.2f}°", f"{r['nees']:.2g}", f"{r['nis']:.2f}",
            ])  # fmt: skip
    return table(header, rows)


def diagnosis_speed() -> str:
    """Time of a diagnosis of a long flight."""
    if not (RESULTS / "diagnosis_speed.json").exists():
        return "Not measured yet: `python benchmarks/diagnosis_speed.py`.\n"
    return table(*diagnosis_tables.speed(load("diagnosis_speed")))


def paper(name: str) -> Callable[[], str]:
    """A table of docs/paper.md."""
    return lambda: table(*paper_tables.TABLES[name](load("paper")))


def mavlink(name: str) -> Callable[[], str]:
    """A table of docs/mavlink.md."""
    return lambda: table(*mavlink_tables.TABLES[name](load("mavlink_bridge")))


def nodes(name: str) -> Callable[[], str]:
    """A table of docs/nodes.md."""
    return lambda: table(*node_tables.TABLES[name]())


def exported(name: str) -> Callable[[], str]:
    """A table of docs/export.md."""
    return lambda: table(*export_tables.TABLES[name](load("export")))


def checked(name: str) -> Callable[[], str]:
    """One of the tables of docs/check.md."""
    return lambda: table(*check_tables.TABLES[name](load("flight_check")))


def fleet(make: Callable[..., tuple[list[str], list[list[str]]]], *sources: str) -> Callable[[], str]:
    """A table of docs/fleet.md."""

    def made() -> str:
        missing = [source for source in sources if not (RESULTS / f"{source}.json").exists()]
        if missing:
            return f"Not measured to its end yet: `make fleet` writes {' and '.join(missing)}.\n"
        return table(*make(*map(load, sources)))

    return made


def trust(name: str) -> Callable[[], str]:
    """A table of docs/trust.md."""
    return lambda: table(*trust_tables.TABLES[name](load("bad_minute")))


def gusts(name: str) -> Callable[[], str]:
    """A table of docs/trust.md."""
    return lambda: table(*gusts_tables.TABLES[name](load("gusts")))


def explain() -> str:
    """First sentences of logs with one thing wrong each."""
    if not (RESULTS / "explain.json").exists():
        return "Not flown yet: `python benchmarks/explain.py`.\n"
    found = load("explain")
    rows = [
        [log["case"], "yes" if log["right"] else "no", log["sentence"], f"{log['elapsed']:.0f} s",
         f"{log['processor']:.0f} s"]
        for log in found["logs"]
    ]  # fmt: skip
    rows.append(["all", f"{found['right']} of {len(rows)}", "", "", ""])
    wrong = f"what is wrong, {found['duration']:g} s of flight"
    return table([wrong, "right", "said first", "time", "processor time"], rows)


def closed_loop(name: str) -> Callable[[], str]:
    """A table of docs/closed-loop.md."""

    def made() -> str:
        if not (RESULTS / "closed_loop.json").exists():
            return "Not flown yet: `make closed-loop`.\n"
        return table(*closed_loop_tables.TABLES[name](load("closed_loop")))

    return made


def workbench() -> str:
    """The page of a long flight in a browser."""
    w = load("workbench")
    seconds, milliseconds = lambda value: f"{value:.1f} s", lambda value: f"{1000 * value:.0f} ms"
    return table(
        [f"{w['duration']:g} s of flight, {w['points']} measured coefficients", "asked", "median", "worst"],
        [
            ["page opened by a new browser, all six axes drawn", "< 3 s", seconds(w["interactive"]),
             seconds(w["interactive_worst"])],
            ["zoom to 10 s, all axes with every point", "", milliseconds(w["zoom"]), milliseconds(w["zoom_worst"])],
            ["a term added: reconstruction, fit, comparison", "", seconds(w["addition"]["work"]), ""],
            ["and after it, until all axes are drawn", "",
             milliseconds(w["addition"]["drawn"] - w["addition"]["work"]), ""],
            ["server ready after", "", seconds(w["server_ready"]), ""],
            ["main thread of the tab while nothing happens", "", percent(w["idle_main_thread"]), ""],
            ["JavaScript heap of the tab", "", f"{w['heap_mb']:.0f} MB", ""],
            ["file of `report`", "< 10 MB", f"{w['report_mb']:.1f} MB", ""],
            ["load of the machine while measuring", "", f"{w['load_average']:.1f} on {w['cores']} cores", ""],
        ],
    )  # fmt: skip


def calibration(name: str) -> Callable[[], str]:
    """A table of docs/calibration.md."""
    source = calibration_tables.SOURCES.get(name, "calibration")

    def made() -> str:
        if not (RESULTS / f"{source}.json").exists():
            return "Not flown yet: `make calibration`.\n"
        return table(*calibration_tables.TABLES[name](load(source)))

    return made


TABLES: dict[str, Callable[[], str]] = {
    **{f"calibration_{name}": calibration(name) for name in calibration_tables.TABLES},
    "workbench": workbench,
    **{f"mavlink_{name}": mavlink(name) for name in mavlink_tables.TABLES},
    **{f"check_{name}": checked(name) for name in check_tables.TABLES},
    **{f"export_{name}": exported(name) for name in export_tables.TABLES},
    **{f"nodes_{name}": nodes(name) for name in node_tables.TABLES},
    **{f"topics_{name}": made for name, made in topic_tables.TABLES.items()},
    "aircraft_keys": lambda: table(*node_tables.aircraft_keys()),
    **{f"trust_{name}": trust(name) for name in trust_tables.TABLES},
    **{f"gusts_{name}": gusts(name) for name in gusts_tables.TABLES},
    **{name: diagnosis(name) for name in diagnosis_tables.TABLES},
    "certificate_parts": certificate_cells(False),
    "certificate_cells": certificate_cells(True),
    **{f"certificate_{name}": certificate(name) for name in certificate_tables.TABLES},
    **{f"closed_loop_{name}": closed_loop(name) for name in closed_loop_tables.TABLES},
    "explain": explain,
    "alias_sets": lambda: table(*diagnosis_tables.alias_sets()),
    "diagnosis_speed": diagnosis_speed,
    "diagnosis_thresholds": lambda: table(*diagnosis_tables.thresholds()),
    "hidden_effects_slow": diagnosis_slow,
    "strangers": strangers,
    "strangers_placed": strangers_placed,
    "third_maker": third_maker,
    "other_aeroplanes": other_aeroplanes,
    "polar_truth": polar_truth,
    "polar_seaway": lambda: table(*polar_tables.seaway(load("polar_seaway"))),
    "faults": faults,
    "faults_now": lambda: faults("faults_now"),
    "lost_samples": lambda: table(
        *trust_tables.lost_samples(load_lines("lost_samples_before"), load_lines("lost_samples"))
    ),
    "late_records": lambda: table(*diagnosis_tables.late_records(load_lines("late_records"))),
    "small_airspeed_error": lambda: table(*trust_tables.small_airspeed_error(load_lines("small_airspeed_error"))),
    "airspeed_faults": lambda: table(*trust_tables.airspeed_faults(load_lines("airspeed_faults"))),
    "stalls_in_flight": lambda: table(*trust_tables.stalls_in_flight(load("stalls_in_flight"))),
    "use_audit": lambda: table(*trust_tables.use_audit(load("use_audit"))),
    "isolation_limits": lambda: table(*trust_tables.isolation_limits()),
    "jet": jet,
    "trimmed_jet": trimmed_jet,
    "stalls": stalls,
    "further_effects": further_effects,
    "fleet_healthy": fleet(fleet_tables.healthy, "fleet_changes"),
    "fleet_changed": fleet(fleet_tables.changed, "fleet_changes"),
    "fleet_prior": fleet(fleet_tables.prior, "fleet_prior"),
    "fleet_health": fleet(fleet_tables.health, "fleet_health"),
    "fleet_whole": fleet(fleet_tables.whole, "fleet"),
    "fleet_killed": fleet(fleet_tables.killed, "fleet_killed"),
    "fleet_small": fleet(fleet_tables.small, "fleet_small"),
    "fleet_million": fleet(fleet_tables.million, "fleet_small", "fleet_costs", "fleet_constants"),
    "fleet_costs": fleet(fleet_tables.costs, "fleet_costs"),
    "miswired": lambda: table(*check_tables.miswired(load("miswired"))),
    "failures": failures,
    "failures_again": failures_again,
    "missions": missions,
    "missions_strangers": missions_strangers,
    "lags": lags,
    "slow_imu": slow_imu,
    "choice": choice,
    "clean_residuals": clean_residuals,
    "lack_of_fit": lack_of_fit,
    "sensor_noise": sensor_noise,
    **{f"paper_{name}": paper(name) for name in paper_tables.TABLES},
    "effects": effects,
    "effect_terms": effect_terms,
    "recursive_likelihood": recursive_likelihood,
    "recursive_likelihood_speed": recursive_likelihood_speed,
    "commands": commands,
    "story": story,
    "story_truth": story_truth,
    "real_story": real_story,
    "real_answers": real_answers,
    "figures": figures,
    "import_guess": import_guess,
    "campaign": campaign,
    "errors": errors,
    "start": start,
    "turbulence": turbulence,
    "consistency": consistency,
    "thor_state": thor_state,
    "thor_live": thor_live,
    "thor_parameters": thor_parameters,
    "inertialnav": inertialnav,
    "kernel_speed": kernel_speed,
    "replay_speed": replay_speed,
    "live_load": live_load,
    "jsbsim_summary": jsbsim_summary,
    "jsbsim_parameters": jsbsim_parameters,
    "jsbsim_added": jsbsim_added,
}


def copy_story() -> None:
    """Result and picture of `make demo`, if it was run here."""
    demo = ROOT / "runs" / "demo"
    if (demo / "story.json").exists():
        shutil.copy(demo / "story.json", RESULTS)
        shutil.copy(demo / "story.png", ROOT / "docs" / "figures")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="only say whether a table is out of date")
    arguments = parser.parse_args()
    if not arguments.check:
        copy_story()
    stale = []
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        text = page.read_text(encoding="utf8")
        new = MARKER.sub(lambda match: match[1] + TABLES[match[2]]() + match[3], text)
        if new != text:
            stale.append(page.name)
            if not arguments.check:
                page.write_text(new, encoding="utf8")
    if (new := params_file()) != PARAMS.read_text(encoding="utf8"):
        stale.append(PARAMS.name)
        if not arguments.check:
            PARAMS.write_text(new, encoding="utf8")
    verb = "out of date: " if arguments.check else "written: "
    print(verb + ", ".join(stale) if stale else "every table is up to date")
    return int(bool(stale) and arguments.check)


if __name__ == "__main__":
    sys.exit(main())
