"""Tables of docs/calibration.md from results in benchmarks/results: header and rows of each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from results import Rows

Result = dict[str, Any]

#: Parameters that are angles: shown in degrees.
_ANGLES = ("b_alpha", "b_beta", "eps_phi", "b_phi", "b_theta", "inclination", "declination", "eta_x", "eta_y", "eta_z")
#: Rows 6 of the two-stage paper, in the units of ours: estimate and standard deviation on its flight.
_PAPER_STD = {
    "lambda_V": 0.0739, "b_V": 1.2672, "lambda_alpha": 0.3228, "b_alpha": 0.5603, "lambda_beta": 0.2379,
    "b_beta": 0.5164, "eps_phi": 15.46, "W_N": 0.8704, "W_E": 0.9956, "W_D": 0.9952,
}  # fmt: skip
_METHODS = {
    "two_stage": "two stages, 500 samples", "one_stage_zero": "one stage from zero wind and zero error, Gauss-Newton",
    "one_stage_random": "one stage from random starts, Gauss-Newton",
    "sqp_zero": "one stage from zero wind and zero error, SQP", "sqp_random": "one stage from a random start, SQP",
}  # fmt: skip
#: Rms of the reconstructed inertial velocity and estimated noise of the paper's flight, Rows 7; its airspeed rms.
_PAPER_RMS, _PAPER_NOISE, _PAPER_AIRSPEED = (1.2564, 1.1028, 0.8321), (0.9875, 0.8645, 0.9207), 0.1241


def _shown(name: str, value: float) -> float:
    return 57.29578 * value if name in _ANGLES else value


def _unit(name: str) -> str:
    if name in _ANGLES:
        return "°"
    return "m/s" if name in ("b_V", "W_N", "W_E", "W_D") else ""


def probe(result: Result) -> Rows:
    """Errors of the ten parameters against their standard errors."""
    rows = []
    for name, p in result["probe"]["parameters"].items():
        plain = result["probe"]["least_squares"][name]
        rows.append([
            f"`{name}`", _unit(name), f"{_shown(name, p['rms_error']):.2g}", f"{_shown(name, p['median_std']):.2g}",
            f"{p['rms_z']:.2f}", f"{100 * p['within_2']:.0f} %", f"{plain['rms_z']:.2f}", f"{_PAPER_STD[name]:.2g}",
        ])  # fmt: skip
    header = ["parameter", "unit", "rms error", "median standard error", "error over standard error, rms", "within 2",
              "the same without the instrumental step", "std of the paper's flight"]  # fmt: skip
    return header, rows


def minima(result: Result) -> Rows:
    """How often the right minimum was reached."""
    found = result["probe"]
    rows = []
    for key, words in _METHODS.items():
        rows.append([words, str(found["starts"][key]), f"{100 * found['reached'][key]:.1f} %"])
    rows.append(["stage 1 finds one clear minimum, so that stage 2 estimates xi2 alone", str(found["flights"]),
                 f"{100 * found['alone']:.1f} %"])  # fmt: skip
    return ["method", "runs", "right minimum"], rows


def velocity(result: Result) -> Rows:
    """Beside Rows 7 and the airspeed of the paper."""
    found = result["probe"]
    rows = [
        [f"V_{axis} rms [m/s]", f"{found['velocity_rms'][i]:.3f}", _thor(result, "velocity_rms", i),
         f"{_PAPER_RMS[i]:.4f}"]
        for i, axis in enumerate("NED")
    ]  # fmt: skip
    rows += [
        [f"V_{axis} noise estimated [m/s]", f"{found['noise_std'][i]:.3f}", _thor(result, "noise_std", i),
         f"{_PAPER_NOISE[i]:.4f}"]
        for i, axis in enumerate("NED")
    ]  # fmt: skip
    rms = found["airspeed_rms"]
    speeds = [half["airspeed"] for half in (result.get("thor") or {}).get("probe", [])]
    real = ", ".join(f"{(s['mean'] ** 2 + s['std'] ** 2) ** 0.5:.2f}" for s in speeds)
    simulated = f"{rms['median']:.3f} (largest {rms['largest']:.2f})"
    rows.append(["airspeed rms [m/s]", simulated, real, f"{_PAPER_AIRSPEED}"])
    header = ["", f"simulated, {found['flights']} flights in steady wind", "Thor, on the half that did not calibrate",
              "the paper's flight"]  # fmt: skip
    return header, rows


def _thor(result: Result, key: str, i: int) -> str:
    return ", ".join(f"{half[key][i]:.2f}" for half in (result.get("thor") or {}).get("probe", []))


def others(result: Result) -> Rows:
    """Magnetometer and compatibility on simulated flights."""
    rows = []
    for kind in ("magnetometer", "compatibility"):
        for name, p in result[kind].get("parameters", {}).items():
            rows.append([kind, f"`{name}`", f"{_shown(name, p['rms_error']):.2g} {_unit(name)}".strip(),
                         f"{_shown(name, p['median_std']):.2g} {_unit(name)}".strip(), f"{p['rms_z']:.2f}",
                         f"{100 * p['within_2']:.0f} %"])  # fmt: skip
    header = ["calibration", "parameter", "rms error", "median standard error", "error over standard error, rms",
              "within 2"]  # fmt: skip
    return header, rows


def other_figures(result: Result) -> Rows:
    """Field strength before and after; output error from zero."""
    rows = []
    magnetic, motion, thor = result["magnetometer"], result["compatibility"], result.get("thor") or {}
    if magnetic["flights"]:
        before, after = magnetic["spread"]
        rows.append([f"field strength, spread over mean, {magnetic['flights']} simulated flights",
                     f"{100 * before:.1f} %", f"{100 * after:.2f} %"])  # fmt: skip
    for half in thor.get("magnetometer", []):
        before, after = half["spread"]
        rows.append([f"the same on Thor, calibrated on the {half['calibrated_on']} half, on the other one",
                     f"{100 * before:.1f} %", f"{100 * after:.1f} %"])  # fmt: skip
    if motion["flights"]:
        rows.append([f"output error from zero ends where two stages do, {motion['flights']} simulated flights", "",
                     f"{100 * motion['reached']['output_error_zero']:.0f} %"])  # fmt: skip
    return ["", "before", "after"], rows


def thor_probe(result: Result) -> Rows:
    """The real probe: each half judges the other."""
    halves = (result.get("thor") or {}).get("probe", [])
    header = ["", *(f"calibrated on the {half['calibrated_on']} half" for half in halves)]
    vector = lambda v: ", ".join(f"{x:.2f}" for x in v)  # noqa: E731
    pair = lambda d, unit: f"{d['mean']:.2f} ± {d['std']:.2f} {unit}"  # noqa: E731
    rows = [
        ["α − firmware's, mean ± scatter", *(pair(h["angles_deg"]["alpha"], "°") for h in halves)],
        ["β − firmware's", *(pair(h["angles_deg"]["beta"], "°") for h in halves)],
        ["airspeed − onboard, true", *(pair(h["airspeed"], "m/s") for h in halves)],
        ["mean wind NED of the other half, ours [m/s]", *(vector(h["wind"]["ours"]) for h in halves)],
        ["the same with the firmware's angles", *(vector(h["wind"]["firmware"]) for h in halves)],
        ["scatter of the wind triangle, ours [m/s]", *(vector(h["wind_scatter"]["ours"]) for h in halves)],
        ["with the firmware's angles", *(vector(h["wind_scatter"]["firmware"]) for h in halves)],
    ]
    names = ("lambda_V", "b_V", "lambda_alpha", "b_alpha", "lambda_beta", "b_beta", "eps_phi", "W_N", "W_E", "W_D")
    for name in names:
        cells = []
        for half in halves:
            there = half["parameters"].get(name)
            if there is None:
                cells.append("not excited")
            else:
                value, std = (_shown(name, number) for number in there)
                cells.append(f"{value:.3g} ± {std:.2g} {_unit(name)}".strip())
        rows.append([f"`{name}`", *cells])
    return header, rows


def thor_motion(result: Result) -> Rows:
    """Compatibility on Thor: residuals and what was found."""
    found = (result.get("thor") or {}).get("compatibility", {"residuals": {}, "parameters": {}})
    rows = [[name, f"{r['before']:.2f}", f"{r['after']:.2f}"] for name, r in found["residuals"].items()]
    return ["output", "rms before, in standard deviations of the aircraft file", "after"], rows


def speed(result: Result) -> Rows:
    """Time of 500 samples on the five-hole problem."""
    times = result["seconds"]
    row = [f"{result['samples']} samples of {result['rows']} velocities, both stages and the covariance", "< 10 s",
           f"{times[len(times) // 2]:.1f} s", f"{times[-1]:.1f} s"]  # fmt: skip
    return [f"on {result['processors']} processors", "asked", "median", f"slowest of {len(times)} flights"], [row]


def models(result: Result) -> Rows:
    """The paper's model and the one that is used, where the wind changes or the curve bends."""
    rows = []
    for condition, found in result["conditions"].items():
        for which, words in (("paper", "(36), (37)"), ("used", _used(found["models"]))):
            r = found[which]
            told = lambda value, digits: "not told" if value != value else f"{value:.{digits}f}"  # noqa: E731
            rows.append([
                condition if which == "paper" else "", words, told(r["lambda_V"]["rms_error"], 4),
                told(r["lambda_alpha"]["rms_error"], 4), f"{_shown('b_alpha', r['b_alpha']['rms_error']):.2f} °",
                told(r["lambda_beta"]["rms_error"], 4), told(r["lambda_alpha"]["rms_z"], 1),
                f"{r['airspeed']:.3f} m/s", f"{r['alpha']:.2f} °",
            ])  # fmt: skip
    flights = max((found["flights"] for found in result["conditions"].values()), default=0)
    header = [f"{flights} flights each", "model", "λ_V, rms error", "λ_α", "b_α", "λ_β",
              "λ_α, error over standard error", "airspeed, rms", "α, rms"]  # fmt: skip
    return header, rows


