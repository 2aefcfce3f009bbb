"""A flight that ends on the ground ends with what was known in the air."""

from types import SimpleNamespace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.frames import quaternion_from_euler
from aircraft_sysid_ros.identification.landing import Known, Landing
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.samples import Kind, Samples, concatenate
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

LEAST, FLIGHT, AFTER = 10.0, 60.0, 35.0  # [m/s], [s], [s]
AT_SPEED, BRAKING = 6.0, 8.0  # [s] of the run on wheels


def rows(begin, end, speed, down=0.0, over_ground=0.0):
    found = np.zeros((round(10 * (end - begin)), StateField.WIDTH))
    found[:, StateField.TIME] = begin + 0.1 * np.arange(len(found))
    found[:, StateField.AIRSPEED], found[:, StateField.VELOCITY.start + 2] = speed, down
    found[:, StateField.VELOCITY.start] = over_ground
    return found


def flown(*parts):
    """When, by what is looked at once a second, it is found on the ground, and of what time the values are."""
    landing, found = Landing(LEAST), []
    for part in parts:
        for second in np.split(part, range(10, len(part), 10)):
            now = float(second[0, StateField.TIME])
            landing.keep(Known(SimpleNamespace(time=now), lambda: None))
            if known := landing.touched_down(now):
                found.append((now, known.kept.time))
            landing.add(second)
    return found, landing


def test_what_was_known_before_the_run_is_published_until_it_flies_again():
    parts = rows(0, 100, 20.0), rows(100, 130, 2.0)
    found, landing = flown(*parts)
    assert found == [(pytest.approx(100.0 + THRESHOLDS.landed), pytest.approx(100.0 - THRESHOLDS.rolling, abs=1.0))]
    assert landing.words(10.0).startswith("on the ground since 90.0 s")
    landing.add(rows(130, 131, 20.0))
    assert landing.words(10.0) == ""


@pytest.mark.parametrize(
    ("fast", "of"),
    [
        (THRESHOLDS.flown - 5.0, 100.0 - THRESHOLDS.rolling),
        (THRESHOLDS.flown + 45.0, 120.0 + THRESHOLDS.flown + 45.0 - THRESHOLDS.rolling),
    ],
)
def test_a_gust_on_the_ground_is_no_flight(fast, of):
    """Wind alone is as fast as the least speed of a light aeroplane: what was known in the air is published again."""
    end = 120.0 + fast
    found, landing = flown(
        rows(0, 100, 20.0), rows(100, 120, 2.0), rows(120, end, 1.1 * LEAST), rows(end, end + 30, 2.0)
    )
    assert [known for _, known in found] == [
        pytest.approx(100.0 - THRESHOLDS.rolling, abs=1.0),
        pytest.approx(of, abs=1.0),
    ]
    assert landing.since == pytest.approx(end, abs=0.2)


@pytest.mark.parametrize(
    "slow",
    [
        rows(100, 100 + THRESHOLDS.landed - 1, 2.0),
        rows(100, 130, 2.0, down=6.0),
        rows(100, 130, 1.2 * LEAST),
        rows(100, 130, 0.0, over_ground=20.0),
    ],
    ids=["a stall", "it sinks", "it glides", "the airspeed fails"],
)
def test_what_is_no_landing(slow):
    end = float(slow[-1, StateField.TIME]) + 0.1
    assert flown(rows(0, 100, 20.0), slow, rows(end, end + 20, 20.0))[0] == []


def test_what_has_not_flown_has_not_landed():
    assert flown(rows(0, THRESHOLDS.flown - 5.0, 20.0), rows(THRESHOLDS.flown - 5.0, 80.0, 0.0))[0] == []


def on_wheels(samples, state):
    """A flight and a run on wheels after it: level, shaken, at speed and then braked; then it stands."""
    rng, last, found = np.random.default_rng(1), int(samples.stamp.max()), []
    velocity = state[StateField.VELOCITY][:2]
    speed, heading = float(np.hypot(*velocity)), float(np.arctan2(velocity[1], velocity[0]))
    along = np.array([np.cos(heading), np.sin(heading), 0.0])
    for kind in np.unique(samples.kind):
        stamps = np.sort(samples.stamp[samples.kind == kind])
        step = int(np.median(np.diff(stamps)))
        stamp = np.arange(stamps[-1] + step, last + int(AFTER * 1e9), step)
        time, noise = (stamp - last) * 1e-9, rng.standard_normal((len(stamp), 6))
        now = speed * np.clip(1.0 - np.clip(time - AT_SPEED, 0.0, None) / BRAKING, 0.0, 1.0)
        rolls = (now > 0.0)[:, None]
        values = np.tile(samples.values[np.flatnonzero(samples.kind == kind)[-1]], (len(stamp), 1))
        if kind == Kind.IMU:
            values[:, :6] = noise * (rolls * np.array([6.0] * 3 + [0.3] * 3) + 0.02)
            values[:, 0] -= speed / BRAKING * (rolls[:, 0] & (time > AT_SPEED))
            values[:, 2] -= 9.81
        elif kind == Kind.ATTITUDE:
            values[:, :4] = quaternion_from_euler(0.0, 0.0, heading)
        elif kind == Kind.GPS_VELOCITY:
            values[:, :3] = now[:, None] * along
        elif kind == Kind.GPS_POSITION:
            way = np.cumsum(now) * step * 1e-9 / 6.371e6
            values[:, 0] += way * along[0]
            values[:, 1] += way * along[1] / np.cos(values[0, 0])
        elif kind == Kind.AIRSPEED:
            values[:, 0] = np.abs(now + 0.1 * noise[:, 0])
        elif kind in (Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP):
            values[:, 0] = 0.05 * noise[:, 0]
        elif kind == Kind.CONTROLS:
            values[:, :3] = 0.05 * noise[:, :3] * rolls
        found.append(Samples(stamp, np.full(len(stamp), kind), values))
    joined = concatenate([samples, *found])
    return joined[np.argsort(joined.stamp, kind="stable")]


@pytest.mark.long
def test_a_hard_landing_spoils_nothing_and_blocks_of_any_size_say_the_same():
    aircraft = default_aircraft()
    samples = simulate_samples(aircraft, 5, FLIGHT, sensors=SensorOptions(attitude=True)).samples
    pipeline = Pipeline(aircraft)
    state = pipeline.push(samples)[0][-1]
    in_air = {p.name: p for p in pipeline.parameters.snapshot().parameters}
    landed, found = on_wheels(samples, state), []
    for pieces in (40, 97):
        pipeline = Pipeline(aircraft)
        for part in np.array_split(np.arange(len(landed)), pieces):
            pipeline.push(landed[part])
        pipeline.flush()
        found.append(pipeline.parameters.snapshot())
    assert repr(found[0]) == repr(found[1])
    used = [p for p in found[0].parameters if p.status is Trust.USE]
    assert len(used) >= 0.8 * sum(p.status is Trust.USE for p in in_air.values())
    assert all("on the ground since" in p.reason and p.age > AFTER for p in used)
    assert all(abs(p.value - in_air[p.name].value) < 4.0 * p.std for p in used)
    assert pipeline.parameters.learning.integrity.summary()["held"] == ""
