"""`ros2 param set` through its services: what is set takes effect, or is refused with the reason."""

import time
from dataclasses import replace

import numpy as np
import pytest
import yaml
from aircraft_sysid_msgs.msg import AircraftState
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters, SetParametersAtomically
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter

from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.nodes import parameter_estimator, state_estimator
from aircraft_sysid_ros.nodes.common import start
from aircraft_sysid_ros.nodes.estimator_node import COMMON
from aircraft_sysid_ros.nodes.model_services import DiagnosisOptions
from aircraft_sysid_ros.nodes.options import When
from aircraft_sysid_ros.nodes.parameter_estimator import ParameterEstimatorNode
from aircraft_sysid_ros.nodes.state_estimator import StateEstimatorNode
from aircraft_sysid_ros.option import options_of
from aircraft_sysid_ros.reconstruction.options import StateOptions
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.samples import concatenate

SUCCESS = TransitionCallbackReturn.SUCCESS
STATE_OPTIONS = COMMON | state_estimator.OPTIONS
PARAMETER_OPTIONS = COMMON | parameter_estimator.OPTIONS


def messages(values):
    return [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]


def put(bench, name, **values):
    """Set each by itself, as `ros2 param set` does; the results."""
    return bench.call(SetParameters, f"/{name}/set_parameters", parameters=messages(values)).results


def put_together(bench, name, **values):
    """Set all or none; the result."""
    kind, service = SetParametersAtomically, f"/{name}/set_parameters_atomically"
    return bench.call(kind, service, parameters=messages(values)).result


def values_of(bench, name, *names):
    found = bench.call(GetParameters, f"/{name}/get_parameters", names=list(names)).values
    return [Parameter.from_parameter_msg(_named(value)).value for value in found]


def _named(value):
    from rcl_interfaces.msg import Parameter as Message

    return Message(name="value", value=value)


def other_value(option, value):
    """A value that is allowed and is not ``value``."""
    if option.choices:
        return next(choice for choice in option.choices if choice != value)
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value + 1
    return 0.5 * (value + option.high) if isinstance(value, float) else "elsewhere.yaml"


# -- in flight -----------------------------------------------------------------------------------------------


@pytest.fixture
def flying(bench, raw):
    """Both nodes in flight, and what their estimators were given: samples and rows, in order."""
    state, parameters = bench.node(StateEstimatorNode), bench.node(ParameterEstimatorNode)
    given = {"state": [], "rows": [], "parameters": []}
    state.on_samples, state.on_rows = given["state"].append, given["rows"].append
    assert start(state) and start(parameters)
    push = parameters.estimator.push_samples

    def kept(samples, epoch):
        given["parameters"].append(samples)
        push(samples, epoch)

    parameters.estimator.push_samples = kept

    def fly(begin, end):
        bench.play(raw, begin, end, state)
        bench.spin_until(lambda: parameters.states_received == state.rows_published)

    return state, parameters, given, fly


@pytest.mark.long
def test_a_change_in_flight_divides_it_to_the_last_bit(bench, aircraft, flying):
    """The nodes give what estimators give that are told the same between the same two samples."""
    state, parameters, given, fly = flying
    fly(0.0, 12.0)
    assert put_together(bench, "state_estimator", horizon=0.2, gate=3.0).successful
    bench.spin_until(lambda: parameters.states_received == state.rows_published)
    learning = {"forgetting_time": 5.0, "excitation": 1.0, "relearn": False}
    assert put_together(bench, "parameter_estimator", **learning).successful
    at = {name: len(parts) for name, parts in given.items()}
    fly(12.0, 25.0)
    assert state.trigger_deactivate() == SUCCESS
    bench.spin_until(lambda: parameters.states_received == state.rows_published)
    assert parameters.trigger_deactivate() == SUCCESS

    def first_step(options):
        estimator = StateEstimator(aircraft)
        estimator.push(concatenate(given["state"][: at["state"]]))
        estimator.change_options(options)
        estimator.push(concatenate(given["state"][at["state"] :]))
        estimator.flush()
        return estimator.state_vector

    def second_step(options):
        estimator, epoch = Identifier(aircraft), parameters._epoch
        estimator.push_samples(concatenate(given["parameters"][: at["parameters"]]), epoch)
        estimator.push_states(np.vstack(given["rows"][: at["rows"]]), epoch)
        estimator.change_options(options)
        estimator.push_samples(concatenate(given["parameters"][at["parameters"] :]), epoch)
        estimator.push_states(np.vstack(given["rows"][at["rows"] :]), epoch)
        estimator.flush()
        return estimator.learning.least_squares.state.theta

    assert np.array_equal(state.estimator.state_vector, first_step(StateOptions(horizon=0.2, gate=3.0)))
    assert not np.array_equal(state.estimator.state_vector, first_step(StateOptions(horizon=0.2)))
    options = replace(ParameterOptions(), **learning)
    assert np.array_equal(parameters.estimator.learning.least_squares.state.theta, second_step(options))
    assert not np.array_equal(parameters.estimator.learning.least_squares.state.theta, second_step(ParameterOptions()))


