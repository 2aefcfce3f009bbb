"""A flight through the MAVLink simulator and the bridge's session on one virtual clock: faster than real time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from aircraft_sysid_ros.mavlink.assembler import Output
from aircraft_sysid_ros.mavlink.session import Session
from aircraft_sysid_ros.ros_messages.conversion import TOPICS, USED_FIELDS, samples_and_rows
from aircraft_sysid_ros.samples import Samples, concatenate
from aircraft_sysid_ros.simulation.mavlink_simulator.autopilot import MavlinkSimulator
from aircraft_sysid_ros.simulation.mavlink_simulator.sensors import Event
from aircraft_sysid_ros.stamps import NANOSECONDS

STEP = 0.01  # [s] between looks at the link
#: Time 0 of the virtual flight [ns].
START = 1_760_000_000 * NANOSECONDS


@dataclass(frozen=True)
class Link:
    """Delays [s] of packets: at least ``least``, more by a random time of mean ``jitter``, either way."""

    least: float = 0.002
    jitter: float = 0.003
    seed: int = 0


def bridged(
    events: Sequence[Event],
    simulator: MavlinkSimulator,
    session: Session,
    link: Link | None = None,
    at: Sequence[tuple[float, Callable[[], None]]] = (),
    until: float | None = None,
) -> list[Output]:
    """Messages of our topics that the session makes of a flight's samples, in order of arrival.

    ``at``: what happens at which time of flight [s], such as a restart. ``until``: end of the flight [s].
    """
    link = link or Link()
    rng = np.random.default_rng([link.seed, 5])
    outputs: list[Output] = []
    down: list[tuple[float, bytes]] = []
    up: list[tuple[float, bytes]] = []
    pending, position = sorted(at, key=lambda item: item[0]), 0
    end = events[-1].time if until is None else until
    for k in range(int(np.ceil(end / STEP)) + 20):
        now = k * STEP
        while pending and pending[0][0] <= now:
            pending.pop(0)[1]()
        for sent, data in _arrived(up, now):
            simulator.receive(data, sent)
            down += _delayed(simulator, sent, link, rng)
        while position < len(events) and events[position].time <= now:
            simulator.sense(events[position])
            position += 1
            down += _delayed(simulator, events[position - 1].time, link, rng)
        simulator.tick(now)
        down += _delayed(simulator, now, link, rng)
        for arrival, data in _arrived(down, now):
            outputs += session.receive(data, START + round(arrival * NANOSECONDS))
        data = session.tick(START + round(now * NANOSECONDS))
        if data:
            up.append((now + _delay(link, rng), data))
    return outputs


def _delay(link: Link, rng: np.random.Generator) -> float:
    return link.least + float(rng.exponential(link.jitter)) if link.jitter > 0.0 else link.least


def _delayed(
    simulator: MavlinkSimulator, sent: float, link: Link, rng: np.random.Generator
) -> list[tuple[float, bytes]]:
    return [(sent + _delay(link, rng), packet) for packet in simulator.packets()]


def _arrived(queue: list[tuple[float, bytes]], now: float) -> list[tuple[float, bytes]]:
    """Packets that have come by now, in order of arrival; they leave the queue."""
    there = sorted((item for item in queue if item[0] <= now), key=lambda item: item[0])
    queue[:] = [item for item in queue if item[0] > now]
    return there


def samples_of_outputs(outputs: Sequence[Output]) -> Samples:
    """Samples of messages as the nodes would take them, in order of arrival; what a message does not say is NaN."""
    batches: list[Samples] = []
    for output in outputs:
        if output.topic not in TOPICS:
            continue
        n = len(output.stamp)
        fields = {name: output.fields.get(name, np.full(n, np.nan)) for name in USED_FIELDS[output.topic]}
        batches += [samples for samples, _ in samples_and_rows(output.topic, output.stamp, fields)]
    return concatenate(batches)
