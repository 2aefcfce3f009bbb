"""Every view of the page in three widths, light and dark: pictures, what overflows, what changed since the last.

    python benchmarks/page_pictures.py OUT [--runs FOLDER --run NAME] [--files FILE.html ...] [--against LAST]

OUT is a folder outside of the project: the pictures are to be looked at. Without --runs a flight with a hidden effect
is simulated, replayed, diagnosed, and given a second version and a second flight; what `explain`, `report` and `fleet`
write of it is pictured too, and what stands behind --files. Said of each picture are errors of
the console of the browser, text that is cut off, a page that is wider than its window, and with --against the share of
points that differ from the picture of the same name in LAST. Exit status 1 where anything but the last is found.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "docs"))
from workbench_figures import FLIGHT, browser, command, serving

from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path

WIDTHS, THEMES = {1440: 900, 1024: 768, 390: 844}, ("light", "dark")
#: Views with what must be drawn in them.
VIEWS = {
    "model": "[data-testid=plot-Cn] .main-svg", "residuals": "[data-testid=distribution-Cn] .main-svg",
    "versions": "[data-testid=differences] td", "parameters": "[data-testid=parameters] td",
    "state": "[data-testid=height] .main-svg", "calibration": "[data-testid=calibrate-words]",
}  # fmt: skip
SIDES = ("where", "why", "add")
#: Steps of a colour from which on a point counts as changed.
_CHANGED = 24
#: Text that does not fit where it stands, and what reaches out of the window.
_CUT = """() => [...document.querySelectorAll('.q-tab__label, h2, .heading, .name, th, button, .axis-head, .legend')]
  .filter((e) => e.offsetParent && e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).overflow !== 'visible')
  .map((e) => 'cut off: ' + e.innerText.slice(0, 40))
  .concat(document.documentElement.scrollWidth > innerWidth + 1 ? ['wider than its window'] : [])
  .concat([...document.querySelectorAll('.main-svg text')].filter((t) => {
    const a = t.getBoundingClientRect(), b = t.closest('.js-plotly-plot').getBoundingClientRect();
    return a.width && t.closest('.infolayer, .xaxislayer-above, .yaxislayer-above') &&
      (a.left < b.left - 1 || a.right > b.right + 1 || a.top < b.top - 1 || a.bottom > b.bottom + 1);
  }).map((t) => 'clipped in a figure: ' + t.textContent))"""


def fly(folder: Path) -> Path:
    """A folder with two runs, of which the first has two versions and a diagnosis."""
    aircraft, runs = config_path(DEFAULT_AIRCRAFT), folder / "runs"
    for name, seed in (("monday", 1), ("tuesday", 2)):
        bag = folder / name
        for arguments in (
            ("simulate", "--out", bag, *FLIGHT[:-1], seed, "--duration", 120),
            ("replay", bag, "--aircraft", aircraft, "--out", runs / name),
        ):
            subprocess.run(command(*arguments), check=True, stdout=subprocess.DEVNULL)
    for arguments in (("diagnose", runs / "monday"), ("add", runs / "monday", "Cl: alpha*beta")):
        subprocess.run(command(*arguments), check=True, stdout=subprocess.DEVNULL)
    return runs


def write_files(folder: Path) -> list[Path]:
    """What explain, report and fleet write of the flights of ``fly``."""
    aircraft, runs = config_path(DEFAULT_AIRCRAFT), folder / "runs"
    for arguments in (
        ("explain", folder / "monday", "--aircraft", aircraft, "--out", folder / "explained"),
        ("report", runs / "monday", "--out", folder / "report.html"),
        ("fleet", folder / "monday", folder / "tuesday", "--aircraft", aircraft, "--out", folder / "fleet",
         "--no-diagnosis"),
    ):  # fmt: skip
        subprocess.run(command(*arguments), check=True, stdout=subprocess.DEVNULL)
    return [folder / "explained/explain.html", folder / "report.html", folder / "fleet/fleet.html"]


def views(page: Any) -> Iterator[str]:
    """Show one view after another; the name of each."""
    for name, there in VIEWS.items():
        page.click(f"[data-testid=tab-{name}]")
        page.wait_for_selector(there)
        page.wait_for_timeout(700)
        if name != "model":
            yield name
            continue
        for side in SIDES:
            page.click(f"[data-testid=side-{side}]")
            page.wait_for_timeout(500)
            yield f"model-{side}"


def photograph(runs: Path, name: str, out: Path) -> list[str]:
    """All pictures of the page of one run; what is wrong with them."""
    wrong: list[str] = []
    with browser() as found, serving(command("workbench", runs, "--port", 0, "--no-browser")) as address:
        for page, look in looks(found, wrong):
            page.goto(address)
            page.wait_for_selector("[data-testid=runs] td")
            keep(page, out, f"runs-{look}", wrong)
            page.goto(f"{address}?run={name}")
            page.wait_for_function("document.querySelectorAll('.grid2 .main-svg').length >= 12")
            for view in views(page):
                keep(page, out, f"{view}-{look}", wrong)
    return wrong


def photograph_files(files: list[Path], out: Path) -> list[str]:
    """All pictures of pages that open without a network; what is wrong with them."""
    wrong: list[str] = []
    with browser() as found:
        for page, look in looks(found, wrong):
            for file in files:
                page.goto(file.resolve().as_uri())
                page.wait_for_timeout(1500)
                keep(page, out, f"{file.stem}-{look}", wrong)
    return wrong


def looks(found: Any, wrong: list[str]) -> Iterator[tuple[Any, str]]:
    """A page in each width and theme, and what that is called; errors of the browser go to ``wrong``."""
    for width, height in WIDTHS.items():
        for theme in THEMES:
            context = found.new_context(viewport={"width": width, "height": height}, color_scheme=theme)
            page = context.new_page()
            page.set_default_timeout(120_000.0)
            page.on("pageerror", lambda error: wrong.append(f"error on the page: {error}"))
            page.on("console", lambda m: wrong.append(f"console: {m.text}") if m.type == "error" else None)
            yield page, f"{width}-{theme}"
            context.close()


def keep(page: Any, out: Path, name: str, wrong: list[str]) -> None:
    """Write one picture."""
    page.evaluate("scrollTo(0, 0)")
    page.screenshot(path=out / f"{name}.png", full_page=True)
    wrong += [f"{name}: {text}" for text in dict.fromkeys(page.evaluate(_CUT))]


def changes(out: Path, last: Path) -> Iterator[str]:
    """What is different from the last pictures, the most first."""
    from PIL import Image

    found = []
    for path in sorted(out.glob("*.png")):
        if not (last / path.name).exists():
            yield f"{path.name} is new"
            continue
        one, other = (np.asarray(Image.open(folder / path.name).convert("RGB"), np.int16) for folder in (out, last))
        if one.shape != other.shape:
            sizes = (f"{shape[1]} x {shape[0]}" for shape in (one.shape, other.shape))
            yield f"{path.name} has another size: {', was '.join(sizes)}"
            continue
        found.append((float(np.mean(np.abs(one - other).max(axis=2) > _CHANGED)), path.name))
    yield from (f"{name}: {100.0 * share:.1f} % of its points" for share, name in sorted(found, reverse=True) if share)


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder for the pictures")
    parser.add_argument("--runs", type=Path, help="a folder of runs, to be looked at as they are")
    parser.add_argument("--run", default="monday", help="name of the run in that folder (default: %(default)s)")
    parser.add_argument(
        "--files", type=Path, nargs="*", help="pages that open without a network, beside or without runs"
    )
    parser.add_argument("--against", type=Path, metavar="LAST", help="folder of the last pictures")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        wrong, files = [], arguments.files or []
        if arguments.runs or not files:
            runs = arguments.runs or fly(Path(folder))
            wrong += photograph(runs, arguments.run, arguments.out)
            files += [] if arguments.runs else write_files(Path(folder))
        wrong += photograph_files(files, arguments.out)
    for text in wrong:
        print(text)
    for text in changes(arguments.out, arguments.against) if arguments.against else ():
        print(f"changed: {text}")
    print(f"{len(list(arguments.out.glob('*.png')))} pictures in {arguments.out}, {len(wrong)} things wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
