"""The parameter node with ``estimator: rml`` hears what it predicts and publishes what replay finds."""

import numpy as np
import pytest
from aircraft_sysid_msgs.msg import Parameters

from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.nodes.common import start
from aircraft_sysid_ros.nodes.parameter_estimator import ParameterEstimatorNode
from aircraft_sysid_ros.nodes.state_estimator import StateEstimatorNode
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.recordings.reader import read_recording


@pytest.mark.long
def test_the_node_publishes_the_parameters_of_replay(bench, raw, recording, aircraft):
    state = bench.node(StateEstimatorNode)
    node = bench.node(ParameterEstimatorNode, estimator="rml", rml_rate=25.0)
    messages = bench.listen(Parameters, "parameter_estimator/parameters")
    assert start(state) and start(node)
    assert {"air_data", "gps/fix", "gps/vel"} <= set(node.received)
    bench.play(raw, 0.0, 29.0, state)
    state.finish()
    bench.spin_until(lambda: node.states_received == state.rows_published)
    node.finish()
    bench.spin_until(lambda: bool(messages))

    replay = Pipeline(aircraft, None, ParameterOptions(estimator="rml", rml_rate=25.0))
    replay.push(read_recording(recording).samples)
    replay.flush()
    expected, published = replay.parameters.snapshot(), node.estimator.snapshot()
    assert np.array_equal(expected.covariance, published.covariance, equal_nan=True)
    assert [p.name for p in messages[-1].parameters] == [p.name for p in expected.parameters]
    values = [[p.value for p in s.parameters] for s in (expected, published)]
    assert np.array_equal(*values, equal_nan=True)
