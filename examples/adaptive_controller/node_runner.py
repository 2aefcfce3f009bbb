"""What both nodes share: the topic of the commands, and how a node is made, run and ended."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.signals import SignalHandlerOptions

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.nodes import common

COMMANDS, DEPTH = "commanded_surfaces", 5000


def run_node(kind: Callable[[], Any], work: Callable[[Any, Any, threading.Event], None]) -> int:
    """Make a node and let it ``work(node, executor, stop)``; exit status 2, and a sentence, for bad parameters."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = kind()
        with common.stop_signals() as stop:
            work(node, common.make_executor([node]), stop)
        node.destroy_node()
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    finally:
        rclpy.try_shutdown()
    return 0
