"""The textbook model is that of the aircraft's parameter vector (6.25), and any other is checked."""

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.aerodynamic_model import (
    AXES,
    TEXTBOOK_TERMS,
    model_from_terms,
    term_label,
    textbook_model,
)
from aircraft_sysid_ros.aircraft.postfix import evaluate_programs
from aircraft_sysid_ros.aircraft.signals import SIGNALS
from aircraft_sysid_ros.errors import InputError

NAMES = [
    "CX_0", "CX_alpha", "CX_alpha2", "CX_q", "CX_de", "CX_Tc",
    "CY_0", "CY_beta", "CY_p", "CY_r", "CY_da", "CY_dr",
    "CZ_0", "CZ_alpha", "CZ_q", "CZ_de",
    "Cl_0", "Cl_beta", "Cl_p", "Cl_r", "Cl_da", "Cl_dr",
    "Cm_0", "Cm_alpha", "Cm_q", "Cm_de",
    "Cn_0", "Cn_beta", "Cn_p", "Cn_r", "Cn_da", "Cn_dr",
]  # fmt: skip
FLIGHT = {name: np.array([0.01 * (i + 1)]) for i, name in enumerate(SIGNALS)}


def coefficients_of(name):
    """C_X … C_n in FLIGHT when only the named parameter is not zero."""
    return textbook_model().coefficients({n: float(n == name) for n in NAMES}, FLIGHT)[0]


def moves(axis, signal):
    """Whether a signal enters an axis of the textbook model."""
    model, other = textbook_model(), {**FLIGHT, signal: FLIGHT[signal] + 0.5}
    ones = dict.fromkeys(NAMES, 1.0)
    change = model.coefficients(ones, other) - model.coefficients(ones, FLIGHT)
    return change[0, AXES.index(axis)] != 0.0


def test_the_32_parameters_have_the_published_names_in_the_published_order():
    model = textbook_model()
    assert model.parameter_names == tuple(NAMES) and len(NAMES) == 32
    assert model.offsets.tolist() == [0, 6, 12, 16, 22, 26, 32]
    assert [len(terms) for terms in model.terms.values()] == [6, 6, 4, 6, 4, 6]
    assert model.signals_used == {"alpha", "beta", "p", "q", "r", "de", "da", "dr", "Tc"}


def test_the_misprint_of_6_9_is_not_followed():
    assert moves("CY", "da") and moves("CY", "dr")
    assert not moves("CX", "da") and not moves("CX", "dr")


def test_the_misprint_of_6_11_is_not_followed():
    assert not moves("Cl", "alpha")
    assert moves("CX", "alpha") and moves("CZ", "alpha") and moves("Cm", "alpha")


@pytest.mark.parametrize("name", NAMES)
def test_each_parameter_multiplies_its_term_in_its_axis_alone(name):
    axis, _, label = name.partition("_")
    signals = {key: float(value[0]) for key, value in FLIGHT.items()}
    expected = np.zeros(6)
    expected[AXES.index(axis)] = {"0": 1.0, "alpha2": signals["alpha"] ** 2}.get(label, signals.get(label))
    np.testing.assert_allclose(coefficients_of(name), expected, rtol=1e-15)


def test_a_hand_worked_example():
    parameters = dict.fromkeys(NAMES, 0.0)
    parameters |= {
        "CX_0": -0.03,
        "CX_alpha": 0.2,
        "CX_alpha2": 2.0,
        "CX_Tc": 1.0,
        "CZ_0": -0.2,
        "CZ_alpha": -4.5,
    }
    parameters |= {"CZ_q": -4.0, "CZ_de": -0.4, "Cl_beta": -0.06, "Cl_p": -0.5, "Cl_da": -0.15}
    signals = {name: np.array([0.0, 0.0]) for name in SIGNALS}
    signals |= {"alpha": np.array([0.1, 0.0]), "q": np.array([0.01, 0.0]), "de": np.array([-0.05, 0.0])}
    signals |= {"Tc": np.array([0.05, 0.0]), "beta": np.array([0.02, 0.1]), "p": np.array([0.04, 0.0])}
    got = textbook_model().coefficients(parameters, signals)
    # CX: -0.03 + 0.02 + 0.02 + 0.05; CZ: -0.2 - 0.45 - 0.04 + 0.02; Cl: -0.0012 - 0.02
    np.testing.assert_allclose(
        got, [[0.06, 0.0, -0.67, -0.0212, 0.0, 0.0], [-0.03, 0.0, -0.2, -0.006, 0.0, 0.0]], atol=1e-15
    )


