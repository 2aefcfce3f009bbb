"""The command line, of which a diagnosis flies two replicas: also in the worker of a page, which runs this file too."""

import sys
from functools import partial

from aircraft_sysid_ros.after_flight import diagnose
from aircraft_sysid_ros.commands.main import main

diagnose.diagnose = partial(diagnose.diagnose, replicas=2)

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
