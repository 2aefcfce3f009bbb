"""``bridge``: an autopilot's MAVLink onto our input topics, wind and parameters back to it, until Ctrl-C.

``bridge dds:`` hears the topics of PX4's uXRCE-DDS agent (px4_msgs) in place of MAVLink.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from aircraft_sysid_ros.commands import bridge_px4
from aircraft_sysid_ros.commands.options import absolute_namespace, add_option, add_servos
from aircraft_sysid_ros.commands.progress import progress_bar, say_ready
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.installation import MissingExtra, missing_ros, start_ros, stay_local
from aircraft_sysid_ros.mavlink.back_options import BackOptions
from aircraft_sysid_ros.option import OptionError, options_of

DEFAULT_CONNECTION = "udp:0.0.0.0:14550"


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "bridge", help="an autopilot onto ROS 2 topics: MAVLink, or PX4's uXRCE-DDS", description=__doc__
    )
    add = parser.add_argument
    add("connection", nargs="?", default=DEFAULT_CONNECTION, metavar="CONNECTION",
        help="udp:HOST:PORT (listens), udpout:HOST:PORT, tcp:HOST:PORT or serial:DEVICE:BAUD; "
        "dds:[PREFIX] for topics of px4_msgs, by default under fmu/out "
        f"(default: {DEFAULT_CONNECTION})")  # fmt: skip
    add_servos(parser, "what outputs and airspeed mean (YAML); without it no control surfaces")
    add("--peer", default="", metavar="HOST",
        help="the only host that is accepted on UDP (default: that of the vehicle, once it is found)")  # fmt: skip
    add("--signing-key", default="", metavar="FILE",
        help="key of signed MAVLink, 64 hexadecimal digits or a passphrase: nothing else is accepted")  # fmt: skip
    add("--system", type=int, default=0, metavar="N", help="system id of the vehicle (default: the first heard)")
    add("--namespace", default="", metavar="NS", help="namespace of the node and its topics")
    add("--topics", nargs="+", default=[], metavar="TOPIC", help="publish these only (default: all)")
    add("--back", nargs="+", default=[], metavar="PARAMETER", help="to send to the autopilot, such as CZ_alpha")
    back = options_of(BackOptions)
    add_option(parser, "back_form", back["form"])
    add_option(parser, "back_rate", replace(back["wind_rate"], sentence="Rate of wind and parameters; 0: nothing."))
    add("--duration", type=float, metavar="S", help="end after S seconds (default: run until Ctrl-C)")
    add("--ready-file", metavar="FILE", help="file to create when the bridge listens, for scripts")
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Run the node until Ctrl-C or the duration; returns what came and went. Raises InputError."""
    if args.duration is not None and not 0.0 < args.duration < 1e9:
        raise InputError(f"--duration must be a positive time in s, not {args.duration:g}")
    is_px4 = bridge_px4.is_meant(args)
    bridge_px4.check(args) if is_px4 else _check(args)
    try:
        import rclpy

        from aircraft_sysid_ros.nodes.common import make_executor, spare_the_collector, spin_until, start, stop_signals

        make = bridge_px4.node if is_px4 else _node
        make_node = make(args)
    except ImportError as error:
        raise missing_ros(error) from None
    _check_namespace(args.namespace)
    said = stay_local()
    start_ros(args.ros_args)  # a signal ends what runs, not ROS under it
    node: Any = None
    try:
        node = make_node()
        if not start(node):
            raise node.failure or InputError("the bridge did not start: see the message above")
        ends = None if args.duration is None else time.monotonic() + args.duration
        with progress_bar() as progress, stop_signals() as stop:
            _say_listening(args, said)
            task = progress.add_task("waiting", total=None)

            def finished() -> bool:
                progress.update(task, description=_state(node.link))
                return stop.is_set() or node.failure is not None or (ends is not None and time.monotonic() >= ends)

            spare_the_collector()
            spin_until(make_executor([node]), finished)
        if node.failure is not None:
            raise node.failure
        counts = {} if is_px4 else {"foreign": node.bridge.transport.foreign, "sent_back": node.bridge.back.sent}
        notes = [text] if (text := node.link.outputs_condition) else []
        return {"connection": args.connection, **node.link.summary(), **counts, "notes": notes}
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()


def _say_listening(args: argparse.Namespace, said: str) -> None:
    print(f"listening on {args.connection}{', publishing to ' if said else ''}{said}", file=sys.stderr)
    if not args.servos:
        print("without --servos it is not known what the outputs move: no control surfaces", file=sys.stderr)
    sys.stderr.flush()
    say_ready(args.ready_file)


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    return "\n".join([_told(result), *(f"note: {note}" for note in result["notes"])])


