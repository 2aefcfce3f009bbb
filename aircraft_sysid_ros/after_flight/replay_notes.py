"""What ``replay`` says of a flight besides its numbers: what was not there, came too seldom, or was of no use."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.after_flight.delay_notes import delay_notes
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.unsaid_places import unsaid_keys
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.flight_check.finding import ERROR, WARNING, Finding
from aircraft_sysid_ros.flight_check.signals import NAMES
from aircraft_sysid_ros.identification.coefficients.as_loaded import as_loaded
from aircraft_sysid_ros.identification.coefficients.pace import (
    CHANGE,
    LOWEST_RATE,
    SPARSEST_CONTROLS,
    too_slow,
    why_airspeed_too_slow,
)
from aircraft_sysid_ros.identification.coefficients.stream import CoefficientStream
from aircraft_sysid_ros.identification.conditions import TELL_FLOW, listed, throttle_instead
from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.absences import absences, of_manoeuvres
from aircraft_sysid_ros.reconstruction.air_data_errors import UNKNOWN_STD_OF
from aircraft_sysid_ros.reconstruction.found_noise import found_noise, noise_notes
from aircraft_sysid_ros.reconstruction.ordering import LARGEST_LEAP
from aircraft_sysid_ros.reconstruction.state import SUSPECTED, contradiction_text
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.recordings.manoeuvres import Body, Manoeuvre
from aircraft_sysid_ros.recordings.reader import Recording
from aircraft_sysid_ros.ros_messages.conversion import INPUTS_TOPIC
from aircraft_sysid_ros.rounding import with_error
from aircraft_sysid_ros.run_writer import RunWriter
from aircraft_sysid_ros.samples import SAME_FLIGHT, Kind, Samples, is_absurd, manoeuvre_at, manoeuvres
from aircraft_sysid_ros.stamps import NANOSECONDS, nanoseconds

#: What the filter can start with beside the IMU, by kind of sample: name, topic, and what is wrong with samples that
#: are invalid.
_START_WITH = {
    "gps_position": ("GPS position", "gps/fix", "no fix (status -1, or latitude and longitude 0) or no usable numbers"),
    "gps_velocity": ("GPS velocity", "gps/vel", "no usable numbers"),
    "airspeed": ("airspeed", "air_data", "no usable numbers, or values that never change"),
}
_WHAT_TO_RECORD = (
    "record the airspeed or GPS; with GPS and no airspeed calm_air (--calm-air) uses the speed over ground instead"
)
#: Share of the mass of the aircraft file from which a recorded one is another loading.
_OTHER_MASS = 0.03
#: Places of throttle and thrust in a sample of the controls.
_THROTTLE, _THRUST = 4, 5
#: So long [s] it is too slow to fly before it flies, or after.
_STANDING = 1.0
#: Slow error [deg], rms, of a heading that is no longer that of a good one.
HEADING_OFF = 10.0
#: A silence [s] of a sensor that is worth a note.
LONGEST_SILENCE = 2.0


def notes(body: Body, pipeline: Pipeline, writer: RunWriter) -> list[str]:
    """What a user should know about the recording and what became of it."""
    recording, aircraft = body.recording, pipeline.parameters.aircraft
    names = [manoeuvre.segment.name for manoeuvre in body.manoeuvres]
    found = list(recording.notes)
    found += input_notes(recording, aircraft)
    if not {"control_surfaces", *([INPUTS_TOPIC] if aircraft.inputs else [])} & recording.topics.keys():
        found.append("no /control_surfaces: state, biases and wind only, no parameters")
    else:
        found += length_notes(pipeline, writer) + rate_notes(pipeline.parameters.stream)
        found += filter(None, [why_airspeed_too_slow(recording.samples)])
    found += estimator_notes(pipeline.parameters)
    found += bound_notes(aircraft) + segment_notes(body)
    found += place_notes(aircraft, pipeline.state.options.air_data_errors) + air_data_error_notes(pipeline.state)
    parameters = pipeline.parameters
    on_ground = parameters.learning.landing.words(parameters.stream.start_time or 0.0)
    found += landing_notes(body, aircraft, on_ground) + thrust_notes(recording.samples, aircraft)
    found += mass_notes(recording.samples, aircraft)
    found += pipeline.check.words
    found += absences(pipeline.state, names) + noise_notes(pipeline.state)
    found += delay_notes(pipeline.parameters) + prior_notes(pipeline.parameters)
    found += gap_notes(recording.samples, names) + air_data_notes(recording) + control_notes(recording.samples)
    found += late_control_notes(recording.samples, pipeline.parameters)
    return found + flight_notes(pipeline.state, pipeline.parameters)


def sensor_findings(pipeline: Pipeline) -> list[Finding]:
    """What the flight itself showed of its sensors: errors of the check in flight, and a heading that is off."""
    found = [finding for finding in pipeline.check.findings if finding.severity == ERROR or finding.kind == "scale"]
    for each in found_noise(pipeline.state):
        if each.slow is not None and (heading := float(np.rad2deg(each.slow[2]))) > HEADING_OFF:
            sentence = (
                f"it is off by {heading:.0f}° (rms) against the course and what turns show, more than any magnetometer "
                "that was calibrated: calibrate it, and check how the autopilot is mounted"
            )
            found.append(Finding(("attitude.yaw",), "offset", WARNING, sentence))
    return found


#: Of holds for a vane that does not show what the other sensors make of it.
_OF_A_VANE = tuple(contradiction_text(n) for n, name in SUSPECTED.items() if name in ("sideslip", "angle of attack"))


def flight_notes(state: StateEstimator, parameters: Identifier) -> list[str]:
    """What became of the samples, and what changed, was held, or started over in flight; of a replay as of live."""
    found, ahead = [], state.order.counts.gps_in_words
    for kind, counts in state.counts().items():
        for what in ("rejected", "late", "invalid", "wrong_stamp"):
            share = counts[what] / max(counts["received"], 1)
            if share > 0.01 and not (what == "wrong_stamp" and ahead and kind.startswith("gps")):
                found.append(f"{100 * share:.0f} % of the {kind} samples were {what.replace('_', ' ')}")
    order, mass = state.order.counts, parameters.stream.controls.mass_in_words
    found += filter(None, [ahead, order.ahead_in_words, order.repeated_in_words, mass])
    if state.order.counts.restarts:
        times = state.order.counts.restarts
        found.append(f"the clock leapt {'once' if times == 1 else f'{times} times'}")
    for axis, when, count in parameters.learning.changes.alarms():
        again = f" ({count} times)" * (count > 1)
        found.append(f"{axis} changed at {when:.1f} s of flight and was relearnt{again}")
    holds = parameters.learning.integrity.summary()
    if times := holds["holds"]:
        newest = f"; at the end {holds['held']}" if holds["held"] else ""
        found.append(f"parameters of an axis were held {times} time{'s' * (times > 1)}, see docs/trust.md{newest}")
    if ("air_data_position", "x") in state.aircraft.unsaid and any(words in holds["held"] for words in _OF_A_VANE):
        found.append(
            "a vane ahead of the centre of gravity, as on a boom, contradicts the other sensors in quick turns: the "
            "aircraft file does not say where it is, set air_data_position there"
        )
    if state.realignments:
        times = state.realignments
        found.append(f"the filter realigned {'once' if times == 1 else f'{times} times'} after gaps or contradictions")
    return found


def estimator_notes(parameters: Identifier) -> list[str]:
    """Where the estimator chose itself, and did not stay with least squares: which, and why."""
    chosen = parameters.learning.published
    choice = parameters.learning.choice
    if choice is None or (choice.successor is None and not parameters.learning.lends):
        return []
    return [f"the parameters are those of {chosen['published']}, chosen automatically: {chosen['why']}"]


def prior_notes(parameters: Identifier) -> list[str]:
    """What came of the prior of a fleet, and what is wrong with the aeroplane beside it."""
    return parameters.learning.fleet.notes() + parameters.learning.health.notes()


def manoeuvre_notes(body: Body, pipeline: Pipeline, writer: RunWriter) -> list[str]:
    """Manoeuvres of which nothing could be used, each with the reason."""
    epoch, found = pipeline.state.epoch, []
    if epoch is None:
        return []
    states = manoeuvre_at(body.recording.samples, nanoseconds(writer.state_times, epoch))
    points = manoeuvre_at(body.recording.samples, nanoseconds(writer.point_times, epoch))
    for number, manoeuvre in enumerate(body.manoeuvres):
        unused = f"the manoeuvre '{manoeuvre.segment.name}' contributes nothing:"
        if not np.any(states == number):
            alone = StateEstimator(pipeline.state.aircraft, pipeline.state.options)
            alone.push(manoeuvre.samples)
            alone.flush()
            found.append(f"{unused} {why_no_start(alone)}")
        elif "control_surfaces" in body.recording.topics and not np.any(points == number):
            found.append(f"{unused} {_why_no_points(manoeuvre, pipeline)}")
    seams = body.recording.samples.values[body.recording.samples.kind == Kind.SEAM, 0]
    if apart := int(np.sum(~(seams <= SAME_FLIGHT))):
        found.append(
            f"{apart} of {len(body.manoeuvres)} manoeuvres begin without the IMU biases found in the one before, "
            f"since their stamps overlap or are more than {SAME_FLIGHT / 3600.0:g} h apart: "
            "forces are less certain for it"
        )
    return found


def _why_no_points(manoeuvre: Manoeuvre, pipeline: Pipeline) -> str:
    """Why nothing could be learnt from a manoeuvre that has states."""
    there = set(manoeuvre.samples.kind.tolist())
    needed = [("controls", {Kind.CONTROLS, Kind.INPUTS})]
    needed += [("airspeed", {Kind.AIRSPEED})] * (not pipeline.state.options.calm_air)
    if lacking := [name for name, kinds in needed if not kinds & there]:
        return f"it has no {listed(lacking)}"
    speed, width = pipeline.state.aircraft.minimum_airspeed, 2.0 * pipeline.parameters.options.half_width
    return f"no {width:g} s in it have states, controls and an airspeed above {speed:.1f} m/s"


def input_notes(recording: Recording, aircraft: Aircraft) -> list[str]:
    """Inputs that the aircraft file names and the recording does not hold, and the other way round."""
    found = unnamed_notes(recording)
    values = recording.samples.values[recording.samples.kind == Kind.INPUTS, : len(aircraft.inputs)]
    lacking = [item.name for k, item in enumerate(aircraft.inputs) if not np.isfinite(values[:, k]).any()]
    if lacking:
        names = ", ".join(lacking)
        found.append(f"/{INPUTS_TOPIC} holds no value of {names} inside its limits: terms that read it are not learnt")
    return found


def unnamed_notes(recording: Recording) -> list[str]:
    """Inputs that the recording holds and the aircraft file does not name."""
    if not (unnamed := recording.unnamed):
        return []
    example = ", ".join(f"{name}: {{unit: …}}" for name in unnamed[:2])
    return [
        f"/{INPUTS_TOPIC} holds {listed(unnamed)}, which the aircraft file does not name, so that no term can read "
        f"{'them' if len(unnamed) > 1 else 'it'}: add inputs: {{{example}}}"
    ]


def length_notes(pipeline: Pipeline, writer: RunWriter) -> list[str]:
    """Said of a flight, or of a body of manoeuvres, that is too short for parameters or for what comes after it."""
    seconds, least, times = pipeline.state.flight_time, THRESHOLDS.shortest, writer.point_times
    usable = frozenset[int]().union(*(sensors.usable for sensors in pipeline.state.sensors))
    judged = len(times) * float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    if judged >= least or Kind.AIRSPEED not in usable:  # without an airspeed it is no length
        return []
    if seconds < least and not any(p.status is Trust.USE for p in pipeline.parameters.snapshot().parameters):
        return [
            f"{seconds:.0f} s are too short for parameters, use none of them: record at least "
            f"{least:g} s of flight with motion about every axis"
        ]
    needed = f"compare, add and diagnose (except for failed inputs) need {least:g} s in all, so"
    if seconds >= least and not {Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP} <= usable:
        told = f"wind and attitude give the flow angles for only {judged:.0f} s of this flight"
        return [f"{told}: {needed} {TELL_FLOW}{_shaken(pipeline)}"]
    learnt = f"{judged:.0f} of {seconds:.0f} s could be used for learning"
    return [f"{learnt}: {needed} record more or replay more manoeuvres together"]


#: Noise of an accelerometer [m/s^2] that is vibration: 1.7 made a walk of the wind of 0.08 m/s/sqrt(s) one of 0.16.
_SHAKES = 0.5


def _shaken(pipeline: Pipeline) -> str:
    """What hides the angles of flow as gusts do, where the IMU vibrates."""
    found = {each.name: float(np.max(each.in_use)) for each in found_noise(pipeline.state)}
    if not (noise := found.get("accelerometer", 0.0)) > _SHAKES:
        return ""
    return (
        f"; the accelerometer vibrates by {noise:.1f} m/s^2, which hides them as gusts do: mount it softly, or "
        "record it through a vibration filter"
    )


def rate_notes(stream: CoefficientStream) -> list[str]:
    """Said of an IMU and of controls that are slow beside the motion of an aeroplane, at the end of a flight."""
    pace, controls = stream.pace, stream.controls.pace
    if pace.is_too_slow:
        return [f"{too_slow(pace.rate)}, and no parameter is learnt"]
    found = []
    if pace.is_sparse:
        least = f"standard errors are therefore at least {pace.sampling_error:.1%} of a value (docs/parameters.md)"
        unknown = "what happens between its samples is not known"
        found.append(f"the IMU comes at {pace.rate:.2g} Hz: {unknown}, and {least}")
    if controls.interval > CHANGE * pace.interval:
        needed = f"at least {LOWEST_RATE:g} Hz are needed"
        unknown = "what happens between their samples is not known, and no standard error allows for it"
        too_few = controls.interval > SPARSEST_CONTROLS
        found.append(f"the controls come at {controls.rate:.2g} Hz: {needed if too_few else unknown}")
    return found


def place_notes(aircraft: Aircraft, has_error_states: bool = False) -> list[str]:
    """Places of sensors that the aircraft file does not say, and what that costs; ``has_error_states``: what vanes show
    too much is estimated.
    """
    unsaid = unsaid_keys(aircraft)
    if not unsaid:
        return []
    found = [
        f"the aircraft file does not give all of {' and '.join(unsaid)}: what is left out is taken as at the centre "
        "of gravity, and standard errors allow for some per cent of the span; measure it, or ask diagnose"
    ]
    if has_error_states and ("air_data_position", "x") in aircraft.unsaid:
        found.append(
            "errors of the vanes, and parameters, hold for vanes at the centre of gravity: ahead of it, as on a boom, "
            "vanes show false scales and offsets: write air_data_position into the aircraft file"
        )
    return found


#: Errors of air data so many times larger than what is taken as usual are no errors of a sensor.
_NO_ERROR = 3.0


def air_data_error_notes(state: StateEstimator) -> list[str]:
    """Where the errors of air data are estimated: what does not have them, and which of them cannot be."""
    if not state.options.air_data_errors:
        return []
    found = [
        "the air data errors that were found correct states and parameters, but not the samples that `compare`, "
        "`diagnose` and `add` use: `scale` and `offset` of a sensor in the aircraft file, or a calibration, correct "
        "those, too"
    ]
    errors = state.air_data_errors.items()
    wild = {name: each for name, each in errors if abs(each["value"]) > _NO_ERROR * UNKNOWN_STD_OF[name]}
    if wild:
        listed = ", ".join(f"{name} = {with_error(each['value'], each['std'])}" for name, each in wild.items())
        found.append(
            f"{listed} is more than {_NO_ERROR:g} times what is usual, and so not a sensor error: gusts, which look "
            "like scales of the angles, or another kind of fault (`check`, `diagnose`); do not use the air data "
            "errors found here"
        )
    return found


def segment_notes(body: Body) -> list[str]:
    """A list of segments beside a recording that was read whole."""
    path = body.recording.path
    beside = path.with_name(f"{path.name}.segments.yaml")
    if body.manoeuvres or not beside.is_file():
        return []
    return [f"{beside} lists the manoeuvres of this recording: give it with --segments"]


def thrust_notes(samples: Samples, aircraft: Aircraft) -> list[str]:
    """What may stand for a thrust that the model reads and nothing measures."""
    controls = samples.values[samples.kind == Kind.CONTROLS]
    reads = [axis for axis, terms in aircraft.model.terms.items() if "Tc" in terms]
    moves = len(controls) > 1 and np.nanmax(controls[:, _THROTTLE], initial=0.0) > 0.0
    if not reads or not moves or np.isfinite(controls[:, _THRUST]).any():
        return []
    return [
        f"thrust is not measured, and {listed(reads)} cannot be judged without it: under 'model' of the aircraft file "
        f"{throttle_instead(aircraft.model.terms)} uses the throttle instead"
    ]


def mass_notes(samples: Samples, aircraft: Aircraft) -> list[str]:
    """That a recorded mass is another one than the file's: its inertia is of another loading, or a unit is wrong."""
    loaded = as_loaded(aircraft, samples)
    if abs(loaded.mass / aircraft.mass - 1.0) < _OTHER_MASS:
        return []
    both = f"{loaded.mass:.4g} kg, and the aircraft file says {aircraft.mass:.4g} kg"
    told = f"the recorded mass is {both}: forces are worked out with the recorded one"
    if np.array_equal(loaded.inertia, aircraft.inertia):
        told += ", and moments with the inertia of the file, which is for another loading: give the one for this"
    return [told]


