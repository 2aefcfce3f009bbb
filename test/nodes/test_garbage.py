"""Messages that no sensor should send: the nodes go on, count them, and find the state again."""

import numpy as np
import pytest
from aircraft_sysid_msgs.msg import AircraftState

from aircraft_sysid_ros.nodes.common import message_class, start
from aircraft_sysid_ros.nodes.parameter_estimator import ParameterEstimatorNode
from aircraft_sysid_ros.nodes.state_estimator import StateEstimatorNode
from aircraft_sysid_ros.ros_messages.conversion import TOPICS

BEFORE, BETWEEN, AFTER = 6.0, 4.0, 27.0  # [s] of flight; the bag has 28
#: Far in the future, and the last that a stamp can hold.
FUTURE, LAST = 2_000_000_000, 2**31 - 1


def filled(message, value):
    """Every floating-point field of a message, however deep, set to a value."""
    for name, kind in message.get_fields_and_field_types().items():
        if name == "header":
            continue
        if kind in ("double", "float"):
            setattr(message, name, value)
        elif kind.startswith("double["):
            getattr(message, name)[:] = value
        elif "/" in kind:
            filled(getattr(message, name), value)
    return message


def garbage(topic, value, seconds, count):
    kind = message_class(TOPICS[topic])
    for i in range(count):
        message = filled(kind(), value)
        message.header.stamp.sec = seconds
        message.header.stamp.nanosec = i * 1_000_000
        yield message


def fly_with(bench, raw, throws):
    """Flight, garbage, flight, other garbage and so on; the nodes and the states that were heard."""
    state, parameters = bench.node(StateEstimatorNode), bench.node(ParameterEstimatorNode)
    states = bench.listen(AircraftState, "state_estimator/state")
    assert start(state) and start(parameters)
    bench.play(raw, 0.0, BEFORE, state)
    at = BEFORE
    for throw in throws:
        now = int(raw.log_time[0] // 1_000_000_000 + at)
        wanted = sum(state.received.values()) + sum(parameters.received.values())
        for topic, messages in throw(now).items():
            publisher = bench.publisher(message_class(TOPICS[topic]), topic)
            for message in messages:
                publisher.publish(message)
                wanted += 1
        bench.spin_until(
            lambda wanted=wanted: sum(state.received.values()) + sum(parameters.received.values()) >= wanted
        )
        bench.play(raw, at, at + BETWEEN, state)
        at += BETWEEN
        bench.spin_until(lambda: parameters.states_received == state.rows_published == len(states))
        assert states[-1].status == AircraftState.STATUS_OK, throw
    bench.play(raw, at, AFTER, state)
    bench.spin_until(lambda: parameters.states_received == state.rows_published == len(states))
    return state, parameters, states


TOPICS_IN = tuple(topic for topic in TOPICS if topic not in ("five_hole_probe", "mass_properties"))


def everywhere(value, seconds=None, count=30):
    return lambda now: {t: garbage(t, value, now if seconds is None else seconds, count) for t in TOPICS_IN}


def no_orientation(now):
    """The covariance says that there is an orientation, and it is all zero."""
    messages = list(garbage("imu/data", 0.0, now, 30))
    for message in messages:
        message.linear_acceleration.z = 9.8
        message.orientation.w = 0.0
        message.orientation_covariance[[0, 4, 8]] = 0.01
    return {"imu/data": messages}


@pytest.mark.long
@pytest.mark.parametrize(
    "throws",
    [
        (everywhere(np.nan), everywhere(np.inf), everywhere(1e300), no_orientation),
        pytest.param(
            (everywhere(0.0, seconds=0), everywhere(1.0, seconds=0), everywhere(0.5, seconds=FUTURE, count=1)),
            marks=pytest.mark.long,
        ),
        pytest.param((everywhere(np.nan, seconds=FUTURE), everywhere(0.5, seconds=LAST)), marks=pytest.mark.long),
    ],
    ids=["values", "stamps-behind", "stamps-ahead"],
)
def test_the_nodes_survive_and_recover(bench, raw, recording, throws):
    check_recovery(bench, raw, recording, throws)


def check_recovery(bench, raw, recording, throws):
    from aircraft_sysid_ros.simulation.truth_files import load_truth

    _, parameters, states = fly_with(bench, raw, throws)
    last = states[-1]
    seconds = last.header.stamp.sec + 1e-9 * last.header.stamp.nanosec
    assert seconds == pytest.approx(raw.log_time[0] * 1e-9 + AFTER, abs=1.0)
    assert last.status == AircraftState.STATUS_OK
    _, truth = load_truth(recording)
    at = int(np.argmin(abs(truth["stamp"] * 1e-9 - seconds)))
    assert np.array(last.wind_ned) == pytest.approx(truth["wind"][at], abs=1.0)
    assert last.true_airspeed == pytest.approx(truth["airspeed"][at], abs=1.0)
    assert np.all(np.isfinite(last.standard_deviations))
    estimates = parameters.estimator.snapshot()
    assert np.isfinite([p.value for p in estimates.parameters]).all()
    assert estimates.time * 1e9 + parameters._epoch == pytest.approx(seconds * 1e9, abs=2e9)
    lift = next(p for p in estimates.parameters if p.name == "CZ_alpha")
    assert lift.value == pytest.approx(-4.616, abs=0.7)


def failing_once(work):
    """The same work, but the first time it meets a matrix that cannot be solved."""
    calls = iter([True])

    def done(*arguments):
        if next(calls, False):
            raise np.linalg.LinAlgError("Singular matrix")
        return work(*arguments)

    return done


@pytest.mark.long
def test_a_matrix_that_cannot_be_solved_ends_no_node(bench, raw):
    state, parameters = bench.node(StateEstimatorNode), bench.node(ParameterEstimatorNode)
    states = bench.listen(AircraftState, "state_estimator/state")
    assert start(state) and start(parameters)
    bench.play(raw, 0.0, BEFORE, state)
    bench.spin_until(lambda: parameters.states_received == state.rows_published > 0)
    before = state.rows_published
    state.estimator.push = failing_once(state.estimator.push)
    parameters.estimator.push_states = failing_once(parameters.estimator.push_states)
    bench.play(raw, BEFORE, 3.0 * BEFORE, state)
    bench.spin_until(lambda: parameters.states_received == state.rows_published == len(states))
    assert (state.numerical_faults, parameters.numerical_faults) == (1, 1)
    assert state.rows_published - before > 1000 and states[-1].status == AircraftState.STATUS_OK
    assert parameters.estimator.learning.least_squares.state.updates.min() > 100
