"""Are all published numbers still the same? For changes that must not change any.

    python tools/same_numbers.py record DIR     # with the code as it was: recordings, and every number made of them
    python tools/same_numbers.py compare DIR    # with the code as it is: which numbers are others, and by how much
    python tools/same_numbers.py compare DIR --only calm thor_smooth    # of these runs alone: a minute

The recordings are simulated (calm, turbulent, half an elevator lost in flight, a vane that sticks, a clock that begins
anew) and, where ../shared/data is, real (Thor flight 75, both logs of InertialNav). Each is replayed with every
estimator, smoothed and not; compare, diagnose and refine run on some. Everything in the run folders is compared:
equal to the bit, or the largest relative difference is told. Exits with 1 where anything differs by more than
LARGEST, or where a text, a status or a time differs at all.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT.parent / "shared" / "data"
ULTRA_STICK = "config/ultra_stick_25e.yaml"
#: Largest relative difference that another order of a sum makes.
LARGEST = 1e-12
#: What differs from run to run.
_TIMING = {"realtime_factor", "computing_time", "seconds", "elapsed", "processor_time", "run", "path"}

#: Simulated recordings: options of ``simulate``.
SIMULATED = {
    "calm": ["--seed", "11", "--duration", "90", "--height-above-ground"],
    "turbulent": ["--seed", "12", "--duration", "90", "--turbulence", "light", "--attitude", "--magnetometer"],
    "damaged": ["--seed", "13", "--duration", "120", "--effect", "control_damage"],
    "effect": ["--seed", "14", "--duration", "90", "--effect", "sideslip_drag"],
}
#: Replays: recording, options. The aircraft file is that of the recording.
REPLAYS = [
    ("calm", []), ("calm", ["--estimator", "fourier"]), ("calm", ["--estimator", "rml"]), ("calm", ["--smooth"]),
    ("calm", ["--estimator", "fourier", "--smooth"]), ("calm", ["--estimator", "rml", "--smooth"]),
    ("turbulent", []), ("turbulent", ["--estimator", "fourier"]), ("turbulent", ["--estimator", "rml"]),
    ("turbulent", ["--smooth"]), ("turbulent", ["--horizon", "0.25", "--no-relearn"]),
    ("damaged", []), ("damaged", ["--estimator", "fourier"]), ("damaged", ["--estimator", "rml"]),
    ("stuck_vane", []), ("stuck_vane", ["--estimator", "fourier"]), ("stuck_vane", ["--estimator", "rml"]),
    ("clock", []), ("clock", ["--estimator", "fourier"]), ("clock", ["--estimator", "rml"]),
    ("thor", []), ("thor", ["--estimator", "fourier"]), ("thor", ["--estimator", "rml"]), ("thor", ["--smooth"]),
    ("SwissLog1", []), ("TestLog2", []), ("effect", []),
]  # fmt: skip
#: Commands on runs: name of the replay, command, options.
COMMANDS = [
    ("calm", "compare", []), ("turbulent", "compare", []), ("thor", "compare", []), ("effect", "compare", []),
    ("effect", "diagnose", []), ("turbulent", "diagnose", []), ("damaged", "diagnose", []),
    ("calm", "refine", ["--method", "output-error"]),
]  # fmt: skip


def sysid(*words: str) -> dict[str, Any]:
    """What a command prints as JSON. Raises RuntimeError with its words where it fails."""
    command = [sys.executable, "-m", "aircraft_sysid_ros.commands.main", *words, "--json"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}  # the code beside this file, whatever is installed
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(words)}: {done.stderr.strip()}")
    return dict(json.loads(done.stdout))


def aircraft_of(recording: str) -> str:
    """The aircraft file of a recording."""
    own = {name: f"config/inertialnav_{name.lower().removesuffix('1')}.yaml" for name in ("SwissLog1", "TestLog2")}
    return {"thor": "config/umn_thor.yaml", **own}.get(recording, ULTRA_STICK)


def make_recordings(folder: Path) -> None:
    """All recordings, made once: with the code as it was."""
    for name, options in SIMULATED.items():
        sysid("simulate", "--out", str(folder / name), "--aircraft", ULTRA_STICK, *options)
    changed(folder / "calm", folder / "stuck_vane.mcap", stuck_vane=(50.0, 62.0))
    changed(folder / "calm", folder / "clock.mcap", restart=45.0)
    logs = {"thor": "umn_thor_flight75/flight75.mat", **{n: f"inertialnav/{n}.mat" for n in ("SwissLog1", "TestLog2")}}
    for name, log in logs.items():
        if (DATA / log).exists():
            sysid("import", str(DATA / log), "--out", str(folder / name))


def changed(
    source: Path, target: Path, stuck_vane: tuple[float, float] | None = None, restart: float | None = None
) -> None:
    """A copy of a recording in which the vane sticks between two times [s], or the clock starts over at one."""
    from rosbags.highlevel import AnyReader
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    held: float | None = None
    shutil.rmtree(target, ignore_errors=True)
    with AnyReader([source], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        begin = reader.start_time
        store = reader.typestore
        with Writer(target, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            targets = {
                c.id: writer.add_connection(c.topic, c.msgtype, typestore=store, serialization_format="cdr")
                for c in reader.connections
            }
            for connection, stamp, raw in reader.messages():
                message, since = reader.deserialize(raw, connection.msgtype), (stamp - begin) * 1e-9
                if stuck_vane and connection.topic == "/air_data":
                    held = message.angle_of_attack if not stuck_vane[0] <= since < stuck_vane[1] else held
                    message.angle_of_attack = held
                if restart is not None and since >= restart:
                    message.header.stamp.sec -= 1000
                writer.write(targets[connection.id], stamp, store.serialize_cdr(message, connection.msgtype))


def name_of(recording: str, options: list[str]) -> str:
    """Name of the run of a replay."""
    return "_".join([recording, *(option.lstrip("-") for option in options if option != "--estimator")])


def make_numbers(recordings: Path, out: Path, only: list[str]) -> None:
    """Every run and every output, two at a time; ``only`` these runs, where there are any."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    found = {path.name.removesuffix(".mcap"): path for path in recordings.iterdir()}

    def replay(case: tuple[str, list[str]]) -> None:
        name, options = case
        if name in found:
            run = str(out / name_of(name, options))
            sysid("replay", str(found[name]), "--aircraft", aircraft_of(name), "--out", run, *options)

    def command(case: tuple[str, str, list[str]]) -> None:
        name, what, options = case
        if name in found:
            result = sysid(what, str(out / name), *options)
            (out / f"{name}_{what}.json").write_text(json.dumps(result))

    with ThreadPoolExecutor(2) as pool:
        replays = [case for case in REPLAYS if not only or name_of(*case) in only]
        for work, cases in ((replay, replays), (command, [] if only else COMMANDS)):
            for done in [pool.submit(work, case) for case in cases]:  # type: ignore[arg-type]
                done.result()


