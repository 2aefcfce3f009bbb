"""Node of the second step: reconstructed state and controls in, aerodynamic parameters out."""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from aircraft_sysid_msgs.msg import AircraftState, AxisError, MassProperties, ModelError, Parameter, Parameters
from aircraft_sysid_msgs.srv import LoadModel, Reset, SaveModel

from aircraft_sysid_ros.aircraft.configuration import Aircraft, with_prior
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification import model_change
from aircraft_sysid_ros.identification.coefficients.pace import stamped_behind
from aircraft_sysid_ros.identification.conditions import CONTROL_SIGNALS
from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.identification.learning import STALE
from aircraft_sysid_ros.identification.model_file import in_folder, load_model, save_model
from aircraft_sysid_ros.identification.monitoring import error_window as modelling
from aircraft_sysid_ros.identification.options import ParameterOptions, check_change
from aircraft_sysid_ros.identification.parameter_set import ParameterEstimate, ParameterSet
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.nodes import common
from aircraft_sysid_ros.nodes.estimator_node import PROBE_TOPIC, EstimatorNode
from aircraft_sysid_ros.nodes.model_services import DiagnosisOptions, ModelServices
from aircraft_sysid_ros.nodes.options import NodeOption, When, node_options, options_from
from aircraft_sysid_ros.reconstruction.options import LONGEST_WAIT
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.ros_messages.conversion import INPUTS_TOPIC, message_fields, nanoseconds_of, to_samples
from aircraft_sysid_ros.ros_messages.output_messages import (
    BASE_FRD,
    model_error_content,
    parameters_content,
    row_from_state,
)
from aircraft_sysid_ros.stamps import epoch_of, nanoseconds, seconds

#: Said once before the flight, perhaps: whoever publishes it with transient local durability is heard later, too.
MASS_TOPIC = "mass_properties"
INPUTS = ("control_surfaces", "height_above_ground", MASS_TOPIC)
#: Without any of them nothing is learnt of a model that reads them.
CONTROLS = ("control_surfaces", INPUTS_TOPIC)
#: Heard for the vanes; kept by the first step.
VANES_TOPIC = "air_data"
#: What an estimator hears besides: the measurements that it predicts, or would if it came to it.
MORE_INPUTS = dict.fromkeys(("auto", "rml"), ("gps/fix", "gps/vel"))
#: Whoever may set parameters must not choose where files are written: read at the start alone.
MODEL_FOLDER = NodeOption(
    "~/.ros/aircraft_sysid_ros/models", "Folder in which save_model writes models and load_model reads them.",
    when=When.STARTED,
)  # fmt: skip
_LEARNT_WITH = "what was learnt is published with it"
PRIOR = {
    "prior": NodeOption(
        "", "Folder written by `aircraft-sysid fleet`, whose flights give a prior for the parameters; empty: no prior.",
        fixed=_LEARNT_WITH, when=When.CONFIGURED,
    ),
    "airframe": NodeOption(
        "", "Airframe of `prior` that is flying; empty: the only one, the one named in the aircraft file, or all.",
        fixed=_LEARNT_WITH, when=When.CONFIGURED,
    ),
}  # fmt: skip
OPTIONS = node_options(ParameterOptions) | node_options(DiagnosisOptions) | PRIOR | {"model_folder": MODEL_FOLDER}
STATES = "state_estimator/state"
#: Time of flight [s] between messages of parameters and of model error.
PERIOD = 1.0
#: Time [s] without states, or without controls, after which whoever made them is said to be silent.
SILENT = 5.0
#: Time [s] from the first state on after which it is worth a word that nothing is to use.
LONG = 60.0


