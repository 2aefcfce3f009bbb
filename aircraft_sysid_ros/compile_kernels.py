"""Compile the numerical kernels before they are needed: ``python -m aircraft_sysid_ros.compile_kernels``.

Numba keeps what it compiles beside the sources and does not notice that a function which a kernel calls has changed
in another file: ``make env`` therefore deletes the caches and runs this whenever a compiled source has changed.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.calibration.calibration_file import Calibration
from aircraft_sysid_ros.calibration.correction import Correction
from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path
from aircraft_sysid_ros.identification.estimators.by_name import ESTIMATORS
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.state_estimator import warm_up
from aircraft_sysid_ros.recordings.reader import read_recording


def main() -> None:
    """Fly, record, read and replay for some seconds: that calls every kernel."""
    from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples
    from aircraft_sysid_ros.simulation.truth_files import write_flight

    aircraft = load_aircraft(config_path(DEFAULT_AIRCRAFT))
    with tempfile.TemporaryDirectory() as folder:
        write_flight(simulate_samples(aircraft, duration=30.0), Path(folder) / "flight", overwrite=False)
        samples = read_recording(Path(folder) / "flight").samples
    for estimator in ESTIMATORS:
        Pipeline(aircraft, parameter_options=ParameterOptions(estimator=estimator)).warm_up()
    Correction(Calibration()).warm_up()
    pipeline = Pipeline(aircraft)
    warm_up(aircraft, smoother=True)
    pipeline.push(samples)
    pipeline.flush()
    pipeline.parameters.snapshot()


if __name__ == "__main__":
    main()
