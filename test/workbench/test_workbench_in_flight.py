"""The live page without ROS and browser: bounded memory, what is noise, sentences, a link that ends."""

from __future__ import annotations

import itertools
import multiprocessing
import time

import numpy as np
import pytest

from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.diagnosis.compare import FAILS, MORE, NOISE, SHORT
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.coefficients.layout import MEASURED, VALID, CoefficientSample
from aircraft_sysid_ros.identification.monitoring.error_window import model_errors, samples_apart
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.ros_messages.output_messages import model_error_content
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples
from aircraft_sysid_ros.workbench import live_session, markup
from aircraft_sysid_ros.workbench.live_flight import MOST_ERRORS, MOST_STATES, LiveFlight
from aircraft_sysid_ros.workbench.live_link import ANSWER, NO_ROS, PRESENCE, READY
from aircraft_sysid_ros.workbench.views import live
from aircraft_sysid_ros.workbench.views.coefficients import NO_DATA
from aircraft_sysid_ros.workbench.views.figure import LIGHT
from aircraft_sysid_ros.workbench.worker import ADD, REMOVE, Job

SECOND = 1_000_000_000


def errors(second: float, model: str = "a", nrmse: float = 0.3, over_noise: float = 4.0) -> dict:
    axis = {"measured": 1.0, "predicted": 0.9, "nrmse": nrmse, "residual_rms": 0.1, "over_noise": over_noise}
    return {"stamp": int((1000 + second) * SECOND), "model": model, "window": 10.0, "axes": {"Cl": axis}}


def parameters(second: float, model: str, *names: str) -> dict:
    return {"stamp": int((1000 + second) * SECOND), "model": model, "parameters": [{"name": name} for name in names]}


def candidate(**changes) -> dict:
    content = {
        "effect": "dihedral_alpha", "expression": "Cl: alpha*beta", "axes": ["Cl"], "p_value": 1e-9,
        "error_before": 0.36, "error_after": 0.04, "confounded_with": [], "where": "40 to 60 s",
    }  # fmt: skip
    return {**content, **changes}


def test_memory_is_bounded_and_another_flight_begins_anew() -> None:
    flight = LiveFlight()
    for second in range(3 * MOST_STATES):
        flight.take("errors", errors(second, str(second)))  # the model changes with every message
        flight.take("state", {"stamp": int((1000 + second) * SECOND)})
    assert (len(flight.errors), len(flight.states), len(flight.changes)) == (MOST_ERRORS, MOST_STATES, MOST_ERRORS)
    for number in range(1000):
        flight.granted(ADD, str(number), "b")
    assert len(flight.added) <= 100
    flight.take("errors", errors(5.0))
    assert len(flight.errors) == 1 and not flight.states and not flight.added
    assert flight.errors[0]["time"] == 0.0


def test_what_was_said_before_anybody_heard_does_not_count_as_heard() -> None:
    """A node says its newest parameters and findings again to whoever comes later, the oldest first."""
    flight = LiveFlight()
    for second in (0.0, 30.0):
        flight.take("missing", {**parameters(second, "a"), "verdict": f"{second:.0f}", "candidates": []})
    flight.take("parameters", parameters(60.0, "a", "Cl_beta"))
    assert flight.silent is None
    flight.take("errors", errors(61.0))
    flight.take("missing", {**parameters(0.0, "a"), "verdict": "0", "candidates": []})  # the link was begun anew
    flight.take("parameters", parameters(50.0, "a"))
    assert flight.missing["verdict"] == "30" and flight.parameters["parameters"] and flight.number == 0
    assert [row["time"] for row in flight.errors] == [0.0] and flight.silent < 60.0


def test_what_was_found_is_of_earlier_where_the_model_is_another_or_the_node_has_not_found_it() -> None:
    """Of a node that was started again it stood as its own until its next search, a minute of flight later."""
    flight = LiveFlight()
    flight.take("errors", errors(0.0))
    flight.take("missing", {"stamp": 1000 * SECOND, "model": "a", "verdict": "missing", "candidates": [], "advice": ""})
    assert not flight.found_earlier
    for verdict, is_earlier in (("missing", False), ("not looked for yet", True), ("missing", False)):
        flight.verdict = verdict
        assert flight.found_earlier == is_earlier
    flight.take("errors", errors(1.0, "b"))
    assert flight.found_earlier


