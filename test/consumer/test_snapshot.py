"""A message becomes one checked, immutable set, or is refused with a sentence."""

import numpy as np
import pytest

from aircraft_sysid_ros.consumer import ParameterSource, snapshot_of
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.identification.trust import Evidence, Trust, judge
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.ros_messages.output_messages import parameters_content
from aircraft_sysid_ros.sensors.sensor_models import stamps_of
from aircraft_sysid_ros.simulation.sensor_faults import with_fault

FAULT, LENGTH = (70.0, 80.0), 100.0  # [s] of a vane, and of the flight


def test_a_snapshot_holds_the_message_and_cannot_be_changed(content):
    found = snapshot_of(5, content(status=(0, 1, 2)))
    assert found.names == ("Cm_0", "Cm_alpha", "Cm_de") and found.stamp == 5 and found.model == "abc"
    assert found.usable.tolist() == [True, False, False]
    assert found.reasons == ("", "why", "why")
    for array in (found.values, found.std, found.covariance, found.status, found.age, found.low, found.high):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0
    with pytest.raises(AttributeError):
        found.model = "other"


def test_it_does_not_share_memory_with_the_message(content):
    message = content()
    found = snapshot_of(0, message)
    before = found.covariance.copy()
    message["covariance"][:] = 7.0
    assert np.array_equal(found.covariance, before)


def test_covariance_by_name(content):
    found = snapshot_of(0, content())
    some = found.covariance_of(["Cm_de", "Cm_0"])
    assert some[0, 0] == pytest.approx(0.02**2) and some[1, 1] == pytest.approx(0.002**2)
    assert some[0, 1] == pytest.approx(0.2 * 0.02 * 0.002)
    with pytest.raises(KeyError, match="no parameter Cl_p"):
        found.covariance_of(["Cl_p"])


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"names": ("Cm_0", "Cm_de", "Cm_de")}, "Cm_de more than once"),
        ({"covariance": np.ones(8)}, "must have 9 numbers, not 8"),
        ({"values": (np.nan, -0.7, -0.8)}, "Cm_0 has USE with the value nan"),
        ({"values": (0.0, np.inf, -0.8)}, "Cm_alpha has USE with the value inf"),
        ({"std": (0.002, 0.02, 0.0)}, "Cm_de has USE with the value -0.85 ± 0"),
        ({"status": (0, 0, 7)}, "status 7"),
        ({"parameters": [], "covariance": []}, "holds no parameters"),
        ({"covariance": np.full(9, np.nan)}, "not finite and positive"),
        ({"covariance": -np.eye(3).ravel()}, "not finite and positive"),
        ({"covariance": np.array([1.0, 0.5, 0, -0.5, 1.0, 0, 0, 0, 1.0])}, "asymmetric"),
        ({"covariance": np.array([1.0, 2.0, 0, 2.0, 1.0, 0, 0, 0, 1.0])}, "not positive semidefinite"),
        ({"covariance": (1.6 * np.eye(3) - 0.6).ravel()}, "not positive semidefinite"),  # no correlation over 1
        ({"covariance": 1e6 * np.eye(3).ravel()}, "Cm_0 has the standard error 0.002, and 1000 in the covariance"),
        ({"covariance": 1e-30 * np.eye(3).ravel()}, "Cm_0 has the standard error 0.002, and 1e-15 in the covariance"),
        ({"values": (-0.03, -0.7, 1e30)}, "Cm_de has USE with 1e\\+30 ± 0.02, and aeroplanes have -5 to 5"),
        ({"values": (-0.03, -0.7, 1e30), "std": (0.002, 0.02, 1e30)}, "Cm_de has USE with 1e\\+30 ± 1e\\+30"),
        ({"airspeed_min": 20.0}, "learnt airspeed begins at 20, above its end 19"),
        ({"airspeed_min": "slow"}, "cannot be read: could not convert"),
        ({"status": ("USE", 0, 0)}, "cannot be read: 'str'"),
        ({"status": (0.9, 0, 0)}, "cannot be read: 'float'"),
        ({"covariance": "none"}, "cannot be read: could not convert"),
        ({"parameters": [{"name": "Cm_0"}], "covariance": [1.0]}, "has no value"),
    ],
)
def test_what_no_estimator_may_send_is_refused_with_a_sentence(content, change, sentence):
    with pytest.raises(InputError, match=sentence) as refused:
        snapshot_of(0, content(**change))
    assert "\n" not in str(refused.value)


