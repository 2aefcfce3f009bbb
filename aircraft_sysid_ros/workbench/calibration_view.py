"""What ``calibrate`` has written, as the page shows it: read from result.json of its folder, whole or not at all."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError

Array = npt.NDArray[np.float64]

#: As ``calibrate`` calls its file, and what a run has that a calibration has not.
RESULT, OF_RUN = "result.json", "aircraft.yaml"
DEGREES = 180.0 / np.pi
_KINDS = {"lambda": "scale error of", "b": "offset of"}
_OF = {
    "V": "the airspeed", "alpha": "the angle of attack", "beta": "the sideslip", "phi": "the roll angle",
    "theta": "the pitch angle", "psi": "the heading", "p": "the roll rate", "q": "the pitch rate", "r": "the yaw rate",
    "ax": "the acceleration forward", "ay": "the acceleration to the right", "az": "the acceleration down",
    **{axis: f"the magnetic field along {axis}" for axis in "xyz"},
}  # fmt: skip
_WORDS = {
    "W_N": "wind to the north", "W_E": "wind to the east", "W_D": "wind downwards",
    "eps_phi": "roll of the probe in its mount", "inclination": "how far the magnetic field points down",
    "declination": "magnetic north, east of true north",
    **{f"n_{axis}": f"hard iron along {axis}" for axis in "xyz"},
    **{f"eta_{axis}": f"the magnetometer is turned about {axis}" for axis in "xyz"},
    **{f"alpha_{axes}": f"soft iron, {axes}" for axes in ("xy", "xz", "yz")},
}  # fmt: skip


@dataclass(frozen=True)
class CalibratedParameter:
    """One estimate with its standard error, in the unit that is shown; None where it is not known."""

    name: str
    value: float | None
    std: float | None
    unit: str
    determined: bool
    reason: str  # of what is wrong with it; empty where nothing is
    factor: float = 1.0  # from the unit of the result to the one that is shown

    @property
    def estimate(self) -> float | None:
        """The value, where it was found and is not what is taken instead."""
        return self.value if self.determined else None

    @property
    def state(self) -> str:
        """What is wrong with it in few words, such as "not excited" or "at its bound"."""
        return self.reason.partition(":")[0].partition(",")[0]

    @property
    def title(self) -> str:
        """Name with unit."""
        return f"{self.name} [{self.unit or '-'}]"

    @property
    def words(self) -> str:
        """What it is, for those who do not know its symbol; empty where that is not known."""
        kind, _, of = self.name.partition("_")
        if self.name in _WORDS or kind not in _KINDS:
            return _WORDS.get(self.name, "")
        return f"{_KINDS[kind]} {_OF[of]}" if of in _OF else ""


@dataclass(frozen=True)
class Residual:
    """One output: rms before and after, and its residuals over time, thinned."""

    name: str
    rms_before: float | None
    rms_after: float | None
    before: Array  # (n,)
    after: Array  # (n,)


@dataclass(frozen=True)
class TriedModel:
    """A model that was tried, judged on parts of the flight that were left out."""

    words: str
    rms: float | None
    better_by: float | None  # standard errors against the first one; None for the first one
    is_used: bool


@dataclass(frozen=True)
class CalibrationView:
    """A calibration: estimates, stage 1, and residuals before and after."""

    what: str
    recording: str
    aircraft: str
    parameters: tuple[CalibratedParameter, ...]
    sampled: tuple[CalibratedParameter, ...]  # of stage 1, in the order of the columns of xi2
    unique: bool
    decision: str
    stage_2: str
    converged: bool
    xi2: Array  # (S, n2) samples of stage 1, in units that are shown
    trace: Array  # (S,) Tr R, NaN where there is none
    minima: tuple[tuple[Array, float], ...]  # xi2 (n2,) and Tr R, lowest first
    time: Array  # (n,) [s]
    outputs: tuple[Residual, ...]
    unit: str  # of the residuals
    segments: tuple[tuple[str, float, float], ...]  # manoeuvre, begin and end [s]
    seconds: float
    models: tuple[TriedModel, ...]  # empty where one was tried
    notes: tuple[str, ...]

    @property
    def estimate(self) -> Array:
        """(n2,) estimates of the sampled parameters, NaN where one is not known."""
        return np.array([_number(p.estimate) for p in self.sampled], dtype=np.float64)


def is_calibration(path: str | Path) -> bool:
    """Whether a folder, or that of a file, looks like that of a calibration rather than that of a run."""
    folder = _folder(path)
    return (folder / RESULT).is_file() and not (folder / OF_RUN).exists()


def of_run(path: str | Path, what: str) -> Path:
    """Where a calibration from the samples of a run is kept."""
    return Path(path) / f"calibration-{what}"


def newest_of_run(path: str | Path) -> Path | None:
    """The calibration of a run that was made last; None where there is none."""
    made = [file for file in Path(path).glob(f"calibration-*/{RESULT}") if file.is_file()]
    return max(made, key=lambda file: file.stat().st_mtime_ns).parent if made else None


def _folder(path: str | Path) -> Path:
    return Path(path).parent if Path(path).is_file() else Path(path)


def calibration_folder(path: str | Path) -> Path:
    """The folder of a calibration, also where one of its files is named. Raises InputError where there is none."""
    folder = _folder(path)
    if not (folder / RESULT).is_file():
        raise InputError(
            f"{path} holds no calibration, {RESULT} is not there: make one with aircraft-sysid calibrate … --out FOLDER"
        )
    return folder


def load_calibration_view(folder: Path) -> CalibrationView:
    """Read a calibration. Raises InputError that names the file where it cannot be shown."""
    file = folder / RESULT
    try:
        return _view(json.loads(file.read_text(encoding="utf8")))
    except (OSError, KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        missing = f", it has no {error}" if isinstance(error, KeyError) else ""
        raise InputError(
            f"{file} is damaged or of another version{missing}: calibrate again with --out {folder} --overwrite"
        ) from None


def _view(content: Mapping[str, Any]) -> CalibrationView:
    parameters = tuple(_parameter(p) for p in content["parameters"])
    known, stage = {p.name: p for p in parameters}, content["stage_1"]
    sampled = tuple(known[name] for name in stage["names"])
    factors = np.array([p.factor for p in sampled])
    time = _array(content["series"]["time"])
    trace = _array(stage["trace"])
    xi2 = _array(stage["xi2"]).reshape(len(trace), len(sampled)) * factors
    return CalibrationView(
        what=str(content["calibration"]),
        recording=str(content["recording"]),
        aircraft=str(content["aircraft"]),
        parameters=parameters,
        sampled=sampled,
        unique=bool(stage["unique"]),
        decision=str(content["decision"]),
        stage_2=str(content["stage_2"]),
        converged=bool(content["converged"]),
        xi2=xi2,
        trace=np.where(np.isfinite(trace) & (trace > 0.0), trace, np.nan),
        minima=tuple(
            (_array(m["xi2"]).reshape(len(sampled)) * factors, _number(m["trace"])) for m in stage["minima"]
        ),
        time=time,
        outputs=tuple(_residual(name, content, time) for name in content["residuals"]),
        unit=str(content["residual_unit"]),
        segments=tuple((str(s["manoeuvre"]), float(s["from"]), float(s["to"])) for s in content["segments"]),
        seconds=_number(content["seconds_used"]),
        models=tuple(
            TriedModel(
                str(m["model"]), _known(m["held_out_rms"]), _known(m["better_by_standard_errors"]), bool(m["used"])
            )
            for m in content["models"]
        ),
        notes=tuple(map(str, content["notes"])),
    )  # fmt: skip


def _residual(name: str, content: Mapping[str, Any], time: Array) -> Residual:
    rms, series = content["residuals"][name], content["series"]
    before, after = (_array(series[key][name]).reshape(time.shape) for key in ("before", "after"))
    return Residual(name, _known(rms["before"]), _known(rms["after"]), before, after)


def _parameter(content: Mapping[str, Any]) -> CalibratedParameter:
    """Angles are shown in degrees."""
    unit, factor = ("deg", DEGREES) if content["unit"] == "rad" else (str(content["unit"]), 1.0)
    determined = bool(content["determined"])
    value, std = _known(content["value"]), _known(content["std"])
    reason = str(content["reason"])
    if determined and (value is None or std is None):
        reason = reason or "not a number: calibrate again"
    return CalibratedParameter(
        str(content["name"]), None if value is None else value * factor, None if std is None else std * factor,
        unit, determined, reason, factor,
    )  # fmt: skip


def _number(value: Any) -> float:
    """A number of JSON, where what is not known is null."""
    return np.nan if value is None else float(value)


def _known(value: Any) -> float | None:
    number = _number(value)
    return number if np.isfinite(number) else None


def _array(values: Any) -> Array:
    return np.array(values, dtype=np.float64)  # null becomes NaN


class CalibrationFolder:
    """The folder of a calibration that is open. ``revision`` rises with everything that a page shows of it."""

    def __init__(self, path: str | Path) -> None:
        self.path = calibration_folder(path)
        self.view = load_calibration_view(self.path)
        self.damage = ""  # why it cannot be read any more; the view is the last that could
        self.revision = 0
        self._stamp = self._changed()

    def look(self) -> None:
        """Read it again where it was changed."""
        stamp = self._changed()
        if stamp == self._stamp:
            return
        self._stamp = stamp
        self.revision += 1
        try:
            self.view, self.damage = load_calibration_view(calibration_folder(self.path)), ""
        except InputError as error:
            self.damage = str(error)

    def _changed(self) -> int:
        try:
            return (self.path / RESULT).stat().st_mtime_ns
        except OSError:
            return 0
