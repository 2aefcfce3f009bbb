"""Pictures of every view of the workbench, into docs/figures: a simulated flight with a hidden effect, in Chromium.

    python docs/workbench_figures.py [--run RUN --truth BAG] [--only PART]

Without --run the flight is simulated, replayed and diagnosed first. Parts are run, calibration and live, which is a
flight in progress. Look at the pictures before they are committed.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path
from aircraft_sysid_ros.simulation.calibration_flight import CALIBRATION_AIRCRAFT

FIGURES = Path(__file__).with_name("figures")
FLIGHT = ("--effect", "dihedral_alpha", "--manoeuvres", "standard", "--seed", "1")
PARTS = ("run", "calibration", "live")
_TIMEOUT = 120_000.0


def command(*arguments: Any) -> list[str]:
    """A command of ours."""
    return [sys.executable, "-m", "aircraft_sysid_ros.commands.main", *map(str, arguments)]


def simulate(folder: Path, *options: Any) -> Path:
    """A recording of a flight with a hidden effect."""
    bag = folder / "flight"
    subprocess.run(command("simulate", "--out", bag, *FLIGHT, *options), check=True, stdout=subprocess.DEVNULL)
    return bag


def fly(folder: Path) -> tuple[Path, Path]:
    """A run with its diagnosis, and its recording."""
    bag, run = simulate(folder), folder / "runs" / "flight"
    for arguments in (
        ("replay", bag, "--aircraft", config_path(DEFAULT_AIRCRAFT), "--out", run),
        ("diagnose", run),
    ):
        subprocess.run(command(*arguments), check=True, stdout=subprocess.DEVNULL)
    return run, bag


@contextmanager
def served(run: Path, *options: Any) -> Iterator[str]:
    """The address of the page of a run."""
    arguments = command("workbench", Path(*run.parts[-2:]), "--port", 0, "--no-browser", *options)
    with serving(arguments, run.parents[1]) as address:
        yield address


@contextmanager
def serving(arguments: list[str], folder: Path | None = None) -> Iterator[str]:
    """The address that a command serves."""
    with subprocess.Popen(arguments, stderr=subprocess.PIPE, text=True, cwd=folder) as server:
        try:
            assert server.stderr is not None
            said, found = "", None
            for line in server.stderr:
                said, found = said + line, re.search(r"http://\S+", line)
                if found:
                    break
            if not found:
                raise SystemExit(said)
            yield found[0]
        finally:
            server.send_signal(signal.SIGINT)
            server.wait(30.0)


@contextmanager
def browser() -> Iterator[Any]:
    """Debian's Chromium without a screen."""
    from playwright.sync_api import sync_playwright

    place = shutil.which("chromium") or shutil.which("chromium-browser")
    if place is None:
        raise SystemExit("no chromium on this machine: apt-get install chromium")
    with sync_playwright() as driver:
        arguments = ["--no-sandbox"] if os.geteuid() == 0 else []
        found = driver.chromium.launch(executable_path=place, args=arguments)
        yield found
        found.close()


def open_page(found: Any, address: str, width: int = 1440, height: int = 900, plots: int = 12, **options: Any) -> Any:
    """The page, with so many layers drawn: two for each plot."""
    page = found.new_context(viewport={"width": width, "height": height}, **options).new_page()
    page.set_default_timeout(_TIMEOUT)
    page.goto(address)
    page.wait_for_function("(n) => document.querySelectorAll('.grid2 .main-svg').length >= n", arg=plots)
    page.mouse.move(5, 5)
    return page


def keep(page: Any, name: str, whole: bool = False) -> None:
    """Write one picture, when all is quiet."""
    page.wait_for_timeout(1500)
    page.screenshot(path=FIGURES / f"workbench_{name}.png", full_page=whole)
    print(f"workbench_{name}.png", flush=True)


def scroll_to(page: Any, selector: str) -> None:
    """Bring something in the side panel to its top."""
    page.locator(selector).first.evaluate("(e) => e.scrollIntoView({block: 'start'})")
    page.evaluate("window.scrollTo(0, 0)")


