"""A run with a hidden effect, its page on a server of its own, and Debian's Chromium to look at it."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import pytest

from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.simulation.calibration_flight import CALIBRATION_AIRCRAFT

HIDDEN = "dihedral_alpha"


@pytest.fixture(scope="session")
def hidden_effect(tmp_path_factory, aircraft_file):
    """The folder of a run whose aeroplane has an effect that its model lacks; tests that change it copy it."""
    folder = tmp_path_factory.mktemp("workbench")
    flight = ["--effect", HIDDEN, "--manoeuvres", "standard", "--duration", "60", "--seed", "1"]
    assert main(["simulate", "--out", str(folder / "flight"), "--aircraft", str(aircraft_file), *flight]) == 0
    assert main(["replay", str(folder / "flight"), "--aircraft", str(aircraft_file), "--out", str(folder / "run")]) == 0
    return folder / "run"


@pytest.fixture(scope="session")
def calibration(tmp_path_factory):
    """The folder of a calibration of a five-hole probe; tests that change it copy it."""
    folder = tmp_path_factory.mktemp("calibration")
    flight = ["--manoeuvres", "calibration", "--seed", "5", "--duration", "150"]
    aircraft = ["--aircraft", str(config_path(CALIBRATION_AIRCRAFT))]
    assert main(["simulate", *flight, "--out", str(folder / "flight")]) == 0
    options = [*aircraft, "--samples", "64", "--out", str(folder / "probe")]
    assert main(["calibrate", "five-hole", str(folder / "flight"), *options]) == 0
    return folder / "probe"


@pytest.fixture
def run(hidden_effect, tmp_path):
    """A copy of the run that a test may change."""
    shutil.copytree(hidden_effect, tmp_path / "run")
    return tmp_path / "run"


@pytest.fixture(scope="session")
def served():
    """A context manager: the page of a run on a server of its own."""
    return _served


@contextmanager
def _served(*arguments, program=("-m", "aircraft_sysid_ros.commands.main")):
    """The address of the page of a run, or of what else the command is told."""
    command = [sys.executable, *map(str, program), "workbench", *map(str, arguments)]
    with subprocess.Popen([*command, "--port", "0", "--no-browser"], stderr=subprocess.PIPE, text=True) as server:
        try:
            said, found = "", None
            for line in server.stderr:
                said, found = said + line, re.search(r"http://\S+", line)
                if found:
                    break
            assert found, said
            yield found[0]
        finally:
            server.send_signal(signal.SIGINT)
            try:
                rest = server.communicate(timeout=300)[1]
            finally:
                server.kill()
    assert "Traceback" not in rest, rest


@pytest.fixture(scope="session")
def chromium():
    """A headless browser; skipped where the machine has none, since none is downloaded."""
    place = shutil.which("chromium") or shutil.which("chromium-browser")
    if place is None:
        pytest.skip("no chromium on this machine: apt-get install chromium")
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with playwright.sync_playwright() as driver:
        arguments = ["--no-sandbox"] if os.geteuid() == 0 else []
        browser = driver.chromium.launch(executable_path=place, args=arguments)
        yield browser
        browser.close()


@pytest.fixture
def open_page(chromium):
    """A function that opens an address in a browser of its own; what goes wrong in it fails the test."""
    contexts, wrong, asked = [], [], []

    def opened(address, plots=12, width=1440, height=900, **options):
        context = chromium.new_context(viewport={"width": width, "height": height}, **options)
        context.set_default_timeout(300_000)  # the machine may be busy
        contexts.append(context)
        page = context.new_page()
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
        page.on("console", lambda message: print(f"{time.strftime('%X')} page says: {message.text}"))  # if a test fails
        page.on("framenavigated", lambda frame: print(f"{time.strftime('%X')} page is loaded: {frame.url}"))
        page.on("request", lambda request: asked.append(request.url))
        page.goto(address)
        page.wait_for_function("(n) => document.querySelectorAll('.grid2 .main-svg').length >= n", arg=plots)
        return page

    yield opened
    for context in contexts:
        context.close()
    assert not wrong
    elsewhere = [
        url for url in asked if not url.startswith(("http://127.0.0.1", "ws://127.0.0.1", "file:", "data:", "blob:"))
    ]
    assert not elsewhere