@pytest.mark.long
def test_parameters_without_new_states_are_said_to_be_old(flying, monkeypatch):
    """Their state estimator was killed in flight: what they say is of then, and was "ok" for as long as nobody came."""
    _, parameters, _, fly = flying
    fly(0.0, 12.0)
    assert parameters.condition()[0] == ""
    later = time.monotonic() + 2.0 * parameter_estimator.SILENT
    monkeypatch.setattr(parameter_estimator.time, "monotonic", lambda: later)
    assert "no states for 10 s" in parameters.condition()[0]


@pytest.mark.long
def test_controls_that_come_no_more_are_said(bench, flying, monkeypatch):
    """The reader of the servos had died in flight, nothing was learnt any more, and /diagnostics was ok."""
    _, parameters, _, fly = flying
    fly(0.0, 12.0)
    later = time.monotonic() + 2.0 * parameter_estimator.SILENT
    monkeypatch.setattr(parameter_estimator.time, "monotonic", lambda: later)
    parameters._heard = later  # states come
    assert parameters.condition()[0] == "no controls for 10 s on /control_surfaces, and nothing is learnt without them"
    parameters.received["control_surfaces"] = 0
    assert parameters.condition()[0] == "no controls have come on /control_surfaces"
    bench.helper.destroy_publisher(bench.publishers.pop("control_surfaces"))
    bench.spin_until(lambda: "which nobody publishes: check its name" in parameters.condition()[0], 20.0)
    parameters._heard = later - 10.0
    assert "no states for 10 s" in parameters.condition()[0] and "controls" not in parameters.condition()[0]


@pytest.mark.long
def test_that_nothing_is_to_use_for_long_is_said_with_the_reason_of_most(flying, monkeypatch):
    """Without vanes all 32 were held for a whole flight, and /diagnostics was ok."""
    _, parameters, _, fly = flying
    fly(0.0, 12.0)
    found = parameters.estimator.snapshot()
    held = [replace(p, status=Trust.HOLD, reason="no angle" if k else "other") for k, p in enumerate(found.parameters)]
    monkeypatch.setattr(parameters.estimator, "snapshot", lambda: replace(found, parameters=tuple(held)))
    assert parameters.condition()[0] == ""  # 12 s are not long
    monkeypatch.setattr(parameter_estimator, "LONG", 5.0)
    assert parameters.condition()[0] == "nothing is to use yet: 31 of 32 parameters say 'no angle'"
    monkeypatch.setattr(
        parameters.estimator, "snapshot",
        lambda: replace(found, parameters=(replace(held[0], status=Trust.USE), *held[1:])),
    )  # fmt: skip
    assert parameters.condition()[0] == ""


@pytest.mark.long
def test_a_shorter_horizon_is_seen_in_the_states(bench, raw):
    node = bench.node(StateEstimatorNode, horizon=1.0)
    states = bench.listen(AircraftState, "state_estimator/state")
    assert start(node)

    def lag():
        node._push()
        bench.spin_until(lambda: len(states) == node.rows_published)
        newest = states[-1].header.stamp
        return (node.estimator.order.clock - newest.sec * 10**9 - newest.nanosec) * 1e-9

    bench.play(raw, 0.0, 6.0, node)
    assert lag() == pytest.approx(1.0, abs=0.03)  # two IMU samples, and the delays of sensors
    assert put(bench, "state_estimator", horizon=0.1)[0].successful
    bench.play(raw, 6.0, 7.0, node)
    assert lag() == pytest.approx(0.1, abs=0.03)
    assert put(bench, "state_estimator", horizon=2.0)[0].successful
    published = node.rows_published
    bench.play(raw, 7.0, 8.5, node)
    node._push()
    assert node.rows_published == published  # they wait for samples that are two seconds late
    bench.play(raw, 8.5, 11.0, node)
    assert lag() == pytest.approx(2.0, abs=0.03)
    stamps = [s.header.stamp.sec * 10**9 + s.header.stamp.nanosec for s in states]
    assert np.all(np.diff(stamps) > 0)


