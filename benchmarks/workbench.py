"""The page of a 10-minute flight in Chromium: when it can be used, how long a zoom and an addition take.

    python benchmarks/workbench.py [--duration 600] [--runs 5]

A browser without a screen and without a graphics processor draws in software, on the machine that serves. Each
opening is a new browser with an empty cache. Times are medians; WORKBENCH's columns of the issue are measured again:
all drawn, zoom to 10 s with every point, redraw after "Add", work of the page's main thread while nothing happens,
memory of the tab.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "docs"))
from workbench_figures import browser, command, open_page, served

from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path

#: Times when all six axes hold their lines of this window and have been painted.
_DRAWN = """([begin, end]) => [...document.querySelectorAll('[data-testid^=plot-]')].length === 6
  && [...document.querySelectorAll('[data-testid^=plot-]')].every((p) => p._fullLayout?.xaxis
    && Math.abs(p._fullLayout.xaxis.range[0] - begin) < 0.6 && Math.abs(p._fullLayout.xaxis.range[1] - end) < 0.6)"""
_LEFT_OVER = "() => document.querySelector('[data-testid=plot-Cl]')._fullLayout.yaxis2.range[1]"


def fly(folder: Path, duration: float) -> Path:
    """A run with a hidden effect."""
    bag, run = folder / "flight", folder / "runs" / "flight"
    flight = ("--effect", "dihedral_alpha", "--manoeuvres", "standard", "--duration", duration)
    aircraft = config_path(DEFAULT_AIRCRAFT)
    for arguments in (("simulate", "--out", bag, *flight), ("replay", bag, "--aircraft", aircraft, "--out", run)):
        subprocess.run(command(*arguments), check=True, stdout=subprocess.DEVNULL)
    return run


def openings(found: Any, address: str, runs: int) -> Iterator[float]:
    """Times [s] from asking for the page until all is drawn; the first, which loads the server, is not among them."""
    for i in range(runs + 1):
        started = time.perf_counter()
        page = open_page(found, address)
        if i:
            yield time.perf_counter() - started
        page.context.close()


def zooms(page: Any, runs: int) -> Iterator[float]:
    """Times [s] from letting go of the mouse until all six plots show every point of about 10 s."""
    for i in range(runs):
        box = page.locator("[data-testid=plot-CX] .nsewdrag").first.bounding_box()
        begin, end = page.evaluate("document.querySelector('[data-testid=plot-CX]')._fullLayout.xaxis.range")
        left = box["x"] + box["width"] * (0.2 + 0.1 * i)
        width = box["width"] * 10.0 / (end - begin)
        y = box["y"] + 0.4 * box["height"]
        page.mouse.move(left, y)
        page.mouse.down()
        page.mouse.move(left + max(width, 12.0), y, steps=4)
        started = time.perf_counter()
        page.mouse.up()
        page.wait_for_function(
            "() => [...document.querySelectorAll('[data-testid^=plot-]')].every((p) => "
            "p._fullLayout.xaxis.range[1] - p._fullLayout.xaxis.range[0] < 60)",
            polling="raf",
        )
        yield time.perf_counter() - started
        page.click("text=Whole flight")
        page.wait_for_function(_DRAWN, arg=[begin, end])


def addition(page: Any) -> dict[str, float]:
    """Times [s] from the click until the work is done on the server, and until the page has drawn it."""
    page.click("[data-testid=side-add]")
    page.fill("[data-testid=term]", "Cl: alpha*beta")
    page.wait_for_timeout(600)
    before, started = page.evaluate(_LEFT_OVER), time.perf_counter()
    page.click("[data-testid=add-term]")
    page.wait_for_selector("[data-testid=notice]:has-text('falls from')")
    known = time.perf_counter() - started
    page.wait_for_function(f"(b) => ({_LEFT_OVER})() < 0.5 * b", arg=before, polling="raf")
    return {"work": known, "drawn": time.perf_counter() - started}


def load_of(page: Any, seconds: float = 5.0) -> dict[str, float]:
    """Share of the main thread that is busy while nothing happens, and memory [MB] of the tab."""
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable")
    metrics = lambda: {m["name"]: m["value"] for m in session.send("Performance.getMetrics")["metrics"]}  # noqa: E731
    before, started = metrics(), time.perf_counter()
    page.wait_for_timeout(1000.0 * seconds)
    after, elapsed = metrics(), time.perf_counter() - started
    busy = (after["TaskDuration"] - before["TaskDuration"]) / elapsed
    return {"idle_main_thread": busy, "heap_mb": after["JSHeapUsedSize"] / 1e6}


def measure(duration: float, runs: int) -> dict[str, Any]:
    """Everything."""
    with tempfile.TemporaryDirectory() as folder:
        run = fly(Path(folder), duration)
        started = time.perf_counter()
        with browser() as found, served(run) as address:
            ready = time.perf_counter() - started
            opened = list(openings(found, address, runs))
            page = open_page(found, address)
            zoomed = list(zooms(page, runs))
            result = {
                "duration": duration,
                "points": 6 * round(25 * duration),
                "runs": runs,
                "server_ready": ready,
                "interactive": statistics.median(opened),
                "interactive_worst": max(opened),
                "zoom": statistics.median(zoomed),
                "zoom_worst": max(zoomed),
                **load_of(page),
                "addition": addition(page),
            }
        size = Path(folder) / "report.html"
        subprocess.run(command("report", run, "--out", size), check=True, stdout=subprocess.DEVNULL)
        result["report_mb"] = size.stat().st_size / 1e6
    machine = f"{platform.machine()}, {platform.python_implementation()} {platform.python_version()}"
    return {**result, "load_average": os.getloadavg()[0], "cores": os.cpu_count(), "machine": machine}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=600.0)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "results" / "workbench.json")
    arguments = parser.parse_args()
    result = measure(arguments.duration, arguments.runs)
    arguments.out.write_text(json.dumps(result, indent=1) + "\n", encoding="utf8")
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
