"""Laws of the maker of flights from strip theory: benchmarks/makers/strip_theory."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks" / "makers"))

from strip_theory.aeroplane import CLEAN, FIN_PART, ICE, TAIL, WASH, WING, drawn_aeroplane, forces_of, section
from strip_theory.flight import gust_field


@pytest.fixture(scope="module")
def plane():
    return drawn_aeroplane(np.random.default_rng(3), "light")


def acting(plane, velocity, rates=(0.0, 0.0, 0.0), controls=(0.0, 0.0, 0.0, 0.0), gust=(0.0, 0.0, 0.0)):
    gusts = np.tile(gust, (len(plane.strips), 1)).astype(float)
    arrays = [np.array(each, dtype=float) for each in (velocity, rates)]
    found = forces_of(plane.strips, *arrays, gusts, np.array(controls), np.array(CLEAN), 0.0, 1.1, 50.0)
    return np.concatenate(found[:2])


def test_left_and_right_are_mirrored(plane):
    one = acting(plane, (60.0, 4.0, 3.0), (0.2, 0.1, -0.3), (0.02, 0.1, -0.1, 0.0))
    other = acting(plane, (60.0, -4.0, 3.0), (-0.2, 0.1, 0.3), (0.02, -0.1, 0.1, 0.0))
    np.testing.assert_allclose(one, other * [1, -1, 1, -1, 1, -1], rtol=1e-9, atol=1e-7)


def test_forces_grow_with_the_square_of_the_speed(plane):
    slow, fast = acting(plane, (40.0, 1.0, 2.0), (0.1, 0.1, 0.1)), acting(plane, (80.0, 2.0, 4.0), (0.2, 0.2, 0.2))
    np.testing.assert_allclose(fast, 4.0 * slow, rtol=1e-9)


def test_air_that_moves_with_all_strips_is_as_a_velocity_of_the_aeroplane(plane):
    np.testing.assert_allclose(acting(plane, (60, 3, 2), gust=(1, -2, -3)), acting(plane, (59, 5, 5)), rtol=1e-12)


def test_rotation_is_damped_and_the_aeroplane_is_stable(plane):
    still = acting(plane, (60.0, 0.0, 2.0))
    for axis in range(3):
        turning = acting(plane, (60.0, 0.0, 2.0), np.eye(3)[axis] * 0.3)
        assert turning[3 + axis] < still[3 + axis]
    assert acting(plane, (60.0, 0.0, 3.0))[4] < still[4]  # nose up: a moment that lowers it
    slipping = acting(plane, (60.0, 3.0, 2.0))
    assert slipping[5] > 0.0 > slipping[3]  # weathercock and dihedral


def test_a_slender_wing_lifts_as_that_of_prandtl(plane):
    """Of a section with 2 π an elliptic wing has 2 π / (1 + 2 / A); strips with the same induced angle have it, too."""
    wing = plane.strips[:WING].copy()
    wing[:, 1:3] *= [1.0, 0.0]
    wing[:, 4:7], wing[:, 8], wing[:, 10], wing[:, 11] = [0.0, 0.0, 1.0], 2.0 * np.pi, 0.0, 0.0
    aspect, area, alpha = wing[0, 9], np.sum(wing[:, 3]), 0.02
    assert aspect == pytest.approx(plane.span**2 / area)
    velocity = 60.0 * np.array([np.cos(alpha), 0.0, np.sin(alpha)])
    zero, none = np.zeros(3), np.zeros((WING, 3))
    force, _, _ = forces_of(wing, velocity, zero, none, np.zeros(4), np.array(CLEAN), 0.0, 1.1, 50.0)
    lift = (force[0] * np.sin(alpha) - force[2] * np.cos(alpha)) / (0.5 * 1.1 * 3600.0 * area)
    drag = -(force[0] * np.cos(alpha) + force[2] * np.sin(alpha)) / (0.5 * 1.1 * 3600.0 * area)
    assert lift == pytest.approx(2.0 * np.pi * alpha / (1.0 + 2.0 / aspect), rel=2e-3)
    assert drag - 0.006 * lift**2 == pytest.approx(lift**2 / (np.pi * aspect), rel=2e-3)


def test_a_section_stalls_and_ice_makes_it_stall_before():
    angles = np.linspace(0.0, 0.6, 121)
    lift, iced = ([section(6.0, angle, ice)[0] for angle in angles] for ice in (0.0, 1.0))
    assert np.argmax(iced) < np.argmax(lift) < 90
    assert max(iced) < max(lift)


def test_a_strip_of_the_wing_has_no_ice_on_the_tail(plane):
    changes = np.array(CLEAN)
    changes[ICE] = 1.0
    tail = plane.strips[WING : WING + TAIL]
    zero, none = np.zeros(3), np.zeros((TAIL, 3))
    arguments = (tail, np.array([60.0, 0.0, 3.0]), zero, none, np.zeros(4))
    clean, iced = (forces_of(*arguments, state, 0.0, 1.1, 50.0)[0] for state in (np.array(CLEAN), changes))
    np.testing.assert_array_equal(clean, iced)


def test_gusts_flow_without_sources_and_have_their_size():
    field = gust_field(np.random.default_rng(0), 2.0, 150.0)
    np.testing.assert_allclose(np.sum(field[:, :3] * field[:, 3:6], axis=1), 0.0, atol=1e-12)
    assert np.sum(field[:, 3:6] ** 2) / 2.0 == pytest.approx(3 * 4.0)  # a wave's mean square is half of its size's


def test_roll_and_yaw_derivatives_of_strips_are_in_proportion_to_lift():
    """What the benchmark counts as true of every flight: C_l,r, C_n,p and C_n,da at two angles of attack."""
    plane = drawn_aeroplane(np.random.default_rng(1), "light")
    pressure, arms = 0.5 * 1.2 * plane.cruise**2 * plane.area, np.array([plane.span, plane.chord, plane.span])

    def moment(alpha, rates=(0.0, 0.0, 0.0), aileron=0.0):
        flow, controls = (
            plane.cruise * np.array([np.cos(alpha), 0.0, np.sin(alpha)]),
            np.array([0.0, aileron, 0.0, 0.0]),
        )
        still = np.zeros((len(plane.strips), 3))
        _, made, _ = forces_of(plane.strips, flow, np.array(rates), still, controls, np.array(CLEAN), 0.0, 1.2, 1e3)
        return made / (pressure * arms)

    def slopes(alpha, h=0.02):
        rate = 2.0 * plane.cruise / plane.span * h
        yawed = (moment(alpha, (0.0, 0.0, rate)) - moment(alpha, (0.0, 0.0, -rate))) / (2.0 * h)
        rolled = (moment(alpha, (rate, 0.0, 0.0)) - moment(alpha, (-rate, 0.0, 0.0))) / (2.0 * h)
        steered = (moment(alpha, aileron=h) - moment(alpha, aileron=-h)) / (2.0 * h)
        return np.array([yawed[0], rolled[2], steered[2]])

    low, high = slopes(0.0), slopes(0.1)
    assert high[0] > 1.7 * low[0] > 0.0  # C_l,r
    assert high[1] < -0.08 and abs(low[1]) < 0.02  # C_n,p
    assert high[2] < -0.01 and abs(low[2]) < 0.006  # C_n,da


@pytest.mark.parametrize(
    ("change", "value", "force", "moment", "surface", "motions"),
    [
        (FIN_PART, 0.5, 1, 5, 2, (((60.0, 3.0, 2.0), (0.0, 0.0, 0.0)), ((60.0, 0.0, 2.0), (0.0, 0.0, 0.2)))),
        (WASH, 0.4, 1, 5, 2, (((60.0, 3.0, 2.0), (0.0, 0.0, 0.0)), ((60.0, 0.0, 2.0), (0.0, 0.0, 0.2)))),
        (WASH, 0.4, 2, 4, 0, (((60.0, 0.0, 4.0), (0.0, 0.0, 0.0)), ((60.0, 0.0, 2.0), (0.0, 0.2, 0.0)))),
    ],
)
def test_what_changes_of_a_tail_surface_has_one_arm(plane, change, value, force, moment, surface, motions):
    """Moment over force of what a lost part, or a wash, makes of flow, rate and deflection: as the ties of the library
    have it (parameter_change, fin with its rudder; propwash, tailplane and fin).
    """

    def made(velocity, rates, deflection=0.0):
        changed, controls = np.array(CLEAN), np.zeros(4)
        changed[change], controls[surface] = value, deflection
        parts = [
            np.concatenate(forces_of(plane.strips, *(np.array(v) for v in (velocity, rates)), still, controls, state,
                                     0.0, 1.1, 50.0)[:2])
            for state in (changed, np.array(CLEAN))
        ]  # fmt: skip
        return parts[0] - parts[1]

    still, level, rest = np.zeros((len(plane.strips), 3)), (60.0, 0.0, 2.0), (0.0, 0.0, 0.0)
    at_rest = made(level, rest)
    steered = made(level, rest, 0.1) - at_rest
    for velocity, rates in motions:
        moved = made(velocity, rates) - at_rest
        assert abs(moved[force]) > 10.0
        assert moved[moment] / moved[force] == pytest.approx(steered[moment] / steered[force], rel=2e-3)
