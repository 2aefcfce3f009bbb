"""``bridge dds:``: what is different where PX4's topics are heard in place of MAVLink."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from typing import Any

from aircraft_sysid_ros.commands.options import absolute_namespace
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.mavlink.assembler import only_known_topics
from aircraft_sysid_ros.mavlink.px4_listener import FMU_OUT
from aircraft_sysid_ros.mavlink.px4_table import PX4
from aircraft_sysid_ros.mavlink.servo_mapping import load_servo_mapping
from aircraft_sysid_ros.mavlink.sources import check_sources

SCHEME = "dds:"


def is_meant(args: argparse.Namespace) -> bool:
    """Whether the connection is to the agent of uXRCE-DDS."""
    return str(args.connection).startswith(SCHEME)


def is_result(result: Mapping[str, Any]) -> bool:
    """Whether a result is of such a connection."""
    return str(result["connection"]).startswith(SCHEME)


def check(args: argparse.Namespace) -> None:
    """Raises InputError for what such a connection does not have."""
    for option, given in (("--peer", args.peer), ("--signing-key", args.signing_key), ("--system", args.system)):
        if given:
            raise InputError(f"{option} is for MAVLink: leave it out with {SCHEME}")
    if args.back:
        raise InputError(f"--back sends MAVLink: it needs a bridge of its own, without {SCHEME}")
    only_known_topics(args.topics, "--topics: unknown topic")
    if args.servos:
        check_sources(PX4, load_servo_mapping(args.servos), args.servos)


def node(args: argparse.Namespace) -> Callable[[], Any]:
    """What makes the node; raises ImportError where there is no ROS."""
    from rclpy.parameter import Parameter

    from aircraft_sysid_ros.nodes.px4_bridge import Px4BridgeNode, check_definitions, whole_prefix

    prefix = str(args.connection).removeprefix(SCHEME) or FMU_OUT
    whole_prefix("", prefix)  # what the node would only log, as one line before it starts
    check_definitions()
    values = {
        "prefix": prefix,
        "servo_file": args.servos or "",
        "topics": args.topics or [""],
    }
    overrides = [Parameter(name, value=value) for name, value in values.items()]
    return lambda: Px4BridgeNode(parameter_overrides=overrides, namespace=absolute_namespace(args.namespace))


def counts(result: Mapping[str, Any]) -> list[str]:
    """How many messages of each kind were received and published, a line each; of MAVLink, too."""
    received = [f"  {name:<28} {count:>8} received" for name, count in sorted(result["received"].items())]
    return received + [f"  /{topic:<27} {count:>8} published" for topic, count in sorted(result["published"].items())]


def render(result: Mapping[str, Any]) -> str:
    """The result for people."""
    place = str(result["connection"]).removeprefix(SCHEME) or FMU_OUT
    nothing = f"no topic of PX4 was heard under {place}: does the agent run, with the same ROS_DOMAIN_ID and namespace?"
    lines = [f"PX4 under {place}" if result["vehicle"] else nothing]
    lines += counts(result)
    if result["clock"]:
        lines.append(f"clock: {result['clock']}")
    if result["not_finite"] or result["unstamped"]:
        lines.append(
            f"left out: {result['not_finite']} without numbers, {result['unstamped']} before the clock was known"
        )
    return "\n".join(lines)
