"""Waiting for processes: long enough for a busy machine, and not for ever."""

import signal
import subprocess

#: [s] A process that takes longer hangs.
LONGEST = 300.0


def finish(process):
    """What a process printed, when it ends; one that hangs shows where: conftest.py turns the fault handler on."""
    try:
        return process.communicate(timeout=LONGEST)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGABRT)
        raise AssertionError(f"{process.args} hangs: {process.communicate()[1]}") from None
