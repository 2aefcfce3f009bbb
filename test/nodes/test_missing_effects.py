"""A flight with a hidden effect over real ROS 2: the node names it, takes it in, and its error falls."""

from types import SimpleNamespace

import numpy as np
import pytest
from aircraft_sysid_msgs.msg import MissingEffects, ModelError, Parameters
from aircraft_sysid_msgs.srv import AddEffect, RemoveEffect, Reset

from aircraft_sysid_ros.diagnosis.live.worker import Answer
from aircraft_sysid_ros.nodes import model_services
from aircraft_sysid_ros.nodes.common import start
from aircraft_sysid_ros.nodes.parameter_estimator import ParameterEstimatorNode
from aircraft_sysid_ros.nodes.state_estimator import StateEstimatorNode
from aircraft_sysid_ros.recordings.storage import read_raw
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples
from aircraft_sysid_ros.simulation.truth_files import write_flight

NODE = "/parameter_estimator"


@pytest.fixture(scope="module")
def hidden(aircraft, tmp_path_factory):
    """Messages of 100 s in which the dihedral effect depends on lift."""
    flight = simulate_samples(aircraft, 11, 100.0, rate=200.0, hidden=[("dihedral_alpha", 1.0)], manoeuvres="standard")
    path = tmp_path_factory.mktemp("hidden") / "flight"
    write_flight(flight, path)
    return read_raw(path)


def add(bench, effect="", expression=""):
    return bench.call(AddEffect, f"{NODE}/add_effect", effect=effect, expression=expression)


def remove(bench, effect="", expression=""):
    return bench.call(RemoveEffect, f"{NODE}/remove_effect", effect=effect, expression=expression)


def play(bench, raw, begin, end, state, parameters):
    for piece in np.arange(begin, end, 20.0):  # no more than the queues hold
        bench.play(raw, piece, min(piece + 20.0, end), state)
        bench.spin_until(lambda: parameters.states_received == state.rows_published)


def errors(messages, axis):
    return [a.nrmse for m in messages for a in m.axes if a.axis == axis]


@pytest.mark.long
def test_missing_effects_are_named_added_and_taken_away(bench, hidden):
    state = bench.node(StateEstimatorNode)
    node = bench.node(ParameterEstimatorNode, diagnosis_period=25.0, diagnosis_share=1.0)
    found = bench.listen(MissingEffects, "parameter_estimator/missing_effects")
    model_errors = bench.listen(ModelError, "parameter_estimator/model_error")
    parameters = bench.listen(Parameters, "parameter_estimator/parameters")
    assert start(state) and start(node)
    old = node.estimator.model.identifier
    play(bench, hidden, 0.0, 84.0, state, node)
    bench.spin_until(lambda: bool(found), 60.0)
    assert (found[0].model, found[0].verdict) == (old, "missing")
    first = found[0].candidates[0]
    assert (first.effect, list(first.axes)) == ("dihedral_alpha", ["Cl"])
    assert first.error_after < 0.5 * first.error_before

    before = node.estimator.snapshot()
    answer = add(bench, "dihedral_alpha")
    assert answer.success and "Cl_alpha*beta" in answer.message, answer.message
    assert answer.model == node.estimator.model.identifier != old
    after = {p.name: p for p in node.estimator.snapshot().parameters}
    for p in before.parameters:
        if not p.name.startswith("Cl"):
            assert (after[p.name].value, after[p.name].std) == (p.value, p.std)
    base = errors(model_errors, "Cl")[-8:]
    model_errors.clear()
    parameters.clear()
    play(bench, hidden, 84.0, 98.0, state, node)
    bench.spin_until(lambda: len(model_errors) > 10)
    assert {m.model for m in model_errors} == {m.model for m in parameters} == {answer.model}
    assert parameters[-1].parameters[[p.name for p in parameters[-1].parameters].index("Cl_alpha*beta")].status == 0
    assert np.mean(errors(model_errors, "Cl")[-4:]) < 0.5 * np.mean(base)

    answer = remove(bench, "dihedral_alpha")
    assert answer.success and answer.model == old
    model_errors.clear()
    play(bench, hidden, 98.0, 101.0, state, node)
    bench.spin_until(lambda: bool(model_errors))
    assert model_errors[-1].model == old