def landing_notes(body: Body, aircraft: Aircraft, on_ground: str = "") -> list[str]:
    """A recording that goes on until the aeroplane stands: what wheels did is the last that parameters have seen.

    Unless it was seen to be ``on_ground``, in words.
    """
    if on_ground:
        return [on_ground]
    samples = body.recording.samples
    known = (samples.kind == Kind.AIRSPEED) & np.isfinite(samples.values[:, 0])
    stamp, speed = samples.stamp[known], samples.values[known, 0]
    flying = np.flatnonzero(speed >= aircraft.minimum_airspeed)
    if body.manoeuvres or not len(flying) or not (samples.kind == Kind.IMU).any():
        return []
    time = (np.sort(stamp) - int(samples.stamp[samples.kind == Kind.IMU].min())) / NANOSECONDS
    begin, end = float(time[flying[0]]), float(time[flying[-1]])
    start = begin + THRESHOLDS.rolling if begin - time[0] > _STANDING else 0.0
    stop = end - THRESHOLDS.rolling
    if time[-1] - end < _STANDING or stop - start < THRESHOLDS.shortest:
        return []
    return [
        "the recording ends on the ground, and its parameters include what the wheels did: for those of the flight "
        f"give --segments a file with [{{name: flight, start: {start:.0f}, stop: {stop:.0f}}}]; compare and diagnose "
        "leave that out by themselves"
    ]


