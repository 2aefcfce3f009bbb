"""The former name of `mavlink_simulator.process`, which still works."""

from __future__ import annotations

import sys

from aircraft_sysid_ros.simulation.mavlink_simulator.process import main

if __name__ == "__main__":
    print("warning: stand_in.process is now called mavlink_simulator.process", file=sys.stderr)
    sys.exit(main())
