"""What refinement reads from a run folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.configuration import Aircraft, load_aircraft
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.physical_bounds import physical_bounds
from aircraft_sysid_ros.run_reader import (
    AIRCRAFT,
    PARAMETERS,
    SAMPLES,
    UNREADABLE,
    lack_of_fit_of,
    not_a_run,
    read_parameters,
    read_points,
    read_samples,
    read_state,
    std_of_sensors_of,
)
from aircraft_sysid_ros.samples import WIDTH, Kind, Samples, without_repeats

Array = npt.NDArray[np.float64]

#: Last line of the aircraft files that this program writes into a run: the end of a document of YAML.
END = "\n...\n"


@dataclass(frozen=True)
class RunData:
    """A run: its flight as samples, and what the recursion made of it."""

    aircraft: Aircraft
    samples: Samples
    parameters: dict[str, dict[str, Any]]  # by name, as in parameters.json
    biases: Array  # (6,) accelerometer [m/s^2], gyro [rad/s]
    point_stamp: npt.NDArray[np.int64]  # (n,) [ns]
    measured: Array  # (n, 6) coefficients
    terms: Array  # (n, parameters)
    calm_air: bool = False  # it was taken as calm when the flight was replayed
    #: Variances of the measured coefficients from the noise of the IMU (n, 6), and of the noise of terms (parameters,).
    noise: tuple[Array, Array] | None = None  # None: an older run does not say
    lack_of_fit: Mapping[str, str] = field(default_factory=dict)  # of axes that the model does not explain, in words
    #: One sigma of what sensors that nobody described leave in doubt of parameters, by name.
    std_of_sensors: Mapping[str, float] = field(default_factory=dict)

    @property
    def start(self) -> Array:
        """Aerodynamic coefficients to begin with; 0 where the run has none that an aeroplane could have."""
        values = np.zeros(len(self.aircraft.model.parameter_names))
        for i, name in enumerate(self.aircraft.model.parameter_names):
            value = self.parameters.get(name, {}).get("value")
            low, high = physical_bounds(name)
            if value is not None and low <= value <= high:
                values[i] = value
        return values


def load_run_aircraft(path: Path) -> Aircraft:
    """An aircraft file of a run; InputError also where its end is missing, since half of it may be a valid file."""
    aircraft = load_aircraft(path)
    if not path.read_text(encoding="utf8").endswith(END):
        raise InputError(f"{path} is cut off, its last line is not '{END.strip()}': replay the recording again")
    return aircraft


def load_run(run: str | Path) -> RunData:
    """Read a run folder; InputError when it is none, has no samples, or is damaged: in which file."""
    folder = Path(run)
    if not (folder / PARAMETERS).is_file() or not (folder / AIRCRAFT).is_file():
        raise not_a_run(run)
    if not (folder / SAMPLES).is_file():
        raise InputError(f"{run} holds no samples, it was made by an older version: replay the recording again")
    aircraft = load_run_aircraft(folder / AIRCRAFT)
    try:
        parameters, state, lacks = read_parameters(folder), read_state(folder), lack_of_fit_of(folder)
        of_sensors = std_of_sensors_of(folder)
        known = [*state["accelerometer_bias"], *state["gyro_bias"]]
        biases = np.array([0.0 if b is None else float(b) for b in known])
        samples, points = read_samples(folder), read_points(folder)
    except UNREADABLE:
        raise not_a_run(run) from None
    stamp, measured, terms = points["stamp"], points["measured"], points["terms"]
    names = aircraft.model.parameter_names
    sound = samples.values.shape == (len(samples.stamp), WIDTH) and samples.kind.shape == samples.stamp.shape
    sound = sound and bool(np.all(np.isin(samples.kind, [int(kind) for kind in Kind])))
    sound = sound and measured.shape == (len(stamp), len(AXES)) and terms.shape == (len(stamp), len(names))
    noise = None
    if "response_variance" in points:
        noise = points["response_variance"], points["term_variance"]
        sound = sound and noise[0].shape == measured.shape and noise[1].shape == (len(names),)
    if not sound:
        raise InputError(f"the run {run} is of another version or model: replay the recording again")
    calm_air = bool(state.get("calm_air", False))
    samples = without_repeats(samples)
    return RunData(aircraft, samples, parameters, biases, stamp, measured, terms, calm_air, noise, lacks, of_sensors)
