"""A calibration flight with known truth: instruments with errors in a steady wind.

The errors are drawn from a seed: of the probe evenly within the constraints of Table 6 of the two-stage paper; of
magnetometer, air data and attitude as large as such instruments have them. Equation numbers: docs/references.md.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft, load_aircraft
from aircraft_sysid_ros.aircraft.frames import cross_matrix
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.sensors.five_hole_probe import ProbeCalibration
from aircraft_sysid_ros.sensors.instrument_errors import AIR_DATA, ANGLES, MagneticErrors, OutputErrors
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions, generator
from aircraft_sysid_ros.simulation.calibration_plan import CALIBRATION
from aircraft_sysid_ros.simulation.simulated_flight import HIDDEN_RATE, SimulatedFlight, simulate_samples

Array = npt.NDArray[np.float64]

CALIBRATION_AIRCRAFT = "ultra_stick_120.yaml"
#: A calibration flight lasts so long [s]; another duration stretches it.
DURATION = 250.0
#: Largest errors: of the probe those of Table 6, scales and [m/s], [rad].
PROBE_SCALE, PROBE_AIRSPEED, PROBE_ANGLE, PROBE_MOUNT = 0.5, 5.0, np.radians(5.0), np.radians(15.0)
#: One sigma: scales, soft iron and misalignment; hard iron [T]; scales and offsets of outputs.
MAGNETIC_SCALE, MAGNETIC_IRON, HARD_IRON = 0.08, 0.03, 1.2e-5
OUTPUT_SCALE, OUTPUT_AIRSPEED, OUTPUT_ANGLE = 0.04, 0.8, np.radians(1.2)


@dataclass(frozen=True)
class InstrumentTruth:
    """What is wrong with the instruments of a flight, by the names that calibrations use."""

    probe: ProbeCalibration
    magnetic: dict[str, float]
    outputs: OutputErrors

    @property
    def magnetic_errors(self) -> MagneticErrors:
        """The same as matrix and hard iron of (B1)."""
        m = self.magnetic
        xy, xz, yz = (m[f"alpha_{axes}"] for axes in ("xy", "xz", "yz"))
        soft = np.array([[1.0, xy, xz], [xy, 1.0, yz], [xz, yz, 1.0]])
        turn = np.eye(3) + cross_matrix(np.array([m[f"eta_{axis}"] for axis in "xyz"]))
        scale = np.array([1.0 + m[f"lambda_{axis}"] for axis in "xyz"])
        return MagneticErrors(soft @ turn * scale, np.array([m[f"n_{axis}"] for axis in "xyz"]))

    def document(self) -> dict[str, Any]:
        """For truth.json, by calibration and parameter."""
        p, o = self.probe, self.outputs
        bend = {"kappa_alpha": p.alpha_cubic, "kappa_beta": p.beta_cubic} if p.alpha_cubic or p.beta_cubic else {}
        return {
            "five_hole_probe": {
                "lambda_V": p.airspeed_scale, "b_V": p.airspeed_offset, "lambda_alpha": p.alpha_scale,
                "b_alpha": p.alpha_offset, "lambda_beta": p.beta_scale, "b_beta": p.beta_offset,
                "eps_phi": p.mount_roll, **bend,
            },
            "magnetometer": self.magnetic,
            "compatibility": {
                **{f"lambda_{name}": value for name, value in o.scale.items()},
                **{f"b_{name}": value for name, value in o.offset.items()},
            },
        }  # fmt: skip


def drawn_errors(seed: int) -> InstrumentTruth:
    """Errors of all instruments from a seed."""
    rng = generator(seed, "instrument errors")

    def even(size: float) -> float:
        return float(rng.uniform(-size, size))

    def normal(size: float) -> float:
        return float(size * rng.standard_normal())

    probe = ProbeCalibration(
        airspeed_scale=even(PROBE_SCALE), airspeed_offset=even(PROBE_AIRSPEED),
        alpha_scale=even(PROBE_SCALE), alpha_offset=even(PROBE_ANGLE),
        beta_scale=even(PROBE_SCALE), beta_offset=even(PROBE_ANGLE), mount_roll=even(PROBE_MOUNT),
    )  # fmt: skip
    magnetic = {f"alpha_{axes}": normal(MAGNETIC_IRON) for axes in ("xy", "xz", "yz")}
    magnetic |= {f"eta_{axis}": normal(MAGNETIC_IRON) for axis in "xyz"}
    magnetic |= {f"lambda_{axis}": normal(MAGNETIC_SCALE) for axis in "xyz"}
    magnetic |= {f"n_{axis}": normal(HARD_IRON) for axis in "xyz"}
    names = (*AIR_DATA, *ANGLES)
    scale = {name: normal(OUTPUT_SCALE) for name in names}
    offset = {name: normal(OUTPUT_AIRSPEED if name == "V" else OUTPUT_ANGLE) for name in names[:-1]}
    return InstrumentTruth(probe, magnetic, OutputErrors(scale, offset))


def drawn_wind(seed: int) -> Array:
    """Wind NED (3,) of 1 to 10 m/s, the vertical part up to 1 m/s."""
    rng = generator(seed, "wind of the calibration")
    speed, direction = rng.uniform(1.0, 10.0), rng.uniform(-np.pi, np.pi)
    return np.array([speed * np.cos(direction), speed * np.sin(direction), rng.uniform(-1.0, 1.0)])


def calibration_flight(
    seed: int = 0,
    duration: float = DURATION,
    *,
    aircraft: Aircraft | None = None,
    wind: npt.ArrayLike | None = None,
    wind_walk: float = 0.0,
    turbulence: str = "none",
    sensors: SensorOptions | None = None,
    errors: InstrumentTruth | None = None,
) -> SimulatedFlight:
    """A flight with pressures and field recorded, in a wind that is steady unless it is asked otherwise.

    Errors and wind are drawn from the seed if not given. ``calibration`` of the result is the truth.
    """
    errors = errors or drawn_errors(seed)
    options = replace(
        sensors or SensorOptions(), five_hole_probe=True, magnetometer=True, probe=errors.probe,
        magnetic=errors.magnetic_errors, outputs=errors.outputs,
    )  # fmt: skip
    flight = simulate_samples(
        aircraft or load_aircraft(config_path(CALIBRATION_AIRCRAFT)), seed, duration,
        wind=drawn_wind(seed) if wind is None else wind, wind_walk=wind_walk, turbulence=turbulence,
        manoeuvres=CALIBRATION, sensors=options, rate=HIDDEN_RATE,
    )  # fmt: skip
    return replace(flight, calibration=errors.document())
