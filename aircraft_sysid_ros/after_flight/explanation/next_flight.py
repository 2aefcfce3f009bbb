"""What to fly next: manoeuvres for the parameters that this flight does not show, and to tell apart what it cannot."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from aircraft_sysid_ros.after_flight.explanation.aeroplane import KnownMode, Learnt
from aircraft_sysid_ros.aircraft.signals import CONTROL_WORDS
from aircraft_sysid_ros.aircraft.unsaid_places import unsaid_keys
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.effects.effect import MEASUREMENT
from aircraft_sysid_ros.flight_check.finding import ABSENT, ERROR, INFO
from aircraft_sysid_ros.flight_model.modes import DUTCH_ROLL, SHORT_PERIOD
from aircraft_sysid_ros.identification.conditions import TELL_FLOW, listed
from aircraft_sysid_ros.reconstruction.state import CONTRADICTED, contradiction_text
from aircraft_sysid_ros.recordings.autopilot_log import NO_SURFACES

_YAW = "rudder doublets{yaw} and steady sideslips to both sides"
_WITHOUT_RUDDER = "aileron doublets{yaw} that make the aeroplane slip and yaw, and quick bank reversals"
#: Which manoeuvre moves a signal; the first that a term reads decides.
_MANOEUVRES: tuple[tuple[frozenset[str], str], ...] = (
    (frozenset({"de", "q", "alpha", "alpha_dot"}), "elevator doublets and a 3-2-1-1{pitch}, slow and fast"),
    (frozenset({"dr", "r", "beta", "beta_dot"}), _YAW),
    (frozenset({"da", "p"}), "aileron doublets and rolls from bank to bank"),
    (frozenset({"Tc", "throttle", "propeller_speed"}), "throttle steps with wings level"),
    (frozenset({"flaps"}), "flaps out and in again in steady flight, with small doublets at each setting"),
    (frozenset({"V", "qbar", "mach", "height"}), "level flight at several speeds and heights"),
)
#: Signal of the model that a control of a recording is: where it is not recorded no manoeuvre of it shows anything.
_CONTROLS = {CONTROL_WORDS[signal]: signal for signal in ("de", "da", "dr", "Tc", "flaps")}
#: Why parameters are held by a sensor that is wrong.
_CONTRADICTED = tuple(contradiction_text(code) for code in CONTRADICTED)
_HARDLY_TOLD, _NOT_TOLD = 0.3, 1.0  # between the least and the most that the airspeed may read
_WIDEST = 1.3  # highest over lowest airspeed below which other speeds are worth a flight


def next_flights(
    check: Mapping[str, Any],
    learnt: Learnt | None,
    modes: Sequence[KnownMode],
    diagnosis: Mapping[str, Any] | None,
    airspeed_reads: Sequence[float] | None = None,
) -> list[str]:
    """Sentences, the most useful first; ``airspeed_reads`` as ``InFlightCheck`` has it."""
    is_sound = not any(finding["severity"] == ERROR for finding in check["findings"])
    lacking = _lacking(diagnosis) if is_sound else {}
    said = [
        *_to_record(check),
        *_to_add(lacking, _counted_with(diagnosis)),
        *_for_parameters(check, learnt, modes, set(lacking)),
    ]
    if is_sound:
        said += [*_to_tell_apart(diagnosis), *_calm(diagnosis), *_to_tell_the_airspeed(airspeed_reads)]
    return list(dict.fromkeys(said)) or [_more(learnt)]


def _to_tell_the_airspeed(reads: Sequence[float] | None) -> Iterator[str]:
    """Whether it reads true is known where the course turns; without that no sensor contradicts it."""
    if reads is None or not reads[1] - reads[0] > _HARDLY_TOLD:
        return
    told = f"only that the airspeed reads {reads[0]:.2f} to {reads[1]:.2f} of what it should"
    if reads[1] - reads[0] > _NOT_TOLD:
        told = "almost nothing about whether the airspeed is right"
    yield (
        f"Fly two full circles with GPS: this flight shows {told}, and every coefficient goes with its square, which "
        "no standard error here counts."
    )


def _to_record(check: Mapping[str, Any]) -> Iterator[str]:
    """What no manoeuvre shows, since it is not in the recording at all; of some samples lost the check speaks."""
    absent = _not_recorded(check)
    if missing := [signal for signal, why in absent.items() if NO_SURFACES not in why]:
        yield f"Record {listed(missing)}: no manoeuvre makes up for what is not in the log."
    if outputs := [signal for signal in absent if signal not in missing]:
        yield f"Explain this log again with --servos: nothing says which of its outputs move {listed(outputs)}."


def _lacking(diagnosis: Mapping[str, Any] | None) -> dict[str, list[str]]:
    """By axis the effects of the library that a diagnosis has found and the model lacks, as ``add`` calls them."""
    found: dict[str, list[str]] = {}
    for candidate in diagnosis["candidates"] if diagnosis else ():
        if candidate["found"] and candidate["effect"] is not None and candidate["kind"] != MEASUREMENT:
            for axis in candidate.get("axes", ()):
                found.setdefault(axis, []).append(candidate["effect"])
    return found


def _counted_with(diagnosis: Mapping[str, Any] | None) -> list[str]:
    """What the diagnosis counts with that the aircraft file does not say of sensors, as ``add`` calls it."""
    candidates = (c for c in (diagnosis or {"candidates": ()})["candidates"] if c["kind"] == MEASUREMENT)
    of_sensors = (c["effect"] for c in candidates if c["found"] or not c.get("terms"))  # or refused, as terms
    return [name for name in dict.fromkeys(of_sensors) if name is not None]


def _to_add(lacking: Mapping[str, Sequence[str]], settings: Sequence[str]) -> Iterator[str]:
    """What no manoeuvre shows before the model has what it lacks, and what that was found with."""
    if lacking:
        if settings:
            yield f"Add {listed(list(settings))} first (`aircraft-sysid add`): what else is missing was found with it."
        effects = listed(list(dict.fromkeys(effect for names in lacking.values() for effect in names)))
        axes = listed([f"{axis[0]}_{axis[1]}" for axis in lacking])
        yield f"Add {effects} to the model (`aircraft-sysid add`) before anything is flown for {axes}."


def _not_recorded(check: Mapping[str, Any]) -> dict[str, str]:
    """Signals with why they are not there, in words."""
    return {
        finding["signal"]: finding["sentence"]
        for finding in check["findings"]
        if finding["severity"] != INFO and finding["sentence"].startswith(ABSENT)
    }


def _for_parameters(
    check: Mapping[str, Any], learnt: Learnt | None, modes: Sequence[KnownMode], lacking: Collection[str]
) -> Iterator[str]:
    """Parameters that are not known, by the manoeuvre that shows them, but of axes that lack something."""
    if learnt is None:
        unknown = [name for name, shown in check["identifiable"].items() if not shown]
        programs = {}
    else:
        unknown = [name for name, reason in learnt.unknown.items() if reason]
        held = next((text for text in _CONTRADICTED if any(text in learnt.unknown[name] for name in unknown)), "")
        if held:
            yield f"Correct that first, and explain this log again: {held}, and no manoeuvre shows more until then."
            unknown = [name for name in unknown if held not in learnt.unknown[name]]
        if unknown and learnt.aircraft.unsaid:
            keys = listed(unsaid_keys(learnt.aircraft))
            yield f"Measure where the sensors are and write {keys} into the aircraft file: errors are wider for it."
        if unknown and (seconds := _seconds_of_flow(check, learnt)) < THRESHOLDS.shortest <= check["duration"]:
            yield (
                f"First make the flow angles known, which they are for {seconds:.0f} s only here: {TELL_FLOW}; "
                "also give the filter the attitude, if the log has one. Without that no manoeuvre shows more."
            )
            return
        listed_programs = [p for of_axis in learnt.model.programs for p in of_axis]
        programs = dict(zip(learnt.model.parameter_names, listed_programs, strict=True))
    unknown = [name for name in unknown if name.partition("_")[0] not in lacking]
    pulses = {
        "pitch": _pulse(modes, SHORT_PERIOD, "the short period"), "yaw": _pulse(modes, DUTCH_ROLL, "the Dutch roll")
    }  # fmt: skip
    unmoved = {_CONTROLS[name] for name in _not_recorded(check) if name in _CONTROLS}
    has_rudder = any("dr" in _signals(name, programs) for name in (learnt.unknown if learnt else check["identifiable"]))
    for signals, text in _MANOEUVRES:
        if signals & unmoved:
            continue
        manoeuvre = _WITHOUT_RUDDER if text == _YAW and not has_rudder else text
        names = [name for name in unknown if _first(signals, name, programs)]
        if names:
            yield f"Fly {manoeuvre.format(**pulses)}: this flight does not show {_some(names)}."
    inputs = learnt.model.inputs if learnt else ()
    if names := [name for name in unknown if _own(name, programs) is None and {*inputs} & {*_signals(name, programs)}]:
        moved = [name for name in inputs if any(name in _signals(each, programs) for each in names)]
        each_own = ", one by one" if len(moved) > 1 else ""
        yield f"Fly doublets of {listed(moved)}{each_own}: this flight does not show {_some(names)}."


def _some(names: Sequence[str]) -> str:
    """Names of parameters, and of more than six how many more."""
    return listed(list(names[:6])) + (f" and {len(names) - 6} more" if len(names) > 6 else "")


def _seconds_of_flow(check: Mapping[str, Any], learnt: Learnt) -> float:
    """How long [s] the angles of flow are known where no vane measures one of them; infinite where vanes do."""
    absent = {f["signal"] for f in check["findings"] if f["sentence"].startswith(ABSENT)}
    if not absent & {"angle_of_attack", "sideslip"}:
        return float("inf")
    time = learnt.flight.time
    return len(time) * float(np.median(np.diff(time))) if len(time) > 1 else 0.0


def _first(signals: frozenset[str], name: str, programs: Mapping[str, Any]) -> bool:
    """Whether the term of a parameter reads one of the signals, and none of a manoeuvre before."""
    return _own(name, programs) == signals


def _own(name: str, programs: Mapping[str, Any]) -> frozenset[str] | None:
    """Signals of the first manoeuvre that moves one which the term of a parameter reads; None: of no manoeuvre."""
    read = set(_signals(name, programs))
    return next((group for group, _ in _MANOEUVRES if group & read), None)


def _signals(name: str, programs: Mapping[str, Any]) -> Collection[str]:
    """Signals that the term of a parameter reads; without the model what its name says."""
    return programs[name].signals if name in programs else {name.partition("_")[2].rstrip("0123456789")}


def _pulse(modes: Sequence[KnownMode], name: str, words: str) -> str:
    """The length of a pulse that suits a mode: half of its period."""
    mode = next((m for m in modes if m.name == name and not m.reason and abs(m.damping) < 1.0), None)
    if mode is None:
        return ""
    half = np.pi / (mode.frequency * np.sqrt(1.0 - min(mode.damping, 0.95) ** 2))
    return f" with pulses of {half:.2g} s (half of {words})"


def _to_tell_apart(diagnosis: Mapping[str, Any] | None) -> Iterator[str]:
    for candidate in diagnosis["candidates"] if diagnosis else ():
        others = [BY_ID[name].name for name in candidate["confounded_with"] if name in BY_ID]
        if candidate["found"] and others and candidate["manoeuvre"]:
            yield f"To tell {candidate['name']} from {listed(others)}: {candidate['manoeuvre']}"


def _calm(diagnosis: Mapping[str, Any] | None) -> Iterator[str]:
    if diagnosis and "gusts" in str(diagnosis["advice"]):
        yield "Fly in calm air with turns through all headings: these gusts hide a wrong scale of the air data."


def _more(learnt: Learnt | None) -> str:
    if learnt is None:
        return "Nothing more is needed."
    speed = learnt.flight.signal("V")
    low, high = np.nanpercentile(speed, (2.0, 98.0))
    if high < _WIDEST * low:
        return f"The same manoeuvres slower and faster: this flight covers {low:.3g} to {high:.3g} m/s only."
    return f"Nothing more is needed for this model from {low:.3g} to {high:.3g} m/s; other speeds would widen this."
