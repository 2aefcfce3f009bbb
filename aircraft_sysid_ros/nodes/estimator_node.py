"""What both nodes are: lifecycle nodes that own an estimator while configured and listen while active."""

from __future__ import annotations

import re
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy

from aircraft_sysid_ros.aircraft.configuration import Aircraft, load_aircraft
from aircraft_sysid_ros.calibration.calibration_file import load_calibration
from aircraft_sysid_ros.calibration.correction import Correction
from aircraft_sysid_ros.errors import InputError, echo
from aircraft_sysid_ros.nodes import common
from aircraft_sysid_ros.nodes.inputs import Input, drain, lost_in_words
from aircraft_sysid_ros.nodes.options import AUTOSTART, ConfigurableNode, NodeOption, When
from aircraft_sysid_ros.ros_messages.conversion import topics_of

#: Topic that a calibrated probe is heard on.
PROBE_TOPIC = "five_hole_probe"
_MADE = "subscriptions are made when the node is activated"


def _check_frame(prefix: str) -> None:
    if prefix.startswith("/") or any(character.isspace() for character in prefix):
        raise InputError(f"frame_prefix begins a frame name, without leading / and without spaces, unlike {prefix!r}")


#: Parameters that both nodes have.
COMMON: dict[str, NodeOption] = {
    "aircraft_file": NodeOption(
        "",
        "Path of the aircraft file (YAML).",
        fixed="what was estimated is of this aircraft",
        when=When.CONFIGURED,
        check=lambda path: load_aircraft(path) if path else None,
    ),
    "calibration_file": NodeOption(
        "",
        "Path of a calibration file (YAML) written by `aircraft-sysid calibrate`; empty: samples are used as received.",
        fixed="samples that were corrected by it are in what was estimated",
        when=When.CONFIGURED,
        check=lambda path: load_calibration(path) if path else None,
    ),
    "frame_prefix": NodeOption(
        "",
        "Prefix of every frame name, such as uav1/, for several aircraft in one transform tree.",
        fixed="what was published names them",
        when=When.CONFIGURED,
        check=_check_frame,
    ),
    "autostart": AUTOSTART,
    "input_reliability": NodeOption(
        "best_effort",
        "best_effort matches every publisher of sensor data; reliable requests every sample of a playback: a "
        "publisher that keeps all samples waits for a slow node.",
        choices=("best_effort", "reliable"),
        fixed=_MADE,
        when=When.ACTIVATED,
    ),
    "input_depth": NodeOption(
        100,
        "Queue depth per topic with best_effort: 100 is one second of an IMU at 100 Hz; use 1000 for a faster IMU or "
        "a link that delivers in bursts.",
        low=1,
        high=100000,
        fixed=_MADE,
        when=When.ACTIVATED,
    ),
}


