"""The one place of the page that speaks ROS 2: a process that hears a parameter node and passes plain values on.

It ends when the other end of its pipe does. What comes through the pipe are pairs (kind, content); what goes into it
are pairs ("add" or "remove", effect or expression), each of which is answered once.
"""

from __future__ import annotations

import multiprocessing
import signal
import time
from collections.abc import Mapping
from multiprocessing.connection import Connection
from typing import Any

from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.installation import missing_ros, stay_local
from aircraft_sysid_ros.ros_messages.conversion import nanoseconds_of
from aircraft_sysid_ros.workbench.live_flight import ERRORS, MISSING, PARAMETERS, STATE
from aircraft_sysid_ros.workbench.worker import ADD, REMOVE

READY, NO_ROS, PRESENCE, ANSWER, INPUTS, VERDICT = "ready", "no ROS", "presence", "answer", "inputs", "verdict"
NODE, STATE_NODE = "parameter_estimator", "state_estimator"
#: Time [s] between states that are passed on, and between looks whether the node is there.
PERIOD = 0.25
#: Longest wait [s] for a callback, for a service to be found (tried anew: the middleware loses some), for its answer.
_SPIN, _FIND, _TRIES, _ANSWER = 0.05, 4.0, 3, 60.0
_STATE_FIELDS = (
    "accelerometer_bias", "gyro_bias", "wind_ned", "position_ned", "true_airspeed", "angle_of_attack", "sideslip",
    "innovation_consistency", "status_text",
)  # fmt: skip


def start_link(namespace: str) -> tuple[Any, Connection]:
    """The process and the pipe to it."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs, namespace), daemon=True)
    process.start()
    theirs.close()
    return process, ours


# -- messages as plain values -----------------------------------------------------------------------------------------


def errors_content(message: Any) -> dict[str, Any]:
    """Of ModelError."""
    names = ("measured", "predicted", "nrmse", "residual_rms", "over_noise")
    axes = {axis.axis: {name: float(getattr(axis, name)) for name in names} for axis in message.axes}
    return {"stamp": nanoseconds_of(message), "model": message.model, "window": float(message.window), "axes": axes}


def parameters_content(message: Any) -> dict[str, Any]:
    """Of Parameters, each as in parameters.json."""
    listed = [
        {
            "name": p.name, "value": float(p.value), "std": float(p.standard_deviation),
            "status": Trust(p.status).name, "reason": p.reason,
        }
        for p in message.parameters
    ]  # fmt: skip
    return {"stamp": nanoseconds_of(message), "model": message.model, "parameters": listed}


def missing_content(message: Any) -> dict[str, Any]:
    """Of MissingEffects."""
    texts, numbers = ("effect", "expression", "where"), ("p_value", "error_before", "error_after")
    candidates = [
        {name: getattr(c, name) for name in texts}
        | {name: float(getattr(c, name)) for name in numbers}
        | {"axes": list(c.axes), "confounded_with": list(c.confounded_with)}
        for c in message.candidates
    ]
    content = {name: getattr(message, name) for name in ("model", "verdict", "advice")}
    return {"stamp": nanoseconds_of(message), **content, "candidates": candidates}


def diagnosed(message: Any, node: str) -> dict[str, Any]:
    """Of DiagnosticArray: the inputs that a node's aircraft file names, and what its newest search found in a word."""
    values = {v.key: v.value for status in message.status if status.name == node.lstrip("/") for v in status.values}
    said = {INPUTS: tuple(values.get("inputs", "").split()), VERDICT: values.get("missing_effects", "")}
    return said if values else {}


def state_content(message: Any) -> dict[str, Any]:
    """Of AircraftState, what the page shows of it."""
    values = {name: getattr(message, name) for name in _STATE_FIELDS}
    plain = {name: v.tolist() if hasattr(v, "tolist") else v for name, v in values.items()}
    return {"stamp": nanoseconds_of(message), **plain, "standard_deviations": message.standard_deviations.tolist()}


# -- the process ------------------------------------------------------------------------------------------------------