@pytest.mark.long
def test_searches_for_missing_effects_can_be_begun_and_ended_in_flight(bench, flying):
    _, parameters, _, fly = flying
    services = parameters.model_services
    assert put(bench, "parameter_estimator", diagnosis_period=0.0)[0].successful
    fly(0.0, 8.0)
    assert services._due == -np.inf, "a search was begun though none was wanted"
    assert put_together(bench, "parameter_estimator", diagnosis_period=20.0, diagnosis_share=0.5).successful
    assert (services._period, services._share) == (20.0, 0.5)


# -- what takes effect, and what is refused -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "described"), [(StateEstimatorNode, STATE_OPTIONS), (ParameterEstimatorNode, PARAMETER_OPTIONS)]
)
def test_while_active_every_parameter_takes_effect_or_is_refused_with_the_reason(bench, kind, described):
    node = bench.node(kind)
    name = node.get_name()
    assert start(node)
    before = node.values()
    assert before.keys() == described.keys()
    wanted = {key: other_value(option, before[key]) for key, option in described.items()}
    at_once = 0
    for (key, value), result in zip(wanted.items(), put(bench, name, **wanted), strict=True):
        option = described[key]
        now = node.get_parameter(key).value
        assert result.successful == (option.when is When.AT_ONCE), (key, result.reason)
        if result.successful:
            at_once += 1
            assert now == value
            if key not in options_of(DiagnosisOptions):
                assert getattr(node.estimator.options, key) == value
            continue
        assert now == before[key]
        assert key in result.reason
        if option.when is not When.STARTED:
            assert option.fixed in result.reason and "deactivate" in result.reason
    assert at_once > 5
    assert all(r.successful for r in put(bench, name, aircraft_file=before["aircraft_file"]))  # nothing is changed


def test_inactive_a_parameter_acts_when_the_node_is_activated_again(bench, aircraft_file, tmp_path):
    node = bench.node(ParameterEstimatorNode)
    assert start(node)
    heavier = yaml.safe_load(aircraft_file.read_text()) | {"mass": 3.0}
    (tmp_path / "heavier.yaml").write_text(yaml.safe_dump(heavier))
    assert node.trigger_deactivate() == SUCCESS
    first = node.estimator
    assert node.trigger_activate() == SUCCESS
    assert node.estimator is first  # nothing was set: it goes on
    assert node.trigger_deactivate() == SUCCESS
    values = {"aircraft_file": str(tmp_path / "heavier.yaml"), "step": 0.05, "estimator": "fourier"}
    assert all(result.successful for result in put(bench, "parameter_estimator", **values))
    assert node.trigger_activate() == SUCCESS
    assert node.estimator is not first
    assert node.estimator.aircraft.mass == 3.0
    assert (node.estimator.options.step, node.estimator.options.estimator) == (0.05, "fourier")
    bench.spin_until(lambda: node.count_publishers("/parameter_estimator/parameters") == 1)


@pytest.mark.long
def test_inactive_what_is_set_beside_a_new_configuration_waits_for_it(bench):
    """The old estimator was told of options that it cannot take, and the process ended with a traceback."""
    for kind, name, other, later in (
        (ParameterEstimatorNode, "parameter_estimator", {"step": 0.05}, {"excitation": 3.0}),
        (StateEstimatorNode, "state_estimator", {"calm_air": True}, {"gate": 6.0}),
    ):
        node = bench.node(kind)
        assert start(node)
        usual = {key: node.get_parameter(key).value for key in other}
        assert node.trigger_deactivate() == SUCCESS
        first = node.estimator
        assert all(result.successful for result in put(bench, name, **other, **later))
        assert all(result.successful for result in put(bench, name, **usual))  # set back: nothing is made anew
        assert node.trigger_activate() == SUCCESS
        ((key, value),) = later.items()
        assert node.estimator is first and getattr(node.estimator.options, key) == value
        assert node.trigger_deactivate() == SUCCESS
        assert all(result.successful for result in put(bench, name, **other, **later))
        assert node.trigger_activate() == SUCCESS
        assert node.estimator is not first and getattr(node.estimator.options, key) == value