def bound_notes(aircraft: Aircraft) -> list[str]:
    """Bounds of the aircraft file that its own coefficients are outside of."""
    found = []
    for name, (low, high) in aircraft.parameter_bounds.items():
        value = aircraft.coefficients.get(name)
        if value is not None and not low <= value <= high:
            outside = f"its value in the same aircraft file, {value:g}, is outside: correct one of them"
            found.append(f"parameter_bounds {name} go from {low:g} to {high:g}, and {outside}")
    return found


def gap_notes(samples: Samples, names: Sequence[str]) -> list[str]:
    """Silences by kind of sample, with the manoeuvres that they are in; a leap of the clock is none of a sensor."""
    parts = manoeuvres(samples)
    found: list[list[str]] = [[] for _ in parts]
    leaps = [_leaps(part) for part in parts]
    for kind in Kind:
        stamps = [np.sort(part.stamp[part.kind == kind]) for part in parts]
        intervals = [np.diff(one) / NANOSECONDS for one in stamps]
        together = np.concatenate(intervals)
        longest = max(LONGEST_SILENCE, 10.0 * float(np.median(together))) if len(together) else np.inf
        for number, interval in enumerate(intervals):
            passed = np.searchsorted(leaps[number], stamps[number])
            gaps = interval[(interval > longest) & (np.diff(passed) == 0)]
            if len(gaps):
                many = f"{len(gaps)} gaps of up to" if len(gaps) > 1 else "a gap of"
                found[number].append(f"the {kind.name.lower()} samples have {many} {gaps.max():.1f} s")
    return of_manoeuvres(found, names)