def pictures(run: Path, bag: Path) -> None:
    """All views, one after another, as a user would go through them."""
    with browser() as found, served(run, "--truth", bag.absolute()) as address:
        page = open_page(found, address)
        keep(page, "model")
        page.click(".place:has-text(' to ')")
        scroll_to(page, "[data-testid=places]")
        keep(page, "where")
        page.click("text=Whole flight")
        page.click("[data-testid=side-why]")
        page.click("[data-testid=card-0] .q-item")
        page.wait_for_selector("[data-testid=card-0] .main-svg")
        scroll_to(page, "[data-testid=verdict]")
        keep(page, "why")
        page.click("[data-testid=add-0]")
        page.wait_for_selector("[data-testid=notice]:has-text('falls from')")
        page.click("[data-testid=side-add]")
        page.fill("[data-testid=term]", "CZ: alhpa**3")
        page.locator(".side").evaluate("(e) => { e.scrollTop = 0 }")
        keep(page, "added")
        for view in ("versions", "parameters", "state"):
            page.click(f"[data-testid=tab-{view}]")
            keep(page, view, whole=view == "state")
        page.click("[data-testid=tab-versions]")
        page.click("text=draw the first one")
        page.click("[data-testid=tab-model]")
        keep(page, "beside")
        page = open_page(found, address, color_scheme="dark")
        keep(page, "dark")
        keep(open_page(found, address, 820, 1180), "tablet")


def flights_picture(run: Path, folder: Path) -> None:
    """Another flight of the same aeroplane beside the first one."""
    bag = simulate(folder / "second", "--seed", 2)
    aircraft = ("--aircraft", config_path(DEFAULT_AIRCRAFT))
    arguments = command("replay", bag, *aircraft, "--out", run.with_name("second"))
    subprocess.run(arguments, check=True, stdout=subprocess.DEVNULL)
    listed = command("workbench", run.parent.name, "--port", 0, "--no-browser")
    with browser() as found, serving(listed, run.parents[1]) as address:
        page = open_page(found, f"{address}?run={run.name}")
        page.click("[data-testid=tab-versions]")
        page.wait_for_selector("[data-testid=beside-other]")
        page.locator("[data-testid=beside-other]").click()
        page.click(".q-menu >> text=flight second")
        page.wait_for_selector("[data-testid=differences] td:has-text('±')")
        page.wait_for_selector("[data-testid=beside-words]:has-text('by more than chance')")
        page.locator("[data-testid=beside-one]").evaluate(
            "(e) => window.scrollTo(0, e.getBoundingClientRect().top - 170)"
        )
        keep(page, "flights")


def calibrate(folder: Path) -> Path:
    """A calibration of a simulated five-hole probe."""
    bag, out = folder / "probe", folder / "calibration"
    aircraft = ("--aircraft", config_path(CALIBRATION_AIRCRAFT))
    for arguments in (
        ("simulate", "--manoeuvres", "calibration", "--seed", 1, "--out", bag),
        ("calibrate", "five-hole", "probe", *aircraft, "--out", out),
    ):
        subprocess.run(command(*arguments), check=True, stdout=subprocess.DEVNULL, cwd=folder)
    return out


def calibration_pictures(folder: Path) -> None:
    """The page of a calibration: all of it, and on a tablet in the dark."""
    arguments = command("workbench", folder.name, "--port", 0, "--no-browser")
    with browser() as found, serving(arguments, folder.parent) as address:
        keep(open_page(found, address, plots=20), "calibration", whole=True)
        page = open_page(found, address, 820, 1180, plots=20, color_scheme="dark")
        page.locator("[data-testid=trace-0]").evaluate("(e) => window.scrollTo(0, e.offsetTop - 200)")
        keep(page, "calibration_dark")


def live_picture(bag: Path) -> None:
    """A node that hears the recording at twice real time; what it finds missing is added on the page."""
    address = command("workbench", "--live", "--port", 0, "--no-browser")
    node = command("live", "--aircraft", config_path(DEFAULT_AIRCRAFT), "--reliable")
    with browser() as found, serving(address) as url, running(node):
        page = open_page(found, url)
        page.wait_for_selector("[data-testid=notice]:has-text('is there')")
        with running(command("play", bag, "--rate", 2)):
            page.click("[data-testid=card-0] .q-item")
            page.click("[data-testid=add-0]")
            page.wait_for_selector("[data-testid=notice]:has-text('Added')")
            page.wait_for_timeout(6000)
            keep(page, "live")
        page.context.close()


@contextmanager
def running(arguments: list[str]) -> Iterator[None]:
    """A command of ours until the end of the block."""
    with subprocess.Popen(arguments, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            yield
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(60.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--run", type=Path, help="a run that is diagnosed already; it is copied")
    parser.add_argument("--truth", type=Path, help="the recording of that run")
    parser.add_argument("--only", choices=PARTS, help="only the pictures of this part")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        wanted = (arguments.only,) if arguments.only else PARTS
        if "run" in wanted and arguments.run:
            run = place / "runs" / "flight"
            shutil.copytree(arguments.run, run)
            pictures(run, arguments.truth)
        elif "run" in wanted:
            run, bag = fly(place)
            pictures(run, bag)
            flights_picture(run, place)
        if "calibration" in wanted:
            calibration_pictures(calibrate(place))
        if "live" in wanted:
            live_picture(simulate(place / "live", "--duration", 180))


if __name__ == "__main__":
    main()
