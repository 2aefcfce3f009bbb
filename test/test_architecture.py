"""The core knows nothing of ROS, files, plots or pages; what it does know stands in docstrings."""

import ast
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = "aircraft_sysid_ros"
ROOT = Path(__file__).resolve().parents[1] / PACKAGE
CORE = (
    "aircraft", "estimation", "reconstruction", "identification", "flight_model", "refinement", "diagnosis",
    "calibration", "effects", "sensors", "ros_messages", "flight_check",
)  # fmt: skip
FILES = [*(ROOT / f"{name}.py" for name in ("samples", "pipeline"))]
FILES += sorted(path for folder in CORE for path in (ROOT / folder).rglob("*.py"))
OUTSIDE = (
    "rclpy", "rosidl_runtime_py", "rosbags", "mcap", "pymavlink", "pyulog", "matplotlib", "nicegui", "launch",
    f"{PACKAGE}.recordings", f"{PACKAGE}.nodes", f"{PACKAGE}.commands",
)  # fmt: skip
NAMES = [str(path.relative_to(ROOT)) for path in FILES]


def imported(path: Path) -> set[str]:
    """Full names of what a file imports, also inside functions and as `from package import module`."""
    package = [PACKAGE, *path.relative_to(ROOT).parts[:-1]]
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            found |= {module} | {f"{module}.{alias.name}" for alias in node.names}
    return found


def is_outside(module: str) -> bool:
    """A module that the core must not know: of OUTSIDE, or a package of ROS messages."""
    first = module.split(".", maxsplit=1)[0]
    is_messages = first.endswith(("_msgs", "_interfaces"))
    return is_messages or any(module == name or module.startswith(name + ".") for name in OUTSIDE)


def test_the_check_itself_finds_imports(tmp_path):
    assert all(map(is_outside, ("sensor_msgs.msg", "rcl_interfaces", f"{PACKAGE}.nodes.common")))
    assert not any(map(is_outside, ("numpy", f"{PACKAGE}.reconstruction.state")))
    assert {"aircraft/frames.py", "estimation/iterated_ekf.py", "samples.py"} <= set(NAMES)
    assert f"{PACKAGE}.samples.Kind" in imported(ROOT / "reconstruction" / "fusion.py")


@pytest.mark.parametrize("path", FILES, ids=NAMES)
def test_the_core_imports_nothing_from_outside(path):
    assert sorted(module for module in imported(path) if is_outside(module)) == []


@pytest.mark.long
def test_importing_the_pipeline_loads_nothing_from_outside():
    """What ast cannot see, what imports import: the modules that are there afterwards, in a new process."""
    code = f"import json, sys; before = set(sys.modules); import {PACKAGE}.pipeline; "
    code += "print(json.dumps(sorted(set(sys.modules) - before)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = json.loads(done.stdout)
    assert f"{PACKAGE}.reconstruction.fusion" in loaded
    assert [module for module in loaded if is_outside(module)] == []
    slow_to_import = {"scipy.signal", "scipy.optimize", "scipy.stats"}  # half a second for each command and node
    assert slow_to_import.isdisjoint(loaded)


@pytest.mark.parametrize("path", sorted((ROOT / "estimation").rglob("*.py")), ids=lambda path: path.name)
def test_estimation_stands_on_its_own(path):
    ours = {module for module in imported(path) if module.split(".")[0] == PACKAGE}
    own = (f"{PACKAGE}.estimation", f"{PACKAGE}.errors", f"{PACKAGE}.kernels")
    assert sorted(module for module in ours if not module.startswith(own)) == []


@pytest.mark.long
def test_layers_hold_through_all_imports():
    """The contracts of .importlinter: layers, no circles, and what the core and the flight nodes may not know."""
    command = [str(Path(sys.executable).with_name("lint-imports")), "--no-cache", "--config", ".importlinter"]
    done = subprocess.run(command, cwd=ROOT.parent, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert "6 kept, 0 broken" in done.stdout


def without_docstring(path: Path) -> list[str]:
    """Public functions, classes and methods of a file that say nothing about themselves."""
    tree = ast.parse(path.read_text(encoding="utf8"))
    found = [] if ast.get_docstring(tree) else ["the module"]
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
    for node in tree.body:
        if isinstance(node, kinds) and not node.name.startswith("_"):
            inside = node.body if isinstance(node, ast.ClassDef) else []
            members = [m for m in inside if isinstance(m, kinds) and not m.name.startswith("_")]
            found += [item.name for item in (node, *members) if not ast.get_docstring(item)]
    return found


@pytest.mark.parametrize("path", FILES, ids=NAMES)
def test_everything_public_in_the_core_has_a_docstring(path):
    assert without_docstring(path) == []


def test_the_files_that_the_way_of_a_sample_names_exist():
    """docs/architecture.md, which newcomers follow."""
    text = (ROOT.parent / "docs" / "architecture.md").read_text(encoding="utf8")
    named = set(re.findall(r"`([\w/]+(?:\.py|/))`", text))
    there = [path for top in (ROOT, ROOT.parent / "examples") for path in (top, *top.rglob("*"))]
    places = [f"/{path.relative_to(ROOT.parent)}{'/' if path.is_dir() else ''}" for path in there]
    assert len(named) > 50
    assert sorted(name for name in named if not any(place.endswith(f"/{name}") for place in places)) == []
