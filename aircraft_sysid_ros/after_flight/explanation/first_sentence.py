"""The most important thing that a flight says, in one sentence.

What makes everything after it wrong comes first: a log that contradicts itself, of which nothing but its sensors is
said, an input that failed where nothing but the inputs can be judged, a flight that shows too little, a sensor that is
off, then a mass that the thrust contradicts, what the model lacks, an aeroplane that is hardly stable. What the model
lacks in the forces comes before the mass, which is worked out from these.
Rules and limits were made on some seeds of benchmarks/explain.py and judged on others (docs/explain.md).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from aircraft_sysid_ros.after_flight.explanation.aeroplane import Fact
from aircraft_sysid_ros.after_flight.explanation.instruments import InstrumentError
from aircraft_sysid_ros.aircraft.sensor_settings import late_words
from aircraft_sysid_ros.diagnosis.failures.words import CHANGE_OF_MOMENTS, DAMAGED, STUCK
from aircraft_sysid_ros.diagnosis.search.candidates import TIMES_OF_CHANGE
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.effects import BY_ID, OF_SERVOS
from aircraft_sysid_ros.effects.effect import MEASUREMENT
from aircraft_sysid_ros.flight_check.check import SHORTEST
from aircraft_sysid_ros.flight_check.finding import ABSENT, ERROR, KEEPS_TIME, WARNING, Finding, joined, short_names
from aircraft_sysid_ros.flight_check.signals import SURFACES
from aircraft_sysid_ros.identification.conditions import listed
from aircraft_sysid_ros.rounding import with_error

#: Share of the parameters below which a flight has too little motion: to USE, and that the check says are shown.
LEAST_USED = 0.4
#: The mass is doubted where the thrust says another one by this share and by so many standard deviations.
LEAST_MASS, SURE_MASS = 0.08, 5.0
#: Warnings of the check that say that a sensor is off. The sign of a surface is a convention, which any model learns.
_OF_SENSORS = ("offset", "scale", "saturated")
#: What a surface that fails is called.
_OF_SURFACES = (STUCK, DAMAGED, CHANGE_OF_MOMENTS)
#: Static margin [% of the chord] below which an aeroplane is hardly stable, by two standard deviations.
SMALL_MARGIN = 5.0


@dataclass(frozen=True)
class Said:
    """A sentence and what it is about."""

    kind: str
    sentence: str


@dataclass(frozen=True)
class Evidence:
    """What was found of a flight; None where it was not looked for."""

    check: Mapping[str, Any]
    used: tuple[int, int]  # parameters to USE, of so many
    instruments: Sequence[InstrumentError] = ()
    diagnosis: Mapping[str, Any] | None = None
    facts: Sequence[Fact] = ()
    calm_air: bool = False  # whether the speed over ground stood for the airspeed
    mass: tuple[float, float, float] | None = None  # as stated, by the thrust, and its standard deviation [kg]
    broken: str = ""  # that the recorder did not finish the log, in words
    #: Delay or lag [s] of the surfaces that the flight has shown, with one sigma, where the aircraft file says neither.
    late: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    states_mass: str = "the aircraft file"  # or the recording, where it has one
    published: str = "rls"  # estimator of the parameters: rls corrects them for what is late


def what_matters(evidence: Evidence) -> list[Said]:
    """Everything of importance, the most important first; never empty."""
    wrong = any(_contradictions(evidence))
    of_sound = () if wrong else (_missing, _mass, _balance) if _is_of_force(evidence) else (_mass, _missing, _balance)
    order = (_contradictions, _failed, _lacking, _little_motion, _sensors, _vanes, *of_sound)
    if not wrong and _found(evidence) and not _inputs_alone(evidence.diagnosis or {}):
        # what the library named this flight has shown: that some parameters are not known hides nothing
        order = (_failed, _lacking, _sensors, _vanes, *of_sound, _little_motion)
    return [said for find in (*order, _late, _held) for said in find(evidence)] or [_nothing(evidence)]


def _is_of_force(evidence: Evidence) -> bool:
    """Whether something that the model lacks acts in the forces along or across the wings."""
    return any({candidate["main_axis"], *candidate.get("axes", ())} & {"CX", "CZ"} for candidate in _found(evidence))


def _contradictions(evidence: Evidence) -> Iterator[Said]:
    """Errors of the check."""
    for finding in _findings(evidence.check, ERROR):
        yield Said(f"check {finding.kind}", f"The log is wrong in {short_names(finding.signals)}: {finding.sentence}.")


def _findings(check: Mapping[str, Any], severity: str) -> list[Finding]:
    listed_ones = (Finding((f["signal"],), f["kind"], f["severity"], f["sentence"]) for f in check["findings"])
    return [finding for finding in joined(listed_ones) if finding.severity == severity]


def _failed(evidence: Evidence) -> Iterator[Said]:
    """Inputs that failed in a flight of which the library could not be searched: the diagnosis says it in sentences."""
    if evidence.diagnosis and _inputs_alone(evidence.diagnosis) and (found := _found(evidence)):
        yield Said(str(found[0]["effect"] or "unexplained"), str(evidence.diagnosis["advice"]))


def _inputs_alone(diagnosis: Mapping[str, Any]) -> bool:
    """Whether nothing but the inputs was looked at: what else there is was compared with no replicas."""
    return diagnosis.get("replicas") == 0


def _lacking(evidence: Evidence) -> Iterator[Said]:
    """That the log is too short, or lacks what everything rests on."""
    used, _ = evidence.used
    if evidence.check.get("duration", SHORTEST) < SHORTEST:
        why = f": {evidence.broken}" if evidence.broken else ""
        yield Said(
            "short", f"The log holds {evidence.check['duration']:.1f} s, too little to say anything about it{why}."
        )  # fmt: skip
        return
    lacking = [f for f in _findings(evidence.check, WARNING) if f.kind == "missing"] if not used else []
    if evidence.calm_air and any(_contradictions(evidence)):  # it is not for calm air that nothing can be used
        lacking = [finding for finding in lacking if "true_airspeed" not in finding.signals]
    if lacking:
        named = listed(short_names(lacking[0].signals).split(", "))
        if evidence.calm_air and "true_airspeed" in lacking[0].signals:
            yield Said("calm air", "No parameter can be used: no airspeed was recorded, and the air was taken as calm, "
                       "which nothing confirms. Record true_airspeed.")  # fmt: skip
            return
        what, are = lacking[0].sentence, "is" if len(lacking[0].signals) == 1 else "are"
        why = f", since {named} {are} {what}" if what.startswith(ABSENT) else f". Of {named}: {what}"
        yield Said("check missing", f"No parameter can be used{why}.")


def _little_motion(evidence: Evidence) -> Iterator[Said]:
    """That the flight shows too little of the aeroplane, where its sensors are there."""
    if _shows_little(evidence) and not any(_lacking(evidence)) and not _absent_vanes(evidence.check):
        yield Said(
            "motion", f"This flight has too little motion to say what the aeroplane is like: {_known(evidence)}. Fly "
            "what is listed under 'what to fly next'.",
        )  # fmt: skip


def _vanes(evidence: Evidence) -> Iterator[Said]:
    """That angles of flow were not measured, which is no fault of a sensor, and is said after these."""
    if _shows_little(evidence) and not any(_lacking(evidence)) and (vanes := _absent_vanes(evidence.check)):
        yield Said(
            "vanes", f"Nothing measured {vanes}, and what speed, wind and attitude show of it is too little to say "
            f"what the aeroplane is like: {_known(evidence)}. Fly what is listed under 'what to fly next' in calm air, "
            "with a good attitude, or with a vane.",
        )  # fmt: skip


def _shows_little(evidence: Evidence) -> bool:
    """Whether few parameters can be used, and the check says that the flight does not show the others."""
    (used, all_of_them), shown = evidence.used, list(evidence.check["identifiable"].values())
    return used < LEAST_USED * all_of_them and sum(shown) < (1.0 + LEAST_USED) / 2.0 * len(shown)


def _known(evidence: Evidence) -> str:
    used, all_of_them = evidence.used
    return f"{used} of {all_of_them} parameters can be used" if used else "no parameter can be used"


def _absent_vanes(check: Mapping[str, Any]) -> str:
    """The angles of flow that are not in the recording, in words; empty where all are."""
    absent = {f["signal"] for f in check["findings"] if f["kind"] == "missing" and f["sentence"].startswith(ABSENT)}
    words = {"angle_of_attack": "the angle of attack", "sideslip": "the sideslip"}
    return " and ".join(text for signal, text in words.items() if signal in absent)


def _sensors(evidence: Evidence) -> Iterator[Said]:
    """Errors of instruments, times by the check, and settings that a diagnosis found, each once."""
    said = set()
    for error in evidence.instruments:
        said.add(error.signal)
        yield Said(f"instrument {error.kind}", f"{error.words[0].upper()}{error.words[1:]}.")
    for finding in _findings(evidence.check, WARNING):
        if finding.kind not in _OF_SENSORS or _is_said_of(finding, said):
            continue
        if finding.kind == "offset" and _a_surface_failed(evidence) and set(finding.signals) & set(SURFACES):
            continue
        if not said & set(finding.signals):
            said |= set(finding.signals)
            named = short_names(finding.signals)
            yield Said(f"check {finding.kind}", f"Something is wrong with {named}: {finding.sentence}.")
    for candidate in _found(evidence):
        if candidate["kind"] == MEASUREMENT and not (said and _explained_by(candidate["effect"], said)):
            yield Said(str(candidate["effect"]), f"The aircraft file does not describe the sensors as they are: "
                       f"{candidate['name']} ({candidate['where']}){_fall(candidate)}.")  # fmt: skip


def _held(evidence: Evidence) -> Iterator[Said]:
    """What comes more seldom than it is recorded: a matter of the logger, which costs some milliseconds."""
    said = {error.signal for error in evidence.instruments}
    for finding in _findings(evidence.check, WARNING):
        if finding.kind == "held" and not said & set(finding.signals):
            yield Said("check held", f"Of {short_names(finding.signals)} {finding.sentence}.")


def _a_surface_failed(evidence: Evidence) -> bool:
    """Whether a surface failed, which feigns a delay of all of them."""
    return any(said.kind in _OF_SURFACES for said in _failed(evidence))


def _is_said_of(finding: Finding, said: set[str]) -> bool:
    """Whether it is the delay of a stream of which it is said already: two streams of one receiver have one delay."""
    text = finding.sentence
    return text.startswith(KEEPS_TIME) and text.removeprefix(KEEPS_TIME).partition(",")[0] in said


#: What a setting is an error of, by the beginning of the name of its effect.
_ERRS_IN = {"airspeed": "true_airspeed", "alpha": "angle_of_attack", "beta": "sideslip", "actuator": "elevator"}


def _explained_by(effect: str, said: set[str]) -> bool:
    return _ERRS_IN.get(effect.partition("_")[0], effect) in said


def _found(evidence: Evidence) -> list[Mapping[str, Any]]:
    return [c for c in evidence.diagnosis["candidates"] if c["found"]] if evidence.diagnosis else []


def _fall(candidate: Mapping[str, Any]) -> str:
    """By how much an error falls, as the end of a sentence; nothing where none does."""
    before, after, axis = candidate["error_before"], candidate["error_after"], candidate["main_axis"]
    if not axis or not before > after:
        return ""
    return f"; the error of {axis[0]}_{axis[1]} falls from {100 * before:.1f} to {100 * after:.1f} % with it"


def _has_late_surfaces(evidence: Evidence) -> bool:
    """Whether the check has said that surfaces come at another time."""
    late = {s for f in _findings(evidence.check, WARNING) if f.kind == "offset" for s in f.signals}
    return bool(late & set(SURFACES))


def _missing(evidence: Evidence) -> Iterator[Said]:
    if evidence.diagnosis and _inputs_alone(evidence.diagnosis):
        return
    for candidate in _found(evidence):
        if candidate["kind"] == MEASUREMENT or (candidate["effect"] in OF_SERVOS and _has_late_surfaces(evidence)):
            continue
        fall = _fall(candidate)
        others = [BY_ID[name].name for name in candidate["confounded_with"] if name in BY_ID]
        doubt = f"; this flight cannot tell it from {listed(others)}" if others else ""
        if candidate["effect"] is None:
            text = f"The model lacks something that has no name in the library, {candidate['label']}{fall}{doubt}."
        else:
            happened = candidate.get("inner", {}).keys() & TIMES_OF_CHANGE  # then when is where
            where = candidate["where"].partition(";")[0] if happened else candidate["where"]
            large = candidate.get("how_large", "").partition("; ")[0]
            text = f"The model lacks one effect: {candidate['name']} ({where}){fall}{doubt}."
            text += f" How large: {large}." if large else ""
        yield Said(str(candidate["effect"] or "unexplained"), text)


def _mass(evidence: Evidence) -> Iterator[Said]:
    if evidence.mass is None:
        return
    stated, shown, std = evidence.mass
    if abs(shown - stated) > max(LEAST_MASS * stated, SURE_MASS * std):
        yield Said(
            "mass", f"The recorded thrust moves the aeroplane as if its mass were {with_error(shown, std)} kg, and "
            f"{evidence.states_mass} says {stated:.3g} kg: the mass or the thrust is wrong, and every force "
            "coefficient with it.",
        )  # fmt: skip


def _balance(evidence: Evidence) -> Iterator[Said]:
    margin = next((f for f in evidence.facts if f.key == "static_margin" and not f.reason), None)
    if margin is not None and margin.value + 2.0 * margin.std < SMALL_MARGIN:
        unstable = margin.value + 2.0 * margin.std < 0.0
        how = "unstable in pitch" if unstable else "barely stable in pitch"
        yield Said(
            "balance", f"The aeroplane is {how}: its static margin is {with_error(margin.value, margin.std)} % of the "
            "chord, so the centre of gravity is too far aft.",
        )  # fmt: skip


def _late(evidence: Evidence) -> Iterator[Said]:
    """Surfaces that come later than they are recorded, where no diagnosis and no check has said so."""
    found = {candidate["effect"] for candidate in _found(evidence)}
    if evidence.late and not found & {*OF_SERVOS, "actuator_lag", "late_controls"} and not _has_late_surfaces(evidence):
        words = late_words(evidence.late)
        corrected = "parameters are corrected for that"
        if evidence.published != "rls":
            by = evidence.published
            corrected = f"the parameters of {by} are not corrected for that, their standard errors allow for it"
        yield Said("late", f"{words[0].upper()}{words[1:]}, as this flight shows: {corrected}.")


def _nothing(evidence: Evidence) -> Said:
    used, all_of_them = evidence.used
    if evidence.diagnosis is None:
        return Said("nothing", f"Nothing in this log looks wrong, and {used} of {all_of_them} parameters can be used.")
    if evidence.diagnosis.get("unknown") or evidence.diagnosis.get("left"):
        return Said("unknown", str(evidence.diagnosis["advice"]))
    candidates = evidence.diagnosis["candidates"]
    if suspect := next(filter(_nearly_named, candidates), next(filter(_is_something_else, candidates), None)):
        axis = suspect["main_axis"]
        share = 100 * (1.0 - suspect["error_after"] / suspect["error_before"])
        usable = f"{used or 'none'} of {all_of_them}"
        return Said(
            "nothing",
            f"Nothing is clearly missing. {suspect['name'] or suspect['label']} would remove {share:.0f} % of "
            f"the error of {axis[0]}_{axis[1]}, but {suspect['refused']}. The sensors agree, and {usable} parameters "
            "can be used.",
        )
    if not used:
        return Said(
            "nothing", f"No parameter can be used (0 of {all_of_them}), so this flight says nothing about the "
            "aeroplane or about faults of its model; its sensors agree.",
        )  # fmt: skip
    return Said(
        "nothing", f"Nothing is missing that this flight could show: the sensors agree, and {used} of {all_of_them} "
        "parameters can be used.",
    )  # fmt: skip


def _nearly_named(candidate: Mapping[str, Any]) -> bool:
    """Significant and of a size, but not the same in most parts of the flight."""
    nested = candidate.get("nested")
    is_apart = nested is not None and 2 * nested["same"] <= nested["parts"] and bool(candidate["refused"])
    return is_apart and candidate["p_value"] < THRESHOLDS.verdict and bool(_fall(candidate))


def _is_something_else(candidate: Mapping[str, Any]) -> bool:
    """Significant and of a size, but ruled out by its own physics: what is there has no name."""
    if not candidate.get("ruled_out") or candidate["p_value"] >= THRESHOLDS.verdict:
        return False
    return bool(candidate["error_after"] <= (1.0 - THRESHOLDS.size) * candidate["error_before"])
