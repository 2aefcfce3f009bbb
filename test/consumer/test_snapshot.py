"""A message becomes one checked, immutable set, or is refused with a sentence."""

import numpy as np
import pytest

from aircraft_sysid_ros.consumer import snapshot_of
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.modelling.parameter_estimator import ParameterEstimator
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.recordings.output_messages import parameters_content


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
        ({"covariance": np.array([1.0, 0.5, 0, -0.5, 1.0, 0, 0, 0, 1.0])}, "asymmetric or correlated over 1"),
        ({"covariance": np.array([1.0, 2.0, 0, 2.0, 1.0, 0, 0, 0, 1.0])}, "asymmetric or correlated over 1"),
        ({"airspeed_min": 20.0}, "learnt airspeed begins at 20, above its end 19"),
    ],
)
def test_what_no_estimator_may_send_is_refused_with_a_sentence(content, change, sentence):
    with pytest.raises(InputError, match=sentence) as refused:
        snapshot_of(0, content(**change))
    assert "\n" not in str(refused.value)


def test_what_was_never_learnt_may_be_nan(content):
    values, std = (np.nan, -0.7, -0.8), (np.nan, 0.02, 0.02)
    covariance = np.diag([np.nan, 4e-4, 4e-4]).ravel()
    found = snapshot_of(0, content(values=values, std=std, status=(1, 0, 0), covariance=covariance))
    assert found.usable.tolist() == [False, True, True]


def test_the_estimator_itself_is_never_refused(aircraft, flight):
    """From nothing learnt to the end of a flight."""
    before = parameters_content(ParameterEstimator(aircraft).snapshot())
    assert not snapshot_of(0, before).usable.any()
    pipeline, counts = Pipeline(aircraft), []
    for begin in range(0, len(flight.samples), 4000):
        pipeline.push(flight.samples[begin : begin + 4000])
        counts.append(int(snapshot_of(begin, parameters_content(pipeline.parameters.snapshot())).usable.sum()))
    assert counts[-1] > 25