def numbers_of(path: Path) -> Iterator[tuple[str, Any]]:
    """Names and values in one file of a run."""
    if path.suffix == ".json":
        yield from flattened(json.loads(path.read_text()))
    elif path.suffix == ".npz":
        with np.load(path) as arrays:
            yield from ((name, arrays[name]) for name in arrays.files)
    elif path.suffix == ".mcap":
        yield from messages_of(path)
    else:
        yield "text", path.read_text()


def flattened(content: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Leaves of a JSON document by their path."""
    if isinstance(content, dict):
        for key, value in content.items():
            if key not in _TIMING:
                yield from flattened(value, f"{name}.{key}")
    elif isinstance(content, list):
        yield f"{name}.length", len(content)
        for i, value in enumerate(content):
            yield from flattened(value, f"{name}[{i}]")
    else:
        yield name, content


def messages_of(path: Path) -> Iterator[tuple[str, Any]]:
    """Every number of every message, as one array per field and topic, and the texts."""
    from rosbags.highlevel import AnyReader

    series: dict[str, list[Any]] = {}
    with AnyReader([path]) as reader:
        for connection, stamp, raw in reader.messages():
            series.setdefault(f"{connection.topic}.received", []).append(stamp)
            collect(reader.deserialize(raw, connection.msgtype), connection.topic, series)
    for name, values in series.items():
        yield name, values if isinstance(values[0], str) else np.array(values, dtype=np.float64)


def collect(value: Any, name: str, series: dict[str, list[Any]]) -> None:
    """Add what a message holds to the series of its fields."""
    if isinstance(value, str):
        series.setdefault(f"{name} (text)", []).append(value)
    elif isinstance(value, (int, float, np.generic)):
        series.setdefault(name, []).append(float(value))
    elif isinstance(value, np.ndarray):
        series.setdefault(name, []).extend(value.astype(np.float64).ravel().tolist())
    elif isinstance(value, (list, tuple)):
        for item in value:
            collect(item, name, series)
    else:
        for field in value.__dataclass_fields__:
            if field != "__msgtype__":
                collect(getattr(value, field), f"{name}.{field}", series)


def difference(old: Any, new: Any) -> float:
    """Largest relative difference; inf for another shape, text or kind of number."""
    if isinstance(old, (str, list, bool)) or old is None or isinstance(new, str) or new is None:
        return 0.0 if old == new else np.inf
    a, b = np.asarray(old), np.asarray(new)
    if a.shape != b.shape:
        return np.inf
    if a.dtype.kind not in "fc":
        return 0.0 if np.array_equal(a, b) else np.inf
    if np.array_equal(a, b, equal_nan=True):
        return 0.0
    if not np.array_equal(np.isfinite(a), np.isfinite(b)):
        return np.inf
    known = np.isfinite(a)
    scale = np.maximum(np.abs(a[known]), 1e-9)
    return float(np.max(np.abs(a[known] - b[known]) / scale))


def compare(old: Path, new: Path, only: list[str]) -> int:
    """Print what differs, in ``only`` these runs if any; returns how many files differ by more than LARGEST."""
    files = sorted(path.relative_to(old) for path in old.rglob("*") if path.is_file())
    of_commands = ("compare", "diagnos", "refine")  # they lie beside the files of the replay
    files = [f for f in files if not only or (f.parts[0] in only and not f.name.startswith(of_commands))]
    worst, same = [], 0
    for file in files:
        if not (new / file).exists():
            worst.append((np.inf, f"{file} is not there"))
            continue
        before, after = dict(numbers_of(old / file)), dict(numbers_of(new / file))
        found = {name: difference(value, after.get(name)) for name, value in before.items()}
        found |= {name: np.inf for name in after if name not in before}
        largest = max(found.values(), default=0.0)
        if largest > 0.0:
            names = sorted(found, key=lambda name: -found[name])[:3]
            worst.append((largest, f"{file}: {', '.join(f'{name} by {found[name]:.1e}' for name in names)}"))
        else:
            same += 1
    print(f"{same} of {len(files)} files are the same to the bit")
    for largest, words in sorted(worst, reverse=True):
        print(f"{'DIFFERS' if largest > LARGEST else 'rounding'}  {words}")
    return sum(largest > LARGEST for largest, _ in worst)


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("record", "compare"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", nargs="*", default=[], metavar="RUN", help="replays to make and compare")
    args = parser.parse_args()
    folder = args.folder.absolute()
    if args.what == "record":
        (folder / "recordings").mkdir(parents=True)
        make_recordings(folder / "recordings")
        make_numbers(folder / "recordings", folder / "before", args.only)
        print(f"recorded in {folder}")
        return
    make_numbers(folder / "recordings", folder / "now", args.only)
    sys.exit(1 if compare(folder / "before", folder / "now", args.only) else 0)


if __name__ == "__main__":
    main()
