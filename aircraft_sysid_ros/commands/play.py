"""``play``: a recording onto ROS 2 topics, for those without `ros2 bag play`.

The messages go out as they were recorded, byte for byte, with their original stamps, in the order of arrival.
Publishers are reliable by default, since a reliable publisher matches every subscriber, whereas a best-effort
one is deaf to those who ask for every sample; --best-effort plays as a sensor driver would. A reliable playback
waits for subscribers that are behind, before one topic is a second of the recording ahead of another, and ends when
they have everything. One that keeps every sample, as `live --reliable` does, loses none at any rate; another loses what
its own queue does not hold. A mass is transient local, so that a node that starts later has it.

Where the log times leap ahead by more than two minutes, the clock of the recorder was set: what follows goes out at
once.

With --clock the time of the recording goes to /clock, for nodes whose use_sim_time is true.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.commands.notes import note_lines
from aircraft_sysid_ros.commands.progress import progress_bar
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.installation import missing_ros, start_ros, stay_local
from aircraft_sysid_ros.recordings.playback import LARGEST_LEAP, Schedule, every
from aircraft_sysid_ros.recordings.raw_messages import RawMessages
from aircraft_sysid_ros.recordings.storage import read_raw
from aircraft_sysid_ros.stamps import NANOSECONDS

BEST_EFFORT_DEPTH = 100
#: Said once, perhaps, and heard by who comes later, too; ROS would warn a publisher that does not offer it.
LATCHED, LATCHED_DEPTH = "mass_properties", 100
#: How long [s] to wait at a time for subscribers that are behind.
PATIENCE = 0.1
#: After so long [s] it is said who is behind.
LONG_WAIT = 10.0
#: Without --wait: as long as this [s] for the first subscriber.
LONGEST_WAIT = 5.0
#: Within this time [s] of its start a program has found all that were there, and they it. The middleware exchanges
#: what it lost once in three seconds: of two nodes that hear a topic one may be found so much later.
DISCOVERY = 3.2
#: And no more have appeared for this time [s].
ALL_FOUND = 0.5
#: Longest time [s] of the recording that one topic runs ahead of another.
MOST_AHEAD = 1.0
#: Of Fast DDS, for ``_quick_heartbeats``.
_PROFILE = """<?xml version="1.0" encoding="UTF-8"?>
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <publisher profile_name="quick_heartbeats" is_default_profile="true">
    <times><heartbeatPeriod><sec>0</sec><nanosec>20000000</nanosec></heartbeatPeriod></times>
  </publisher>