def test_what_was_added_is_known_until_its_terms_are_gone() -> None:
    flight = LiveFlight()
    flight.take("errors", errors(0.0, "a", 0.3))
    flight.take("parameters", parameters(0.0, "a", "Cl_beta"))
    flight.granted(ADD, "dihedral_alpha", "b")
    flight.take("parameters", parameters(0.5, "a", "Cl_beta"))  # was on its way
    assert [item.text for item in flight.added] == ["dihedral_alpha"]
    flight.take("errors", errors(1.0, "b", 0.05))
    flight.take("parameters", parameters(1.0, "b", "Cl_beta", "Cl_alpha*beta"))
    assert flight.added[0].names == {"Cl_alpha*beta"}
    assert flight.before == {"Cl": 0.3} and list(flight.changes) == [1.0]
    flight.take("parameters", parameters(2.0, "a", "Cl_beta"))  # somebody else took it out
    assert not flight.added
    flight.granted(ADD, "Cl: beta**3", "c")
    flight.granted(REMOVE, "Cl: beta**3", "a")
    assert not flight.added


def published(pipeline: Pipeline) -> dict:
    """The newest content of ModelError, as the page hears it."""
    found = model_error_content("a", 10.0, pipeline.parameters.model_error())
    return {"axes": {axis.pop("axis"): axis for axis in found["axes"]}}


@pytest.mark.parametrize("turbulence", ["none", "light"])
def test_only_what_a_model_lacks_is_more_than_noise(turbulence) -> None:
    """Every five seconds from the first minute on; the drag of sideslip as soon as it has been flown."""
    aircraft = default_aircraft()
    for hidden, says in (((), set()), ((("sideslip_drag", 1.0),), {"CX"})):
        samples = simulate_samples(aircraft, 12, 120.0, turbulence=turbulence, hidden=hidden).samples
        pipeline, at = Pipeline(aircraft), np.arange(60, 121, 5)
        edges = np.searchsorted(samples.stamp, samples.stamp[0] + at * SECOND)
        states = []
        for begin, end in itertools.pairwise([0, *edges.tolist()]):
            pipeline.push(samples[begin:end])
            states.append({row.axis: row.state for row in live.axis_rows(published(pipeline))})
        assert {axis for each in states for axis, state in each.items() if state == MORE} == says
        assert all(NOISE in each.values() for each in states)


def test_white_is_what_is_not_correlated_where_windows_share_nothing() -> None:
    """Means of white noise over windows that overlap are white; with a larger slow error they are not."""
    options = ParameterOptions()
    apart, rng = samples_apart(options.step, options.half_width), np.random.default_rng(4)
    assert (apart - 1) * options.step <= 2.0 * options.half_width < apart * options.step
    are_white = []
    for slow in (0.0, 2.0):
        found = []
        for _ in range(300):
            noise = np.convolve(rng.normal(size=250 + apart - 1), np.ones(apart), "valid")
            slow_error = slow * noise.std() * np.sqrt(2.0) * np.sin(0.05 * np.arange(250) + rng.uniform(0.0, 6.0))
            samples = np.zeros((250, CoefficientSample.TERMS))
            samples[:, VALID], samples[:, MEASURED] = 1.0, noise + slow_error
            found.append(model_errors(samples, apart, [1.0] * 6)[0].white)
        are_white.append(np.mean(found))
    assert are_white[0] > 0.97 and are_white[1] < 0.05


