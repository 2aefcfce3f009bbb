"""A vane upside down beside an autopilot: all that listens is told which sensor it is, and what to do."""

import pytest
from aircraft_sysid_msgs.msg import AircraftState, Parameter, Parameters
from diagnostic_msgs.msg import DiagnosticArray

from aircraft_sysid_ros.nodes.common import start
from aircraft_sysid_ros.nodes.parameter_estimator import ParameterEstimatorNode
from aircraft_sysid_ros.nodes.state_estimator import StateEstimatorNode


@pytest.fixture(scope="module")
def upside_down(aircraft, tmp_path_factory):
    """Messages of a flight of 36 s."""
    from aircraft_sysid_ros.recordings.storage import read_raw
    from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples
    from aircraft_sysid_ros.simulation.truth_files import write_flight

    flight = simulate_samples(aircraft, seed=3, duration=36.0)
    for stream in flight.streams:
        if stream.topic == "air_data":
            stream.fields["sideslip"] *= -1.0
    path = tmp_path_factory.mktemp("recording") / "flight"
    write_flight(flight, path)
    return read_raw(path)


@pytest.mark.long
def test_state_diagnostics_and_parameters_name_the_sensor(bench, upside_down):
    state, parameters = bench.node(StateEstimatorNode), bench.node(ParameterEstimatorNode)
    states = bench.listen(AircraftState, "state_estimator/state")
    sets = bench.listen(Parameters, "parameter_estimator/parameters")
    diagnostics = bench.listen(DiagnosticArray, "/diagnostics")
    assert start(state) and start(parameters)
    bench.play(upside_down, 0.0, 36.0, state)
    state.finish()
    bench.spin_until(lambda: parameters.states_received == state.rows_published)
    parameters.finish()
    bench.spin_until(lambda: states and states[-1].status >> 4 == 8)
    words = "sign, unit, axes or place of the sideslip contradict the other sensors"
    assert words in states[-1].status_text
    assert states[0].status >> 4 == 0
    bench.spin_until(lambda: sets and all(words in p.reason for p in sets[-1].parameters))
    assert {p.status for p in sets[-1].parameters} == {Parameter.HOLD}

    def said():
        statuses = [s for array in diagnostics for s in array.status if "state_estimator" in s.name]
        return any(s.level and s.message.startswith("sideslip:") and "reverse it" in s.message for s in statuses)

    bench.spin_until(said)