def test_linked_code_gives_the_regressors_of_all_axes():
    model = textbook_model()
    out = np.empty(32)
    evaluate_programs(*model.linked, np.array([FLIGHT[name][0] for name in SIGNALS]), out)
    for axis in AXES:
        np.testing.assert_array_equal(out[model.axis_slice(axis)], model.regressors(axis, FLIGHT)[0])


@pytest.mark.parametrize(
    ("term", "label"),
    [
        ("1", "0"),
        ("alpha", "alpha"),
        ("alpha**2", "alpha2"),
        ("alpha*da", "alpha*da"),
        ("alpha**2*q", "alpha**2*q"),
    ],
)
def test_labels(term, label):
    assert term_label(term) == label


@pytest.mark.parametrize(
    ("terms", "message"),
    [
        ({"CL": [1]}, "'CL': the axes are CX CY CZ Cl Cm Cn"),
        ({3: [1]}, "names the axis '3'"),
        ({"CX": ["alpha", "alpha"]}, "'alpha' twice in CX"),
        ({"CX": ["alpha ** 2", "alpha**2"]}, r"'alpha\*\*2' twice in CX"),
        ({"CX": [1, 0]}, "twice in CX"),  # both would be CX_0
        ({"CX": "alpha"}, "must be a list"),
        ({"CX": None}, "must be a list"),
        ({"CX": 3}, "must be a list"),
        ({"CX": {"alpha": 1}}, "must be a list"),
        ({"CX": ["alfa"]}, "'alfa' is not a signal|'alfa' in 'alfa' is not a signal"),
        ({"CX": [True]}, "'True' in 'True' is not a number"),
        ({"CX": [None]}, "is not a number"),
        ({"CX": [["alpha"]]}, "not allowed"),
        ({"CX": [1, "2"]}, "'2' reads no signal: the constant of an axis is written 1"),
        ({"CX": ["1/0"]}, "'1/0' reads no signal"),
        ({"CX": ["alpha/0"]}, "'alpha/0' is never a number, whatever the aeroplane does"),
        ({"CX": ["alpha*0"]}, r"'alpha\*0' is 0, whatever the aeroplane does"),
    ],
)
def test_bad_models_are_one_clear_line(terms, message):
    with pytest.raises(InputError, match=message) as raised:
        model_from_terms(terms)
    assert len(str(raised.value).splitlines()) == 1


def test_the_same_terms_have_the_same_id_and_others_another():
    same = model_from_terms({axis: list(terms) for axis, terms in reversed(TEXTBOOK_TERMS.items())})
    spaced = model_from_terms({**TEXTBOOK_TERMS, "CX": [1, "alpha", "alpha ** 2", "q", "de", "Tc"]})
    other = model_from_terms({**TEXTBOOK_TERMS, "CZ": [1, "alpha", "q", "de", "alpha**3"]})
    assert textbook_model().identifier == same.identifier == spaced.identifier != other.identifier
    assert len(other.identifier) == 8 and other.parameter_names[16] == "CZ_alpha3"


def test_an_axis_that_is_left_out_has_no_terms():
    model = model_from_terms({"CZ": [1, "alpha"]})
    assert model.parameter_names == ("CZ_0", "CZ_alpha")
    assert model.terms["CX"] == () and model.regressors("CX", FLIGHT).shape == (1, 0)
    np.testing.assert_allclose(model.coefficients({"CZ_0": 1.0, "CZ_alpha": 2.0}, FLIGHT), [[0, 0, 1.02, 0, 0, 0]])
