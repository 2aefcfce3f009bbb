"""Missing effects in flight: named when they are there, nothing said when nothing is, at bounded cost."""

import re
import time

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX, SIGNALS
from aircraft_sysid_ros.diagnosis.live import search_in_flight as live
from aircraft_sysid_ros.diagnosis.live.worker import Answer, LiveWorker, answer_to
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.flight_memory import SampleMemory
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.state import D_ACCELEROMETER_BIAS, StateField
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

BIAS = StateField.STANDARD_DEVIATIONS.start + D_ACCELEROMETER_BIAS
STEP = 0.04


def memory_of(flight, end=np.inf):
    """What the node keeps of a flight until a time [s]."""
    pipeline, memory = Pipeline(flight.aircraft), SampleMemory()
    rows, points = (np.vstack(parts) for parts in zip(pipeline.push(flight.samples), pipeline.flush(), strict=True))
    at = np.clip(np.searchsorted(rows[:, StateField.TIME], points[:, 0]), 0, len(rows) - 1)
    for point, row in zip(points, rows[at], strict=True):
        if point[0] - points[0, 0] <= end:
            memory.add(point[None, :], row[BIAS : BIAS + 3], float(row[StateField.AIR_VELOCITY_STD]))
    return memory


@pytest.fixture(scope="module")
def hidden(aircraft):
    return simulate_samples(aircraft, 11, 90.0, rate=200.0, hidden=[("dihedral_alpha", 1.0)], manoeuvres="standard")


@pytest.fixture(scope="module")
def windows(hidden):
    return live.windows(hidden.aircraft, memory_of(hidden), STEP)


@pytest.fixture(scope="module")
def found(windows):
    """What is said of the flight with the hidden effect."""
    return live.diagnose_live(windows)


@pytest.fixture(scope="module")
def clean(aircraft):
    return live.windows(aircraft, memory_of(simulate_samples(aircraft, 12, 180.0, rate=200.0)), STEP)


# -- what is kept ----------------------------------------------------------------------------------------


@pytest.mark.long
def test_windows_begin_when_settled_and_do_not_overlap(clean):
    flight, newest = clean
    assert flight.data.time[0] >= live.SETTLING
    assert np.ptp(newest.data.time) == pytest.approx(live.SLIDING, abs=1.0)
    for window in clean:
        assert np.diff(window.data.time).min() == pytest.approx(live.SPACING, abs=1e-6)
        assert window.data.step == pytest.approx(live.SPACING)
        assert window.bias_std.shape == (len(window.data.time), 3)


@pytest.mark.long
def test_short_flights_are_not_judged(hidden):
    assert live.windows(hidden.aircraft, SampleMemory(), STEP) == []
    assert live.windows(hidden.aircraft, memory_of(hidden, end=75.0), STEP) == []
    with pytest.raises(InputError, match="are settled"):
        live.diagnose_live([])


# -- the verdict -----------------------------------------------------------------------------------------


@pytest.mark.long
def test_the_hidden_effect_is_named(windows, found):
    assert found.verdict == "missing"
    assert found.model == windows[0].data.model.identifier
    content = found.content
    first = content["candidates"][0]
    assert (first["effect"], first["expression"], first["axes"]) == ("dihedral_alpha", "Cl: alpha*beta", ["Cl"])
    assert first["error_after"] < 0.5 * first["error_before"]
    assert first["p_value"] < THRESHOLDS.live_level
    assert "add_effect dihedral_alpha" in content["advice"]
    assert "C_l" in first["where"]


@pytest.mark.long
def test_outside_the_library_it_is_unexplained_in_the_right_words(windows):
    found = live.diagnose_live(windows, [e for e in BY_ID.values() if e.identifier != "dihedral_alpha"])
    assert found.verdict == "unexplained"
    assert found.content["candidates"][0]["expression"] == "Cl: alpha*beta"
    assert "depends on alpha*beta" in found.advice


@pytest.mark.long
def test_nothing_is_said_of_a_clean_flight(clean):
    found = live.diagnose_live(clean)
    assert (found.verdict, found.findings) == ("none", ())
    assert "Nothing is missing" in found.content["advice"]


@pytest.mark.long
def test_what_reads_the_forces_is_not_judged(windows, found):
    terms = [c for f in found.findings for ts in f.trial.candidate.terms.values() for c in ts]
    assert not any("_dot" in term for term in terms)
    trial = CandidateEvaluator(windows[0].data).best_of(BY_ID["alpha_dot"])
    assert live.reads(trial.candidate, live.FORCES)
    assert not live.reads(CandidateEvaluator(windows[0].data).best_of(BY_ID["stall"]).candidate, live.FORCES)


