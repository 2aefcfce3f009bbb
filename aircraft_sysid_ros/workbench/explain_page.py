"""The page of an explanation: what a log means, to be read in a minute; one file that needs nothing else."""

from __future__ import annotations

from typing import Any

from markupsafe import Markup

from aircraft_sysid_ros.after_flight.explanation.aeroplane import Fact
from aircraft_sysid_ros.after_flight.explanation.explain import Explanation
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.effects.effect import MEASUREMENT
from aircraft_sysid_ros.flight_check.check import SHORTEST, nothing_wrong
from aircraft_sysid_ros.flight_check.finding import ERROR, INFO, SEVERITIES, WARNING, short_names
from aircraft_sysid_ros.identification.conditions import TELL_FLOW, throttle_instead
from aircraft_sysid_ros.workbench import markup
from aircraft_sysid_ros.workbench.report import STYLE
from aircraft_sysid_ros.workbench.views import coefficients

#: Findings of the check and places where the model fails that are listed.
_MOST_FINDINGS, _MOST_PLACES = 8, 3


def explain_html(found: Explanation) -> str:
    """The whole file."""
    return markup.page(
        "explain.html",
        found=found,
        style=Markup(STYLE.read_text(encoding="utf8")),
        trust=_trust(found),
        findings=_findings(found),
        groups=_groups(found),
        modes=found.modes,
        no_modes=_why_no_modes(found),
        errors=_errors(found),
        places=[] if found.compared is None else found.compared.comparison.worst[:_MOST_PLACES],
        sensors=_sensors(found),
        notes=_notes(found),
    )


def _trust(found: Explanation) -> list[str]:
    """Whether the log can be trusted, in sentences."""
    findings = found.check.checked.findings
    count = {severity: sum(f.severity == severity for f in findings) for severity in SEVERITIES}
    if count[ERROR]:
        make = "makes" if count[ERROR] == 1 else "make"
        first = f"Not as it is: {_counted(count[ERROR], 'error')} {make} what is estimated from it wrong."
    elif found.check.duration < SHORTEST:
        first = f"That cannot be said: {nothing_wrong(found.check.duration)}."
    elif off := _off(found):
        of = "them" if len(off) > 1 else "it"
        sensors = _counted(len(off), "sensor")
        first = f"With care: something is wrong with {sensors}, or with what the aircraft file says of {of}."
    elif count[WARNING]:
        first = f"With care: {_counted(count[WARNING], 'warning')}, of parts of the flight or single parameters."
    else:
        first = "Yes: its sensors do not contradict each other."
    said = [first]
    if found.why_not and found.diagnosis is None:  # else it stands with what is wrong with the model
        said.append(f"It could not be judged to the end: {found.why_not}.")
    used, every = found.used
    if found.replayed is not None:
        said.append(f"{used} of {every} parameters can be used; the others are in the run with the reason.")
    return said


def _counted(count: int, word: str) -> str:
    return f"{count} {word}{'s' * (count != 1)}"


def _findings(found: Explanation) -> list[dict[str, Any]]:
    findings = [f for f in found.check.checked.findings if f.severity != INFO][:_MOST_FINDINGS]
    return [
        {"severity": f.severity, "signals": short_names(f.signals), "kind": f.kind, "sentence": f.sentence}
        for f in findings
    ]


def _groups(found: Explanation) -> list[tuple[str, list[Fact]]]:
    """Facts by group, in their order."""
    groups: dict[str, list[Fact]] = {}
    for fact in found.facts:
        groups.setdefault(fact.group, []).append(fact)
    return list(groups.items())


def _why_no_modes(found: Explanation) -> str:
    """The one reason why no mode is known; empty where one is, or where they have several reasons."""
    reasons = {mode.reason for mode in found.modes}
    return reasons.pop() if len(reasons) == 1 and len(found.modes) > 1 else ""


def _errors(found: Explanation) -> dict[str, Any] | None:
    if found.compared is None:
        return None
    rows = coefficients.axis_rows(found.compared.comparison)
    return {"rows": rows, "scale": markup.errors_scale(row.held_out for row in rows)}


def _off(found: Explanation) -> list[str]:
    """What is said of sensors, without what is said of the aeroplane."""
    kinds = ("check", "instrument")  # a sensor that is not there does not lie
    said = (s for s in found.said if s.kind != "check missing")
    return [s.sentence for s in said if s.kind.startswith(kinds) or _is_setting(s.kind)]


def _sensors(found: Explanation) -> list[str]:
    if found.check.duration < SHORTEST:
        return _off(found) or [f"That cannot be said: {nothing_wrong(found.check.duration)}."]
    return _off(found) or ["None that could be seen: what they show fits together."]


def _notes(found: Explanation) -> list[str]:
    """Notes that do not say once more what stands elsewhere: why an axis is not compared and what would let it be.

    Nor, from the flight, the delay that the check has found in the whole log: two numbers of one delay contradict.
    """
    reasons = [] if found.compared is None else found.compared.comparison.reasons.values()
    beside = " ".join([found.why_not, *reasons])
    said = [why for why in (found.why_not.partition(": ")[2],) if why]
    said += [
        remedy for remedy in (TELL_FLOW, throttle_instead(found.aircraft.model.terms)) if remedy in beside and remedy
    ]
    late = tuple(f"{finding['signals']}: " for finding in _findings(found) if finding["kind"] == "offset")
    return [note for note in found.notes if not note.startswith(late) and not any(text in note for text in said)]


def _is_setting(kind: str) -> bool:
    return kind in BY_ID and BY_ID[kind].kind == MEASUREMENT