def _leaps(samples: Samples) -> npt.NDArray[np.int64]:
    """Stamps [ns] from which the clock leapt ahead, beyond what ``ordering`` takes for a silence."""
    stamps = np.sort(samples.stamp)
    return stamps[:-1][np.diff(stamps) > LARGEST_LEAP] + 1


def air_data_notes(recording: Recording) -> list[str]:
    """Parts of the air data that are measured at times only; ``absences`` say what a manoeuvre never has."""
    parts = manoeuvres(recording.samples)
    probe = Kind.FIVE_HOLE not in recording.samples.kind and recording.topics.get("five_hole_probe", 0)
    messages, found = probe or recording.topics.get("air_data", 0), []
    for kind in (Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP):
        counts = np.array([(np.sum(part.kind == kind), np.sum(part.kind == Kind.IMU)) for part in parts])
        share = np.sum(counts[counts[:, 0] > 0, 1]) / max(np.sum(counts[:, 1]), 1)  # of the time that has any
        missing = 1.0 - np.sum(counts[:, 0]) / max(messages * share, 1.0)
        if 0.01 < missing < 1.0 and not _is_steady(parts, kind):
            found.append(f"{100 * missing:.0f} % of the air data have no {kind.name.lower().replace('_', ' ')}")
    return found


def _is_steady(parts: Sequence[Samples], kind: Kind) -> bool:
    """Whether a sensor comes at steps of its own all the time: messages between are of others, with another rate.

    Steps that jitter are as long as others on the average; where samples are lost they are longer.
    """
    gaps = np.concatenate([np.diff(part.stamp[part.kind == kind]) for part in parts])
    if not len(gaps):
        return False
    usual = np.median(gaps)
    return bool(np.sum(gaps[gaps > 1.5 * usual]) < 0.01 * np.sum(gaps) or np.mean(gaps) < 1.03 * usual)