def _serve(pipe: Connection, namespace: str) -> None:
    """Hear and ask until the pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the server
    try:
        import aircraft_sysid_msgs.msg  # noqa: F401
        import rclpy
        from rclpy.exceptions import NameValidationException
    except ImportError as error:
        pipe.send((NO_ROS, str(missing_ros(error))))
        return
    stay_local()
    rclpy.init(signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    try:
        link = _Link(pipe, namespace)
        pipe.send((READY, None))
        while True:
            link.turn()
            if pipe.poll():
                link.ask(*pipe.recv())
    except NameValidationException as error:
        pipe.send((NO_ROS, f"--namespace {namespace} is not a namespace: {error}"))
    except (EOFError, BrokenPipeError, ConnectionResetError):
        pass
    finally:
        rclpy.try_shutdown()


class _Link:
    """Subscriptions and clients on one node."""

    def __init__(self, pipe: Connection, namespace: str) -> None:
        import rclpy
        from aircraft_sysid_msgs import msg
        from diagnostic_msgs.msg import DiagnosticArray
        from rclpy.qos import QoSProfile, ReliabilityPolicy

        from aircraft_sysid_ros.nodes.common import make_executor, newest_quality

        self._pipe, self._state, self._due = pipe, b"", 0.0
        self._node = rclpy.create_node("workbench", namespace=namespace or None)
        nodes: list[Any] = [self._node]
        self._executor = make_executor(nodes)
        self._hear(msg.ModelError, "model_error", ERRORS, errors_content)
        self._hear(msg.Parameters, "parameters", PARAMETERS, parameters_content, newest_quality())
        self._hear(msg.MissingEffects, "missing_effects", MISSING, missing_content, newest_quality())
        self._said: dict[str, Any] = {INPUTS: (), VERDICT: ""}  # of the diagnostics
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._diagnosed, 10)
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        # Raw: hundreds of states a second come, and four are read.
        self._node.create_subscription(msg.AircraftState, f"{STATE_NODE}/state", self._keep, newest, raw=True)

    def _hear(self, kind: Any, topic: str, name: str, content: Any, quality: Any = 10) -> None:
        self._node.create_subscription(kind, f"{NODE}/{topic}", lambda m: self._pipe.send((name, content(m))), quality)

    def _diagnosed(self, message: Any) -> None:
        """Of all diagnostics: what the parameter node says anew."""
        for name, said in diagnosed(message, f"{self._node.get_namespace().rstrip('/')}/{NODE}").items():
            if said != self._said[name]:
                self._said[name] = said
                self._pipe.send((name, said))

    def _keep(self, state: bytes) -> None:
        self._state = state

    def turn(self) -> None:
        """Run callbacks for a moment; pass on what is due."""
        self._executor.spin_once(timeout_sec=_SPIN)
        now = time.monotonic()
        if now < self._due:
            return
        self._due = now + PERIOD
        self._pipe.send((PRESENCE, self._node.count_publishers(f"{NODE}/model_error") > 0))
        if self._state:
            from aircraft_sysid_msgs.msg import AircraftState
            from rclpy.serialization import deserialize_message

            state, self._state = self._state, b""
            self._pipe.send((STATE, state_content(deserialize_message(state, AircraftState))))

    def ask(self, kind: str, text: str) -> None:
        """Have the node add or remove an effect (an id) or an expression ("axis: term"), and pass its answer on."""
        from aircraft_sysid_msgs.srv import AddEffect, RemoveEffect

        service, name = {ADD: (AddEffect, "add_effect"), REMOVE: (RemoveEffect, "remove_effect")}[kind]
        client = self._client(service, f"{NODE}/{name}")
        if client is None:
            self._answer(kind, text, message="the parameter node does not answer: is it running?")
            return
        future = client.call_async(service.Request(**{"expression" if ":" in text else "effect": text}))
        deadline = time.monotonic() + _ANSWER
        while not future.done() and time.monotonic() < deadline:
            self.turn()
        if future.done():
            found = future.result()
            self._answer(kind, text, success=found.success, message=found.message, model=found.model)
        else:
            self._answer(kind, text, message=f"the parameter node has not answered within {_ANSWER:g} s")
        self._node.destroy_client(client)

    def _client(self, service: Any, name: str) -> Any:
        """A client that has found its service, or None."""
        for _ in range(_TRIES):
            client = self._node.create_client(service, name)
            deadline = time.monotonic() + _FIND
            while not client.service_is_ready() and time.monotonic() < deadline:
                self.turn()
            if client.service_is_ready():
                return client
            self._node.destroy_client(client)
        return None

    def _answer(self, kind: str, text: str, success: bool = False, message: str = "", model: str = "") -> None:
        content: Mapping[str, Any] = {"kind": kind, "text": text, "success": success, "message": message}
        self._pipe.send((ANSWER, {**content, "model": model}))
