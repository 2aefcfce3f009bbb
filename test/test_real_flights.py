"""The chain on real flights. The references are not truth: tolerances are those that a user would accept."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
import real_flights


@pytest.fixture(scope="module")
def thor(shared_data, tmp_path_factory):
    return real_flights.thor(shared_data, tmp_path_factory.mktemp("thor"))[0]


@pytest.fixture(scope="module")
def inertialnav(shared_data, tmp_path_factory):
    return real_flights.inertialnav(shared_data, tmp_path_factory.mktemp("inertialnav"))


@pytest.mark.long
def test_thor_wind_is_that_of_the_wind_triangle(thor) -> None:
    assert thor["wind_horizontal_difference"] < 1.5


@pytest.mark.long
def test_thor_gyro_biases_are_those_of_the_onboard_filter(thor) -> None:
    assert np.max(thor["gyro_bias_difference"]) < 0.005


def test_thor_attitude_is_that_of_the_onboard_filter(thor) -> None:
    assert np.max(thor["attitude_rms_deg"]) < 3.0


def test_thor_derivatives_have_the_signs_of_the_reference_model(thor) -> None:
    parameters = {p["name"]: p for p in thor["parameters"]}
    assert parameters["CZ_alpha"]["value"] == pytest.approx(-4.58, rel=0.5)
    for name in ("Cm_alpha", "Cm_q", "Cl_p", "Cn_beta", "Cl_beta", "Cl_da", "Cm_de", "Cn_r", "CY_beta"):
        assert np.sign(parameters[name]["value"]) == np.sign(parameters[name]["reference"]), name


def test_thor_rudder_is_not_claimed_to_be_known(thor) -> None:
    """It moves by 0.7 deg at most: software that reports its derivatives is wrong."""
    for p in thor["parameters"]:
        if p["name"].endswith("_dr"):
            assert p["status"] in ("HOLD", "REJECT") and p["reason"], p


def test_on_thor_what_is_held_is_what_the_laboratory_contradicts(thor) -> None:
    """C_m,q is read five times too small, with a small standard error: docs/real-flights.md."""
    of_axis = {axis: [p for p in thor["parameters"] if p["name"].startswith(f"{axis}_")] for axis in ("Cl", "Cm")}
    assert of_axis["Cl"] and of_axis["Cm"]
    assert not any(p["status"] == "USE" for axis in ("Cl", "Cm") for p in of_axis[axis])
    assert any("the model explains" in p["reason"] for p in of_axis["Cm"])


@pytest.mark.long
def test_inertialnav_does_not_diverge(inertialnav) -> None:
    for variants in inertialnav.values():
        assert variants["with delays"]["finite"]
        assert variants["with delays"]["realignments"] == 0
        for nis in variants["with delays"]["innovation_consistency"].values():
            assert nis < 1.5
    assert inertialnav["TestLog2"]["with delays"]["largest_roll_deg"] > 175.0


@pytest.mark.long
def test_stated_delays_make_innovations_smaller(inertialnav) -> None:
    variants = inertialnav["SwissLog1"]
    for kind in ("airspeed", "gps_velocity"):
        with_delays = variants["with delays"]["innovation_consistency"][kind]
        assert with_delays < variants["without delays"]["innovation_consistency"][kind], kind
