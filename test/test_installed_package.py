"""The package as pip installs it: everything without ROS in an empty environment, everything beside the ROS wheels.

The environment of a test is a new one that holds, by links, what pip would install for the requirements of the
wheel, and nothing else: what a command needs and setup.py does not name is missing there.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
import zipfile
from email import message_from_bytes
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from waiting import finish

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "aircraft_sysid_ros"
LEFT_OUT = shutil.ignore_patterns(
    ".git", ".venv*", "benchmarks", "build", "dist", "docs", "install", "log", "runs", "__pycache__", "*.egg-info"
)
#: Leads back to the environment of the tests.
LEAKS = ("PYTHONPATH", "VIRTUAL_ENV", "LD_LIBRARY_PATH", "AMENT_PREFIX_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")
PIP = (sys.executable, "-m", "pip", "--disable-pip-version-check", "-q")
ALONE = ("--no-index", "--no-deps", "--no-build-isolation")


def started(*command, cwd, **variables):
    """A process in an environment of its own."""
    environment = {name: value for name, value in os.environ.items() if name not in LEAKS}
    environment |= {name: str(value) for name, value in variables.items()}
    command = [str(part) for part in command]
    return subprocess.Popen(
        command, cwd=cwd, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def call(*command, cwd, **variables):
    """Run a command that must succeed; returns what it prints."""
    with started(*command, cwd=cwd, **variables) as process:
        output, errors = finish(process)
    assert process.returncode == 0, errors
    return output


def complaint(*command, cwd, **variables):
    """The last line of a command that must refuse its input; one before it may tell what it was doing."""
    with started(*command, cwd=cwd, **variables) as process:
        output, errors = finish(process)
    assert (process.returncode, output) == (2, ""), errors
    *before, said = errors.splitlines()
    assert before in ([], ["reading run"])
    return said


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    """A copy of the source tree: building leaves files in it."""
    return shutil.copytree(ROOT, tmp_path_factory.mktemp("source") / "checkout", ignore=LEFT_OUT)


@pytest.fixture(scope="module")
def sdist(checkout, tmp_path_factory):
    out = tmp_path_factory.mktemp("sdist")
    code = f"from setuptools.build_meta import build_sdist; build_sdist({str(out)!r})"
    call(sys.executable, "-c", code, cwd=checkout)
    return next(out.glob("*.tar.gz"))


def wheel_of(source, out):
    """The wheel that pip builds from a source distribution or a source tree."""
    call(*PIP, "wheel", *ALONE, "-w", out, source, cwd=out)
    return next(out.glob("*.whl"))


@pytest.fixture(scope="module")
def wheel(sdist, tmp_path_factory):
    return wheel_of(sdist, tmp_path_factory.mktemp("wheel"))


def contents(wheel):
    with zipfile.ZipFile(wheel) as file:
        return {name: file.read(name) for name in file.namelist() if not name.endswith(("RECORD", "/METADATA"))}


@pytest.mark.long
def test_the_wheels_of_the_checkout_and_of_its_source_distribution_are_the_same(checkout, wheel, tmp_path):
    assert contents(wheel_of(checkout, tmp_path)) == contents(wheel)


def test_the_wheel_holds_every_file_of_the_package_the_messages_and_the_aeroplanes(wheel):
    inside = {name: data for name, data in contents(wheel).items() if name.startswith(f"{PACKAGE}/")}
    sources = [file for file in (ROOT / PACKAGE).rglob("*") if file.suffix not in (".pyc", ".nbi", ".nbc")]
    expected = {str(file.relative_to(ROOT)): file for file in sources if file.is_file()}
    shipped = [*(ROOT / "msg_defs/msg").iterdir(), *(ROOT / "config").iterdir()]
    expected |= {f"{PACKAGE}/{file.relative_to(ROOT)}": file for file in shipped}
    assert inside == {name: file.read_bytes() for name, file in expected.items()}


def needed(wheel, extra=""):
    """Names of what pip would install beside the wheel for its requirements, or for those of an extra alone."""
    with zipfile.ZipFile(wheel) as file:
        about = next(name for name in file.namelist() if name.endswith(".dist-info/METADATA"))
        lines = message_from_bytes(file.read(about)).get_all("Requires-Dist")
    waiting, seen = asked_for(lines, extra), set()
    while waiting:
        name, extra = pair = waiting.pop()
        if pair not in seen:
            seen.add(pair)
            waiting += asked_for(metadata.requires(name) or [], extra)
    return {name for name, _ in seen}


def asked_for(lines, extra):
    """Names and extras that requirements ask for where an extra is wanted, "" for none."""
    requirements = [Requirement(line) for line in lines]
    wanted = [r for r in requirements if r.marker is None or r.marker.evaluate({"extra": extra})]
    return [(r.name, each) for r in wanted for each in ("", *r.extras)]


def link(distributions, folder):
    """What the distributions installed into site-packages, as links in ``folder``."""
    for name in distributions:
        distribution = metadata.distribution(name)
        for top in {file.parts[0] for file in distribution.files} - {"..", "__pycache__"}:
            target = folder / top
            if not target.exists():
                target.symlink_to(distribution.locate_file(top))


class Installed:
    """An environment with the wheel and what its metadata requires."""

    def __init__(self, folder, wheel):
        call(sys.executable, "-m", "venv", "--without-pip", folder, cwd=folder.parent)
        self.python = folder / "bin" / "python"
        self.command = folder / "bin" / "aircraft-sysid"
        self.site = next(folder.glob("lib/python*/site-packages"))
        link(needed(wheel), self.site)
        call(*PIP, "--python", self.python, "install", *ALONE, wheel, cwd=folder.parent)

    def take_compiled_kernels(self):
        """Numba's caches beside the sources serve their copies: same text, and for Numba the same time."""
        for cache in (ROOT / PACKAGE).rglob("__pycache__/*.nb[ic]"):
            copy = self.site / cache.relative_to(ROOT)
            copy.parent.mkdir(exist_ok=True)
            shutil.copy(cache, copy)
        for file in (self.site / PACKAGE).rglob("*.py"):
            source = ROOT / file.relative_to(self.site)
            os.utime(file, ns=(source.stat().st_atime_ns, source.stat().st_mtime_ns))


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    environment = Installed(tmp_path_factory.mktemp("environment") / "venv", wheel)
    environment.take_compiled_kernels()
    return environment


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder that is far from the source tree, with what the commands write."""
    return tmp_path_factory.mktemp("place")


@pytest.fixture(scope="module")
def run(installed, place):
    """A flight, simulated and replayed by the installed command."""
    flight = json.loads(call(installed.command, "simulate", "--out", "flight", "--duration", 30, "--json", cwd=place))
    aircraft = Path(flight["aircraft_file"])
    assert aircraft.is_relative_to(installed.site)
    call(installed.command, "replay", "flight", "--aircraft", aircraft, "--out", "run", "--json", cwd=place)
    return place / "run"


@pytest.mark.long
def test_pip_puts_the_commands_where_a_shell_finds_them(installed, place):
    assert "COMMAND" in call(installed.command, "--help", cwd=place)
    nodes = {"state_estimator", "parameter_estimator", "mavlink_bridge"}
    assert nodes <= {file.name for file in installed.command.parent.iterdir()}
    assert not (installed.command.parents[1] / "lib" / PACKAGE).exists()  # colcon's place


@pytest.mark.long
def test_the_installed_program_is_the_one_that_runs_and_nothing_of_ros_is_there(installed, place):
    code = f"import {PACKAGE} as p, importlib.util as u; print(p.__file__, *map(u.find_spec, ('rclpy', 'plotly')))"
    found = call(installed.python, "-c", code, cwd=place).split()
    assert found == [str(installed.site / PACKAGE / "__init__.py"), "None", "None"]


@pytest.mark.long
def test_the_installed_replay_gives_the_numbers_of_the_source_tree(run, place):
    command = (sys.executable, "-m", f"{PACKAGE}.commands.main", "replay", "flight")
    aircraft = ROOT / "config" / "ultra_stick_25e.yaml"
    call(*command, "--aircraft", aircraft, "--out", "run_of_source", "--json", cwd=place)
    here, there = (json.loads((place / name / "parameters.json").read_text()) for name in ("run", "run_of_source"))
    assert here["parameters"] == there["parameters"]
    assert len(here["parameters"]) == 32


def test_without_ros_and_extras_a_run_is_compared_diagnosed_and_extended(run, installed, place):
    compared = json.loads(call(installed.command, "compare", run, "--json", cwd=place))
    assert set(compared["axes"]) == {"CX", "CY", "CZ", "Cl", "Cm", "Cn"}
    assert compared["figure"] is None
    assert compared["notes"][-1].endswith(f"pictures need matplotlib: python3 -m pip install '{PACKAGE}[report]'")
    diagnosed = json.loads(call(installed.command, "diagnose", run, "--replicas", 2, "--json", cwd=place))
    assert diagnosed["verdict"] in ("none", "missing", "unexplained")
    added = json.loads(call(installed.command, "add", run, "CZ: alpha**2", "--json", cwd=place))
    assert added["added"] == "CZ: alpha**2"
    assert added["figure"] is None


@pytest.mark.long
def test_a_mat_file_is_imported_without_extras(installed, place, shared_data):
    log = shared_data / "inertialnav" / "SwissLog1.mat"
    report = json.loads(call(installed.command, "import", log, "--out", "swiss", "--json", cwd=place))
    assert report["topics"]["imu/data"]["messages"] > 1000


@pytest.mark.long
@pytest.mark.parametrize(
    "command",
    [("live", "--aircraft", ROOT / "config" / "ultra_stick_25e.yaml"), ("play", "flight"), ("demo",)],
    ids=lambda command: command[0],
)
def test_a_command_that_needs_ros_says_that_it_is_not_there(run, installed, place, command):
    assert "ROS 2 is not in this environment (No module named '" in (complaint(installed.command, *command, cwd=place))
    assert not (place / "runs").exists()


def test_a_required_package_that_is_too_old_is_named(installed, place, tmp_path):
    """As where rosdep installed it, which knows no versions."""
    (tmp_path / "numba.py").write_text("raise ImportError('numba needs another NumPy')")
    (tmp_path / "numba-0.57.1.dist-info").mkdir()
    (tmp_path / "numba-0.57.1.dist-info" / "METADATA").write_text("Name: numba\nVersion: 0.57.1\n")
    said = complaint(installed.command, "replay", "flight", "--out", "old", cwd=place, PYTHONPATH=tmp_path)
    assert said == (
        "aircraft-sysid: the required package numba is too old, 0.57.1: python3 -m pip install 'numba>=0.60'"
    )


EXTRAS = [
    (("simulate", "--simulator", "jsbsim", "--duration", "20", "--out", "other"), "jsbsim", "simulation"),
    (("import", "log.ulg", "--out", "other"), "pyulog", "logs"),
    (("import", "log.bin", "--out", "other"), "pymavlink", "logs"),
    (("import", "log.tlog", "--out", "other"), "pymavlink", "logs"),
    (("import", "table.csv", "--map", "map.yaml", "--out", "other"), "pint", "tables"),
    (("fleet", "run", "--aircraft", "aircraft.yaml", "--out", "other"), "pyarrow", "fleet"),
    (("bridge", "udp:127.0.0.1:14999"), "pymavlink", "bridge"),
    (("report", "run", "--out", "run.html"), "jinja2 and plotly", "workbench"),
    (("workbench", "run"), "nicegui and plotly", "workbench"),
]


@pytest.mark.long
@pytest.mark.parametrize(("command", "package", "extra"), EXTRAS, ids=[" ".join(words[:2]) for words, _, _ in EXTRAS])
def test_a_command_names_the_extra_that_it_needs(run, installed, place, command, package, extra):
    for name in ("log.ulg", "log.bin", "log.tlog"):
        (place / name).touch()
    write_table(place)
    said = complaint(installed.command, *command, cwd=place)
    assert f" need {package}: python3 -m pip install '{PACKAGE}[{extra}]'" in said
    assert not (place / "other").exists()


def write_table(place):
    """A table of another program, and its map."""
    (place / "table.csv").write_text("t,m\n0,1.5\n1,1.4\n2,1.3\n3,1.2\n")
    mass = "{mass: {column: m, unit: kg}}"
    (place / "map.yaml").write_text(f"tables: [{{time: {{column: t, unit: s}}, signals: {mass}}}]\n")


@pytest.fixture(scope="module")
def with_extra(wheel, installed, tmp_path_factory):
    """Variables with which the installed program finds what an extra brings."""

    def variables(extra):
        folder = tmp_path_factory.mktemp(extra)
        link(needed(wheel, extra) - needed(wheel), folder)
        return {"PYTHONPATH": folder}

    return variables


@pytest.mark.long
def test_an_extra_brings_all_that_its_commands_need(run, installed, place, wheel, with_extra):
    call(installed.command, "report", run, "--out", "run.html", cwd=place, **with_extra("workbench"))
    assert (place / "run.html").stat().st_size > 1_000_000
    compared = json.loads(call(installed.command, "compare", run, "--json", cwd=place, **with_extra("report")))
    assert Path(place, compared["figure"]).read_bytes().startswith(b"\x89PNG")
    for name in ("log.ulg", "log.bin", "log.tlog"):
        (place / name).touch()
        said = complaint(installed.command, "import", name, "--out", "other", cwd=place, **with_extra("logs"))
        assert "pip install" not in said
    write_table(place)
    command = (installed.command, "import", "table.csv", "--map", "map.yaml", "--out", "table", "--json")
    report = json.loads(call(*command, cwd=place, **with_extra("tables")))
    assert report["topics"]["mass_properties"]["messages"] == 4


def test_with_the_ros_wheels_beside_it_the_installed_program_flies_live(domain, run, installed, place):
    """The interpreter that has ROS and our messages takes the package from where pip installed it."""
    with_ros = {"PYTHONPATH": installed.site}
    code = f"import {PACKAGE} as p, rclpy, aircraft_sysid_msgs; print(p.__file__)"
    found = call(sys.executable, "-c", code, cwd=place, **with_ros)
    assert found == f"{installed.site / PACKAGE / '__init__.py'}\n"
    program = (sys.executable, installed.command)
    aircraft = installed.site / PACKAGE / "config" / "ultra_stick_25e.yaml"
    options = ("--reliable", "--until-idle", 1.5, "--ready-file", "ready", "--out", "live", "--json")
    with started(*program, "live", "--aircraft", aircraft, *options, cwd=place, **with_ros) as live:
        while not (place / "ready").exists():
            assert live.poll() is None, live.stderr.read()
            time.sleep(0.05)
        sent = json.loads(call(*program, "play", "flight", "--rate", 8, "--json", cwd=place, **with_ros))
        output, errors = finish(live)
    assert live.returncode == 0, errors
    received = {f"/{topic}": count for topic, count in json.loads(output)["received"].items() if count}
    assert received == sent["messages"]
    assert (place / "live" / "parameters.json").exists()