class EstimatorNode(ConfigurableNode, ABC):
    """Lifecycle, inputs, diagnostics; a node adds its estimator and what it publishes."""

    def __init__(self, name: str, inputs: tuple[str, ...], options: Mapping[str, NodeOption], **arguments: Any) -> None:
        super().__init__(name, {**COMMON, **options}, **arguments)
        self.estimator: Any = None
        self.correction: Correction | None = None  # of the samples, by the calibration file
        self.received = dict.fromkeys(inputs, 0)
        self.inputs: list[Input] = []  # while active
        #: The nodes of this process: what they hear is received in one order.
        self.together: Sequence[EstimatorNode] = (self,)
        self.numerical_faults = 0
        self.noted: list[str] = []  # what was changed or forgotten in this flight, and when
        self._gap: tuple[int, float] | None = None  # while deactivated in flight: number of the note, since when [s]
        self._shared: dict[str, int] = {}  # topics that several programs published on, and how many
        self._is_shared = False  # just now
        self._said = ""  # what was wrong at the last look, without numbers
        self._lost: dict[str, int] = {}  # before the newest activation
        self._told: dict[str, int] = {}  # of what was lost, at the last look
        self._offered_publishers: list[Any] = []
        self._offered_services: list[Any] = []

    # -- what a node adds ------------------------------------------------------------------------------------

    @abstractmethod
    def make_estimator(self, aircraft: Aircraft, values: Mapping[str, Any]) -> Any:
        """The estimator, compiled and ready."""

    @abstractmethod
    def offer(self) -> None:
        """Create publishers and services with ``publisher`` and ``service``."""

    @abstractmethod
    def take(self, topic: str, message: Any) -> None:
        """One input message."""

    @abstractmethod
    def finish(self) -> None:
        """Use and publish what is still held back."""

    @abstractmethod
    def begin_anew(self) -> None:
        """Forget what was estimated and go on."""

    @property
    @abstractmethod
    def flown(self) -> float:
        """Time of flight [s]; 0 before it has begun."""

    @abstractmethod
    def condition(self) -> tuple[str, dict[str, Any]]:
        """What is wrong in words, empty when nothing is, and values for the diagnostics."""

    # -- lifecycle -------------------------------------------------------------------------------------------

    def configure(self, values: Mapping[str, Any]) -> None:
        """Load the files, compile, create publishers and services."""
        if not values["aircraft_file"]:
            raise InputError("the parameter aircraft_file is empty: set it to the path of the aircraft file")
        aircraft = load_aircraft(values["aircraft_file"])
        self.correction = None
        if values["calibration_file"]:
            self.correction = Correction(load_calibration(values["calibration_file"]), aircraft)
            self.correction.warm_up()
        self.get_logger().info("loading numerical kernels; the first start compiles them, which takes up to a minute")
        self._lost.clear()
        self._told.clear()
        self._shared.clear()
        self.noted.clear()
        self._gap = None
        self.estimator = self.make_estimator(aircraft, values)
        self.offer()
        self._diagnostics_publisher = self.publisher(DiagnosticArray, "/diagnostics", 10)

    def activate(self) -> None:
        """Listen."""
        self._process_times = common.process_times()
        quality = self._input_quality()
        topics = topics_of(self.estimator.aircraft.inputs)
        for topic in self.received:
            self.hear(common.message_class(topics[topic]), topic, partial(self._receive, topic), quality)
        diagnose = partial(self._survive, self._publish_diagnostics)
        self._timer = common.steady_timer(self, common.DIAGNOSTICS_PERIOD, diagnose)
        names = sorted(heard.subscription.topic_name for heard in self.inputs)
        self.get_logger().info(f"active, and hears {', '.join(names)}")

    def deactivate(self, left: Callable[[int], None]) -> None:
        """Receive what has come, use what was held back, and stop listening."""
        drain(self.inputs, left)
        self._survive(self.finish)
        self._lost = self.lost
        for heard in self.inputs:
            heard.close()
        self.inputs.clear()
        self.destroy_timer(self._timer)

    def forget(self) -> None:
        """Forget the flight."""
        for publisher in self._offered_publishers:
            self.destroy_lifecycle_publisher(publisher)
        for service in self._offered_services:
            self.destroy_service(service)
        self._offered_publishers.clear()
        self._offered_services.clear()
        self.estimator = None

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Activate, and say for how long it did not listen, if it did before."""
        result = super().on_activate(state)
        if self._gap is not None and result == TransitionCallbackReturn.SUCCESS:
            place, begin = self._gap
            self.noted[place] += f" ({time.monotonic() - begin:.1f} s)"
            self._gap = None
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate, with a note: a run that goes on has a gap."""
        result = super().on_deactivate(state)
        if self.flown > 0.0:
            self._gap = len(self.noted), time.monotonic()
            self.noted.append(
                f"{self.get_name()} was deactivated at {self.flown:.1f} s of flight, and used nothing that came from "
                "then until it was activated"
            )
        return result

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop, from whatever state, for good."""
        self.is_over = True
        return self.on_deactivate(state) if self.is_active else TransitionCallbackReturn.SUCCESS

    # -- for the nodes ---------------------------------------------------------------------------------------

    def publisher(self, kind: Any, topic: str, quality: Any) -> Any:
        """A publisher that lives from configure to cleanup."""
        self._offered_publishers.append(self.create_lifecycle_publisher(kind, topic, quality))
        return self._offered_publishers[-1]

    def service(self, kind: Any, name: str, answer: Callable[[Any, Any], Any]) -> None:
        """A service that lives from configure to cleanup."""
        self._offered_services.append(self.create_service(kind, name, answer))

    def hear(self, kind: Any, topic: str, receive: Callable[[Any], None], quality: Any) -> None:
        """An input that lives while the node is active; of a topic that is heard already, what that does not hear."""
        take = partial(self._survive, receive)
        twin = next((heard for heard in self.inputs if heard.topic == topic), None)
        self.inputs.append(Input(self, kind, topic, take, quality, self._all_inputs, self._serve_all, twin))

    def note_call(self, service: str, what: str) -> None:
        """A service changed what is estimated: for the log, and for the notes of the run."""
        self.noted.append(f"{service} of {self.get_name()} was called at {self.flown:.1f} s of flight: {what}")
        self.get_logger().info(self.noted[-1])

    @property
    def lost(self) -> dict[str, int]:
        """Messages that were sent and did not come, by topic; of those that some were lost of."""
        lost = dict(self._lost)
        for heard in self.inputs:
            if heard.lost:
                lost[heard.topic] = lost.get(heard.topic, 0) + heard.lost
        return lost

    @property
    def shared_in_words(self) -> str:
        """That several programs have published on an input at once; empty: none have."""
        if not self._shared:
            return ""
        listed = ", ".join(f"{count} on {topic}" for topic, count in self._shared.items())
        return (
            f"several programs published at once ({listed}), and what they sent is mixed: let one of them send, or "
            "give each aircraft a namespace"
        )

    def must_have(self, topic: str) -> bool:
        """Whether no message of a topic may be lost."""
        return bool(self.get_parameter("input_reliability").value == "reliable")

    def unfinished(self) -> str:
        """Messages that were lost where none may be."""
        return lost_in_words({topic: count for topic, count in self.lost.items() if self.must_have(topic)})

    def publishers_that_matter(self) -> Sequence[Any]:
        """All."""
        return self._offered_publishers

    def frame(self, name: str) -> str:
        """A frame by its whole name."""
        return f"{self.get_parameter('frame_prefix').value}{name}"

    def _input_quality(self) -> QoSProfile:
        """Best effort with a deep queue by default: a reliable subscription does not match MAVROS."""
        if self.get_parameter("input_reliability").value == "reliable":
            return QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE)
        depth = self.get_parameter("input_depth").value
        return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)

    def _all_inputs(self) -> list[Input]:
        return [heard for node in self.together for heard in node.inputs]

    def _serve_all(self) -> None:
        for node in self.together:
            common.serve(node)

    def _survive(self, work: Callable[..., None], *arguments: Any) -> None:
        """Do some work; a matrix that cannot be solved costs what was estimated, and not the node in flight."""
        try:
            work(*arguments)
        except np.linalg.LinAlgError as error:
            self.numerical_faults += 1
            when = f"numerical fault of {self.get_name()} at {self.flown:.1f} s of flight ({error})"
            self.noted.append(f"{when}: what was estimated is forgotten, and starts over")
            self.get_logger().error(self.noted[-1])
            self.begin_anew()

    def _receive(self, topic: str, message: Any) -> None:
        self.received[topic] += 1
        self.take(topic, message)

    def _publish_diagnostics(self) -> None:
        times = common.process_times()
        share = f"{common.cpu_share(self._process_times, times):.3f}"
        self._process_times = times
        self._look_for_others()
        problem, values = self.condition()
        lost = self.lost
        new = {topic: more for topic, count in lost.items() if (more := count - self._told.get(topic, 0))}
        self._told = lost
        shared = self.shared_in_words if self._is_shared else ""
        problems = (shared, self._twin_in_words(), self._other_types_in_words(), lost_in_words(new), problem)
        problem = "; ".join(filter(None, problems))
        self._log(problem)
        level = DiagnosticStatus.WARN[0] if problem else DiagnosticStatus.OK[0]
        listed = {f"{topic}.lost": count for topic, count in lost.items()}
        values = {"cpu_share": share, "numerical_faults": self.numerical_faults, **listed, **values}
        message = common.diagnostics(self, level, problem or "ok", values)
        self._diagnostics_publisher.publish(message)

    def _look_for_others(self) -> None:
        """Who else publishes what this node hears; one that was killed is listed for 20 s more, and sends nothing."""
        self._is_shared = False
        for heard in self.inputs:
            if heard.take_turns() and (count := self.count_publishers(heard.topic)) > 1:
                topic, self._is_shared = heard.subscription.topic_name, True
                self._shared[topic] = max(count, self._shared.get(topic, 0))

    def _twin_in_words(self) -> str:
        """That another program publishes what this node does; empty: none does."""
        own = f"{self.get_fully_qualified_name()}/"
        for publisher in self._offered_publishers:
            if publisher.topic_name.startswith(own) and self.count_publishers(publisher.topic_name) > 1:
                return (
                    f"another program publishes {publisher.topic_name}, too, or was killed in the last 20 s: give each "
                    "aircraft a namespace"
                )
        return ""

    def _other_types_in_words(self) -> str:
        """Inputs that somebody publishes as another type, which ROS does not deliver; empty: none."""
        found = []
        for heard in self.inputs:
            kind, topic = heard.subscription.msg_type, heard.subscription.topic_name
            mine = f"{kind.__module__.partition('.')[0]}/msg/{kind.__name__}"
            others = sorted({info.topic_type for info in self.get_publishers_info_by_topic(topic)} - {mine})
            found += [f"{topic} is published as {echo(other)}, but heard as {mine}" for other in others]
        return "; ".join(found)

    def _log(self, problem: str) -> None:
        """Say on the terminal what has begun to be wrong, and that it is over."""
        said = re.sub(r"[\d.]+", "", problem)
        if said == self._said:
            return
        if problem:
            self.get_logger().warning(problem)
        else:
            self.get_logger().info("ok again")
        self._said = said