@pytest.mark.long
def test_what_is_set_while_deactivated_in_flight_and_the_gap_are_noted(bench, flying):
    state, _, _, fly = flying
    fly(0.0, 12.0)
    assert put(bench, "state_estimator", gate=7.0)[0].successful
    assert state.trigger_deactivate() == SUCCESS
    assert put(bench, "state_estimator", gate=6.0)[0].successful
    assert state.set_in_flight == {"gate": 6.0}
    assert state.trigger_activate() == SUCCESS
    (note,) = state.noted
    assert note.startswith("state_estimator was deactivated at 1") and note.endswith(" s)")
    assert not state.is_over
    assert state.trigger_shutdown() == SUCCESS and state.is_over


def test_inactive_the_queue_of_inputs_is_that_of_the_next_activation(bench):
    node = bench.node(StateEstimatorNode, input_reliability="best_effort")
    assert start(node)
    assert node.trigger_deactivate() == SUCCESS
    estimator = node.estimator
    assert put(bench, "state_estimator", input_depth=7)[0].successful
    assert node.trigger_activate() == SUCCESS
    assert {each.subscription.qos_profile.depth for each in node.inputs} == {7}
    assert node.estimator is estimator


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("horizon", 9.0, "out of range"),
        ("horizon", float("nan"), "out of range"),
        ("horizon", 1, "Wrong parameter type"),
        ("maximum_iterations", 0, "out of range"),
        ("input_reliability", "perhaps", "must be one of best_effort or reliable, not 'perhaps'"),
        ("aircraft_file", "nowhere.yaml", "cannot read the aircraft file nowhere.yaml"),
        ("calibration_file", "nowhere.yaml", "cannot read the calibration file nowhere.yaml"),
        ("autostart", False, "read-only"),
        ("nonsense", 1.0, "undeclared"),
    ],
)
def test_a_wrong_value_is_refused_in_words(bench, name, value, words):
    node = bench.node(StateEstimatorNode)
    result = put(bench, "state_estimator", **{name: value})[0]
    assert not result.successful
    assert words in result.reason
    assert node.trigger_configure() == SUCCESS


def test_two_at_once_are_set_both_or_not_at_all(bench):
    node = bench.node(ParameterEstimatorNode)
    name = "parameter_estimator"
    alone = put(bench, name, lowest_frequency=3.0)[0]
    assert not alone.successful and "set both together" in alone.reason  # it would pass the highest
    assert put_together(bench, name, lowest_frequency=3.0, highest_frequency=5.0).successful
    assert values_of(bench, name, "lowest_frequency", "highest_frequency") == [3.0, 5.0]
    assert start(node)
    refused = put_together(bench, name, forgetting_time=30.0, step=0.02)
    assert not refused.successful and "step cannot change" in refused.reason
    assert not put_together(bench, name, forgetting_time=30.0, excitation=-1.0).successful
    assert values_of(bench, name, "forgetting_time") == [120.0]
    assert node.estimator.options.forgetting_time == 120.0
    assert put_together(bench, name, forgetting_time=30.0, excitation=1.0).successful
    assert (node.estimator.options.forgetting_time, node.estimator.options.excitation) == (30.0, 1.0)


def test_what_the_transforms_are_weighted_with_cannot_change_while_they_grow(bench):
    node = bench.node(ParameterEstimatorNode, estimator="fourier")
    assert start(node)
    result = put(bench, "parameter_estimator", forgetting_time=30.0)[0]
    assert not result.successful and "the estimator fourier" in result.reason
    assert put(bench, "parameter_estimator", excitation=1.0)[0].successful
    assert node.estimator.learning.estimator._setting.excitation == 1.0


@pytest.mark.parametrize(
    ("kind", "described"), [(StateEstimatorNode, STATE_OPTIONS), (ParameterEstimatorNode, PARAMETER_OPTIONS)]
)
def test_descriptions_say_what_is_allowed_and_when_it_takes_effect(bench, kind, described):
    node = bench.node(kind)
    names = list(described)
    found = bench.call(DescribeParameters, f"/{node.get_name()}/describe_parameters", names=names).descriptors
    for name, descriptor in zip(names, found, strict=True):
        option = described[name]
        assert option.when.value in descriptor.additional_constraints
        assert descriptor.read_only == (option.when is When.STARTED)
        assert all(choice in descriptor.additional_constraints for choice in option.choices)
        ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
        assert [(r.from_value, r.to_value) for r in ranges] == [(option.low, option.high)] * (option.low is not None)
        assert bool(option.fixed) == (option.when in (When.ACTIVATED, When.CONFIGURED)), name
