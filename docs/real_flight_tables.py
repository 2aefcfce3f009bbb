"""Tables of docs/real-flights.md and the two stories of the README."""

from __future__ import annotations

from results import load, percent, table


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


def story() -> str:
    """The demo: errors of every axis before and after what diagnose named was added."""
    told = load("story")
    cases = {"the model as it was": "error_before", f"with `{', '.join(told['found'])}`": "error_after",
             "noise of the sensors": "noise_floor"}  # fmt: skip
    rows = [[words, *(percent(errors[key]) for errors in told["axes"].values())] for words, key in cases.items()]
    return table(["error on held-out flight", *(f"C_{axis[1]}" for axis in told["axes"])], rows)


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


TABLES = {
    "thor_state": thor_state,
    "thor_live": thor_live,
    "thor_parameters": thor_parameters,
    "inertialnav": inertialnav,
    "real_story": real_story,
    "real_answers": real_answers,
    "story": story,
    "story_truth": story_truth,
}
