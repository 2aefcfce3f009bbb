"""Tables of docs/accuracy.md, parameters.md, trust.md and the README: what estimates are worth."""

from __future__ import annotations

from results import load, percent, table


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


TABLES = {
    "figures": figures,
    "errors": errors,
    "turbulence": turbulence,
    "start": start,
    "consistency": consistency,
    "campaign": campaign,
    "import_guess": import_guess,
    "choice": choice,
    "lack_of_fit": lack_of_fit,
    "slow_imu": slow_imu,
    "sensor_noise": sensor_noise,
    "recursive_likelihood": recursive_likelihood,
    "recursive_likelihood_speed": recursive_likelihood_speed,
}