def test_what_is_missing_is_named(content):
    for name in ("model", "parameters", "covariance", "beta_max"):
        with pytest.raises(InputError, match=f"has no {name}"):
            snapshot_of(0, {key: value for key, value in content().items() if key != name})
    for nothing in (None, 5, []):
        with pytest.raises(InputError, match="cannot be read"):
            snapshot_of(0, nothing)
    for stamp in (np.nan, 10**30, "now"):
        with pytest.raises(InputError, match="cannot be read"):
            snapshot_of(stamp, content())


def test_what_is_not_used_may_be_of_nothing(content):
    """Only what a controller may take is checked: REJECT is said of what no aeroplane has."""
    values, covariance = (-0.03, 1e30, -0.85), np.diag([4e-6, -1.0, 4e-4]).ravel()
    found = snapshot_of(0, content(values=values, status=(0, 2, 0), covariance=covariance))
    assert found.usable.tolist() == [True, False, True]


def test_a_small_parameter_that_is_little_known_is_no_fault(content):
    """Where thrust hardly moved, its factor is known to more than aeroplanes differ by, and the estimator says USE."""
    name, value, std = "CX_Tc", 1.0, 1.5
    evidence = Evidence(name, value, std, excitation=5.0, effect_of_std=0.01, samples=1000, missing="")
    assert judge(evidence).status == Trust.USE
    message = content(names=(name, "Cm_alpha", "Cm_de"), values=(value, -0.7, -0.85), std=(std, 0.02, 0.02))
    assert snapshot_of(0, message).usable.all()


def test_rounding_and_collinear_parameters_are_no_fault(content):
    """Standard errors in single precision, and two parameters of which only the sum is known, to rounding."""
    std = np.array([0.002, 0.02, 0.02])
    correlation = np.array([[1.0, 0.3, 0.3], [0.3, 1.0, 1.0 + 1e-9], [0.3, 1.0 + 1e-9, 1.0]])
    message = content(std=tuple(float(s) for s in std.astype(np.float32)), covariance=correlation * np.outer(std, std))
    assert snapshot_of(0, message).usable.all()


def test_what_was_never_learnt_may_be_nan(content):
    values, std = (np.nan, -0.7, -0.8), (np.nan, 0.02, 0.02)
    covariance = np.diag([np.nan, 4e-4, 4e-4]).ravel()
    found = snapshot_of(0, content(values=values, std=std, status=(1, 0, 0), covariance=covariance))
    assert found.usable.tolist() == [False, True, True]


@pytest.mark.long
@pytest.mark.parametrize("estimator", ["rls", *(pytest.param(e, marks=pytest.mark.long) for e in ("fourier", "rml"))])
def test_the_estimator_itself_is_never_refused(aircraft, flight, estimator):
    """From nothing learnt to the end of a flight in which a vane sticks: holds, a way back, what is not known."""
    options = ParameterOptions(estimator=estimator, rml_rate=50.0)
    before = parameters_content(Identifier(aircraft, options).snapshot())
    assert not snapshot_of(0, before).usable.any()
    samples = flight.samples[flight.samples.stamp < stamps_of(LENGTH)]
    samples = with_fault(samples, "alpha_stuck", *FAULT)
    pipeline, source, texts = Pipeline(aircraft, parameter_options=options), ParameterSource({}), []
    second = (samples.stamp - samples.stamp[0]) // 10**9
    for part in np.split(np.arange(len(samples)), np.flatnonzero(np.diff(second)) + 1):
        pipeline.push(samples[part])
        if np.isfinite(pipeline.parameters.time):
            content = parameters_content(pipeline.parameters.snapshot())
            assert source.offer(round(1e9 * pipeline.parameters.time), content) == ""
            texts += [(int(p["status"]), p["reason"], bool(np.isfinite(p["value"]))) for p in content["parameters"]]
    assert sum(status == Trust.USE for status, _, _ in texts) > 200
    assert any("the values are those from before it" in reason for _, reason, _ in texts)
    assert any(not finite for _, _, finite in texts)
