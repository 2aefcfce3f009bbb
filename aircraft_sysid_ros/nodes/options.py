"""Parameters of a node: described, checked before they are set, and never set in vain.

A parameter takes effect at once where it can, in flight too. Where it cannot, it is refused while the node is active,
with the reason; set while the node is inactive it takes effect when the node is activated.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from typing import Any, TypeVar

from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from aircraft_sysid_ros.errors import InputError, echo
from aircraft_sysid_ros.option import Option, options_of
from aircraft_sysid_ros.spelling import did_you_mean

Options = TypeVar("Options")


class When(Enum):
    """When a new value takes effect, in words that its description ends with."""

    AT_ONCE = "takes effect at once, in flight too"
    ACTIVATED = "takes effect when the node is activated"
    CONFIGURED = "takes effect when the node is configured, or activated again, which starts over"
    STARTED = "read when the process starts"


@dataclasses.dataclass(frozen=True)
class NodeOption(Option):
    """An option as a parameter of a node; ``check`` raises InputError for what it does not accept.

    ``fixed`` says why the value cannot change while the node is active.
    """

    when: When = When.AT_ONCE
    check: Callable[[Any], object] | None = None

    def descriptor(self) -> ParameterDescriptor:
        """What ROS is told of the parameter."""
        constraints = [self.allowed] if self.choices else []
        descriptor = ParameterDescriptor(
            description=self.text,
            additional_constraints="; ".join([*constraints, self.when.value]),
            read_only=self.when is When.STARTED,
        )
        if self.low is None or self.high is None:
            return descriptor
        if isinstance(self.default, int):
            descriptor.integer_range = [IntegerRange(from_value=int(self.low), to_value=int(self.high), step=1)]
        else:
            descriptor.floating_point_range = [FloatingPointRange(from_value=self.low, to_value=self.high)]
        return descriptor

    def accept(self, name: str, value: Any) -> None:
        """Raises InputError for a value out of range, that is none of the choices, or that ``check`` refuses."""
        super().accept(f"the parameter {name}", value)
        if self.check is not None:
            self.check(value)


#: A parameter of every node.
AUTOSTART = NodeOption(True, "Configure and activate at start-up, without a lifecycle manager.", when=When.STARTED)


def node_options(kind: type[Any]) -> dict[str, NodeOption]:
    """The options that a class declares, as parameters: those that are fixed take effect at the next configuration."""
    declared = {name: vars(option) for name, option in options_of(kind).items()}
    return {
        name: NodeOption(**values, when=When.CONFIGURED if values["fixed"] else When.AT_ONCE)
        for name, values in declared.items()
    }


def options_from(kind: Callable[..., Options], values: Mapping[str, Any]) -> Options:
    """The options of a class from values by name; raises InputError where they do not fit each other."""
    return kind(**{field.name: values[field.name] for field in dataclasses.fields(kind)})  # type: ignore[arg-type]


class ConfigurableNode(LifecycleNode):
    """A lifecycle node with described parameters; ``is_active`` between its activation and its deactivation."""

    def __init__(self, name: str, options: Mapping[str, NodeOption], **arguments: Any) -> None:
        """``options``: one for each parameter."""
        super().__init__(name, **arguments)
        self.is_active = False
        self.must_keep = ""  # why the node may not forget what it works with, in words; empty: it may
        self.is_over = False  # it was shut down, and never works again
        self.set_in_flight: dict[str, Any] = {}  # parameters that were set since the first activation, newest values
        self._has_worked = False  # since it was configured
        self._to_be_used = False  # options that were set while others waited for a new configuration
        self._described = options
        self._configured_with: dict[str, Any] = {}
        for key, option in options.items():
            self.declare_parameter(key, option.default, option.descriptor())
        self._change_state = self._service_change_state.callback
        self._service_change_state.callback = self._on_change_state
        self.add_on_set_parameters_callback(self._may_be_set)
        self.add_post_set_parameters_callback(self._has_been_set)

    # -- what a node adds ----------------------------------------------------------------------------------------

    def configure(self, values: Mapping[str, Any]) -> None:
        """Make what the node works with from the values of its parameters; raises InputError."""

    def activate(self) -> None:
        """Begin to work."""

    def deactivate(self, left: Callable[[int], None]) -> None:
        """Work no more; what has come is used first, and ``left`` told how many messages of it there still are."""

    def forget(self) -> None:
        """Undo ``configure``."""

    def check_together(self, values: Mapping[str, Any]) -> None:
        """Raises InputError where values do not fit each other, or cannot change from what they are now."""

    def use_options(self, values: Mapping[str, Any]) -> None:
        """Values of all parameters, after one was set that takes effect at once."""

    def unfinished(self) -> str:
        """What the node should have got and did not, in words, when it has ended; empty: nothing."""
        return ""

    def publishers_that_matter(self) -> Sequence[Any]:
        """Publishers whose last messages must arrive before the process ends."""
        return ()

    def unknown_parameters(self) -> list[str]:
        """A sentence for each parameter that the process was given for this node and that it does not have."""
        sentences = []
        for name in sorted(set(self._parameter_overrides) - set(self._described) - {"use_sim_time"}):
            hint = did_you_mean(name, self._described)
            sentences.append(f"the parameter {name} is not one of this node{hint and f': {hint}'}")
        return sentences

    # -- lifecycle -----------------------------------------------------------------------------------------------

    def destroy_node(self) -> None:
        """End its state machine too, which rclpy leaves: the node would stay in the graph, and its services offered."""
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()

    def _on_change_state(self, request: ChangeState.Request, response: ChangeState.Response) -> ChangeState.Response:
        """Refuse a transition that the state does not have: rclpy raises for it, and the client waits for ever."""
        wanted, state = request.transition, self._state_machine.current_state[1]
        there = {label: number for number, label, *_ in self._state_machine.available_transitions}
        if wanted.label in there or (not wanted.label and wanted.id in there.values()):
            return self._change_state(request, response)
        names = {number: label for number, label, *_ in self._state_machine.transition_graph}
        name = echo(wanted.label) or names.get(wanted.id, f"transition {wanted.id}")
        possible = f"possible: {', '.join(there)}" if there else "it is the last one"
        self.get_logger().error(f"'{name}' is refused: the node is {state} ({possible})")
        response.success = False
        return response

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Check the parameters and configure; FAILURE with one sentence in the log."""
        try:
            values = self.values()
            for name, option in self._described.items():
                option.accept(name, values[name])
            self.check_together(values)
            self.configure(values)
        except InputError as error:
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        except Exception as error:  # rclpy would keep it to itself
            self.get_logger().fatal(f"a fault of the program, {type(error).__name__}: {error}")
            raise
        self._configured_with = self._needing_configuration()
        self.set_in_flight.clear()
        self._has_worked = self._to_be_used = False
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget, unless what the node works with must be kept."""
        if self.must_keep:
            self.get_logger().error(f"'cleanup' is refused: {self.must_keep}")
            return TransitionCallbackReturn.FAILURE
        self.forget()
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Activate; before that configure again if a parameter was set that needs it."""
        if self._configured_with != self._needing_configuration():
            self._configured_with = {}
            self.forget()
            result = self.on_configure(state)
            if result != TransitionCallbackReturn.SUCCESS:
                return result
        if self._to_be_used:
            self.use_options(self.values())
            self._to_be_used = False
        self.activate()
        self.is_active = self._has_worked = True
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate."""
        self.end()
        return super().on_deactivate(state)

    def end(self, left: Callable[[int], None] = lambda count: None) -> None:
        """Deactivate if active, without a transition: the process ends."""
        if self.is_active:
            self.is_active = False
            self.deactivate(left)

    # -- parameters ----------------------------------------------------------------------------------------------

    def values(self) -> dict[str, Any]:
        """Values of all described parameters."""
        return {name: self.get_parameter(name).value for name in self._described}

    def _needing_configuration(self) -> dict[str, Any]:
        return {
            name: self.get_parameter(name).value
            for name, option in self._described.items()
            if option.when is When.CONFIGURED
        }

    def _may_be_set(self, parameters: list[Any]) -> SetParametersResult:
        now = self.values()
        wanted = {p.name: p.value for p in parameters if p.name in now and p.value != now[p.name]}
        try:
            for name, value in wanted.items():
                option = self._described[name]
                if self.must_keep and self._configured_with and option.when is When.CONFIGURED:
                    raise InputError(f"{name} cannot change: {self.must_keep}")
                if self.is_active and option.when is not When.AT_ONCE:
                    why = f"since {option.fixed}: deactivate the node first"
                    raise InputError(f"{name} cannot change while the node is active, {why}")
                option.accept(name, value)
            if wanted:
                self.check_together({**now, **wanted})
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _has_been_set(self, parameters: list[Any]) -> None:
        given = {p.name: p.value for p in parameters if p.name in self._described}
        used = {name: value for name, value in given.items() if self._described[name].when is When.AT_ONCE}
        if not used:
            return
        if self._configured_with == self._needing_configuration():
            self.use_options(self.values())
        else:  # it is made anew when it is activated, unless what waits for that is set back
            self._to_be_used = True
        if self._has_worked:
            self.set_in_flight.update(used)
            since = "from now on" if self.is_active else "from its activation on"
            self.get_logger().info(f"{since} " + ", ".join(f"{name} = {value}" for name, value in used.items()))