# -- the null --------------------------------------------------------------------------------------------


@pytest.mark.long
def test_bias_drift_has_the_covariance_of_a_constant_that_becomes_known(clean):
    """Errors b(t) of the best estimate of a constant: cov(b(t), b(s)) = variance at the later time."""
    flight = clean[0]
    root = live.bias_drift(flight, "CY")
    data = flight.data
    unit = data.aircraft.mass / (data.signal("qbar") * data.aircraft.wing_area)
    rows = [10, len(data.time) // 3, len(data.time) - 1]
    covariance = (root @ root.T)[np.ix_(rows, rows)] / np.outer(unit[rows], unit[rows])
    variance = np.minimum.accumulate(flight.bias_std[:, 1] ** 2)
    for i, a in enumerate(rows):
        for j, b in enumerate(rows):
            assert covariance[i, j] == pytest.approx(variance[max(a, b)], rel=0.35)  # known to the second
    assert live.bias_drift(flight, "Cm").shape[1] == 0


def test_the_wald_test_holds_its_level_under_drift_of_the_bias(clean):
    """Slow growth is significant at 1 % in about 1 % of drifts with the stated covariance, in most without it."""
    flight = clean[0]
    data, rng = flight.data, np.random.default_rng(3)
    axis, column = "CY", np.maximum(data.time - 60.0, 0.0)[:, None]
    fit = CandidateEvaluator(data).fits[axis]
    root, base = live.bias_drift(flight, axis), fit.columns @ fit.parameters
    still = live.LiveFlight(data, np.zeros_like(flight.bias_std), flight.window)
    noise = 0.3 * float(np.median(np.sqrt(np.sum(root**2, axis=1))))
    fires = np.zeros(2)
    for _ in range(60):
        measured = base + root @ rng.standard_normal(root.shape[1]) + noise * rng.standard_normal(len(base))
        drawn = type(fit)(data, axis, fit.columns, fit.names, measured)
        values = [live.wald(window, drawn, column) for window in (flight, still)]
        fires += [value > 6.63 * count for value, count in values]
    assert fires[0] <= 4
    assert fires[1] >= 20


# -- what the user asks for ------------------------------------------------------------------------------


def test_terms_of_an_effect_have_its_inner_numbers_fitted(windows):
    assert live.terms_of_effect(BY_ID["dihedral_alpha"], windows[0])[0] == {"Cl": ("alpha*beta",)}
    terms, _ = live.terms_of_effect(BY_ID["stall"], windows[0])
    assert set(terms) <= {"CZ", "CX", "Cm"} and all("{" not in t for ts in terms.values() for t in ts)


@pytest.mark.long
def test_what_is_not_missing_costs_more_than_it_explains(windows, clean):
    assert live.terms_of_effect(BY_ID["dihedral_alpha"], windows[0])[1]
    for absent in ("control_damage", "stuck_control", "parameter_change", "stall"):
        assert not live.terms_of_effect(BY_ID[absent], clean[0])[1]


def test_requests_that_make_no_sense_are_answered_with_a_sentence(windows):
    for text, words in (
        ("alpha_scale", "concerns the sensors"),
        ("nonsense", "is not an effect"),
        ("CQ: alpha", "is not an axis"),
        ("CL: alpha**2", "for lift write CZ"),
        ("CZ: import os", "not an expression"),
    ):
        with pytest.raises(InputError, match=words):
            live.requested(text)
    with pytest.raises(InputError, match="less than 20 s"):
        live.terms_of_effect(BY_ID["stall"], None)
    with pytest.raises(InputError, match="needs flaps"):
        data = windows[0].data
        signals = data.signals.copy()
        signals[:, SIGNAL_INDEX["flaps"]] = np.nan
        live.terms_of_effect(BY_ID["flaps"], live.LiveFlight(data.with_signals(signals), windows[0].bias_std, ""))


def test_terms_that_read_what_is_not_measured_are_refused():
    memory = SampleMemory()
    point = np.zeros((1, CoefficientSample.TERMS))
    point[0, CoefficientSample.SIGNALS.start + SIGNAL_INDEX["height"]] = np.nan
    live.check_signals({"CZ": ("height",)}, memory.newest())  # nothing is known yet
    memory.add(point, np.zeros(3), 1.0)
    live.check_signals({"CZ": ("alpha**3",)}, memory.newest())
    with pytest.raises(InputError, match="'CZ: height' needs height, which"):
        live.check_signals({"CZ": ("height",)}, memory.newest())


def test_terms_may_read_the_inputs_that_the_aircraft_file_names():
    inputs, memory = ("tab", "spoiler"), SampleMemory()
    point = np.zeros((1, CoefficientSample.TERMS))
    point[0, CoefficientSample.SIGNALS.start + len(SIGNALS) + 1] = np.nan
    memory.add(point, np.zeros(3), 1.0)
    terms = live.requested("Cm: tab; CZ: alpha*tab", inputs)
    assert terms == {"Cm": ("tab",), "CZ": ("alpha*tab",)}
    live.check_signals(terms, memory.newest(), inputs)
    with pytest.raises(InputError, match="'CZ: spoiler' needs spoiler, which"):
        live.check_signals(live.requested("CZ: spoiler", inputs), memory.newest(), inputs)
    with pytest.raises(InputError, match="'tab' in 'tab' is not a signal"):
        live.requested("Cm: tab")


@pytest.mark.parametrize(("text", "words"), [
    ("CZ: sqrt(alpha - 5)", "'CZ: sqrt(alpha-5)' is not a number at 200 of the 200 newest points"),
    ("CZ: 1/max(alpha - 2, 0)", "is not a number at 200 of the 200"),
    ("CZ: sqrt(alpha - 0.06)", "is not a number at 120 of the 200"),
    ("CZ: max(alpha - 2, 0)", "'CZ: max(alpha-2,0)' has been 0 throughout this flight"),
    ("CZ: alpha; Cm: max(alpha - 1, 0)", "'Cm: max(alpha-1,0)' has been 0 throughout"),
    ("CZ: sqrt(alpha - 0.03)", ""),  # of a part of the flight
    ("CZ: flaps", ""),  # they have not moved yet
    ("CZ: lag(alpha, 0.5)", ""),
    ("CZ: propeller_speed", ""),  # not measured: check_signals has that
])  # fmt: skip
def test_a_term_that_says_nothing_in_this_flight_is_refused(text, words):
    memory, count = SampleMemory(), 200
    points = np.full((count, CoefficientSample.TERMS + 3), 0.0)
    points[:, CoefficientSample.TIME] = 0.04 * np.arange(count)
    signals = points[:, CoefficientSample.SIGNALS]
    signals[:, SIGNAL_INDEX["time"]] = points[:, CoefficientSample.TIME]
    signals[:, SIGNAL_INDEX["alpha"]] = 0.1 * np.arange(count) / count
    signals[:, SIGNAL_INDEX["propeller_speed"]] = np.nan
    memory.add(points, np.zeros(3), 1.0)
    terms = live.requested(text)
    if words:
        with pytest.raises(InputError, match=re.escape(words)):
            live.check_values(terms, memory.newest(), 0.06)
    else:
        live.check_values(terms, memory.newest(), 0.06)
    live.check_values(terms, memory.newest(2.0), 0.06)  # too little to judge from


# -- in another process ----------------------------------------------------------------------------------


def answer_of(worker):
    while (answer := worker.answer()) is None:
        time.sleep(0.05)
    return answer


@pytest.mark.long
def test_the_worker_answers_and_ends_with_us(windows, found):
    worker = LiveWorker()
    assert not worker.busy and worker.answer() is None
    worker.submit(windows)
    assert worker.answer() is None  # nobody waits
    assert worker.busy
    answer = answer_of(worker)
    assert answer.content == found.content
    assert 0.0 < answer.processor_time < 60.0
    worker.submit([])
    answer = answer_of(worker)
    assert answer.content is None and "settled" in answer.failure
    worker.submit(windows)
    worker.close()  # in the midst of a search
    assert worker._process.returncode is not None


@pytest.mark.long
def test_a_worker_that_dies_says_so_and_is_replaced(windows):
    worker = LiveWorker()
    worker.submit(windows)
    worker._process.kill()  # in the midst of a search
    answer = answer_of(worker)
    assert answer.content is None and "ended" in answer.failure
    worker._process.wait()
    worker.submit([])
    assert "settled" in answer_of(worker).failure
    worker.close()
    assert isinstance(answer_to([]), Answer)
