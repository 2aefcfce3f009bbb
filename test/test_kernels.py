"""Kernels are loaded without what Numba compiles with; they answer, raise, and serve others, as compiled ones do."""

import itertools
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

from aircraft_sysid_ros import kernels
from aircraft_sysid_ros.aircraft.atmosphere import STANDARD_GRAVITY
from aircraft_sysid_ros.identification.coefficients.signals import flow_angle_rates
from aircraft_sysid_ros.reconstruction.state import StateField

KEPT = """
import numpy as np
from aircraft_sysid_ros.kernels import njit

@njit(cache=True)
def sums(values):
    if len(values) > 3:
        raise ValueError("too many")
    return np.cumsum(values)
"""
SCRIPT = """
import json, sys
import numba
import numpy as np
from kept import sums

@numba.njit
def last(values):
    return sums(values)[-1]

def refused(kernel):
    try:
        kernel(np.ones(4))
    except ValueError as error:
        return str(error)

answers = [sums(np.ones(2)).tolist(), refused(sums)]
loaded = len(sums.stats.cache_hits)
alone = "numba.typed.typeddict" not in sys.modules
if sys.argv[1:]:
    answers += [last(np.ones(3)), refused(last)]
print(json.dumps({"answers": answers, "loaded": loaded, "alone": alone}))
"""


def test_what_is_divided_by_zero_in_a_kernel_is_no_number():
    """An air velocity of exactly zero, as a simulator has it before the start, ended who estimated with an error."""
    row = np.zeros(StateField.WIDTH)
    row[StateField.ATTITUDE.start] = 1.0
    row[StateField.SPECIFIC_FORCE] = 0.0, 0.0, -STANDARD_GRAVITY
    assert not np.isfinite(flow_angle_rates(row, STANDARD_GRAVITY)).any()


@pytest.mark.long
def test_a_loaded_kernel_is_as_good_as_a_compiled_one(tmp_path):
    """A first process compiles it; a second loads it alone, and then compiles another that calls it."""
    (tmp_path / "kept.py").write_text(KEPT, encoding="utf8")
    script = tmp_path / "script.py"
    script.write_text(SCRIPT, encoding="utf8")
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def run(*arguments):
        command = [sys.executable, str(script), *arguments]
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    answers = [[1.0, 2.0], "too many"]
    assert run() == {"answers": answers, "loaded": 0, "alone": False}
    assert run("another") == {"answers": [*answers, 3.0, "too many"], "loaded": 1, "alone": True}


def test_this_version_of_numba_is_known():
    """With another all is right, but loads slowly: compare its inside with what `kernels` says, and widen KNOWN."""
    assert numba.version_info.major == 0 and numba.version_info.minor in kernels.KNOWN


def test_every_kernel_is_loaded_so():
    """One that takes Numba's own makes each process that calls it import what compiles."""
    package = Path(kernels.__file__).parent
    others = [path for path in package.rglob("*.py") if path.name != "kernels.py" and "numba" in path.read_text("utf8")]
    assert not [path for path in others if re.search(r"^\s*from numba import.*njit", path.read_text("utf8"), re.M)]


@pytest.mark.long
def test_after_an_update_no_kernel_runs_with_what_another_file_was(tmp_path):
    """A constant, and a kernel that is called, of files that changed; what nothing rests on compiles nothing anew."""
    package = tmp_path / Path(kernels.__file__).parent.name
    package.mkdir()
    sources = {
        "__init__": "",
        "kernels": Path(kernels.__file__).read_text(encoding="utf8"),
        "constants": "FACTOR = 2.0\n",
        "inner": "from {p}.kernels import njit\n\n@njit(cache=True)\ndef inner(x):\n    return x + 1.0\n",
        "outer": "from {p} import inner\nfrom {p}.constants import FACTOR\nfrom {p}.kernels import njit\n\n"
        "call = inner.inner\n\n@njit(cache=True)\ndef outer(x):\n    return FACTOR * call(x)\n",
        "apart": "NUMBER = 1\n",
    }

    seconds = itertools.count(1_700_000_000)

    def write(**changed):
        second = next(seconds)  # Python's own cache does not tell files of one length and one second apart
        for name, text in {**sources, **changed}.items():
            path = package / f"{name}.py"
            path.write_text(text.replace("{p}", package.name), encoding="utf8")
            os.utime(path, (second, second))

    def answer():
        code = f"from {package.name}.outer import outer; print(outer(1.0), len(outer.stats.cache_hits))"
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "cache")},
        )  # fmt: skip
        return done.stdout.split()

    write()
    assert answer() == ["4.0", "0"] and answer() == ["4.0", "1"]
    write(apart="NUMBER = 2\n")
    assert answer() == ["4.0", "1"]
    write(constants="FACTOR = 3.0\n")
    assert answer() == ["6.0", "0"]
    write(constants="FACTOR = 3.0\n", inner=sources["inner"].replace("1.0", "2.0"))
    assert answer() == ["9.0", "0"] and answer() == ["9.0", "1"]


IN_FLIGHT = """
import gc, json, sys, tempfile
from pathlib import Path
import numpy as np
from numba.core.dispatcher import Dispatcher
from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.flight_check import in_flight
from aircraft_sysid_ros.identification import model_change
from aircraft_sysid_ros.identification.model_file import load_model, save_model
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

def kernels():
    known = [each for each in gc.get_objects() if isinstance(each, Dispatcher)]
    return {f"{each.py_func.__module__}.{each.py_func.__name__}": len(each.overloads) for each in known}

aircraft, options = default_aircraft(), ParameterOptions(estimator=sys.argv[2])
if sys.argv[1] == "shape":
    keys = ("name", "mass", "wing_area", "span", "chord", "inertia")
    aircraft = aircraft_from_dict({key: aircraft.source[key] for key in keys})
samples = simulate_samples(default_aircraft(), 5, 60.0).samples
time = (samples.stamp - samples.stamp[0]) * 1e-9
samples = samples[(time < 40.0) | (time > 45.0)]  # and it has to start once more
pipeline = Pipeline(aircraft, None, options)
pipeline.warm_up()
in_flight.warm_up()
model_change.warm_up(aircraft, options)
before = kernels()
with tempfile.TemporaryDirectory() as folder:
    for first in range(0, len(samples), 2000):
        pipeline.push(samples[first : first + 2000])
        pipeline.parameters.snapshot()
        pipeline.parameters.model_error()
        pipeline.state.summary()
        if first == 10000:
            save_model(pipeline.parameters, Path(folder) / "model.json")
            load_model(pipeline.parameters, Path(folder) / "model.json")
late = [name for name, count in kernels().items() if count > before.get(name, 0)]
print(json.dumps({"late": late, "updates": int(pipeline.parameters.learning.least_squares.state.updates.max())}))
"""


@pytest.mark.parametrize(("file", "estimator"), [("shape", "auto"), ("whole", "fourier")])
def test_what_a_flight_needs_is_compiled_before_it(file, estimator):
    """A kernel that was first called after half a minute stopped a node for 17 s on a new machine, and lost samples."""
    command = [sys.executable, "-c", IN_FLIGHT, file, estimator]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["updates"] > 500 and found["late"] == []
