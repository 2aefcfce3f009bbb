"""What is said of a flight: the verdict, its findings and the advice, as JSON and in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.diagnosis.cannot_show import OutOfReach
from aircraft_sysid_ros.diagnosis.diagnose import MISSING, NONE, UNEXPLAINED, Diagnosis
from aircraft_sysid_ros.diagnosis.finding import Finding, resting_on
from aircraft_sysid_ros.diagnosis.flight.flight_data import BLOCK, FlightData
from aircraft_sysid_ros.diagnosis.how_large import added_terms, how_large
from aircraft_sysid_ros.diagnosis.measurement.setting import Setting
from aircraft_sysid_ros.diagnosis.recorded_times import in_recording
from aircraft_sysid_ros.diagnosis.search.candidates import TIMES_OF_CHANGE, Candidate
from aircraft_sysid_ros.diagnosis.search.evaluator import errors_of
from aircraft_sysid_ros.diagnosis.significance.error_regions import unusual
from aircraft_sysid_ros.diagnosis.significance.parametric_bootstrap import Replica
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.effects.effect import Effect
from aircraft_sysid_ros.identification.conditions import listed

_HEADLINES = {
    NONE: "nothing is missing", MISSING: "an effect is missing", UNEXPLAINED: "something is unexplained",
}  # fmt: skip

#: How advice begins where something has size, and is refused for another reason.
_NOT_SURELY = "Nothing is clearly missing:"


def headline(said: Mapping[str, Any]) -> str:
    """The answer in a few words, of the JSON that is said of a flight or of a part of it."""
    if said["verdict"] == NONE and said.get("replicas") == 0:  # the library was not searched
        return (
            "no input has stopped acting, nothing else was checked" if said["tried"] else "nothing could be looked for"
        )
    if said["verdict"] == NONE and said.get("unknown"):
        return "nothing can be named, since the flow angles are not measured"
    if said["verdict"] == NONE and said.get("left"):
        most = [axis for axis, of in said["left"].items() if of["error"] > THRESHOLDS.left_most]
        axes = listed([f"{axis[0]}_{axis[1]}" for axis in most or said["left"]])
        return f"nothing is named, and {'most' if most else 'part'} of {axes} is not explained"
    if said["verdict"] == NONE and str(said.get("advice", "")).startswith(_NOT_SURELY):
        return "nothing is clearly missing"
    return _HEADLINES[said["verdict"]]


def chosen_anew(candidate: Mapping[str, Any]) -> str:
    """In words what is named without each part of the flight, and the error there; empty of what nothing says that."""
    nested = candidate.get("nested")
    if not nested:
        return ""
    others = sorted({name or "nothing" for name in nested["others"]})
    return (
        f"chosen again with each quarter of the flight left out: the same in {nested['same']} of {nested['parts']}"
        + (f" (else {listed(others)})" if others else "")
        + f"; error of {candidate['main_axis']} in the quarters left out {100.0 * nested['error_after']:.3g} %"
    )


#: Candidates of which it is said why they are no verdict.
_MOST_REFUSED = 2
#: Why a place is no fault: one that the aircraft file leaves out, and one that it states.
OF_PLACE = "it is allowed for: the aircraft file does not say where the sensor is"
OF_SHORT_WAY = "it is allowed for: air data that are early or late because a sensor averages look the same"


@dataclass(frozen=True)
class MeasurementFinding:
    """A setting of the aircraft file that is wrong, and what that does to the errors of all axes (held out)."""

    setting: Setting
    p_value: float
    confounded_with: tuple[str, ...]
    errors: dict[str, tuple[float, float]]
    matters: bool = True  # it is a fault, and not only what the aircraft file leaves out
    why_no_fault: str = ""  # of what is counted with and is none, in words

    @property
    def main_axis(self) -> str:
        """The axis whose error falls most."""
        return max(self.errors, key=lambda axis: self.errors[axis][0] - self.errors[axis][1])


@dataclass(frozen=True)
class FlightDiagnosis:
    """Everything that is said of a flight."""

    flight: FlightData  # with corrected settings
    settings: tuple[MeasurementFinding, ...]
    diagnosis: Diagnosis
    replicas: Sequence[Replica] = field(repr=False)
    is_calm: bool  # scales of the air data could be told
    unseen: tuple[OutOfReach, ...] = ()
    zero: int = 0  # stamp [ns] at which the signal ``time`` is 0
    recorded_from: int = 0  # stamp [ns] of the first sample

    @property
    def verdict(self) -> str:
        """none, missing or unexplained."""
        return MISSING if any(corrected.matters for corrected in self.settings) else self.diagnosis.verdict

    @property
    def json(self) -> dict[str, Any]:
        """What ``diagnose --json`` prints, with more about each candidate."""
        return {
            **({"held_out": "runs" if self.flight.by_manoeuvre else "blocks of time"} if self.flight.runs else {}),
            "verdict": self.verdict,
            "candidates": [*map(self._of_setting, self.settings), *map(self._of_finding, self.diagnosis.candidates)],
            "advice": " ".join(self._advice()),
            "p_value": self.diagnosis.p_value,
            "false_alarm_rate": THRESHOLDS.false_alarm,
            "least_size": THRESHOLDS.size,
            "noise_floor": dict(self.diagnosis.floor),
            "unknown": dict(self.diagnosis.unknown),
            "left": {axis: {"error": e, "times_noise": n} for axis, (e, n) in self.diagnosis.left.items()},
            "cannot_show": [
                {"effect": e.effect.identifier, "name": e.effect.name, "why": e.why, "manoeuvre": e.effect.manoeuvre}
                for e in self.unseen
            ],
            "tried": self.diagnosis.tried,
            "replicas": self.diagnosis.replicas,
        }

    def _of_setting(self, finding: MeasurementFinding) -> dict[str, Any]:
        setting, (before, after) = finding.setting, finding.errors[finding.main_axis]
        return {
            **_about(setting.effect, setting.label),
            **self._runs_of(None),
            "expression": None,
            "axes": [],
            "main_axis": finding.main_axis,
            "evidence": setting.evidence,
            "p_value": finding.p_value,
            "error_before": before,
            "error_after": after,
            "confounded_with": list(finding.confounded_with),
            "where": f"{setting.label}: {_of_sensors(setting)}",
            "how_large": "",
            "inner": {setting.effect.setting_number(setting.variant).name: setting.value},
            "settings": {".".join(key): value for key, value in setting.values},
            "parameters": [],
            "found": finding.matters,
            "refused": "" if finding.matters else finding.why_no_fault,
        }

    def _of_finding(self, finding: Finding) -> dict[str, Any]:
        trial, axis = finding.trial, finding.trial.main_axis
        effect = trial.candidate.effect
        terms = {a: list(texts) for a, texts in trial.candidate.terms.items() if a in trial.gains}
        added = added_terms(finding.flight, trial)
        before, after = errors_of(finding.flight, trial, axis)
        return {
            **_about(effect, self._label(trial.candidate)),
            **self._runs_of(trial.candidate),
            "expression": None if effect else "; ".join(f"{a}: {text}" for a, ts in terms.items() for text in ts),
            "axes": sorted(trial.gains, key=lambda a: -trial.log_ratios[a]),
            "main_axis": axis,
            "evidence": finding.evidence,
            "p_value": finding.p_value,
            "error_before": before,
            "error_after": after,
            "confounded_with": list(finding.not_told_from),
            "where": self._where(finding),
            "how_large": how_large(added),
            "inner": dict(trial.candidate.inner),
            **self._stamps(trial.candidate),
            "terms": terms,
            "parameters": [
                {"axis": a, "term": text, "value": value, "std": std}
                for a, texts in terms.items()
                for text, (value, std) in zip(texts, added.terms[a], strict=True)
            ],
            "shape": dict(finding.shape),
            "nested": _nested(finding),
            "found": finding in self.diagnosis.found,
            "refused": self._refusal(finding),
            "ruled_out": bool(finding.impossible or finding.outdone_by),
        }

    def _refusal(self, finding: Finding) -> str:
        """Why a significant candidate has no name; empty where it has."""
        found = self.diagnosis.found
        if finding in found:
            return ""
        axis, unsure = finding.trial.main_axis, [f for f in self.diagnosis.candidates if f.is_unsure]
        why = finding.refusal(first=not found and not unsure)
        if not why and axis in resting_on(self.flight.inferred):
            return "it rests on flow angles that no vane measures"
        if not why and (more := next((f for f in unsure if f.trial.main_axis == axis), None)):
            return f"{self._label(more.trial.candidate)} explains more of {axis[0]}_{axis[1]}, but is not chosen again"
        return why or "with the named effects in the model, too little of it is left"

    def _where(self, finding: Finding) -> str:
        """Stretches of time that hold most of the evidence, and what sets them apart."""
        axis = finding.trial.main_axis
        inside = np.isin(self.flight.block, finding.blocks)
        judged = np.isfinite(self.flight.measured[:, AXES.index(axis)])
        since = self.flight.begin
        spans = ", ".join(
            f"{since + begin:.0f} to {since + end:.0f} s{self.flight.at_time(begin)}"
            for begin, end in _spans(finding.blocks)
        )
        words = unusual(self.flight, inside, judged)
        candidate = finding.trial.candidate
        since_when = f"{self._when(candidate)}{self._in_recording(candidate)}; " if candidate.happens else ""
        if finding.told_by:
            return since_when + finding.told_by
        fails = "one model for the whole flight fails in " if candidate.happens else ""  # before the change as after it
        return f"{since_when}{fails}{axis[0]}_{axis[1]}, {spans}" + (f", {words}" if words else "")

    def _stamps(self, candidate: Candidate) -> dict[str, dict[str, int]]:
        """Stamps [ns] of when a change begins and ends, of one flight: what was joined has no clock in common."""
        if not candidate.happens or self.flight.manoeuvre is not None:
            return {}
        times = {name: value for name, value in candidate.inner if name in TIMES_OF_CHANGE}
        return {"stamps": {name: self.zero + int(1e9 * value) for name, value in times.items()}}

    def _in_recording(self, candidate: Candidate) -> str:
        """When that is since the first sample, in words, where the filter started late."""
        return in_recording(self._stamps(candidate).get("stamps", {}).values(), self.zero, self.recorded_from)

    def _runs_of(self, candidate: Candidate | None) -> dict[str, list[str] | None]:
        """Of several runs, those in which something changed between them; None of what is no such change."""
        if not self.flight.runs:
            return {}
        return {"runs": (self._changed_runs(candidate) or None) if candidate is not None else None}

    def _changed_runs(self, candidate: Candidate) -> list[str]:
        times = dict(candidate.inner)
        return self.flight.runs_within(times["t0"], times.get("t1", np.inf)) if candidate.happens else []

    def _when(self, candidate: Candidate) -> str:
        """When a change is there, in words: in which runs, where it came between them."""
        runs = self._changed_runs(candidate)
        if len(runs) > 1:
            return f"from {runs[0]} to {runs[-1]}" if candidate.passes else f"from {runs[0]} on"
        if runs:
            return f"in {runs[0]}"
        name = self.flight.at_time(candidate.moment - self.flight.begin) if self.flight.runs else ""
        return candidate.span.replace(" s ", f" s{name} ", 1)

    def _label(self, candidate: Candidate) -> str:
        return f"{self._when(candidate)} {candidate.what_changed}" if candidate.changed else candidate.label

    def _outside(self, candidate: Candidate) -> str:
        """What to do about terms that are no effect of the library."""
        read = {s for texts in candidate.terms.values() for p in self.flight.parsed(texts) for s in p.signals}
        unused = [s for s in self.flight.model.inputs if s in read and s not in self.flight.model.signals_used]
        what = self._in_words(candidate)
        if unused:
            return f"The model does not use the input {' and '.join(unused)}: {what}; add it as an expression."
        return (
            f"Unexplained: {what}, which no effect of the library explains as well; it can be added as an expression."
        )

    def _in_words(self, candidate: Candidate) -> str:
        """What depends on what, outside the library."""
        if candidate.changed:
            parts = []
            for axis, names in candidate.changed.items():
                what = ("another constant" if name == "1" else f"a part in {name}" for name in names)
                parts.append(f"{axis[0]}_{axis[1]} has {' and '.join(what)}")
            return f"{self._when(candidate)} " + ", ".join(parts)
        ((axis, terms),) = candidate.terms.items()
        return f"{axis[0]}_{axis[1]} depends on {' and '.join(terms)}"

    def _of_measurement(self) -> Iterator[str]:
        """What to do about the sensors."""
        for corrected in self.settings:
            fault = corrected.setting.effect
            if not corrected.matters:
                stated = corrected.setting.nominal != 0.0 and not corrected.setting.is_place
                stated = stated or corrected.why_no_fault == OF_SHORT_WAY
                says = "states another value than" if stated else "leaves out what"
                yield f"The aircraft file {says} is used here: {fault.name} (add {fault.identifier})."
                for other in corrected.confounded_with:
                    yield f"It may equally be {BY_ID[other].name}; to separate them: {fault.manoeuvre}"
                continue
            yield f"Correct the measurement first: {fault.name} (add {fault.identifier})."

    @property
    def _refused(self) -> list[tuple[Finding, str]]:
        """What explains enough to be named and is not, with the rule that refuses it, in words."""
        large = [(f, f.refusal(first=True)) for f in self.diagnosis.candidates if f.size >= THRESHOLDS.size]
        return [(finding, why) for finding, why in large if why]

    @property
    def _beginning(self) -> str:
        """How advice that names nothing begins: something may be there of which the flight is no proof."""
        if self.diagnosis.left:
            return "Nothing is named:"
        if self._refused:
            return _NOT_SURELY
        return "Nothing is missing that this flight could show:"

    def _nearest(self) -> Iterator[str]:
        """What explains enough to be named and is not, with the rule that refuses it."""
        refused = self._refused
        if not refused:
            yield f"no effect explains {THRESHOLDS.size:.0%} of the error of an axis on flight that was held out."
        for finding, why in refused[:_MOST_REFUSED]:
            axis, effect = finding.trial.main_axis, finding.trial.candidate.effect
            yield (
                f"{self._label(finding.trial.candidate)} would explain {finding.size:.0%} of the error of "
                f"{axis[0]}_{axis[1]}{f' ({effect.name})' if effect else ''} but is not named, since {why}."
            )

    def _of_what_is_left(self) -> Iterator[str]:
        """Axes that the model does not describe, and no candidate either."""
        left = self.diagnosis.left
        if left:
            shares = {axis: f"{error:.0%}" if error <= 1.0 else "more than all" for axis, (error, _) in left.items()}
            parts = [f"{shares[a]} of {a[0]}_{a[1]} ({times:.0f} times its noise)" for a, (_, times) in left.items()]
            if "CX" in left and self.diagnosis.bench.data.lacks({"Tc"}):
                yield (
                    "Thrust is not measured, and the throttle alone is a poor measure of it, above all for an engine "
                    "whose speed lags: record thrust or propeller speed before C_X is believed."
                )
            gusts = "" if self.is_calm else ", and no sensor shows gusts that roll and pitch it"
            yield (
                f"The model leaves {listed(parts)}, which neither an effect nor an expression explains: check its "
                "inputs first (deflections that are commands, clocks that differ, an input that is not recorded)"
                f"{gusts}."
            )

    def _of_noise(self) -> Iterator[str]:
        """Axes that hardly more than noise moves: whatever acts in one of them alone can have no name."""
        fits, floor = self.diagnosis.bench.fits, self.diagnosis.floor
        noise = {
            axis: min(error, fits[axis].nrmse_held_out) for axis, error in floor.items()
        }  # replicas may be noisier
        noisy = [axis for axis, error in noise.items() if error * THRESHOLDS.above_floor >= 1.0]
        if noisy:
            axes = listed([f"{axis[0]}_{axis[1]}" for axis in noisy])
            are = "are" if len(noisy) > 1 else "is"
            yield f"{axes} {are} mostly noise in this flight: without manoeuvres it cannot show what acts there alone."

    def _advice(self) -> Iterator[str]:
        found = self.diagnosis.found
        for axis, times in self.diagnosis.unknown.items():
            yield (
                f"The error of {axis[0]}_{axis[1]} is {times:.1f} times its noise, and no effect is "
                "named: it rests on flow angles that no vane measures, and may be their error. Measure them."
            )
        if self.verdict == NONE and not self.diagnosis.unknown:
            yield self._beginning
            yield from self._nearest()
            if self.flight.runs:
                yield "Nothing that they could show changed between the flights."
        yield from self._of_what_is_left()
        yield from self._of_noise()
        if not self.is_calm:
            yield "The air data residuals look like gusts, and hide a wrong scale or offset of the air data:"
            yield "fly in calm air to see one."
        yield from dict.fromkeys(self._of_measurement())  # a place has three numbers and one name
        for finding in found:
            effect = finding.trial.candidate.effect
            if effect is None:
                yield self._outside(finding.trial.candidate)
                continue
            if self._changed_runs(finding.trial.candidate):
                yield f"Between the flights this changed: {effect.name}, {self._when(finding.trial.candidate)}."
            else:
                yield f"{effect.name} is missing (add {effect.identifier})."
            for axis, text in finding.shape.items():
                yield f'Its shape differs in {axis[0]}_{axis[1]}: add the expression "{axis}: {text}", too.'
            for other in finding.not_told_from:
                if other in BY_ID:
                    yield f"This flight cannot tell it from {BY_ID[other].name}; to separate them: {effect.manoeuvre}"


def _nested(finding: Finding) -> dict[str, Any] | None:
    nested, own = finding.nested, finding.trial.candidate.family
    if nested is None:
        return None
    others = [name for name in nested.names if name != own]
    parts = len(nested.names)
    return {"parts": parts, "same": parts - len(others), "others": others, "error_after": nested.error}


def _about(effect: Effect | None, label: str) -> dict[str, Any]:
    if effect is None:
        return {"effect": None, "label": label, "name": label, "kind": None, "physics": None, "manoeuvre": None}
    return {
        "effect": effect.identifier, "label": label, "name": effect.name, "kind": effect.kind,
        "physics": effect.physics, "manoeuvre": effect.manoeuvre,
    }  # fmt: skip


def _of_sensors(setting: Setting) -> str:
    """What fits the sensors better than the number of the file."""
    inner = setting.effect.setting_number(setting.variant)
    if inner.name == "offset":
        value, nominal = np.degrees((setting.value, setting.nominal))
        return f"an offset of {value:.2g} deg fits the sensors better than {nominal:.2g}"
    if inner.name != "drift":
        beside = "".join(f", with {value:.2g} in {'.'.join(key)}" for key, value in setting.beside)
        return f"{setting.value:.3g} {inner.unit} fits {setting.judges} better than {setting.nominal:.3g}{beside}"
    speed = setting.variant.setting[1] == "airspeed"
    each = 60.0 * (setting.value - setting.nominal) * (100.0 if speed else 180.0 / np.pi)
    change = f"{abs(each):.2g} {'%' if speed else 'deg'} per minute {'less' if each < 0.0 else 'more'}"
    return f"it shows {change} since the flight began, which fits {setting.judges} better"


def _spans(blocks: Sequence[int]) -> list[tuple[float, float]]:
    """Begin and end [s] of runs of blocks, the three longest in order of time."""
    spans: list[list[int]] = []
    for block in blocks:
        if spans and block == spans[-1][1]:
            spans[-1][1] = block + 1
        else:
            spans.append([block, block + 1])
    longest = sorted(sorted(spans, key=lambda s: s[0] - s[1])[:3])
    return [(begin * BLOCK, end * BLOCK) for begin, end in longest]