def _used(counts: dict[str, int]) -> str:
    return "found: " + ", ".join(f"{words} ({count})" for words, count in counts.items())


def thor_models(result: Result) -> Rows:
    """What the real probe supports."""
    rows = []
    for half in result["thor"]:
        for m in half["judged"]:
            better = m["better_by_standard_errors"]
            told = "" if better is None or better != better else f"{better:.1f}"
            rows.append([half["half"], m["model"], f"{m['held_out_rms']:.3f}", told, "yes" if m["used"] else ""])
    return ["half of the flight", "model", "rms in left-out blocks [m/s]", "better by standard errors", "used"], rows


def filter_start(result: Result) -> Rows:
    """How soon the filter knows wind and scale."""
    rows = []
    for name, r in result["starts"].items():
        cells = []
        for what in ("wind", "scale", "both"):
            t = r[what]
            late = "" if t["late"] is None else f", {t['late']:.0f} s"
            middle = "never in most" if t["median"] is None else f"{t['median']:.0f} s{late}"
            cells.append(f"{middle} ({100 * t['reached']:.0f} %)")
        rows.append([_STARTS[name], *cells, f"{r['wind_error']:.2f} m/s", f"{100 * r['scale_error']:.1f} %"])
    header = [f"{result['flights']} flights", "wind within 0.5 m/s: median, 90 % (share that ever are)",
              "scale within 2 %", "both", "wind, rms error at the end", "scale"]  # fmt: skip
    return header, rows


_STARTS = {
    "no states": "filter without these states", "from zero": "errors as states, started at zero",
    "from stage 1": "started by stage 1 after 60 s",
    "from a calibration": "started by the calibration of another flight",
}  # fmt: skip

#: Results that a table is made of, where they are not those of benchmarks/calibration.py.
SOURCES = {"speed": "two_stage_speed", "models": "probe_models", "thor_models": "probe_models",
           "filter_start": "filter_start"}  # fmt: skip
TABLES: dict[str, Callable[[Result], Rows]] = {
    "probe": probe,
    "minima": minima,
    "velocity": velocity,
    "others": others,
    "other_figures": other_figures,
    "thor_probe": thor_probe,
    "thor_motion": thor_motion,
    "speed": speed,
    "models": models,
    "thor_models": thor_models,
    "filter_start": filter_start,
}