</profiles>
"""
CLOCK_RATE = 40.0  # [Hz] of --clock, as of `ros2 bag play`
LAST_MESSAGES = 0.2  # [s] for the middleware to send what best-effort publishers still hold


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "play", help="a recording onto ROS 2 topics", description=__doc__
    )
    add = parser.add_argument
    add("recording", metavar="BAG", help="rosbag2 folder, .mcap, .db3 or .bag file")
    add(
        "--rate",
        type=float,
        default=1.0,
        metavar="R",
        help="times real time; 0: unpaced, which only fast subscribers can follow (default: 1)",
    )
    add("--topic-prefix", default="", metavar="NS", help="namespace to put before every topic")
    add("--clock", nargs="?", type=float, const=CLOCK_RATE, metavar="HZ",
        help=f"the time of the recording onto /clock, at this rate (default: {CLOCK_RATE:g} a second)")  # fmt: skip
    add("--topics", nargs="+", metavar="TOPIC", help="play only these, named as recorded (default: all)")
    add(
        "--wait",
        type=float,
        metavar="S",
        help="wait up to this long for a subscriber on every topic (default: 5 s, or until no more appear)",
    )
    reliability = parser.add_mutually_exclusive_group()
    reliability.add_argument(
        "--reliable", action="store_true", help="offer every sample again until received (default)"
    )
    reliability.add_argument("--best-effort", action="store_true", help="publish as a sensor driver does")
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Play; returns the number of messages by topic. Raises InputError."""
    if not 0.0 <= args.rate < np.inf:
        raise InputError(f"--rate must be 0 or more, not {args.rate:g}")
    if args.wait is not None and not 0.0 <= args.wait < np.inf:
        raise InputError(f"--wait must be 0 or more, not {args.wait:g}")
    if args.clock is not None and not 0.0 < args.clock <= 1e4:
        raise InputError(f"--clock must be a rate in Hz from above 0 to 10000, not {args.clock:g}")
    raw = read_raw(args.recording)
    selected = _selected(raw, args)
    try:
        import rclpy
    except ImportError as error:
        raise missing_ros(error) from None
    if said := stay_local():
        print(f"playing to {said}", file=sys.stderr, flush=True)
    start_ros(args.ros_args)  # a signal ends what runs, not ROS under it
    try:
        with _quick_heartbeats():
            node = rclpy.create_node("player")
        created = time.perf_counter()
        publishers, unknown = _publishers(node, raw, selected, args)
        if not publishers:
            raise InputError(f"no message type of {args.recording} is installed: {', '.join(unknown.values())}")
        _wait_for_subscribers(publishers, args.wait, created)
        played = _play(raw, publishers, args, _Clock(node, args) if args.clock else None)
        notes = [*raw.notes, *played.pop("notes")]
        return {"recording": str(args.recording), **played, "not_played": unknown, "notes": notes}
    finally:
        rclpy.try_shutdown()


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    lines = [f"{result['recording']}: {result['duration']:.1f} s played in {result['elapsed']:.1f} s"]
    for topic, count in result["messages"].items():
        listeners = result["subscribers"][topic]
        lines.append(f"  {topic:<32} {count:>8}  {listeners} subscriber{'' if listeners == 1 else 's'}")
    lines += [f"  {topic:<32} not played: {why}" for topic, why in result["not_played"].items()]
    lines += note_lines(result["notes"])
    return "\n".join(lines)


def _selected(raw: RawMessages, args: argparse.Namespace) -> dict[int, str]:
    """Full name to publish on by channel."""
    wanted = None if args.topics is None else {"/" + topic.strip("/") for topic in args.topics}
    names = {key: "/" + channel.topic.strip("/") for key, channel in raw.channels.items()}
    missing = (wanted or set()) - set(names.values())
    if missing:
        raise InputError(f"the recording {args.recording} has no {sorted(missing)[0]}: it holds {raw.topic_names()}")
    prefix = "/" + args.topic_prefix.strip("/") if args.topic_prefix.strip("/") else ""
    return {key: prefix + name for key, name in names.items() if wanted is None or name in wanted}


