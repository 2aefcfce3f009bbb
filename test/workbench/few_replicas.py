"""The command line, of which a diagnosis flies two replicas: also in the worker of a page, which runs this file too."""

import sys
from functools import partial

from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.diagnosis import flight_answer

flight_answer.diagnose_run = partial(flight_answer.diagnose_run, replicas=2)

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
