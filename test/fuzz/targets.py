"""What is fuzzed: everything that somebody else may have written. Each target takes one input and must return, or raise
InputError: one sentence that prints and has an end. Everything else, a crash and a hang too, is a fault.

``make fuzz`` runs them for long, ``test_fuzz.py`` for a moment. An input that found something becomes a test of its own
beside the code that it is about.
"""

from __future__ import annotations

import contextlib
import ipaddress
import json
import shutil
import struct
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from aircraft_sysid_ros.errors import InputError

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "recordings")]
from mutations import WORDS, mutated, mutated_text  # noqa: E402

CONFIG = Path(__file__).parents[2] / "config"
AIRCRAFT = CONFIG / "ultra_stick_25e.yaml"
START = 1_760_000_000_000_000_000


@dataclass(frozen=True)
class Target:
    """Inputs, what is done with one, and how many the tests try."""

    inputs: Callable[[], st.SearchStrategy[Any]]
    run: Callable[[Any], None]
    tried: int


TARGETS: dict[str, Target] = {}


def target(inputs: Callable[[], st.SearchStrategy[Any]], tried: int) -> Callable[[Callable[[Any], None]], Any]:
    """Make a function a target under its name."""

    def known(run: Callable[[Any], None]) -> Callable[[Any], None]:
        TARGETS[run.__name__] = Target(inputs, run, tried)
        return run

    return known


@contextlib.contextmanager
def refusal() -> Any:
    """What may be raised: a sentence."""
    try:
        yield
    except InputError as error:
        text = str(error)
        assert text.isprintable() and 10 < len(text) < 1500, ascii(text[:200])


@cache
def folder() -> Path:
    """A folder of this process, which goes with it."""
    keep = tempfile.TemporaryDirectory(prefix="fuzz.")
    folder.keep = keep  # type: ignore[attr-defined]
    return Path(keep.name)


def written(name: str, content: bytes | str) -> Path:
    """A file with that content."""
    path = folder() / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode("utf8", "replace"))
    return path


def new_place(name: str) -> Path:
    """A name that is free."""
    path = folder() / name
    shutil.rmtree(path, ignore_errors=True)
    return path


# -- recordings ----------------------------------------------------------------------------------------------


@cache
def recorded() -> Path:
    """A recording of every topic, half a second long."""
    from aircraft_sysid_ros.recordings.writer import RecordingWriter
    from aircraft_sysid_ros.ros_messages.conversion import TOPICS

    path, stamp = folder() / "seed", START + np.arange(25) * 20_000_000
    with RecordingWriter(path) as writer:
        for topic, type_name in TOPICS.items():
            writer.write(topic, type_name, stamp, {}, frame_id="base_link")
        writer.write_inputs(stamp, ["trim_tab", "slat"], np.zeros((25, 2)))
    return path