def test_rows_cards_and_figures() -> None:
    assert {row.state for row in live.axis_rows(None)} == {NO_DATA}
    missing = {"model": "a", "verdict": "missing", "advice": "", "candidates": [candidate()]}
    assert live.failing_axes(missing) == {"Cl"} and not live.failing_axes(None)
    row = next(row for row in live.axis_rows(errors(0.0), {"Cl"}) if row.axis == "Cl")
    assert (row.held_out, row.state, row.floor) == (0.3, FAILS, pytest.approx(0.075))
    for over_noise, state in ((1.5, NOISE), (4.0, MORE), (np.nan, SHORT)):
        (row,) = (row for row in live.axis_rows(errors(0.0, over_noise=over_noise)) if row.axis == "Cl")
        assert (row.held_out, row.state) == (0.3, state) and (row.floor is None) == np.isnan(over_noise)
        assert state in markup.state_words(row) and "30.0 %" in markup.axis_head(row)
        assert ("noise 7" in markup.axis_head(row)) == (over_noise == 4.0)
    card, other = live.cards({**missing, "candidates": [candidate(), candidate(effect="", expression="Cm: q**2")]})
    assert (card.key, card.title) == ("dihedral_alpha", "Dihedral effect that depends on lift")
    assert card.physics and card.manoeuvre and card.gain == "36.0 % → 4.0 %"
    assert other.key == "Cm: q**2" and "Cm: q**2" in other.title
    rows = [{**errors(t), "time": float(t)} for t in range(300)]
    figure = live.coefficient_figure(rows, "Cl", LIGHT, [100.0, 250.0])
    assert figure["layout"]["xaxis"]["range"] == [299.0 - live.WINDOW, 299.0]
    assert [shape["x0"] for shape in figure["layout"]["shapes"]] == [250.0]
    assert live.coefficient_figure([], "Cl", LIGHT)["layout"]["xaxis"]["range"] == [0.0, live.WINDOW]


@pytest.mark.parametrize(
    ("is_there", "was_there", "silent", "words"),
    [
        (False, False, None, "no /node yet"),
        (False, True, 12.0, "/node is gone"),
        (True, True, None, "has said nothing new yet"),
        (True, True, 12.0, "has said nothing for 12 s"),
        (True, True, 0.5, ""),
    ],
)
def test_one_sentence_says_what_keeps_the_page_back(is_there, was_there, silent, words) -> None:
    said = live.presence_sentence("/node", is_there, was_there, silent)
    assert words in said and bool(said) == bool(words) and "\n" not in said


class FakeLink:
    """Links that a test speaks for."""

    def __init__(self) -> None:
        self.ends: list = []

    def start(self, namespace: str):
        ours, theirs = multiprocessing.Pipe()
        self.ends.append(theirs)
        return self, ours

    def kill(self) -> None:
        self.ends[-1].close()

    def join(self) -> None:
        pass


@pytest.fixture
def fake(monkeypatch):
    """A session on a link that does what the test says."""
    link = FakeLink()
    monkeypatch.setattr(live_session, "start_link", link.start)
    monkeypatch.setattr(live_session, "_REST", 0.01)
    session = live_session.LiveSession("plane/one/")
    yield session, link
    session.close()


def until(true) -> None:
    deadline = time.monotonic() + 20.0
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_a_link_that_ends_is_started_again_and_its_request_is_not_lost_silently(fake) -> None:
    session, link = fake
    link.ends[0].send((READY, None))
    session.wait(10.0)
    assert session.node == "/plane/one/parameter_estimator"
    link.ends[0].send((PRESENCE, True))
    until(lambda: session.flight.is_there)
    assert session.start(Job(ADD, "stall")) and not session.start(Job(ADD, "stall"))
    assert link.ends[0].recv() == (ADD, "stall")
    link.ends[0].close()
    until(lambda: len(link.ends) == 2)
    assert session.job is None and session.is_bad and "ask again" in session.sentence
    assert session.flight.was_there and not session.flight.is_there
    link.ends[1].send((PRESENCE, True))
    link.ends[1].send(("errors", errors(0.0)))
    until(lambda: session.flight.model == "a")
    assert session.start(Job(ADD, "CZ: alpha**3"))
    answer = {"kind": ADD, "text": "CZ: alpha**3", "success": True, "message": "added: CZ_alpha3", "model": "b"}
    link.ends[1].send((ANSWER, answer))
    until(lambda: session.job is None)
    assert session.sentence == "added: CZ_alpha3" and not session.is_bad
    assert [item.text for item in session.flight.added] == ["CZ: alpha**3"]


def test_no_ros_is_one_sentence(fake) -> None:
    session, link = fake
    link.ends[0].send((NO_ROS, "ROS 2 is not in this environment"))
    with pytest.raises(InputError, match="not in this environment"):
        session.wait(10.0)


@pytest.mark.parametrize(
    "arguments", [["--live", "run"], ["--live", "--truth", "bag"], [], ["run", "--namespace", "plane"]]
)
def test_arguments_that_do_not_go_together(arguments, capsys) -> None:
    assert main(["workbench", *arguments, "--no-browser", "--port", "0"]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
