"""The calls for a notebook or a script; the commands of ``aircraft-sysid`` make the same ones.

    import aircraft_sysid_ros as sysid

    recording = sysid.import_log("log.ulg", out="flight")     # or sysid.record(frames, out="flight"), of pandas
    run = sysid.replay(recording, "aircraft.yaml", out="runs/flight")
    sysid.compare(run).errors                                  # a pandas.DataFrame
    found = sysid.diagnose(run)
    sysid.add(run, found.candidates.effect[0])

Recordings and runs are folders; wherever one is asked for, its path or what another call has returned will do. Every
result has ``json``, the same document as the command with ``--json``. Tables are made with pandas when they are asked
for (the extra ``tables``), SI and radians, FRD and NED. Bad input raises InputError, one sentence that says what to do.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
import yaml

from aircraft_sysid_ros.after_flight import check as _check
from aircraft_sysid_ros.after_flight import compare as _compare
from aircraft_sysid_ros.after_flight import diagnose as _diagnose
from aircraft_sysid_ros.after_flight import log_import as _import
from aircraft_sysid_ros.after_flight import replay as _replay
from aircraft_sysid_ros.after_flight.explanation.explain import PAGE, RUN, ExplainOptions
from aircraft_sysid_ros.after_flight.explanation.explain import Explanation as _Explained
from aircraft_sysid_ros.after_flight.explanation.explain import explain as _explain
from aircraft_sysid_ros.after_flight.progress import Tell, nobody
from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.frames import euler_angles
from aircraft_sysid_ros.aircraft.named_inputs import NamedInput
from aircraft_sysid_ros.aircraft.signals import MOST_INPUTS
from aircraft_sysid_ros.call_arguments import Place, aircraft_of, options_by_name, place_of, text_of, text_path
from aircraft_sysid_ros.diagnosis.model_versions import additions
from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run, released_parameters
from aircraft_sysid_ros.diagnosis.significance.parametric_bootstrap import COUNT
from aircraft_sysid_ros.diagnosis.two_runs import SideBySide
from aircraft_sysid_ros.errors import InputError, echo
from aircraft_sysid_ros.flight_check.signals import INPUTS, NAMES
from aircraft_sysid_ros.installation import MissingExtra
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.recordings.tabular.column_map import parse_column_map
from aircraft_sysid_ros.recordings.tabular.signals import check_signal, unit_of
from aircraft_sysid_ros.recordings.tabular.table_import import import_tables
from aircraft_sysid_ros.report.diagnosis_figures import comparison_figure, errors_figure
from aircraft_sysid_ros.run_reader import AIRCRAFT, UNREADABLE, not_a_run, read_points, read_state
from aircraft_sysid_ros.samples import Kind

if TYPE_CHECKING:
    import pandas

__all__ = [
    "Addition", "Check", "Comparison", "Diagnosis", "Explanation", "InputError", "Recording", "Run", "TwoRuns", "add",
    "check", "compare", "diagnose", "explain", "import_log", "load", "record", "remove", "replay",
]  # fmt: skip


def _frame(rows: Sequence[Mapping[str, Any]], index: str | None = None) -> pandas.DataFrame:
    """A table of records."""
    frame = _pandas().DataFrame(list(rows))
    return frame.set_index(index) if index and len(frame) else frame


@contextmanager
def _drawing(path: Place) -> Iterator[None]:
    """Why a figure cannot be written, as InputError."""
    try:
        yield
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from None
    except ValueError as error:
        if not str(error).startswith("Format "):
            raise
        raise InputError(f"{path} is not a kind of picture that can be drawn: give it a name ending in .png") from None


def _pandas() -> Any:
    try:
        import pandas
    except ImportError:
        raise MissingExtra("tables", "pandas", "tables") from None
    return pandas


@dataclass(frozen=True)
class Recording:
    """A flight as it was recorded: a rosbag2 with our topics. ``json`` is the report of its import, if it has one."""

    path: Path
    json: Mapping[str, Any] = field(default_factory=dict, repr=False)

    def tables(self) -> dict[str, pandas.DataFrame]:
        """Its samples by sensor: columns are signals, by the names of the MAP of an import; the index is time [s].

        The attitude comes as roll, pitch and yaw, named inputs in the unit of the recording. Times count from the
        earliest stamp. Raises InputError.
        """
        pandas = _pandas()
        recording = read_recording(self.path)
        samples, tables = recording.samples, {}
        for kind, names in NAMES.items():
            rows = samples[samples.kind == kind]
            if not len(rows):
                continue
            values = rows.values[:, : len(names)]
            if kind == Kind.ATTITUDE:
                values = euler_angles(np.ascontiguousarray(rows.values[:, :4]))
            time = pandas.Index((rows.stamp - recording.start) * 1e-9, name="time")
            tables[kind.name.lower()] = pandas.DataFrame(values, time, names)
        for first in range(0, len(recording.unnamed), MOST_INPUTS):
            named = recording.unnamed[first : first + MOST_INPUTS]
            inputs = [NamedInput(name, limits=(-np.inf, np.inf)) for name in named]
            samples = read_recording(self.path, inputs).samples
            rows = samples[samples.kind == Kind.INPUTS]
            time = pandas.Index((rows.stamp - recording.start) * 1e-9, name="time")
            columns = [f"{INPUTS}{name}" for name in named]
            table = pandas.DataFrame(rows.values[:, : len(named)], time, columns)
            tables["inputs" if first == 0 else f"inputs_{first // MOST_INPUTS + 1}"] = table
        return tables


@dataclass(frozen=True)
class Run:
    """What was estimated from a flight: the folder that ``replay`` and ``live`` write, with its model versions."""

    path: Path
    json: Mapping[str, Any] = field(default_factory=dict, repr=False)  # of `replay`, where that made it

    @property
    def model(self) -> str:
        """Id of the current model version."""
        return open_run(self.path).current.identifier

    @property
    def aircraft(self) -> Aircraft:
        """The aircraft file of the current model version, read."""
        return open_run(self.path).current.aircraft

    @property
    def parameters(self) -> pandas.DataFrame:
        """Of the current version: value, std, status (USE, HOLD, REJECT) and reason, by name.

        What ``refine`` contradicts has HOLD.
        """
        run = open_run(self.path)
        listed = self._read(lambda folder: released_parameters(run, run.current))
        return _frame([{"name": name, **p} for name, p in listed.items()], "name")

    @property
    def state(self) -> dict[str, Any]:
        """Final biases, wind and what became of the samples: the content of state.json."""
        return self._read(read_state)

    @property
    def points(self) -> pandas.DataFrame:
        """Signals and measured coefficients over time [s] as the filter saw them in flight."""
        points = self._read(read_points)
        names = [*map(str, points["signal_names"]), *AXES]
        time = (points["stamp"] - points["stamp"][:1]) * 1e-9
        index = _pandas().Index(time, name="since_start")
        return _pandas().DataFrame(np.hstack([points["signals"], points["measured"]]), index, names)

    def _read(self, read: Callable[[Path], Any]) -> Any:
        try:
            return read(self.path)
        except UNREADABLE:
            raise not_a_run(self.path) from None


@dataclass(frozen=True)
class Check:
    """What the sensors of a recording say of themselves and of each other."""

    json: Mapping[str, Any] = field(repr=False)

    @property
    def findings(self) -> pandas.DataFrame:
        """signal, kind, severity, sentence; the worst first."""
        return _frame(self.json["findings"])

    @property
    def parameters(self) -> pandas.DataFrame:
        """Whether the flight shows each parameter, and why not."""
        shown = self.json["identifiable"]
        return _frame([{**p, "is_shown": shown[p["name"]]} for p in self.json["parameters"]], "name")


@dataclass(frozen=True)
class Comparison:
    """How good the model of a run is on flight that it was not fitted to."""

    result: _compare.ComparedRun = field(repr=False)

    @property
    def json(self) -> dict[str, Any]:
        """As ``compare --json``, without the figure."""
        return self.result.json

    @property
    def errors(self) -> pandas.DataFrame:
        """By axis: nrmse_fit, nrmse_held_out, noise_floor, white."""
        return _frame([{"axis": name, **axis} for name, axis in self.json["axes"].items()], "axis")

    @property
    def worst(self) -> pandas.DataFrame:
        """Where it fails, worst first."""
        return _frame(self.json["worst"])

    def plot(self, path: Place) -> Path:
        """Measured and predicted coefficients and what is left over, to a PNG file."""
        title = f"{self.result.comparison.flight.aircraft.name}, model {self.result.run.current.identifier}"
        with _drawing(path):
            return comparison_figure(self.result.comparison, path, title)


@dataclass(frozen=True)
class TwoRuns:
    """Two runs, or two versions of one, side by side."""

    first: Comparison
    result: SideBySide = field(repr=False)

    @property
    def json(self) -> dict[str, Any]:
        """As ``compare --with --json``, without the figure."""
        return {**self.first.json, "with": self.result.json}

    @property
    def parameters(self) -> pandas.DataFrame:
        """By name: both values, their difference with its standard error, and whether that is more than chance."""
        return _frame([d.json for d in self.result.parameters], "name")

    @property
    def errors(self) -> pandas.DataFrame:
        """Held-out errors by axis: of the model of run i on the flight of run j in column (i, j)."""
        rows = {axis: table.ravel() for axis, table in self.result.errors.items()}
        columns = [f"{model} on {flight}" for model in self.result.runs for flight in self.result.runs]
        return _pandas().DataFrame.from_dict(rows, "index", columns=columns)


@dataclass(frozen=True)
class Diagnosis:
    """Which effect the model of a run lacks."""

    json: Mapping[str, Any] = field(repr=False)

    @property
    def verdict(self) -> str:
        """none, missing or unexplained."""
        return str(self.json["verdict"])

    @property
    def advice(self) -> str:
        """What to do about it."""
        return str(self.json["advice"])

    @property
    def candidates(self) -> pandas.DataFrame:
        """Significant candidates, best first; what is taken for true has ``found``."""
        return _frame(self.json["candidates"])


@dataclass(frozen=True)
class Addition:
    """What became of the errors when the model of a run was changed."""

    run: Run  # whose current version is the new one
    result: additions.Outcome = field(repr=False)

    @property
    def json(self) -> dict[str, Any]:
        """Model, errors and new parameters."""
        return {
            "model": self.result.version.identifier,
            "label": self.result.label,
            "axes": {axis: dict(errors) for axis, errors in self.result.axes.items()},
            "parameters": self.result.parameters,
            "improved": self.result.improved,
            "verdict": self.result.verdict,
        }

    @property
    def verdict(self) -> str:
        """In a sentence."""
        return self.result.verdict

    @property
    def errors(self) -> pandas.DataFrame:
        """By axis: error_before, error_after (held out) and noise_floor."""
        return _frame([{"axis": axis, **errors} for axis, errors in self.result.axes.items()], "axis")

    def plot(self, path: Place) -> Path:
        """The errors before and after, to a PNG file."""
        with _drawing(path):
            return errors_figure(self.result.axes, path, f"{self.result.label}: {self.result.verdict}")


@dataclass(frozen=True)
class Explanation:
    """What a log means; ``first`` is the most important thing that it says."""

    result: _Explained = field(repr=False)

    @property
    def first(self) -> str:
        """In a sentence."""
        return self.result.first

    @property
    def json(self) -> dict[str, Any]:
        """As ``explain --json``."""
        return self.result.json

    @property
    def run(self) -> Run | None:
        """What was estimated; None where the log allows none."""
        return None if self.result.replayed is None else Run(self.result.out / RUN, self.result.replayed)

    @property
    def page(self) -> Path:
        """The page for a browser."""
        return self.result.out / PAGE

    @property
    def modes(self) -> pandas.DataFrame:
        """By name: frequency [rad/s], damping, their standard deviations, and why one is not known."""
        return _frame([mode.json for mode in self.result.modes], "name")

    @property
    def aeroplane(self) -> pandas.DataFrame:
        """Stability, damping, control power and margin to the stall, each with its standard deviation."""
        return _frame([fact.json for fact in self.result.facts], "key")


# -- the calls -----------------------------------------------------------------------------------------------


def load(path: Place) -> Run | Recording:
    """A run or a recording that is there. Raises InputError for anything else."""
    folder = _path(path)
    if (folder / AIRCRAFT).exists():
        return Run(open_run(folder).path)
    if not folder.exists():
        raise InputError(f"there is no {path}: give the folder of a run, or a recording")
    read_recording(folder)
    return Recording(folder)


def import_log(
    log: Place, out: Place, *, columns: Place | None = None, calibration: Place | None = None, overwrite: bool = False
) -> Recording:
    """A log of another program as a recording. ``columns``: the MAP of a table; ``calibration``: of servo outputs."""
    place, by_map = place_of(out), None if columns is None else place_of(columns)
    report = _import.import_log(
        _path(log), place, columns=by_map, calibration=text_path(calibration), overwrite=overwrite
    )
    return Recording(place, report)


def record(
    frames: pandas.DataFrame | Sequence[pandas.DataFrame], out: Place, *, clock: str | None = None,
    overwrite: bool = False,
) -> Recording:  # fmt: skip
    """Tables of pandas as a recording: columns are signals by the names of the MAP of an import, in SI and radians.

    The index of each is its time: numbers [s], times since a start, or dates, in UTC where they name no zone. Frames of
    sensors that come at different times are given as a list. ``clock``: what time 0 is, as in a MAP; without it stamps
    begin in the year 2000. Raises InputError.
    """
    pandas, place = _pandas(), place_of(out)
    listed = [frames] if isinstance(frames, pandas.DataFrame) else frames
    if not isinstance(listed, list | tuple) or not listed or not all(isinstance(f, pandas.DataFrame) for f in listed):
        raise InputError("give a table of pandas, or a list of tables: of the answer of tables(), list(….values())")
    tables = []
    with tempfile.TemporaryDirectory() as folder:
        for number, frame in enumerate(listed):
            for name in frame.columns:
                check_signal(str(name))
            named = f"table_{number}.parquet"
            timed = frame.assign(time=_times(frame.index))
            timed.columns = [str(name) for name in timed.columns]
            try:
                timed.reset_index(drop=True).to_parquet(Path(folder) / named, index=False)
            except (ValueError, TypeError, NotImplementedError) as error:  # pyarrow's, which name the column
                why = echo(" ".join(map(str, error.args)), 200)
                raise InputError(f"a table cannot be recorded: {why}: give columns of numbers, each once") from None
            signals = {str(c): {"column": str(c), "unit": unit_of(str(c)) or "1"} for c in frame.columns}
            unit = "iso" if timed["time"].dtype.kind == "M" else "s"
            tables.append({"file": named, "time": {"column": "time", "unit": unit}, "signals": signals})
        content = {"tables": tables, **({"clock": clock} if clock else {})}
        text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
        report = import_tables(Path(folder), parse_column_map(text), place, overwrite=overwrite)
    return Recording(place, {**report, "log": "pandas", "format": "pandas"})


def _times(index: pandas.Index) -> Any:
    """The index of a table as its time: dates as they are, in UTC, all else in seconds. Raises InputError."""
    pandas = _pandas()
    if isinstance(index, pandas.DatetimeIndex):
        return index if index.tz is None else index.tz_convert("UTC").tz_localize(None)
    if isinstance(index, pandas.TimedeltaIndex):
        return index.total_seconds()
    try:
        return np.asarray(index, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"the index of a table is its time [s], but '{echo(str(index[0]))}' is not a number") from None


def check(recording: Place | Recording, aircraft: Place | Mapping[str, Any] | Aircraft | None = None) -> Check:
    """Whether a recording contradicts itself, and which parameters it shows. Raises InputError."""
    found = _check.check_recording(_path(recording), None if aircraft is None else aircraft_of(aircraft))
    return Check({**found.json, "notes": list(found.notes)})


def replay(
    recordings: Place | Recording | Sequence[Place | Recording],
    aircraft: Place | Mapping[str, Any] | Aircraft,
    out: Place,
    *,
    segments: Place | None = None,
    calibration: Place | None = None,
    smooth: bool = False,
    prior: Place | None = None,
    airframe: str | None = None,
    as_live: bool = False,
    overwrite: bool = False,
    tell: Tell = nobody,
    **options: Any,
) -> Run:
    """Estimate everything from recordings, of one aeroplane, and write it to the run ``out``.

    ``aircraft``: a file, or its content. ``prior``: folder of a fleet, and which ``airframe`` of it flies. ``as_live``:
    a vane that the aircraft file does not place stays in the middle, as live has it. Further options are those of
    docs/nodes.md, such as estimator="rml" or calm_air=True. Raises InputError, and then nothing is written.
    """
    several = isinstance(recordings, Sequence) and not isinstance(recordings, str)
    listed: list[Any] = list(recordings) if several else [recordings]  # type: ignore[arg-type]
    if not listed:
        raise InputError("no recording is given to replay: give at least one")
    state, parameters = options_by_name(options)
    chosen = _replay.ReplayOptions(
        state,
        parameters,
        segments=text_path(segments),
        overwrite=overwrite,
        calibration=text_path(calibration),
        smooth=smooth,
        prior=text_path(prior),
        airframe=airframe,
        as_live=as_live,
    )
    place = place_of(out)
    result = _replay.replay([str(_path(each)) for each in listed], aircraft_of(aircraft), place, chosen, tell)
    return Run(place, result)


@overload
def compare(run: Place | Run, other: None = None) -> Comparison: ...


@overload
def compare(run: Place | Run, other: Place | Run) -> TwoRuns: ...


def compare(run: Place | Run, other: Place | Run | None = None) -> Comparison | TwoRuns:
    """How good the model of a run is (Comparison); beside another run, or version by its id, TwoRuns.

    Raises InputError.
    """
    if other is None:
        return Comparison(_compare.compare_run(_path(run)))
    first, both = _compare.compare_runs(_path(run), other if isinstance(other, str) else _path(other))
    return TwoRuns(Comparison(first), both)


def diagnose(*runs: Place | Run, replicas: int = COUNT, tell: Tell = nobody) -> Diagnosis:
    """Which effect the model lacks; several runs of one aeroplane are one body of evidence. Raises InputError."""
    if not runs:
        raise InputError("no run is given to diagnose: give at least one")
    return Diagnosis(_diagnose.diagnose([_path(run) for run in runs], replicas, tell))


def add(run: Place | Run, what: str) -> Addition:
    """Add an effect by its id, or terms such as "CZ: alpha**3", as a new version of the model. Raises InputError."""
    return Addition(Run(_path(run)), additions.add(_path(run), text_of(what)))


def remove(run: Place | Run, what: str) -> Addition:
    """Take out what was added, or any term, as a new version of the model. Raises InputError."""
    return Addition(Run(_path(run)), additions.remove(_path(run), text_of(what)))


def explain(
    log: Place | Recording,
    aircraft: Place | Mapping[str, Any] | Aircraft,
    out: Place,
    *,
    columns: Place | None = None,
    calibration: Place | None = None,
    overwrite: bool = False,
    replicas: int = COUNT,
    calm_air: bool = False,
    tell: Tell = nobody,
) -> Explanation:
    """What a log means: all of the above in one go, to the folder ``out`` with the run and explain.html.

    ``columns``: the MAP of a table; ``calm_air``: the speed over ground stands for an airspeed that is not measured.
    Raises InputError, and then nothing is written.
    """
    try:
        from aircraft_sysid_ros.workbench.explain_page import explain_html
    except ImportError:
        raise MissingExtra("pages", "jinja2", "workbench") from None
    options = ExplainOptions(overwrite, text_path(calibration), replicas, calm_air, text_path(columns))
    return Explanation(_explain(_path(log), aircraft_of(aircraft), place_of(out), options, tell, explain_html))


def _path(given: Place | Recording | Run) -> Path:
    """The folder or file of what was given. Raises InputError for what is none."""
    return (
        given.path if isinstance(given, Recording | Run) else place_of(given, "a path, or what another call has given")
    )