def control_notes(samples: Samples) -> list[str]:
    """Controls that are measured at times only."""
    controls = samples[samples.kind == Kind.CONTROLS]
    missing = np.isnan(controls.values)
    share = float(np.mean(np.any(missing[:, ~np.all(missing, axis=0)], axis=1))) if len(missing) else 0.0
    text = f"{100 * share:.0f} % of the control samples lack values that others have"
    absurd = np.mean(is_absurd(controls)[:, : len(NAMES[Kind.CONTROLS])], axis=0) if len(missing) else np.zeros(0)
    units = [
        f"{100 * part:.0f} % of the values of {name} cannot be in SI units (degrees instead of rad?): give its unit "
        "where the recording is made, or in the map of the import"
        for name, part in zip(NAMES[Kind.CONTROLS], absurd, strict=False)
        if part > 0.01
    ]
    return units + [text] * (share > 0.01)


def late_control_notes(samples: Samples, parameters: Identifier) -> list[str]:
    """What the second step alone hears and could not use, since it came too late."""
    count = int(np.sum(np.isin(samples.kind, (Kind.CONTROLS, Kind.INPUTS, Kind.HEIGHT))))
    share = parameters.late / max(count, 1)
    return [f"{100 * share:.0f} % of the samples of controls, inputs and heights were late"] * (share > 0.01)


