"""Compile the numerical kernels before they are needed: ``python -m aircraft_sysid_ros.compile_kernels``.

Numba keeps what it compiles beside the sources and does not notice that a function which a kernel calls has changed
in another file: ``make env`` therefore deletes the caches and runs this whenever a compiled source has changed.
Parts that share few kernels are compiled side by side; one process then goes through all of them again, which
compiles whatever is left and otherwise loads what is there.
"""

from __future__ import annotations

import fcntl
import multiprocessing
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from numba.core import caching

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict, load_aircraft
from aircraft_sysid_ros.aircraft.expression import SIGNAL_COUNT
from aircraft_sysid_ros.calibration.calibration_file import Calibration
from aircraft_sysid_ros.calibration.correction import Correction
from aircraft_sysid_ros.calibration.kinematics import integrated_outputs
from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.search.fit import fits_of, tied_gains
from aircraft_sysid_ros.estimation.kalman_filter import LinearSystem, filter_series
from aircraft_sysid_ros.estimation.smoothing import smooth_series
from aircraft_sysid_ros.flight_check import in_flight
from aircraft_sysid_ros.flight_model.bank import filter_bank, simulation_bank
from aircraft_sysid_ros.flight_model.layout import make_theta
from aircraft_sysid_ros.identification.flight_memory import SampleMemory
from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.identification.model_change import change_model, with_terms
from aircraft_sysid_ros.identification.monitoring.agreement import solved
from aircraft_sysid_ros.identification.monitoring.range_agreement import RangeAgreement
from aircraft_sysid_ros.identification.options import EstimatorName, ParameterOptions
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.state import STATE_SIZE
from aircraft_sysid_ros.reconstruction.state_estimator import warm_up
from aircraft_sysid_ros.reconstruction.state_row import wind_of
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.refinement.record import record_of
from aircraft_sysid_ros.ros_messages.output_messages import state_fields
from aircraft_sysid_ros.samples import Samples

#: Of an aircraft file that says nothing of its sensors, which are then estimated as well.
_SHAPE = ("name", "mass", "wing_area", "span", "chord", "inertia")


def filters() -> None:
    """The state's filter and smoother, its wind while it still stands, and those of linear systems."""
    warm_up(load_aircraft(config_path(DEFAULT_AIRCRAFT)), smoother=True)
    wind_of(np.zeros(STATE_SIZE))
    system = LinearSystem(np.eye(1), np.eye(1), np.eye(1), np.eye(1))
    smooth_series(system, filter_series(system, np.zeros(1), np.eye(1), np.zeros((2, 1))))


def maximum_likelihood() -> None:
    """Recursive maximum likelihood, which holds a bank of filters of its own."""
    _identifier("rml").warm_up()


def least_squares() -> None:
    """Least squares in time and in frequency, and the correction of sensors."""
    _identifier("rls").warm_up()
    _identifier("fourier").warm_up()
    Correction(Calibration()).warm_up()


def search() -> None:
    """The fits on which a diagnosis tries its candidates."""
    aircraft, draws, count = load_aircraft(config_path(DEFAULT_AIRCRAFT)), np.random.default_rng(0), 1000
    signals = draws.uniform(0.1, 0.2, (count, SIGNAL_COUNT))
    time = np.linspace(0.0, 100.0, count)
    fits, _ = fits_of(FlightData(aircraft, time, draws.standard_normal((count, len(AXES))), signals, 0.1))
    fits["CZ"].gain(signals[:, :2])
    _ = fits["CZ"].fit
    tied_gains(fits, {"CZ": signals[:, :1]}, {"CZ": np.ones((1, 1))})


def whole_way() -> None:
    """Fly, record, read and replay for some seconds, with a model that changes; and what may follow."""
    from aircraft_sysid_ros.simulation.closed_loop import SteppedAeroplane
    from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples
    from aircraft_sysid_ros.simulation.truth_files import write_flight

    aircraft = load_aircraft(config_path(DEFAULT_AIRCRAFT))
    with tempfile.TemporaryDirectory() as folder:
        write_flight(simulate_samples(aircraft, duration=30.0), Path(folder) / "flight", overwrite=False)
        samples = read_recording(Path(folder) / "flight").samples
    pipeline, memory, half = Pipeline(aircraft), SampleMemory(), len(samples) // 2
    rows, points = pipeline.push(samples[:half])
    state_fields(rows)
    memory.add(points, np.zeros(3), 0.1)
    changed = with_terms(aircraft, {"CZ": ("alpha**2", "lag(alpha, 0.2)")}, {})
    change_model(pipeline.parameters, changed, memory.newest())
    pipeline.push(samples[half:])
    pipeline.flush()
    pipeline.parameters.snapshot()
    sensors_unknown = Pipeline(aircraft_from_dict({key: aircraft.source[key] for key in _SHAPE}))
    sensors_unknown.push(samples[:half])
    sensors_unknown.flush()
    solved(np.eye(4))  # of the monitor, where two parts of a flight disagree
    RangeAgreement(aircraft.model).warm_up()
    in_flight.warm_up()
    _refine(aircraft, samples)
    _calibrate()
    SteppedAeroplane(aircraft, seed=1, duration=1.0).look()


def _refine(aircraft: Aircraft, samples: Samples) -> None:
    record = record_of(aircraft, samples, 50.0)
    theta = make_theta(record.model, np.zeros(len(aircraft.model.parameter_names)))[None]
    flown = record.time[:2], record.inputs[:2]
    filter_bank(record.states[0], np.eye(15), *flown, record.outputs[:2], theta, record.model)
    simulation_bank(record.states[:1], *flown, theta, record.model)


def _calibrate() -> None:
    times, north, still, zeros = np.zeros(1), np.array([[1.0, 0.0, 0.0]]), np.zeros((1, 3)), np.zeros(1, dtype=np.int64)
    level, outputs = np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((2, 6))
    integrated_outputs(
        times, still, still, zeros, zeros, 2, north, level, np.zeros(6), np.zeros(3), 9.8, outputs[:, 5], True
    )


#: Longest first, so that two processes end at about the same time.
PARTS: tuple[Callable[[], None], ...] = (maximum_likelihood, filters, least_squares, search)


def main() -> None:
    """Call every kernel, first in parts side by side and then as a whole."""
    with tempfile.NamedTemporaryFile() as lock:
        processes = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(mp_context=processes, initializer=_take_turns, initargs=(lock.name,)) as pool:
            for compiled in [pool.submit(part) for part in PARTS]:
                compiled.result()
    for part in (*PARTS, whole_way):
        part()


def _identifier(estimator: EstimatorName) -> Identifier:
    aircraft = load_aircraft(config_path(DEFAULT_AIRCRAFT))
    return Identifier(aircraft, ParameterOptions(estimator=estimator))


def _take_turns(lock: str) -> None:
    """One process at a time writes into the caches: a file is entered in the index of its function before it exists."""
    save: Any = caching.IndexDataCacheFile.save

    def save_alone(self: Any, key: Any, data: Any) -> None:
        with open(lock) as turn:
            fcntl.flock(turn, fcntl.LOCK_EX)
            save(self, key, data)

    caching.IndexDataCacheFile.save = save_alone  # type: ignore[method-assign]


if __name__ == "__main__":
    main()