def _told(result: dict[str, Any]) -> str:
    if bridge_px4.is_result(result):
        return bridge_px4.render(result)
    clock = result["clock"]
    heard = f"{result['vehicle']} on {result['connection']}"
    lines = [heard if result["vehicle"] else f"no autopilot was heard on {result['connection']}: does it send there?"]
    lines += bridge_px4.counts(result)
    if clock["std"] is not None:
        lines.append(f"clock known to {1e3 * clock['std']:.2f} ms, drift {clock['drift_ppm']:.1f} ppm")
    refused = {
        "packets of others": result["foreign"],
        "messages that were not signed with the key": result["not_signed"],
        "messages without usable numbers": result["not_finite"],
    }
    if told := ", ".join(f"{count} {what}" for what, count in refused.items() if count):
        lines.append(f"left out: {told}")
    lines.append(
        f"{result['bad_data']} pieces of bad data, {result['reboots']} restarts of the autopilot, "
        f"{result['losses']} silences, {result['missing']} packets lost on the way, "
        f"{result['sent_back']} messages sent back"
    )
    return "\n".join(lines)


def _check(args: argparse.Namespace) -> None:
    """What the node would only log, as one clear line before it starts."""
    try:
        from aircraft_sysid_ros.mavlink.assembler import only_known_topics
        from aircraft_sysid_ros.mavlink.mavlink_table import MAVLINK
        from aircraft_sysid_ros.mavlink.requests import Requests
        from aircraft_sysid_ros.mavlink.servo_mapping import load_servo_mapping
        from aircraft_sysid_ros.mavlink.signing import load_key
        from aircraft_sysid_ros.mavlink.sources import check_sources
        from aircraft_sysid_ros.mavlink.transport import Transport, parse_address
    except ImportError:
        raise MissingExtra("bridges", "pymavlink", "bridge") from None
    address = parse_address(args.connection)
    if args.servos:
        mapping = load_servo_mapping(args.servos)
        Requests(mapping.rates)
        check_sources(MAVLINK, mapping, args.servos)
    if args.signing_key:
        load_key(args.signing_key)
    if args.peer and address.kind != "udpin":
        raise InputError(f"--peer is for a connection that listens, such as {DEFAULT_CONNECTION}: leave it out")
    if not 0 <= args.system <= 255:
        raise InputError(f"--system must be from 0 to 255, not {args.system}")
    only_known_topics(args.topics, "--topics: unknown topic")
    _check_back(args)
    if address.kind == "udpin":  # a board may start anew when its port is opened: once is enough
        transport = Transport(address, args.peer)
        transport.open()
        transport.close()


def _check_back(args: argparse.Namespace) -> None:
    rate = args.back_rate
    try:
        BackOptions(parameters=tuple(args.back), form=args.back_form, wind_rate=rate, parameter_rate=rate)
    except OptionError as error:
        raise InputError(f"--back-rate {error.what}") from None


def _check_namespace(namespace: str) -> None:
    """Before a node is made: rclpy would print a warning of its own first."""
    from rclpy.exceptions import NameValidationException
    from rclpy.validate_namespace import validate_namespace

    try:
        validate_namespace(absolute_namespace(namespace) or "/")
    except NameValidationException as error:
        reason = str(error).splitlines()[0].removeprefix("Invalid namespace: ")
        raise InputError(f"--namespace {namespace} is not a namespace: {reason}") from None


def _node(args: argparse.Namespace) -> Callable[[], Any]:
    """What makes the node; raises ImportError where there is no ROS."""
    from aircraft_sysid_ros.nodes.mavlink_bridge import MavlinkBridgeNode

    return lambda: MavlinkBridgeNode(**_node_arguments(args))


def _node_arguments(args: argparse.Namespace) -> dict[str, Any]:
    from rclpy.parameter import Parameter

    values = {
        "connection": args.connection,
        "servo_file": args.servos or "",
        "peer": args.peer,
        "signing_key_file": args.signing_key,
        "system": args.system,
        "topics": args.topics or [""],
        "back_parameters": args.back or [""],
        "back_form": args.back_form,
        "back_wind_rate": float(args.back_rate),
        "back_parameter_rate": float(args.back_rate),
    }
    overrides = [Parameter(name, value=value) for name, value in values.items()]
    return {"parameter_overrides": overrides, "namespace": absolute_namespace(args.namespace)}


def _state(session: Any) -> str:
    counts = f"{sum(session.received.values())} messages, {sum(session.published.values())} samples"
    problem = session.condition or session.outputs_condition
    return f"{problem}: {counts}" if problem else counts
