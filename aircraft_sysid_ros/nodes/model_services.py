"""What the parameter node says and does about its model in flight: missing effects, add, remove."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from aircraft_sysid_msgs.msg import EffectCandidate, MissingEffects
from aircraft_sysid_msgs.srv import AddEffect, RemoveEffect

from aircraft_sysid_ros.aircraft.aerodynamic_model import term_label
from aircraft_sysid_ros.diagnosis.live.search_in_flight import (
    Terms,
    check_signals,
    check_values,
    live_flight,
    requested,
    terms_of_effect,
    windows,
)
from aircraft_sysid_ros.diagnosis.live.worker import LiveWorker
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.effects.effect import Effect
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.coefficients.pace import too_slow
from aircraft_sysid_ros.identification.conditions import listed
from aircraft_sysid_ros.identification.flight_memory import SampleMemory
from aircraft_sysid_ros.identification.model_change import change_model, with_terms
from aircraft_sysid_ros.nodes import common
from aircraft_sysid_ros.option import option, options
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.ros_messages.output_messages import BASE_FRD

Array = npt.NDArray[np.float64]

_NO_REASON = "it explains less of the flight so far than its parameters cost, which gives no reason to keep it"
_FORGOTTEN = "what was found is forgotten with what was learnt: the next search begins when enough is known again"
#: Time [s] between looks whether a search has ended.
_POLL = 0.2


@options
class DiagnosisOptions:
    """Options of the search in flight."""

    diagnosis_period: float = option(
        30.0, "Time of flight between searches for missing effects; 0: no searches.", "s", 0.0, 3600.0
    )
    diagnosis_share: float = option(0.05, "Share of one core that the searches may take on average.", "", 0.001, 1.0)


class ModelServices:
    """A part of the parameter node; lives as long as it does, with a memory of the flight while configured."""

    def __init__(self, node: Any) -> None:
        self._node = node
        self.memory = SampleMemory()
        self._added: dict[str, Terms] = {}
        self._period, self._share = 0.0, 1.0
        self._worker: LiveWorker | None = None
        self._accuracy: tuple[Array, float] = (np.full(3, np.nan), np.nan)
        self._restart()

    def _restart(self) -> None:
        self._due, self._begun, self._spent, self._stamp = -np.inf, 0.0, 0.0, 0
        self._verdict = ""  # of the newest search
        self._has_told = False  # anything, in this flight
        self._is_stale = False  # what the search that runs looks at has been forgotten

    # -- lifecycle -----------------------------------------------------------------------------------------------

    def configure(self, options: DiagnosisOptions) -> None:
        """Begin a flight."""
        self.close()
        self.memory.clear()
        self._added.clear()
        self._restart()
        self.use(options)

    def begin_anew(self) -> None:
        """What was learnt is forgotten or another's: so is what was found missing, also by a search that still runs."""
        self.memory.clear()
        self._due, self._verdict = -np.inf, ""
        self._is_stale = self._worker is not None and self._worker.busy
        if self._has_told:  # what was never looked for needs no taking back
            self._publish({"model": self._node.estimator.model.identifier, "verdict": "", "advice": _FORGOTTEN})

    def use(self, options: DiagnosisOptions) -> None:
        """Search with other options from the next search on; a period that is set begins with a search."""
        if options.diagnosis_period != self._period:
            self._due = -np.inf
        self._period, self._share = options.diagnosis_period, options.diagnosis_share

    def offer(self) -> None:
        """Publishers and services."""
        node = self._node
        self._publisher = node.publisher(MissingEffects, "~/missing_effects", common.newest_quality())
        node.service(AddEffect, "~/add_effect", lambda request, response: self._answer(request, response, self._add))
        node.service(
            RemoveEffect, "~/remove_effect", lambda request, response: self._answer(request, response, self._remove)
        )

    def start(self) -> None:
        """Look for the end of searches while the node is active."""
        self._timer = common.steady_timer(self._node, _POLL, self.publish_ready)

    def stop(self) -> None:
        """Look no more."""
        self._node.destroy_timer(self._timer)

    def close(self) -> None:
        """End the worker, if a search has ever begun."""
        if self._worker is not None:
            self._worker.close()
            self._worker = None

    # -- the flight ----------------------------------------------------------------------------------------------

    def keep(self, points: Array, row: Array | None = None) -> None:
        """Remember points, with the accuracy that the newest row (1, StateField.WIDTH) has."""
        if row is not None:
            bias_std, across = row[0, StateField.ACCELEROMETER_BIAS_STD], row[0, StateField.AIR_VELOCITY_STD]
            self._accuracy = (bias_std.copy(), float(across))
        self.memory.add(points, *self._accuracy)

    def search_if_due(self, now: float, stamp: int) -> None:
        """Begin a search at the time of flight [s] and the stamp [ns] where one is due and the processor has rested."""
        busy = self._worker is not None and self._worker.busy
        waits = self._period <= 0.0 or self._due - self._period <= now < self._due
        if busy or waits or time.monotonic() < self._begun + self._spent / self._share:
            return
        estimator = self._node.estimator
        flights = windows(estimator.aircraft, self.memory, estimator.options.step)
        if flights:
            self._due = now + self._period
            self._worker = self._worker or LiveWorker()
            self._begun, self._stamp = time.monotonic(), stamp
            self._worker.submit(flights)

    def publish_ready(self) -> None:
        """Publish the verdict of a search that has ended, unless the model has changed since it began."""
        answer = self._worker.answer() if self._worker is not None else None
        if answer is None:
            return
        self._spent, is_stale, self._is_stale = answer.processor_time, self._is_stale, False
        if answer.content is None:
            self._node.get_logger().warning(answer.failure)
            self.close()
        elif answer.content["model"] == self._node.estimator.model.identifier and not is_stale:
            candidates = [EffectCandidate(**candidate) for candidate in answer.content["candidates"]]
            self._verdict = answer.content["verdict"]
            self._publish({**answer.content, "candidates": candidates})

    def _publish(self, content: dict[str, Any]) -> None:
        self._has_told = True
        message = common.fill(MissingEffects(), content)
        self._publisher.publish(common.stamp_of(message, self._stamp, self._node.frame(BASE_FRD)))

    @property
    def search_in_words(self) -> str:
        """What the newest search for missing effects has found, or why there was none."""
        if self._period <= 0.0:
            return "not looked for: diagnosis_period is 0"
        if self._verdict:
            return self._verdict
        if self._worker is not None and self._worker.busy:
            return "not known yet: the first search of this model runs"
        return f"not looked for yet: {THRESHOLDS.live_least:g} s of settled flight are needed"

    # -- services ------------------------------------------------------------------------------------------------

    def _answer(self, request: Any, response: Any, change: Callable[[str], str]) -> Any:
        try:
            if bool(request.effect) == bool(request.expression):
                raise InputError("give either effect, an id of the library, or expression, such as CZ: alpha**3")
            response.message = change(request.effect or request.expression)
            response.success = True
            self._node.note_call("add_effect" if change == self._add else "remove_effect", response.message)
        except InputError as error:
            response.success, response.message = False, str(error)
        response.model = self._node.estimator.model.identifier
        return response

    def _requested(self, text: str) -> Effect | Terms:
        return requested(text, self._node.estimator.model.inputs)

    def _add(self, text: str) -> str:
        estimator, parsed, doubt = self._node.estimator, self._requested(text), ""
        if isinstance(parsed, Effect):
            if estimator.stream.pace.is_too_slow:
                raise InputError(too_slow(estimator.stream.pace.rate))
            flight = live_flight(estimator.aircraft, self.memory.flight(), estimator.options.step, "the flight")
            terms, pays = terms_of_effect(parsed, flight)
            doubt = "" if pays else f"; {_NO_REASON}"
            before = self._added.get(parsed.identifier, {})
            merged = {axis: (*before.get(axis, ()), *terms.get(axis, ())) for axis in {**before, **terms}}
        else:
            terms = parsed
        kept, pause = self.memory.newest(), 1.5 * estimator.options.step
        check_signals(terms, kept, estimator.model.inputs)
        check_values(terms, kept, pause, estimator.model.inputs)
        note = self._change(terms, {})
        if isinstance(parsed, Effect):
            self._added[parsed.identifier] = merged
        names = [f"{axis}_{term_label(term)}" for axis, listed in terms.items() for term in listed]
        return f"added: {' '.join(names)}{doubt}{note}"

    def _remove(self, text: str) -> str:
        parsed = self._requested(text)
        if isinstance(parsed, Effect):
            if parsed.identifier not in self._added:
                there = f"only {listed(list(self._added))}" if self._added else "nothing"
                raise InputError(f"'{parsed.identifier}' was not added in this flight, {there} was")
            terms = self._added[parsed.identifier]
        else:
            terms = parsed
        note = self._change({}, terms)
        remaining = {name: _without(listed, terms) for name, listed in self._added.items()}
        self._added = {name: listed for name, listed in remaining.items() if listed}
        names = [f"{axis}_{term_label(term)}" for axis, listed in terms.items() for term in listed]
        return f"removed: {' '.join(names)}{note}"

    def _change(self, added: Terms, removed: Terms) -> str:
        """Change the model of the estimator; a note on what started over."""
        estimator = self._node.estimator
        name = estimator.learning.published["published"]
        change = change_model(estimator, with_terms(estimator.aircraft, added, removed), self.memory.newest())
        self._due, self._verdict = -np.inf, ""  # what is missing now?
        return f"; the estimator {name} starts over with this model" if change.restarted else ""


def _without(terms: Terms, gone: Terms) -> Terms:
    left = {axis: tuple(t for t in listed if t not in gone.get(axis, ())) for axis, listed in terms.items()}
    return {axis: listed for axis, listed in left.items() if listed}