def why_no_start(state: StateEstimator) -> str:
    """What the filter lacks to start with: sensors of which nothing can be used, and why; else time or motion."""
    counts = state.counts()
    incomplete = "no usable numbers (all three of its accelerations and of its rates are needed)"
    if reason := _why_useless(counts["imu"], "IMU", "imu/data", incomplete):
        return reason
    if standing := state.order.counts.stamps_in_words:
        return standing
    useless = {kind: _why_useless(counts[kind], *words) for kind, words in _START_WITH.items()}
    told = [reason for kind, reason in useless.items() if counts[kind]["received"] or all(useless.values())]
    if any(told):
        reasons = "; ".join(reason for reason in told if reason)
        return f"{reasons}: {_WHAT_TO_RECORD}" if all(useless.values()) else reasons
    if slow := state.imu_in_words:
        return slow
    speed = state.aircraft.minimum_airspeed
    return (
        "it needs a second of IMU and GPS together, and then an attitude, a magnetometer, or motion of more than "
        f"{0.8 * speed:.1f} m/s (from minimum_airspeed, or from mass and wing_area of the aircraft file); without all "
        "of the GPS, such motion"
    )


def _why_useless(count: dict[str, int], name: str, topic: str, invalid: str) -> str:
    """Why nothing of a sensor can be used, by what became of its samples; empty where something can."""
    received, misfits = count["received"], count["late"] + count["wrong_stamp"]
    if not received:
        return f"no {name} came on {topic}"
    if received > count["invalid"] + misfits:
        return ""
    reasons = ((count["invalid"], invalid), (misfits, "a stamp that does not fit the IMU"))
    return f"of {received} samples of the {name} " + " and ".join(f"{n} have {why}" for n, why in reasons if n)
