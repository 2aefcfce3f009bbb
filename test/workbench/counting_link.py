"""The command line, whose live page hears a node that counts: its error is 1 %, 2 %, ... 20 %, then it is silent."""

from __future__ import annotations

import multiprocessing
import sys
import threading
import time
from typing import Any

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.workbench import live_session
from aircraft_sysid_ros.workbench.live_link import PRESENCE, READY

LAST, PERIOD = 20, 0.6  # [-], [s]


class Counting(threading.Thread):
    """In place of the process that hears ROS."""

    def __init__(self, pipe: Any) -> None:
        super().__init__(daemon=True)
        self.pipe = pipe
        self.start()

    def run(self) -> None:
        self.pipe.send((READY, None))
        for count in range(1, LAST + 1):
            time.sleep(PERIOD)
            values = {"measured": 0.1, "predicted": 0.1, "nrmse": 0.01 * count, "over_noise": 5.0}
            stamp = int((1000 + count) * 1e9)
            self.pipe.send(("errors", {"stamp": stamp, "model": "a", "axes": dict.fromkeys(AXES, values)}))
            self.pipe.send((PRESENCE, True))

    def kill(self) -> None:
        self.pipe.close()


def start_link(namespace: str) -> tuple[Counting, Any]:
    ours, theirs = multiprocessing.Pipe()
    return Counting(theirs), ours


if __name__ == "__main__":
    live_session.start_link = start_link
    sys.exit(main(sys.argv[1:]))
