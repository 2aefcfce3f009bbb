"""What is said of an input that failed, for people and as JSON like that of every other candidate."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from aircraft_sysid_ros.aircraft.expression import parse_expression
from aircraft_sysid_ros.aircraft.signals import CONTROL_WORDS, SURFACE_WORDS
from aircraft_sysid_ros.diagnosis.failures.airspeed_step import AirspeedStep
from aircraft_sysid_ros.diagnosis.failures.axis_relation import ENGINE
from aircraft_sysid_ros.diagnosis.failures.episode import Episode, Times
from aircraft_sysid_ros.diagnosis.failures.failure import THRUST_LEFT, Failure, FailureReport
from aircraft_sysid_ros.diagnosis.failures.interval_search import PART
from aircraft_sysid_ros.diagnosis.failures.unrecorded_change import UnrecordedChange
from aircraft_sysid_ros.diagnosis.recorded_times import in_recording
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.effects.effect import CHANGE, MEASUREMENT
from aircraft_sysid_ros.identification.conditions import listed

LOSS_OF_THRUST, STUCK, DAMAGED = "loss_of_thrust", "stuck_control", "control_damage"
CHANGE_OF_MOMENTS = "parameter_change"
_NO_NAME = (
    "Commands make other moments than before: a stuck control, one that lost part of its effect, or one of several "
    "surfaces that no longer moves. The flight does not show clearly which it is."
)
_WHAT = {**CONTROL_WORDS, ENGINE: "engine"}
#: What a moment is called, and what else than a control it could be, by effect and in words.
_MOMENTS = {"Cl": "rolling", "Cm": "pitching", "Cn": "yawing"}
_SIDEWAYS = ("unrecorded_flaps", "cg_shift", "asymmetric_thrust")
_IN_PITCH = ("unrecorded_flaps", "cg_shift", "landing_gear")
_RIVALS = {
    "landing_gear": "a step in drag, as from a landing gear",
    "parameter_change": "another constant in the same axes for that time, as from a trim that moved",
}
#: Likelihoods are not believed further than to this power of ten.
_POWERS = 6
_PHYSICS = {
    LOSS_OF_THRUST: "An engine that stops no longer pulls, whatever the throttle says; its propeller stands or "
    "windmills, which is drag. What the throttle did along the body is gone from one moment on.",
    STUCK: "A surface that stays where it was no longer follows the recorded command, or one of several does not. Its "
    "part of the moments is then a constant instead of one in proportion to the command.",
    DAMAGED: "A surface that lost part of its area, a linkage that slips, or one of several surfaces that no longer "
    "moves: what is commanded makes part of the moments that it made before.",
    CHANGE_OF_MOMENTS: "A control that is not where it is commanded, a flap, a load or damage on one side, a "
    "centre of gravity that moved: each is a moment that was not there before.",
}
_MANOEUVRES = {
    LOSS_OF_THRUST: "Throttle steps at constant speed, before and after.",
    STUCK: "Doublets of every surface, repeated during the flight.",
    DAMAGED: "Doublets of every surface, repeated during the flight.",
    CHANGE_OF_MOMENTS: "Doublets of every surface before and after, with vanes: they tell a control from the rest.",
}


def effect_of(failure: Failure) -> str:
    """Id of the effect."""
    if failure.is_loss_of_thrust:
        return LOSS_OF_THRUST
    return DAMAGED if failure.kind == PART else STUCK


def span_of(failure: Episode | AirspeedStep) -> str:
    """From when to when, with what it may be off."""
    return listed([_from_to(times) for times in failure.times])


def sentence_of_airspeed(step: AirspeedStep) -> str:
    """One sentence that a pilot understands."""
    return (
        f"By GPS and a steady wind the airspeed reads {step.ratio:.3f} ± {step.std:.3f} of its usual value "
        f"{span_of(step)}: moments that are worked out with it change there, and none is named; check the pitot tube."
    )


def _from_to(times: Times) -> str:
    begin = f"from {times.begin:.1f} s (± {times.begin_error:.1f} s)"
    if times.end is None:
        return f"{begin} to the end of the flight"
    return f"{begin} to {times.end:.1f} s (± {times.end_error:.1f} s)"


def sentence_of(failure: Failure) -> str:
    """One sentence that a pilot understands."""
    if failure.recorded:
        return (
            f"The engine makes no thrust {span_of(failure)}: the recorded throttle itself is at its lowest, while "
            "the aeroplane gets slower than ever before; no sensor shows whether it failed or was commanded to stop."
        )
    if failure.is_deaf and failure.level > THRUST_LEFT:
        return (
            f"The engine no longer follows its throttle {span_of(failure)}: it acts as at {failure.level:.0%} of the "
            "command, which for a propeller in flight may be no thrust at all."
        )
    if failure.is_loss_of_thrust:
        return f"The engine makes no thrust {span_of(failure)}, whatever the throttle says."
    name = _WHAT.get(failure.name, failure.name)
    if failure.kind == PART:
        return f"The control '{name}' keeps {_left(failure)} of its effect {span_of(failure)}."
    unit = " rad" if failure.name in SURFACE_WORDS else "" if failure.name in _WHAT else " in SI units"
    where = f" It stays near {failure.level:.3f}{unit}." if np.isfinite(failure.level) else ""
    return f"The control '{name}' does not move {span_of(failure)}, whatever is commanded.{where}"


def sentence_of_change(change: UnrecordedChange) -> str:
    """One sentence that a pilot understands."""
    made = listed([f"a {_MOMENTS[axis]} moment" for axis in _MOMENTS if axis in change.gains])
    rest = "flaps that are not recorded, or a centre of gravity that moved"
    if change.main_axis != "Cm":
        rest = "damage, a flap or a load on one side, or an engine that pulls to one side"
    return (
        f"No recorded input explains {made} that acts {span_of(change)}: a control that is not where it is "
        f"commanded, {rest}."
    )


def sentence_of_unlike(failure: Failure) -> str:
    """One sentence that a pilot understands."""
    return (
        f"The aeroplane does not answer the control '{_WHAT.get(failure.name, failure.name)}' as before "
        f"{span_of(failure)}, and the flight does not show whether it is stuck or damaged."
    )


def _times_likelier(evidence: float) -> str:
    powers = evidence / np.log(10.0)
    return f"10^{powers:.0f} times likelier" if powers < _POWERS else f"more than 10^{_POWERS} times likelier"


def _left(failure: Failure) -> str:
    return f"{round(100 * failure.left)} ± {200 * failure.left_std:.0f} %"


def sure_of(failure: Failure) -> str:
    """How sure, and what else it could be."""
    said = f"It is {_times_likelier(failure.evidence)} than that nothing failed"
    if failure.recorded:
        return said + ". A landing with the engine idle looks the same."
    if failure.name != ENGINE and failure.kind != PART:
        said += f"; meanwhile {_left(failure)} of its effect is left"
    if not failure.rivals:
        return said + ". Nothing else that was tried explains it as well."
    return said + f". It could also be {' or '.join(_RIVALS[name] for name in failure.rivals)}."


def _window(failure: Episode) -> str:
    """1 while it is there, as an expression."""
    windows = []
    for times in failure.times:
        window = f"max(sign(time{-times.begin:+.5g}),0)"  # it may have begun before time 0
        windows.append(window if times.end is None else f"{window}*max(sign({times.end:.5g}-time),0)")
    return windows[0] if len(windows) == 1 else f"({'+'.join(windows)})"


def terms_of(failure: Failure, report: FailureReport) -> dict[str, list[str]]:
    """Terms by axis that ``add`` adds to the model for it."""
    window, model = _window(failure), report.balance.aircraft.model
    names = ("throttle", "Tc") if failure.name == ENGINE else (failure.name,)
    terms = {}
    for axis in failure.gains:
        read = [t for t in model.terms[axis] if parse_expression(t, model.inputs).signals & set(names)]
        if read:
            moving = [f"{window}*{failure.name}"] if failure.name != ENGINE else [f"{window}*({t})" for t in read]
            terms[axis] = [*moving, window]
    return terms


def candidate_json(failure: Failure, report: FailureReport) -> dict[str, Any]:
    """As of any candidate of a diagnosis."""
    identifier = effect_of(failure)
    name = BY_ID[identifier].name if identifier in BY_ID else "Loss of thrust"
    which = "" if failure.is_loss_of_thrust else f" ({_WHAT.get(failure.name, failure.name)})"
    return {
        **_what(identifier, which, name),
        **_shown(failure, terms_of(failure, report), failure.rivals, report),
        "input": failure.name,
        "level": failure.level if np.isfinite(failure.level) else None,
    }


def change_json(change: UnrecordedChange, report: FailureReport) -> dict[str, Any]:
    """As of any candidate of a diagnosis."""
    axes = sorted(change.gains, key=lambda axis: -change.gains[axis])
    rivals = (STUCK, *(_IN_PITCH if change.main_axis == "Cm" else _SIDEWAYS))
    window = _window(change)
    return {
        **_what(CHANGE_OF_MOMENTS, f" ({listed([f'{axis}_0' for axis in axes])})", "A moment that no input shows"),
        **_shown(change, {axis: [window] for axis in axes}, rivals, report),
    }


def _of_airspeed(step: AirspeedStep, report: FailureReport) -> dict[str, Any]:
    """What is otherwise of a change of moments that the airspeed makes: no term or input of the model stands for it."""
    effect = BY_ID["airspeed_scale"]
    return {
        "effect": effect.identifier, "label": effect.identifier, "name": effect.name, "kind": MEASUREMENT,
        "physics": effect.physics, "manoeuvre": effect.manoeuvre, "expression": None, "terms": {}, "axes": [],
        "confounded_with": [], "where": f"reads {step.ratio:.3f} ± {step.std:.3f} of its usual value {span_of(step)}"
        f"{_recorded(step.times, report)}", "is_to_add": False, "input": None, **_dated(step.times, report),
    }  # fmt: skip


def unlike_json(failure: Failure, report: FailureReport) -> dict[str, Any]:
    """As of any candidate without a name: the terms say that the input does something else for that time."""
    label = f"changed effect of the control '{_WHAT.get(failure.name, failure.name)}'"
    return {
        **{"effect": None, "label": label, "name": label, "kind": CHANGE, "physics": _NO_NAME},
        "manoeuvre": _MANOEUVRES[STUCK],
        **_shown(failure, terms_of(failure, report), (STUCK, DAMAGED), report),
        "input": failure.name,
    }


def _what(identifier: str, which: str, name: str) -> dict[str, Any]:
    return {
        "effect": identifier,
        "label": identifier + which,
        "name": name + which,
        "kind": CHANGE,
        "physics": _PHYSICS[identifier],
        "manoeuvre": _MANOEUVRES[identifier],
    }


def _shown(
    failure: Episode, terms: dict[str, list[str]], rivals: Sequence[str], report: FailureReport
) -> dict[str, Any]:
    """What the flight shows of it, and the terms that ``add`` adds."""
    return {
        "expression": "; ".join(f"{axis}: {text}" for axis, texts in terms.items() for text in texts) or None,
        "axes": sorted(failure.gains, key=lambda axis: -failure.gains[axis]),
        "main_axis": failure.main_axis,
        "evidence": failure.evidence,
        "p_value": max(float(np.exp(-failure.evidence)), 10.0**-_POWERS),
        "error_before": failure.error_before,
        "error_after": failure.error_after,
        "confounded_with": list(rivals),
        "where": f"{failure.main_axis[0]}_{failure.main_axis[1]}, {span_of(failure)}{_recorded(failure.times, report)}",
        **_dated(failure.times, report),
        "terms": terms,
        "parameters": [],
        "found": True,
    }


def _dated(episodes: Sequence[Times], report: FailureReport) -> dict[str, Any]:
    """Begins and ends, in seconds of the flight with their errors and as stamps."""
    inner, errors = dict[str, float](), dict[str, float]()
    for number, times in enumerate(episodes):
        inner |= {f"t{2 * number}": times.begin} | ({} if times.end is None else {f"t{2 * number + 1}": times.end})
        errors |= {f"t{2 * number}": times.begin_error, f"t{2 * number + 1}": times.end_error}
    begin = int(report.balance.begin)
    return {
        "inner": inner,
        "inner_error": {name: errors[name] for name in inner},
        "stamps": {key: begin + int(1e9 * time) for key, time in inner.items()},
    }


def _recorded(episodes: Sequence[Times], report: FailureReport) -> str:
    """When that is since the first sample, in words, where the filter started late."""
    stamps = _dated(episodes, report)["stamps"].values()
    return in_recording(stamps, report.balance.begin, report.balance.recorded_from)


def candidates_of(report: FailureReport) -> Iterator[tuple[dict[str, Any], Episode]]:
    """What is said of each thing that was found, and what that is."""
    for failure in report.found:
        yield candidate_json(failure, report), failure
    if report.changed is not None:
        said = change_json(report.changed, report)
        yield {**said, **(_of_airspeed(report.airspeed, report) if report.airspeed else {})}, report.changed
    elif report.unexplained is not None and report.airspeed is not None:
        yield {**unlike_json(report.unexplained, report), **_of_airspeed(report.airspeed, report)}, report.unexplained


def report_json(report: FailureReport, notes: list[str]) -> dict[str, Any]:
    """The answer of a flight of which nothing but its inputs could be judged, or one of whose inputs failed."""
    candidates, verdict = [candidate for candidate, _ in candidates_of(report)], "missing"
    if not candidates:
        candidates = [] if report.unexplained is None else [unlike_json(report.unexplained, report)]
        verdict = "unexplained" if candidates else "none"
    return {
        "verdict": verdict,
        "candidates": candidates,
        "advice": " ".join(_advice(report)),
        "notes": [*notes, *notes_of(report)],
        "false_alarm_rate": THRESHOLDS.false_alarm,
        "least_size": THRESHOLDS.size,
        "noise_floor": {},
        "tried": len(report.tried),
        "replicas": 0,
    }


def notes_of(report: FailureReport) -> list[str]:
    """What could not be judged, and what the flight itself says of its wind."""
    notes = []
    wind = report.balance.wind
    if wind is not None and wind.is_there:
        taken = "it was removed" if wind.is_known else "the flight does not show it well enough to remove it"
        notes.append(f"{wind.text}: {taken}")
    elif wind is not None and not wind.is_known:
        notes.append("the course changes too little to find the wind from the speed over ground")
    notes += [
        f"failed inputs are not looked for in {axis[0]}_{axis[1]}: {why}" for axis, why in report.not_judged.items()
    ]
    return notes


def _failed_in_model(report: FailureReport) -> list[str]:
    """Inputs that the model has changed at times, as ``add`` adds what failed."""
    model, found = report.balance.aircraft.model, []
    for name in report.tried:
        signals = {"throttle", "Tc"} if name == ENGINE else {name}
        read = [parse_expression(text, model.inputs).signals for texts in model.terms.values() for text in texts]
        if any("time" in each and each & signals for each in read):
            found.append(_WHAT.get(name, name))
    return found


_OF_ENGINE = ", and for the engine only a stop is looked for, not a loss of power"


def _advice(report: FailureReport) -> Iterator[str]:
    for failure in report.found:
        yield sentence_of(failure)
        yield sure_of(failure)
    if report.airspeed is not None:
        yield sentence_of_airspeed(report.airspeed)
    elif report.changed is not None:
        yield sentence_of_change(report.changed)
        yield f"It is {_times_likelier(report.changed.evidence)} than that nothing changed."
    elif report.unexplained is not None:
        yield sentence_of_unlike(report.unexplained)
        yield f"It is {_times_likelier(report.unexplained.evidence)} than that nothing changed."
    elif not report.tried:
        yield (
            "Nothing could be looked for: no recorded input moves a coefficient that this flight shows. The notes say "
            "why for each axis. Record deflections, and vanes; what such a flight does show is its drag (polar)."
        )
    elif not report.found:
        unlike = {failure.name for failure in report.unlike}
        known = [_WHAT.get(name, name) for name in report.tried if name in report.shown - unlike]
        if failed := _failed_in_model(report):
            yield f"The model already says that {listed(failed)} failed or changed for a time. Beyond that:"
        hidden = [_WHAT.get(name, name) for name in report.tried if name not in report.shown | unlike]
        if known:
            yield (
                f"Of the inputs whose effect this flight shows, none was seen to fail: {', '.join(known)}. One that "
                "fails for only seconds, or while it is hardly commanded, would not be seen; one that keeps half of "
                f"its effect might not be{_OF_ENGINE if _WHAT.get(ENGINE, ENGINE) in known else ''}."
            )
        if unlike:
            yield (
                f"The effect of {listed([_WHAT.get(name, name) for name in report.tried if name in unlike])} is not "
                "the same throughout the flight, as when the model is too simple for turns: whether it failed for a "
                "while cannot be said."
            )
        if hidden:
            yield f"It cannot show whether {listed(hidden)} failed, since the effect in this flight is too small."