class ParameterEstimatorNode(EstimatorNode):
    """Lifecycle node that owns a Identifier while it is configured."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("parameter_estimator", INPUTS, OPTIONS, **arguments)
        self.states_received, self._heard = 0, 0.0
        self._controls_came = 0.0  # [s] the newest of them, or the activation
        self.hears_states = True  # False before it is activated: a node of this process gives them to `take_states`
        self.on_points: Callable[[Any], None] | None = None  # `live --out` keeps both for the run folder
        self.on_parameters: Callable[[Any, Any], None] | None = None
        self.on_samples: Callable[[Any], None] | None = None
        self._epoch: int | None = None  # of the states; controls before the first state wait for it
        self._due, self._has_published, self._held = -np.inf, False, ""
        self.model_services = ModelServices(self)

    def make_estimator(self, aircraft: Aircraft, values: Mapping[str, Any]) -> Identifier:
        """The estimator, compiled."""
        self._epoch, self._due, self._has_published, self._held = None, -np.inf, False, ""
        options = options_from(ParameterOptions, values)
        more = (VANES_TOPIC, *MORE_INPUTS.get(options.estimator, ()))
        if self.correction is not None and self.correction.uses_probe:
            more = (*more, PROBE_TOPIC)
        if aircraft.inputs:
            more = (*more, INPUTS_TOPIC)
        self.received = dict.fromkeys(INPUTS + more, 0)
        estimator = Identifier(with_prior(aircraft, values["prior"], values["airframe"]), options)
        estimator.warm_up()
        model_change.warm_up(aircraft, options)
        self.model_services.configure(options_from(DiagnosisOptions, values))
        return estimator

    def check_together(self, values: Mapping[str, Any]) -> None:
        """The band of frequencies must rise; what the chosen estimator is made of cannot change in flight."""
        options = options_from(ParameterOptions, values)
        if self.is_active:
            check_change(self.estimator.options, options)

    def use_options(self, values: Mapping[str, Any]) -> None:
        """Learn with other options from the next state on."""
        if self.estimator is not None:
            self.estimator.change_options(options_from(ParameterOptions, values))
            self.model_services.use(options_from(DiagnosisOptions, values))

    def offer(self) -> None:
        """Parameters, model error, services on the model."""
        self._parameters_publisher = self.publisher(Parameters, "~/parameters", common.newest_quality())
        self._model_error_publisher = self.publisher(ModelError, "~/model_error", 10)
        self.service(Reset, "~/reset", self._on_reset)
        self.service(SaveModel, "~/save_model", self._on_save)
        self.service(LoadModel, "~/load_model", self._on_load)
        self.model_services.offer()

    def activate(self) -> None:
        """Listen to the first step too."""
        self._controls_came = time.monotonic()
        if self.hears_states:
            self.hear(AircraftState, STATES, self._on_state, common.state_quality())
        self.model_services.start()
        super().activate()
        self.hear(MassProperties, MASS_TOPIC, partial(self._receive, MASS_TOPIC), common.newest_quality())

    def deactivate(self, left: Callable[[int], None]) -> None:
        """Stop listening."""
        self.model_services.stop()
        super().deactivate(left)

    def must_have(self, topic: str) -> bool:
        """States always."""
        return topic == STATES or super().must_have(topic)

    def destroy_node(self) -> None:
        """End what runs beside the node too."""
        self.model_services.close()
        super().destroy_node()

    def take(self, topic: str, message: Any) -> None:
        """One message of controls, height or mass, or of what the chosen estimator hears besides."""
        if topic in CONTROLS:
            self._controls_came = time.monotonic()
        for samples in to_samples(topic, *message_fields(topic, message), self.estimator.aircraft.inputs):
            if self.correction is not None:
                samples = self.correction.apply(samples)
            if self.on_samples is not None and topic in (*INPUTS, INPUTS_TOPIC):
                self.on_samples(samples)
            self.estimator.push_samples(samples, self._epoch)

    def finish(self) -> None:
        """Learn from the states that still wait for controls, and publish the result."""
        if self.estimator is not None and self._epoch is not None:
            self._due = -np.inf
            self._keep(self.estimator.flush())
            self._publish_due()

    def begin_anew(self) -> None:
        """Forget the parameters; the model and what has been measured of it stay."""
        now = self.estimator.time
        self.estimator.reset()
        self._take_back(now)

    def _take_back(self, now: float) -> None:
        """What was learnt until a time of flight [s] is forgotten: whoever comes later is not given it any more."""
        self.model_services.begin_anew()
        if np.isfinite(now):
            self._publish_parameters(now, self.estimator.snapshot())

    @property
    def flown(self) -> float:
        """Time [s] since the first state."""
        return float(self.estimator.stream.flown)

    def condition(self) -> tuple[str, dict[str, Any]]:
        """Whether it learns, and how many parameters may be used."""
        parameters = self.estimator.snapshot().parameters
        statuses = [p.status for p in parameters]
        published = self.estimator.learning.published
        values: dict[str, Any] = {
            "states_received": self.states_received,
            "controls_received": self.received["control_surfaces"],
            "controls_late": self.estimator.late,
            "vanes_late": self.estimator.late_vanes,
            "inputs": " ".join(item.name for item in self.estimator.aircraft.inputs),
            **{trust.name: statuses.count(trust) for trust in Trust},
            "missing_effects": self.model_services.search_in_words,
            "estimator": published["published"],
            "estimator_because": published["why"],
            "late_surfaces": ", ".join(
                f"{key} {value:.3f} ± {std:.3f} s"
                for key, (value, std) in self.estimator.learning.late_surfaces.items()
            ),
            "prior": "; ".join(self.estimator.learning.fleet.notes()),
            "health": "; ".join(self.estimator.learning.health.notes()),
            "ground": self.estimator.learning.landing.words(self.estimator.stream.start_time or 0.0),
            **self.estimator.learning.changes.summary(),
            **self.estimator.learning.integrity.summary(),
        }
        mass = self.estimator.stream.controls.mass_in_words
        words = (self._waits_for(parameters), self._controls_in_words(), mass)
        return "; ".join(filter(None, words)), values

    def _waits_for(self, parameters: Sequence[ParameterEstimate]) -> str:
        """What it waits for, or why nothing of it is to use, in words; empty while it learns."""
        if self.estimator.learning.newest is None:
            return "waiting for states in flight"
        silence = time.monotonic() - self._heard
        if self.is_active and silence > SILENT:
            return f"no states for {silence:.0f} s: the parameters are as old"
        if (behind := self.estimator.stream.controls.pace.behind) > LONGEST_WAIT:
            return f"no controls are used, {stamped_behind(behind)}"
        integrity = self.estimator.learning.integrity
        if all(integrity.holds):
            return f"nothing is to use: {integrity.summary()['held']}"
        return self._why_nothing(parameters)

    def _controls_in_words(self) -> str:
        """That controls, which the model reads, have never come, or come no more; empty: they come, or nothing does."""
        model, now = self.estimator.model, time.monotonic()
        heard = [each for each in self.inputs if each.topic in CONTROLS]
        no_states = self.states_received and now - self._heard > SILENT
        silence = now - self._controls_came
        if silence <= SILENT or no_states or not heard or not model.signals_used & {*CONTROL_SIGNALS, *model.inputs}:
            return ""
        topics = " and ".join(each.subscription.topic_name for each in heard)
        if any(self.received[topic] for topic in CONTROLS if topic in self.received):
            return f"no controls for {silence:.0f} s on {topics}, and nothing is learnt without them"
        words = f"no controls have come on {topics}"
        if any(self.count_publishers(each.topic) for each in heard):
            return words
        return f"{words}, which nobody publishes: check its name and the remaps"

    def _why_nothing(self, parameters: Sequence[ParameterEstimate]) -> str:
        """Why nothing is to use though it has learnt for long: what most parameters give as their reason."""
        if self.estimator.stream.flown < LONG or any(p.status is Trust.USE for p in parameters):
            return ""
        reason, count = Counter(p.reason for p in parameters).most_common(1)[0]
        return f"nothing is to use yet: {count} of {len(parameters)} parameters say '{reason}'"

    def take_states(self, rows: Any, stamps: Any) -> None:
        """States (n, StateField.WIDTH) with stamps (n,) [ns] from a node of this process: none can be lost."""
        if self.is_active:
            self._survive(self._learn, rows, stamps)

    def _on_state(self, message: AircraftState) -> None:
        self._learn(row_from_state(message, np.nan), np.array([nanoseconds_of(message)], dtype=np.int64))

    def _learn(self, rows: Any, stamps: Any) -> None:
        """Learn from states up to each that may bring news: what is published does not depend on how they come."""
        self._heard = time.monotonic()
        if self._epoch is None:
            self._epoch = epoch_of(int(stamps[0]))
        rows = rows.copy()
        rows[:, StateField.TIME] = seconds(stamps, self._epoch)
        while len(rows):
            count = self.estimator.states_until_news(rows[:, StateField.TIME])
            part, rows = rows[:count], rows[count:]
            self.states_received += count
            self._keep(self.estimator.push_states(part, self._epoch), part[-1:])
            self._publish_due()

    def _keep(self, points: Any, row: Any = None) -> None:
        self.model_services.keep(points, row)
        if self.on_points is not None and len(points):
            self.on_points(points)

    def _publish_due(self) -> None:
        """Publish when the time of flight says so, so that playback at any speed gives the same messages."""
        if self.estimator.learning.newest is None:
            return
        now = self.estimator.time
        if not self._due - PERIOD - STALE <= now < self._due:
            if not self._has_published:
                self._has_published = True
                self.get_logger().info("the first parameters are there")
            self._due = now + PERIOD
            self._log_holds()
            estimates, errors = self.estimator.snapshot(), self.estimator.model_error()
            if self.on_parameters is not None:
                self.on_parameters(estimates, errors)
            self._publish_parameters(now, estimates)
            self._publish_model_error(now, errors)
            self.model_services.search_if_due(now, self._stamp(now))

    def _log_holds(self) -> None:
        """Say on the terminal which axes are held from now on, and why."""
        held = str(self.estimator.learning.integrity.summary()["held"])
        axes = held.partition(":")[0]
        if axes != self._held:
            if held:
                self.get_logger().warning(f"held {held}")
            else:
                self.get_logger().info("no axis is held any more")
            self._held = axes

    def _stamp(self, time: float) -> int:
        assert self._epoch is not None
        return int(nanoseconds(np.array(time), self._epoch))

    def _publish_parameters(self, now: float, estimates: ParameterSet) -> None:
        content = parameters_content(estimates)
        content["parameters"] = [Parameter(**p) for p in content["parameters"]]
        message = common.stamp_of(common.fill(Parameters(), content), self._stamp(now), self.frame(BASE_FRD))
        self._parameters_publisher.publish(message)

    def _publish_model_error(self, now: float, errors: list[modelling.AxisError]) -> None:
        estimator = self.estimator
        content = model_error_content(estimator.model.identifier, estimator.options.error_window, errors)
        content["axes"] = [AxisError(**axis) for axis in content["axes"]]
        message = common.stamp_of(common.fill(ModelError(), content), self._stamp(now), self.frame(BASE_FRD))
        self._model_error_publisher.publish(message)

    def _on_reset(self, _request: Reset.Request, response: Reset.Response) -> Reset.Response:
        self.begin_anew()
        response.success, response.message = True, "the parameters start over"
        self.note_call("reset", response.message)
        return response

    def _model_path(self, name: str) -> Path:
        return in_folder(self.get_parameter("model_folder").value, name)

    def _on_save(self, request: SaveModel.Request, response: SaveModel.Response) -> SaveModel.Response:
        try:
            path = self._model_path(request.path)
            save_model(self.estimator, path)
            response.success, response.message = True, f"written to {path}"
        except InputError as error:
            response.success, response.message = False, str(error)
        return response

    def _on_load(self, request: LoadModel.Request, response: LoadModel.Response) -> LoadModel.Response:
        try:
            path = self._model_path(request.path)
            now = self.estimator.time
            response.model = load_model(self.estimator, path)
            self._take_back(now)  # what is known now is not from these samples
            name = self.estimator.learning.published["published"]
            anew = f"; the estimator {name} starts over" if self.estimator.learning.lends else ""
            response.success, response.message = True, f"read from {path}{anew}"
            self.note_call("load_model", response.message)
        except InputError as error:
            response.success, response.message = False, str(error)
        return response


def main() -> None:
    """Executable ``parameter_estimator``."""
    sys.exit(common.run_node(ParameterEstimatorNode))


if __name__ == "__main__":
    main()
