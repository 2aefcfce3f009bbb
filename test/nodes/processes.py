"""Processes of ours for tests: `live`, `play` and the nodes, and a machine that is too slow for them."""

import contextlib
import json
import signal
import subprocess
import sys
import threading
import time

from waiting import LONGEST

MODULE = "aircraft_sysid_ros"


def ours(module, *arguments):
    """Command of a module of ours."""
    return [sys.executable, "-m", f"{MODULE}.{module}", *map(str, arguments)]


def play(recording, rate, *options):
    """Play a recording; what `play` says of it."""
    command = ours("commands.main", "play", recording, "--rate", rate, "--wait", 60, "--json", *options)
    done = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@contextlib.contextmanager
def live(folder, aircraft_file, *options):
    """`live` in another process; yields it once it listens."""
    ready = folder.parent / "ready"
    command = ours(
        "commands.main", "live", "--aircraft", aircraft_file, "--out", folder, "--ready-file", ready, "--json", *options
    )
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        deadline = time.monotonic() + LONGEST
        while not ready.exists():
            assert process.poll() is None, process.communicate()[1]
            assert time.monotonic() < deadline, "live did not start"
            time.sleep(0.05)
        yield process
    finally:
        process.kill()
        process.communicate()


@contextlib.contextmanager
def slowed(process, stopped=0.2, running=0.05):
    """Let a process run for a part of the time only."""
    over = threading.Event()

    def slow():
        while process.poll() is None:
            process.send_signal(signal.SIGSTOP)
            over.wait(stopped)
            process.send_signal(signal.SIGCONT)
            if over.wait(running):
                return

    thread = threading.Thread(target=slow)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
