"""The aircraft of (6.1)-(6.25) in docs/references.md as a dynamic system: what its vectors hold.

State, 16 numbers: velocity over ground and position NED of the centre of gravity, quaternion body to NED, angular
rates p q r, wind NED:

    v' = C f + g e_D,   p' = v,   q' = q (x) (0, omega) / 2,
    I omega' = M - omega x I omega + w_r  (6.19),   W' = w_W,

with specific force f and moment M of (6.8)-(6.15) at the air-relative velocity u = C' (v - W). (6.16)-(6.18) hold
for the air-relative u, v, w only while the wind is steady; the velocity over ground as state holds for any wind,
and the gusts are a random walk of W. X of (6.14) and (6.16), called aerodynamic there, holds the thrust too, since
T_c is among the terms of C_X: it is the whole force without gravity. Attitude errors are rotation vectors in body
axes, C = C_hat exp([delta x]), so that the error of the state has 15 numbers.

Parameters theta: the aerodynamic coefficients in the order of AerodynamicModel.parameter_names; six IMU biases
(6.4), (6.5); the logarithms of three levels of process noise and of eight factors on the standard deviations
FlightModel.output_std. A level of -inf is no noise at all.

Outputs, the 18 of (6.3): specific force at the IMU, angular rate, position and velocity of the GPS antenna,
attitude, and V, alpha, beta at the probe. Attitude is the rotation vector, in NED axes, from a reference attitude
that is given with the inputs: three numbers without a singular point, of which the last is an error of heading.
An output that is not measured is NaN.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.signals import MOST_INPUTS
from aircraft_sysid_ros.errors import InputError

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Vector = tuple[float, float, float]

# Nominal state, 16 numbers.
VELOCITY = slice(0, 3)
POSITION = slice(3, 6)
ATTITUDE = slice(6, 10)
RATES = slice(10, 13)
WIND = slice(13, 16)
STATE_SIZE = 16

# Its error, 15 numbers; first index of each block.
D_VELOCITY, D_POSITION, D_ATTITUDE, D_RATES, D_WIND = 0, 3, 6, 9, 12
ERROR_SIZE = 15

# Inputs at one time: controls as in Kind.CONTROLS with the signs of the aircraft file applied, density [kg/m^3],
# height above ground [m], speed of sound [m/s], time of flight [s], reference attitude (quaternion body to NED), named
# inputs of the aircraft. Behind them, where it is known, controls and named inputs in the middle of the step that ends
# at this time: servos move by more than a straight line tells. A row may end before; then they are linear within it.
CONTROLS = slice(0, 7)
DENSITY, HEIGHT, SPEED_OF_SOUND, TIME = 7, 8, 9, 10
REFERENCE = slice(11, 15)
NAMED = slice(15, 15 + MOST_INPUTS)
INPUT_SIZE = NAMED.stop
CONTROL_COUNT = 7
MIDDLE_SIZE = CONTROL_COUNT + MOST_INPUTS

# Outputs; first index of each block.
FORCE, GYRO, GPS_POSITION, GPS_VELOCITY, ATTITUDE_VECTOR = 0, 3, 6, 9, 12
AIRSPEED, ALPHA, BETA = 15, 16, 17
OUTPUT_SIZE = 18
OUTPUT_NAMES = (
    "Ax", "Ay", "Az", "p", "q", "r", "position north", "position east", "position down",
    "velocity north", "velocity east", "velocity down", "tilt north", "tilt east", "heading", "V", "alpha", "beta",
)  # fmt: skip
#: Noise levels that outputs share.
OUTPUT_GROUPS = (
    "specific_force", "angular_rate", "position", "velocity", "attitude", "airspeed", "angle_of_attack", "sideslip",
)  # fmt: skip
GROUP_OF_OUTPUT: Integers = np.array([0] * 3 + [1] * 3 + [2] * 3 + [3] * 3 + [4] * 3 + [5, 6, 7], dtype=np.int64)
#: Levels of process noise: random walk of the wind [m/s per sqrt(s)], of the rates [rad/s per sqrt(s)].
PROCESS_GROUPS = ("gusts_horizontal", "gusts_vertical", "rates")
BIAS_NAMES = tuple(f"{sensor}_bias_{axis}" for sensor in ("accelerometer", "gyro") for axis in "xyz")

# Behind the aerodynamic coefficients, counted from the end of theta.
TAIL = len(BIAS_NAMES) + len(PROCESS_GROUPS) + len(OUTPUT_GROUPS)
_BIAS, _PROCESS, _OUTPUT = 0, len(BIAS_NAMES), len(BIAS_NAMES) + len(PROCESS_GROUPS)


class FlightModel(NamedTuple):
    """What the jitted functions need of an aeroplane; SI, positions FRD from the centre of gravity.

    Few arrays: every one costs a reference count at every call.
    """

    mass: float
    inertia: tuple[float, float, float, float]  # xx, yy, zz, xz of (6.19)
    geometry: Vector  # wing area, span, chord
    gravity: float
    reference: Vector  # aerodynamic reference point
    imu: Vector
    gps: Vector
    probe: Vector
    code: Array  # linked terms of the model
    code_offsets: Integers  # (terms + 1,)
    axis_offsets: Integers  # (7,)
    has_flow_rates: bool  # a term reads alpha_dot or beta_dot
    output_std: Array  # (18,) standard deviations that the output levels multiply


def flight_model_of(aircraft: Aircraft, gravity: float, imu_samples_per_step: int = 1) -> FlightModel:
    """Model of an aircraft file at a place with ``gravity`` [m/s^2].

    ``imu_samples_per_step`` IMU samples are averaged into one output; their noise falls by its root. Raises InputError
    for a model with lags, whose states it does not have.
    """
    if aircraft.model.lags:
        raise InputError(
            f"'{aircraft.model.lags[0].text}' is a state that the equations of motion here do not have: "
            "remove the term, or stay with least squares"
        )
    code, code_offsets = aircraft.model.linked
    inertia = aircraft.inertia
    return FlightModel(
        mass=float(aircraft.mass),
        inertia=(float(inertia[0, 0]), float(inertia[1, 1]), float(inertia[2, 2]), float(-inertia[0, 2])),
        geometry=(float(aircraft.wing_area), float(aircraft.span), float(aircraft.chord)),
        gravity=float(gravity),
        reference=_vector(aircraft.aerodynamic_reference),
        imu=_vector(aircraft.imu_position),
        gps=_vector(aircraft.gps_position),
        probe=_vector(aircraft.air_data_position),
        code=code,
        code_offsets=code_offsets,
        axis_offsets=aircraft.model.offsets,
        has_flow_rates=bool({"alpha_dot", "beta_dot"} & aircraft.model.signals_used),
        output_std=_output_std(aircraft, imu_samples_per_step),
    )


def _vector(values: Array) -> Vector:
    return float(values[0]), float(values[1]), float(values[2])


def _output_std(aircraft: Aircraft, imu_samples_per_step: int) -> Array:
    noise = {name: sensor.noise_of_true for name, sensor in aircraft.sensors.items()}
    imu = np.sqrt(imu_samples_per_step)
    return np.concatenate(
        [
            np.full(3, noise["accelerometer"][0] / imu),
            np.full(3, noise["gyro"][0] / imu),
            noise["gps_position"],
            noise["gps_velocity"],
            np.full(3, noise["attitude"][0]),
            [noise["airspeed"][0], noise["angle_of_attack"][0], noise["sideslip"][0]],
        ]
    )


def parameter_count(model: FlightModel) -> int:
    """Length of theta."""
    return len(model.code_offsets) - 1 + TAIL


def aerodynamic_slice(model: FlightModel) -> slice:
    """Where the aerodynamic coefficients stand in theta."""
    return slice(0, len(model.code_offsets) - 1)


def bias_slice(model: FlightModel) -> slice:
    """Where the biases of accelerometer [m/s^2] and gyro [rad/s] stand in theta."""
    first = len(model.code_offsets) - 1
    return slice(first + _BIAS, first + _PROCESS)


def process_slice(model: FlightModel) -> slice:
    """Where the logarithms of the levels of PROCESS_GROUPS stand in theta."""
    first = len(model.code_offsets) - 1
    return slice(first + _PROCESS, first + _OUTPUT)


def output_slice(model: FlightModel) -> slice:
    """Where the logarithms of the factors of OUTPUT_GROUPS stand in theta."""
    first = len(model.code_offsets) - 1
    return slice(first + _OUTPUT, first + TAIL)


def make_theta(
    model: FlightModel,
    coefficients: Array,
    biases: Array | None = None,
    process: tuple[float, float, float] = (0.0, 0.0, 0.0),
    output_factors: Array | None = None,
) -> Array:
    """theta from coefficients, biases (6,), levels of process noise (3,), factors on output_std (8,).

    Without biases they are 0, without factors these are 1; a level of 0 is stored as -inf.
    """
    theta = np.zeros(parameter_count(model))
    theta[aerodynamic_slice(model)] = coefficients
    if biases is not None:
        theta[bias_slice(model)] = biases
    with np.errstate(divide="ignore"):
        theta[process_slice(model)] = np.log(np.asarray(process, dtype=np.float64))
    if output_factors is not None:
        theta[output_slice(model)] = np.log(output_factors)
    return theta