def _publishers(
    node: Any, raw: RawMessages, selected: dict[int, str], args: argparse.Namespace
) -> tuple[dict[int, Any], dict[str, str]]:
    """Publisher by channel, and for topics that cannot be played the reason."""
    from rclpy.exceptions import InvalidTopicNameException
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

    from aircraft_sysid_ros.nodes.common import message_class
    from aircraft_sysid_ros.recordings.message_types import is_as_known

    quality = QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE)
    if args.best_effort:
        quality = QoSProfile(depth=BEST_EFFORT_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
    latched = QoSProfile(depth=LATCHED_DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publishers: dict[int, Any] = {}
    unknown: dict[str, str] = {}
    for key, topic in selected.items():
        offered = latched if topic.rpartition("/")[2] == LATCHED else quality
        channel = raw.channels[key]
        if not is_as_known(channel):
            unknown[topic] = f"the recording has another definition of {channel.type}"
            continue
        try:
            publishers[key] = node.create_publisher(message_class(channel.type), topic, offered)
        except (ImportError, AttributeError, ValueError):
            unknown[topic] = f"the type {channel.type} is not installed"
        except InvalidTopicNameException as error:
            raise InputError(f"{topic} is not a topic name: {error}") from None
    return publishers, unknown


def _wait_for_subscribers(publishers: dict[int, Any], asked: float | None, created: float) -> None:
    """Until every topic has a subscriber and no more appear, or the time is over; if none was asked for, or no more
    appear at all. ``created``: when the node was, by the clock of ``time.perf_counter``.
    """
    start = changed = time.perf_counter()
    longest = LONGEST_WAIT if asked is None else asked
    before = 0
    while (now := time.perf_counter()) - start < longest:
        counts = [publisher.get_subscription_count() for publisher in publishers.values()]
        if sum(counts) != before:
            before, changed = sum(counts), now
        is_enough = all(counts) or (before and asked is None)
        if is_enough and now - created > DISCOVERY:
            was_there = changed - created < DISCOVERY  # else it has just started, and so may have others
            if now - changed > (ALL_FOUND if was_there else DISCOVERY):
                return
        time.sleep(0.02)


def _play(
    raw: RawMessages, publishers: dict[int, Any], args: argparse.Namespace, clock: _Clock | None
) -> dict[str, Any]:
    """Send everything; returns counts by topic and times [s]."""
    rows = np.flatnonzero(np.isin(raw.channel, list(publishers)))
    channels, log_times = raw.channel[rows].tolist(), raw.log_time[rows].tolist()
    steps = np.diff(raw.log_time[rows], prepend=raw.log_time[rows[:1]]) / NANOSECONDS
    leaps = steps > LARGEST_LEAP / NANOSECONDS
    times = np.cumsum(np.where(leaps, 0.0, steps)).tolist()  # of the recording, without leaps
    duration = times[-1] if times else 0.0
    counts = dict.fromkeys(publishers, 0)
    schedule, show = Schedule(args.rate), every(0.1)
    reliable = [] if args.best_effort else list(publishers.values())  # best-effort subscribers never say what they have
    together, latecomers = _Together(reliable), _Latecomers(list(publishers.values()))
    started = time.perf_counter()
    with progress_bar() as progress:
        task = progress.add_task("playing", total=duration)
        for row, key, log_time, played in zip(rows.tolist(), channels, log_times, times, strict=True):
            schedule.wait(log_time)
            together.wait(log_time)
            if clock is not None:
                clock.tell(log_time)
            _publish(publishers[key], raw[row])
            counts[key] += 1
            if next(show):
                progress.update(task, completed=played)
                latecomers.look(played)
        elapsed = time.perf_counter() - started
        subscribers = {p.topic_name: p.get_subscription_count() for p in publishers.values()}
        progress.update(task, description="waiting for subscribers that are behind", completed=duration)
        time.sleep(LAST_MESSAGES)
        _wait_until_all_have_it(reliable)
    messages: dict[str, int] = {}
    for key, count in counts.items():
        topic = publishers[key].topic_name
        messages[topic] = messages.get(topic, 0) + count
    timing = {"rate": args.rate, "duration": duration, "elapsed": elapsed, "delay": schedule.delay}
    notes = [*latecomers.notes, *_leap_notes(steps[leaps])]
    return {**timing, "messages": messages, "subscribers": subscribers, "notes": notes}


def _leap_notes(leaps: npt.NDArray[np.float64]) -> list[str]:
    """That the log times leap ahead by so much [s] (n,), each."""
    if not len(leaps):
        return []
    times = "once" if len(leaps) == 1 else f"{len(leaps)} times"
    return [
        f"the log times leap ahead {times}, by {leaps.max():.4g} s at most, as where the clock of the recorder was "
        "set: this is not waited for"
    ]


@contextmanager
def _quick_heartbeats() -> Iterator[None]:
    """For a node that is made meanwhile: Fast DDS asks reliable subscribers for what they have 50 times in a second.

    By default it asks every three seconds, for which ``_Together`` would wait. A profile of the user's own stays.
    """
    name = "FASTRTPS_DEFAULT_PROFILES_FILE"
    if os.environ.get(name) or os.environ.get("FASTDDS_DEFAULT_PROFILES_FILE"):
        yield
        return
    with tempfile.NamedTemporaryFile("w", suffix=".xml") as file:
        file.write(_PROFILE)
        file.flush()
        os.environ[name] = file.name
        try:
            yield
        finally:
            del os.environ[name]


class _Together:
    """Lets no topic run ahead of another: reliable subscribers have what was sent before more of the flight is.

    The queues of a fast topic are full first, at the publisher as at a subscriber that is slow: what waits there would
    come a minute after what slow topics go on to send.
    """

    def __init__(self, publishers: list[Any]) -> None:
        self._publishers, self._due = publishers, 0

    def wait(self, log_time: int) -> None:
        """Before what was recorded at a time [ns]."""
        if log_time >= self._due:
            self._due = log_time + int(MOST_AHEAD * NANOSECONDS)
            _wait_until_all_have_it(self._publishers)


class _Clock:
    """The time of the recording on /clock, with its messages and at most so often."""

    def __init__(self, node: Any, args: argparse.Namespace) -> None:
        from rclpy.qos import QoSProfile
        from rosgraph_msgs.msg import Clock

        self._kind = Clock
        self._publisher = node.create_publisher(Clock, "/clock", QoSProfile(depth=10))
        self._period = int(NANOSECONDS * (args.rate or 1.0) / args.clock)
        self._due: int | None = None

    def tell(self, now: int) -> None:
        """Publish a log time [ns] where it is due."""
        if self._due is None or not self._due - 2 * self._period <= now < self._due:
            self._due = now + self._period
            message = self._kind()
            message.clock.sec, message.clock.nanosec = divmod(now, NANOSECONDS)
            self._publisher.publish(message)


def _publish(publisher: Any, message: bytes) -> None:
    """Publish; while the queue is full because subscribers are behind, wait for them."""
    from rclpy.impl.implementation_singleton import rclpy_implementation

    had_room, slow = False, _SlowSubscriber(publisher)
    while True:
        try:
            publisher.publish(message)
            return
        except rclpy_implementation.RCLError:
            if had_room:
                raise
            had_room = _all_have_it(publisher)
            slow.tell()


class _SlowSubscriber:
    """Says once who is waited for, when it has taken long: one that hangs is waited for as long as it lives."""

    def __init__(self, publisher: Any) -> None:
        self._publisher, self._since, self._told = publisher, time.perf_counter(), False

    def tell(self) -> None:
        if not self._told and time.perf_counter() - self._since > LONG_WAIT:
            self._told = True
            count, topic = self._publisher.get_subscription_count(), self._publisher.topic_name
            who = f"{count} subscriber{'' if count == 1 else 's'} of {topic}"
            words = f"waiting for {who}, which took nothing for {LONG_WAIT:g} s; Ctrl-C ends"
            print(words, file=sys.stderr, flush=True)


def _all_have_it(publisher: Any) -> bool:
    """Whether reliable subscribers have, before long, what was sent."""
    from rclpy.duration import Duration

    return bool(publisher.wait_for_all_acked(Duration(nanoseconds=int(PATIENCE * NANOSECONDS))))


def _wait_until_all_have_it(publishers: list[Any]) -> None:
    """Until reliable subscribers have what was sent, or are gone."""
    for publisher in publishers:
        slow = _SlowSubscriber(publisher)
        while not _all_have_it(publisher):
            slow.tell()


class _Latecomers:
    """Notes of subscribers that were found only after the playback had begun: what had gone out they do not have."""

    def __init__(self, publishers: list[Any]) -> None:
        self._publishers, self._counts = publishers, [p.get_subscription_count() for p in publishers]
        self.notes: list[str] = []

    def look(self, played: float) -> None:
        """When so much [s] of the recording has been played."""
        before, self._counts = self._counts, [p.get_subscription_count() for p in self._publishers]
        new = [p.topic_name for p, *n in zip(self._publishers, self._counts, before, strict=True) if n[0] > n[1]]
        if new:
            self.notes.append(
                f"a subscriber of {', '.join(new)} was found when {played:.1f} s had been played, and lacks what came "
                "before: start it before the playback"
            )
