"""The laws of turns hold where an aeroplane turns: a Dutch roll on a straight flight slips, and needs no bank."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from aircraft_sysid_ros.flight_check.grid import Grid
from aircraft_sysid_ros.flight_check.laws import turns
from aircraft_sysid_ros.flight_check.signals import ATTITUDE, GYRO

STEP, COUNT, SPEED = 0.05, 3000, 30.0


def motion_with(turning, roll_rate):
    """A level flight with accelerations (n,) across the track [m/s^2] and a roll rate (n,)."""
    course = np.cumsum(turning / SPEED) * STEP
    velocity = SPEED * np.column_stack([np.cos(course), np.sin(course), np.zeros(COUNT)])
    euler = np.column_stack([np.cumsum(roll_rate) * STEP, np.zeros(COUNT), course])
    gyro = np.column_stack([roll_rate, np.zeros(COUNT), turning / SPEED])
    return SimpleNamespace(
        grid=Grid(0.0, STEP, COUNT), gps_width=0.2, turn_acceleration=turning, velocity=velocity, euler=euler,
        gyro=gyro, course_rate=turning / SPEED,
    )  # fmt: skip


@pytest.mark.parametrize(("across", "judged"), [(0.1, False), (2.0, True)])
def test_a_bank_is_what_the_turn_needs_where_there_is_a_turn(across, judged):
    time = np.arange(COUNT) * STEP
    turning = across * np.sqrt(2.0) * np.sin(2.0 * np.pi * time / 6.0)
    banked = np.gradient(np.arctan(turning / 9.80665), STEP)
    motion = motion_with(turning, 0.2 * banked if not judged else banked)
    found = {relation.first for relation in turns.relations(motion)}
    of_turns = {ATTITUDE[0], ATTITUDE[2], GYRO[0], GYRO[2]}
    assert found & of_turns == (of_turns if judged else set())