def test_requests_before_a_flight_and_wrong_ones_are_answered(bench):
    node = bench.node(ParameterEstimatorNode)
    assert start(node)
    old = node.estimator.model
    for call, effect, expression, words in (
        (add, "", "", "either effect"),
        (add, "stall", "CZ: alpha**3", "either effect"),
        (add, "stall", "", "less than 20 s"),
        (add, "alpha_scale", "", "concerns the sensors"),
        (add, "flying_saucer", "", "not an effect"),
        (add, "", "CZ: alpha", "already"),
        (add, "", "CZ: alpha**", "not an expression"),
        (remove, "stall", "", "was not added"),
        (remove, "", "CZ: beta", "no term 'beta'"),
    ):
        answer = call(bench, effect, expression)
        assert not answer.success and words in answer.message, answer.message
        assert "\n" not in answer.message
        assert answer.model == old.identifier
        assert node.estimator.model is old
    answer = add(bench, expression="CZ: alpha**3; Cm: alpha**3")
    assert answer.success, answer.message
    assert [n for n in node.estimator.model.parameter_names if "alpha3" in n] == ["CZ_alpha3", "Cm_alpha3"]
    assert remove(bench, expression="Cm: alpha**3").success
    assert remove(bench, expression="CZ: alpha**3").model == old.identifier


@pytest.mark.long
def test_another_estimator_says_that_it_begins_anew(bench, raw):
    state, node = bench.node(StateEstimatorNode), bench.node(ParameterEstimatorNode, estimator="fourier")
    parameters = bench.listen(Parameters, "parameter_estimator/parameters")
    assert start(state) and start(node)
    play(bench, raw, 0.0, 6.0, state, node)
    answer = add(bench, expression="CZ: alpha**3")
    assert answer.success and "the estimator fourier starts over" in answer.message
    parameters.clear()
    play(bench, raw, 6.0, 9.0, state, node)
    bench.spin_until(lambda: bool(parameters))
    assert "CZ_alpha3" in [p.name for p in parameters[-1].parameters]
    assert bench.call(Reset, f"{NODE}/reset").success
    assert not len(node.model_services.memory.flight().time)


@pytest.mark.long
def test_no_search_where_none_is_wanted(bench, raw):
    state, node = bench.node(StateEstimatorNode), bench.node(ParameterEstimatorNode, diagnosis_period=0.0)
    assert start(state) and start(node)
    play(bench, raw, 0.0, 3.0, state, node)
    assert node.model_services._worker is None


class FakeWorker:
    """A search that ended at once and took two seconds of the processor."""

    busy = False

    def __init__(self):
        self.submitted = 0

    def submit(self, flights):
        self.submitted += 1

    def answer(self):
        return Answer(None, 2.0, "nothing")

    def close(self):
        pass


def test_searches_take_no_more_than_their_share(bench, monkeypatch):
    node = bench.node(ParameterEstimatorNode, diagnosis_share=0.05, diagnosis_period=1.0)
    assert start(node)
    services, clock = node.model_services, {"now": 1000.0}
    monkeypatch.setattr(model_services, "time", SimpleNamespace(monotonic=lambda: clock["now"]))
    monkeypatch.setattr(model_services, "windows", lambda *_: ["flight"])
    monkeypatch.setattr(model_services, "LiveWorker", lambda: worker)
    worker, begun = FakeWorker(), []
    for second in range(100):
        clock["now"] = 1000.0 + second
        before = worker.submitted
        services.search_if_due(float(second), 0)
        if worker.submitted > before:
            begun.append(second)
            services.publish_ready()
    assert begun == [0, 40, 80]


def test_a_reset_takes_back_what_was_found_missing_also_by_a_search_that_runs(bench):
    """The page went on offering to add it in flight."""
    node = bench.node(ParameterEstimatorNode)
    found = bench.listen(MissingEffects, "parameter_estimator/missing_effects")
    assert start(node)
    services, running = node.model_services, FakeWorker()
    content = {"model": node.estimator.model.identifier, "verdict": "unexplained", "candidates": [], "advice": ""}
    running.answer = lambda: Answer(content, 2.0)
    services._worker = running
    services.publish_ready()
    bench.spin_until(lambda: bool(found))
    assert services.search_in_words == found[-1].verdict == "unexplained"
    running.busy = True
    assert bench.call(Reset, f"{NODE}/reset").success
    bench.spin_until(lambda: "forgotten" in found[-1].advice)
    running.busy = False
    services.publish_ready()
    assert found[-1].verdict == "" and services.search_in_words.startswith("not looked for yet")
    assert found[-1].header.stamp == found[0].header.stamp and not found[-1].candidates  # by the clock of the samples
    services.publish_ready()  # of the next search
    assert services.search_in_words == "unexplained"