@cache
def copied(compression: str) -> bytes:
    """The same as other writers write it."""
    from mcap.writer import CompressionType, Writer
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as BagWriter

    from aircraft_sysid_ros.recordings.message_types import known_types
    from aircraft_sysid_ros.recordings.storage import read_raw

    raw = read_raw(recorded())
    if compression == "sqlite3":
        bag = new_place("sqlite3")
        with BagWriter(bag, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
            places = {
                key: writer.add_connection(channel.topic, channel.type, typestore=known_types())
                for key, channel in raw.channels.items()
            }
            for i in range(len(raw)):
                writer.write(places[int(raw.channel[i])], int(raw.log_time[i]), raw[i])
        return next(bag.glob("*.db3")).read_bytes()
    path = folder() / f"{compression}.mcap"
    with path.open("wb") as stream:
        chunks = Writer(stream, chunk_size=4000, compression=CompressionType[compression])
        chunks.start("ros2", "fuzz")
        keys = {}
        for key, channel in raw.channels.items():
            schema = chunks.register_schema(channel.type, "ros2msg", channel.definition.encode())
            keys[key] = chunks.register_channel(channel.topic, "cdr", schema)
        for i in range(len(raw)):
            chunks.add_message(keys[int(raw.channel[i])], int(raw.log_time[i]), raw[i], int(raw.log_time[i]))
        chunks.finish()
    return path.read_bytes()


def of_mcap() -> st.SearchStrategy[bytes]:
    ours = next(recorded().glob("*.mcap")).read_bytes()
    return st.one_of(mutated(ours), *(mutated(copied(name)) for name in ("NONE", "ZSTD", "LZ4")))


@target(of_mcap, 20)
def mcap(data: bytes) -> None:
    from aircraft_sysid_ros.recordings.reader import read_recording

    with refusal():
        recording = read_recording(written("fuzz.mcap", data))
        assert all(note.isprintable() for note in recording.notes)


@target(lambda: mutated(copied("sqlite3")), 15)
def sqlite(data: bytes) -> None:
    from aircraft_sysid_ros.recordings.reader import read_recording

    with refusal():
        read_recording(written("fuzz.db3", data))


@cache
def in_ros1() -> bytes:
    """The recording as ROS 1 writes it, without what is ours."""
    from rosbags.convert.converter import convert

    path = folder() / "ros1.bag"
    convert([recorded()], path, "", 0, None, "file", None, None, [], ["imu/data", "/imu/data", "/gps/fix"], [], [])
    return path.read_bytes()


@target(lambda: mutated(in_ros1()), 20)
def ros1(data: bytes) -> None:
    from aircraft_sysid_ros.recordings.reader import read_recording

    with refusal():
        read_recording(written("fuzz.bag", data))


def of_metadata() -> st.SearchStrategy[Any]:
    seed = (recorded() / "metadata.yaml").read_text()
    return st.one_of(mutated_text(seed), mutated(seed.encode()), st.binary(max_size=200))


@target(of_metadata, 20)
def metadata(content: bytes | str) -> None:
    from aircraft_sysid_ros.recordings.reader import read_recording

    path = folder() / "bag"
    if not path.exists():
        shutil.copytree(recorded(), path)
    written("bag/metadata.yaml", content)
    with refusal():
        read_recording(path)


# -- logs of others ------------------------------------------------------------------------------------------


@cache
def log(kind: str) -> bytes:
    """A second of a log."""
    import test_autopilot_import as logs
    from autopilot_log_files import dataflash, ulog

    if kind == ".bin":
        return bytes(dataflash(logs.FORMATS, logs.dataflash_rows()[:300]))
    if kind == ".ulg":
        topics = {name: (fields, rows[:20]) for name, (fields, rows) in logs.ulog_topics().items()}
        return bytes(ulog(topics))
    packets = mavlink_packets()
    times = [struct.pack(">Q", START // 1000 + 10_000 * k) for k in range(len(packets))]
    return b"".join(stamp + packet for stamp, packet in zip(times, packets, strict=True))


def of_logs() -> st.SearchStrategy[Any]:
    return st.one_of(*(st.tuples(st.just(kind), mutated(log(kind))) for kind in (".bin", ".ulg", ".tlog")))


@target(of_logs, 8)
def logs(item: tuple[str, bytes]) -> None:
    kind, data = item
    imported(written(f"fuzz{kind}", data))


@cache
def mat_file() -> bytes:
    """A structure with channels, as MATLAB 5 has them."""
    from scipy.io import savemat

    channel = {"data": np.arange(50.0), "units": "deg"}
    savemat(folder() / "seed.mat", {"flight": {"Time": channel, "P": channel, "Nz": np.arange(50.0)}, "m": np.eye(3)})
    return (folder() / "seed.mat").read_bytes()


@target(lambda: mutated(mat_file()), 3)
def mat(data: bytes) -> None:
    imported(written("fuzz.mat", data))


MAP = """clock: utc
tables:
  - file: "*.csv"
    time: {column: Time, unit: s, offset: 0.0}
    signals:
      angular_velocity.x: {column: P, unit: deg/s}
      specific_force.z: {column: Nz, unit: g, sign: -1}
      true_airspeed: {expression: "sqrt(2*Qc/1.2)", unit: m/s}
      inputs.trim_tab: {column: dte, unit: deg}
"""
CSV = (
    "\n".join(["Time,P,Nz,Qc,dte", *(f"{0.02 * i:.2f},{i % 7},-1.0{i % 3},{200 + i},{i % 5}" for i in range(60))])
    + "\n"
)


def of_tables() -> st.SearchStrategy[Any]:
    return st.one_of(st.tuples(mutated_text(CSV), st.just(MAP)), st.tuples(st.just(CSV), mutated_text(MAP)))


@target(of_tables, 10)
def tables(item: tuple[str, str]) -> None:
    from aircraft_sysid_ros.recordings.tabular.column_map import load_column_map
    from aircraft_sysid_ros.recordings.tabular.table_import import import_tables

    source = folder() / "tables"
    source.mkdir(exist_ok=True)
    written("tables/a.csv", item[0])
    with refusal():
        report = import_tables(source, load_column_map(written("map.yaml", item[1])), new_place("out"))
        assert all(note.isprintable() for note in report["notes"])


def imported(path: Path) -> None:
    """As the command imports a log; without what it prints."""
    import argparse

    from aircraft_sysid_ros.commands import import_log

    options = {"overwrite": False, "map": None, "guess": None, "calibration": None}
    with refusal():
        import_log.run(argparse.Namespace(log=str(path), out=str(new_place("out")), **options))


# -- what people write ---------------------------------------------------------------------------------------


def of_yaml() -> st.SearchStrategy[Any]:
    seeds = [AIRCRAFT, CONFIG / "umn_thor.yaml", CONFIG / "mavlink_simulator_servos.yaml"]
    texts = [mutated_text(path.read_text()) for path in seeds]
    return st.one_of(*texts, st.recursive(st.sampled_from(WORDS), nested, max_leaves=8))


def nested(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    """YAML in YAML."""
    many = st.lists(inner, max_size=4)
    return many.map(lambda items: f"[{', '.join(items)}]") | many.map(
        lambda items: "{" + ", ".join(f"k{i}: {item}" for i, item in enumerate(items)) + "}"
    )


@target(of_yaml, 15)
def yaml_files(text: str) -> None:
    from aircraft_sysid_ros.aircraft.configuration import load_aircraft
    from aircraft_sysid_ros.calibration.calibration_file import load_calibration
    from aircraft_sysid_ros.mavlink.servo_mapping import load_servo_mapping
    from aircraft_sysid_ros.recordings.manoeuvres import read_segments

    path = written("fuzz.yaml", text)
    for load in (load_aircraft, load_calibration, load_servo_mapping, lambda p: read_segments(str(p), [folder()])):
        with refusal():
            load(path)


EXPRESSION = st.text(alphabet="alpha bet qr deT*+-/()0123456789.,_[]:;'\"`\\\n\x00\x1bé", max_size=80) | st.recursive(
    st.sampled_from(("alpha", "q", "de", "1", "2.5", "Tc", "time", "V", "1e999", "0x1F", "1_0")),
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from("+-*/"), inner).map("".join),
        st.tuples(st.sampled_from(("abs", "sqrt", "exp", "tanh", "lag", "max", "eval", "__import__")), inner).map(
            lambda pair: f"{pair[0]}({pair[1]})"
        ),
        st.tuples(inner, st.integers(-2, 12)).map(lambda pair: f"({pair[0]})**{pair[1]}"),
        inner.map(lambda text: f"lag({text}, 0.2)"),
    ),
    max_leaves=12,
)


@target(lambda: EXPRESSION, 60)
def expressions(text: str) -> None:
    from aircraft_sysid_ros.aircraft.expression import parse_expression
    from aircraft_sysid_ros.aircraft.signals import SIGNALS
    from aircraft_sysid_ros.aircraft.term_values import evaluate
    from aircraft_sysid_ros.diagnosis.model_versions.requests import parse_request
    from aircraft_sysid_ros.recordings.tabular.column_expression import parse_column_expression

    with refusal():
        program = parse_expression(text)
        assert parse_expression(program.text).text == program.text
        evaluate([program], {name: np.linspace(-1.0, 1.0, 5) for name in SIGNALS})
    with refusal():
        parse_request(f"CZ: {text}")
    with refusal():
        column = parse_column_expression(text)
        assert len(column.evaluate(dict.fromkeys(column.columns, np.linspace(-1.0, 1.0, 5)))) == 5


# -- runs and models -----------------------------------------------------------------------------------------


@cache
def run_folder() -> Path:
    """A run of 20 s with a version."""
    from aircraft_sysid_ros.commands.main import main

    flight, run = folder() / "flight", folder() / "run"
    with contextlib.redirect_stdout(StringIO()), contextlib.redirect_stderr(StringIO()):
        assert main(["simulate", "--out", str(flight), "--duration", "20", "--seed", "3"]) == 0
        assert main(["replay", str(flight), "--aircraft", str(AIRCRAFT), "--out", str(run)]) == 0
    version = run / "models" / "12345678"
    version.mkdir(parents=True)
    for name in ("aircraft.yaml", "parameters.json"):
        shutil.copy(run / name, version)
    content = {"model": "12345678", "parents": [], "changes": {"CZ: alpha**3": {"terms": {"CZ": ["alpha**3"]},
               "without": {}, "settings": [{"key": ["mass"], "value": 2.0}]}}, "axes": {}}  # fmt: skip
    (version / "version.json").write_text(json.dumps(content))
    (run / "model.json").write_text('{"model": "12345678"}')
    return run


RUN_FILES = ("aircraft.yaml", "parameters.json", "state.json", "points.npz", "samples.npz", "model.json",
             "models/12345678/version.json", "models/12345678/aircraft.yaml")  # fmt: skip


def of_runs() -> st.SearchStrategy[Any]:
    run = run_folder()
    seeds = {name: (run / name).read_bytes() for name in RUN_FILES}
    texts = [name for name in RUN_FILES if not name.endswith(".npz")]
    return st.one_of(
        *(st.tuples(st.just(name), mutated(seed)) for name, seed in seeds.items()),
        *(st.tuples(st.just(name), mutated_text(seeds[name].decode())) for name in texts),
    )


@target(of_runs, 12)
def runs(item: tuple[str, Any]) -> None:
    from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run, versions_of
    from aircraft_sysid_ros.refinement.run_data import load_run
    from aircraft_sysid_ros.run_reader import damaged_files

    run, (name, content) = run_folder(), item
    before = (run / name).read_bytes()
    written(f"run/{name}", content)
    try:
        assert all(wrong.isprintable() for wrong in damaged_files(run))
        with refusal():
            versions_of(open_run(run))
        with refusal():
            load_run(run)
    finally:
        (run / name).write_bytes(before)


@cache
def identifier() -> Any:
    from aircraft_sysid_ros.aircraft.configuration import load_aircraft
    from aircraft_sysid_ros.identification.identifier import Identifier

    return Identifier(load_aircraft(AIRCRAFT))


@cache
def model_json() -> bytes:
    """A model of a node."""
    from aircraft_sysid_ros.identification.model_file import save_model

    save_model(identifier(), new_place("models") / "seed.json")
    return (folder() / "models" / "seed.json").read_bytes()


NAMES = st.text(max_size=30) | st.sampled_from(
    (*WORDS, "..", "/etc/passwd", "a/../../b", "a\x00b", ".x", "-x", "ok.json")
)


@target(lambda: st.tuples(NAMES, mutated(model_json())), 8)
def models(item: tuple[str, bytes]) -> None:
    from aircraft_sysid_ros.identification.model_file import in_folder, load_model

    place = folder() / "models"
    with refusal():
        path = in_folder(place, item[0])
        assert path.parent == place and path.resolve().parent == place.resolve()
    with refusal():
        load_model(identifier(), written("models/fuzz.json", item[1]))
    (place / "fuzz.json").unlink()


# -- the network ---------------------------------------------------------------------------------------------


@cache
def mavlink_packets() -> list[bytes]:
    """What a simulated autopilot sends in a second and a half, every message that it knows."""
    from aircraft_sysid_ros.aircraft.configuration import load_aircraft
    from aircraft_sysid_ros.mavlink.servo_mapping import load_servo_mapping
    from aircraft_sysid_ros.simulation.mavlink_simulator.autopilot import MavlinkSimulator
    from aircraft_sysid_ros.simulation.mavlink_simulator.sensors import FlightSensors, pieces
    from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

    aircraft = load_aircraft(AIRCRAFT)
    simulator = MavlinkSimulator(load_servo_mapping(CONFIG / "mavlink_simulator_servos.yaml"))
    for rate in simulator._rates.values():
        rate.rate = 20.0
    flight, sensors = simulate_samples(aircraft, seed=4, duration=20.0), FlightSensors(aircraft, 4)
    found: list[bytes] = []
    for event in (event for piece in pieces(flight.truth) for event in sensors.events(piece)):
        if event.time > 1.5:
            break
        simulator.tick(event.time)
        simulator.sense(event)
        found += simulator.packets()
    return found


def of_mavlink() -> st.SearchStrategy[Any]:
    return st.tuples(mutated(b"".join(mavlink_packets())[:8000]), st.integers(1, 500), st.booleans())


@target(of_mavlink, 12)
def mavlink(item: tuple[bytes, int, bool]) -> None:
    from aircraft_sysid_ros.mavlink.servo_mapping import load_servo_mapping
    from aircraft_sysid_ros.mavlink.session import Session

    data, size, is_signed = item
    session = Session(
        load_servo_mapping(CONFIG / "mavlink_simulator_servos.yaml"), key=bytes(32) if is_signed else None
    )
    for k, at in enumerate(range(0, len(data), size)):
        now = START + k * 20_000_000
        for output in session.receive(data[at : at + size], now):
            assert not is_signed and len(output.stamp)
            for name, values in output.fields.items():
                assert not (values.dtype.kind == "f" and np.isinf(values).any()), (output.topic, name)
        session.tick(now)
    assert session.decoder.waiting < 4096 and (session.vehicle is None or not is_signed)
    json.dumps(session.summary())


HOSTS = st.sampled_from(
    (b"localhost", b"127.0.0.1:80", b"evil.example", b"[::1]:1", b"\xff\xfe", b"", b"localhost.evil")
)


def of_requests() -> st.SearchStrategy[Any]:
    value = st.binary(max_size=60) | HOSTS | HOSTS.map(lambda host: b"http://" + host)
    name = st.sampled_from((b"host", b"Host", b"origin", b"ORIGIN", b"x")) | st.binary(max_size=10)
    method = st.sampled_from(("GET", "POST", "PUT", "HEAD", "\x00", ""))
    return st.tuples(st.sampled_from(("http", "websocket")), method, st.lists(st.tuples(name, value), max_size=6))


@target(of_requests, 60)
def page_requests(item: tuple[str, str, list[tuple[bytes, bytes]]]) -> None:
    from aircraft_sysid_ros.workbench.guard import HEADERS, SameOrigin

    kind, method, headers = item
    reached, sent = [], []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        reached.append(scope)
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def receive() -> None:
        return None

    async def send(message: Any) -> None:
        sent.append(message)

    scope = {"type": kind, "method": method, "headers": headers}
    with contextlib.suppress(StopIteration):  # nothing in it waits, and a browser test of this process has the loop
        SameOrigin(app, "127.0.0.1")(scope, receive, send).send(None)
    for message in sent:
        assert message["type"] != "http.response.start" or set(HEADERS) <= set(message["headers"])
    if reached:
        given = {name.lower(): value.decode("latin-1") for name, value in headers}
        host, origin = given.get(b"host", ""), given.get(b"origin")
        assert origin in (None, f"http://{host}", f"https://{host}")
        assert origin is not None or (kind == "http" and method in ("GET", "HEAD", "OPTIONS"))
        assert "evil" not in host or _is_address(host)


def _is_address(host: str) -> bool:
    with contextlib.suppress(ValueError):
        return bool(ipaddress.ip_address(host.rpartition(":")[0].strip("[]")))
    return False
