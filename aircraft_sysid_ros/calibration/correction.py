"""Samples with the errors of their sensors taken out: the same code for replay and for the live nodes.

Every sample is corrected by itself with scalar arithmetic in compiled code, so that one live sample and a thousand in
replay give the same bits. Equation numbers are those of the two-stage paper, docs/references.md.

With a calibrated five-hole probe its airspeed, angle of attack and sideslip take the place of those of air_data, at the
probe and in body axes; the first step knows where the probe is (air_data_position). Their stamps move by what the
aircraft file says that the probe is less late than the sensors whose place they take.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.atmosphere import density_at
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.frames import euler_from_quaternion, quaternion_from_euler
from aircraft_sysid_ros.calibration import compatibility, five_hole_probe
from aircraft_sysid_ros.calibration.calibration_file import Calibration, magnetic_matrix
from aircraft_sysid_ros.calibration.probe_models import CURVE
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction.filter_setup import stamp_delays
from aircraft_sysid_ros.samples import WIDTH, Kind, Samples

Array = npt.NDArray[np.float64]

#: What a sample of pressures becomes.
_OF_PROBE = (Kind.AIR, Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP)
_AIR_DATA = (Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP)


class Correction:
    """Takes out of samples what a calibration says is wrong with their sensors; ``aircraft``: whose delays these have.

    Without it no sensor is late.
    """

    def __init__(self, calibration: Calibration, aircraft: Aircraft | None = None) -> None:
        self.calibration = calibration
        delays = np.zeros(len(Kind), np.int64) if aircraft is None else stamp_delays(aircraft)
        self._later = delays - delays[Kind.FIVE_HOLE]  # [ns] by kind of what comes of the probe
        probe, outputs = calibration.five_hole_probe, calibration.compatibility
        self.uses_probe = bool(probe)
        names = (*five_hole_probe.NAMES1[:2], *five_hole_probe.NAMES2, "alpha_sensitivity", "beta_sensitivity")
        given = [probe.get(name, 0.0) for name in names]
        bend = [probe.get(name, 0.0) for name in CURVE]
        self._probe = np.array([*given, *calibration.pressure_zeros, *bend])
        self._scale = np.array([1.0 + outputs.get(f"lambda_{y}", 0.0) for y in compatibility.OUTPUT_NAMES])
        self._offset = np.array([outputs.get(f"b_{y}", 0.0) for y in compatibility.OUTPUT_NAMES])
        self._biases = np.array([outputs.get(name, 0.0) for name in compatibility.NAMES2])
        magnetic = calibration.magnetometer
        self._iron = np.array([magnetic.get(f"n_{axis}", 0.0) for axis in "xyz"])
        self._to_field = np.linalg.solve(magnetic_matrix(magnetic), np.eye(3)) if magnetic else np.eye(3)

    def apply(self, samples: Samples) -> Samples:
        """Corrected samples in the same order."""
        if self.uses_probe:
            samples = self._with_probe(samples)
        if self.calibration.compatibility:
            samples = self._compatible(samples)
        if self.calibration.magnetometer:
            field = samples.kind == Kind.MAGNETIC_FIELD
            if field.any():
                values = samples.values.copy()
                values[field] = magnetic_fields(values[field], self._to_field, self._iron)
                samples = Samples(samples.stamp, samples.kind, values)
        return samples

    def warm_up(self) -> None:
        """Compile before the first sample."""
        nothing = np.full((1, WIDTH), np.nan)
        flow_of_pressures(nothing, self._probe)
        magnetic_fields(nothing, self._to_field, self._iron)
        attitudes(nothing, self._scale, self._offset)

    def _with_probe(self, samples: Samples) -> Samples:
        pressures = samples.kind == Kind.FIVE_HOLE
        replaced = np.isin(samples.kind, _AIR_DATA)
        count = np.where(pressures, len(_OF_PROBE), np.where(replaced, 0, 1))
        rows = np.repeat(np.arange(len(samples)), count)
        stamp, kind, values = samples.stamp[rows], samples.kind[rows], samples.values[rows]
        of_probe = kind == Kind.FIVE_HOLE
        flow = flow_of_pressures(samples.values[pressures], self._probe)
        values[of_probe] = np.nan
        places = np.flatnonzero(of_probe).reshape(-1, len(_OF_PROBE))
        kind[places] = _OF_PROBE
        stamp[of_probe] += self._later[kind[of_probe]]
        values[places[:, 0], 1] = samples.values[pressures, 0]
        values[places[:, 1:], 0] = flow
        told = np.ones(len(kind), dtype=bool)
        told[places[:, 1:]] = np.isfinite(flow)
        return Samples(stamp[told], kind[told], values[told])

    def _compatible(self, samples: Samples) -> Samples:
        values = samples.values.copy()
        values[samples.kind == Kind.IMU, :6] -= self._biases
        for number, kind in enumerate(_AIR_DATA):
            rows = samples.kind == kind
            values[rows, 0] = (values[rows, 0] - self._offset[number]) / self._scale[number]
        angles = samples.kind == Kind.ATTITUDE
        if angles.any():
            values[angles] = attitudes(values[angles], self._scale, self._offset)
        return Samples(samples.stamp, samples.kind, values)


@njit(cache=True)
def flow_of_pressures(pressures: Array, probe: Array) -> Array:
    """V [m/s], alpha, beta [rad] (n, 3) in body axes from static, dynamic, alpha, beta pressure (n, WIDTH): (36), (37).

    probe (14,): lambda_V, b_V, lambda_alpha, b_alpha, lambda_beta, b_beta, eps_phi, K_alpha, K_beta, three zeros, and
    kappa_alpha, kappa_beta of a curve that bends.
    NaN without static pressure; angles also without flow, where the law of (36) is beyond 90 deg.
    """
    out = np.full((len(pressures), 3), np.nan)
    c, s = np.cos(probe[6]), np.sin(probe[6])
    for i in range(len(pressures)):
        static, impact = pressures[i, 0], pressures[i, 1] - probe[9]
        if not (static > 0.0 and np.isfinite(impact)):
            continue
        density = density_at(static)
        speed = (1.0 + probe[0]) * np.sqrt(2.0 * max(impact, 0.0) / density) + probe[1]
        out[i, 0] = max(speed, 0.0)
        if not impact > 0.0:
            continue
        of_alpha = (pressures[i, 2] - probe[10]) / (probe[7] * impact)
        of_beta = (pressures[i, 3] - probe[11]) / (probe[8] * impact)
        alpha = (1.0 + probe[2]) * (of_alpha + probe[12] * of_alpha**3) + probe[3]
        beta = (1.0 + probe[4]) * (of_beta + probe[13] * of_beta**3) + probe[5]
        if abs(alpha) < 0.5 * np.pi and abs(beta) < 0.5 * np.pi:
            u, v, w = np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)
            across, down = c * v + s * w, c * w - s * v
            out[i, 1], out[i, 2] = np.arctan2(down, u), np.arctan2(across, np.sqrt(u * u + down * down))
    return out


@njit(cache=True)
def magnetic_fields(values: Array, to_field: Array, iron: Array) -> Array:
    """Values (n, WIDTH) whose first three are the true field: C^-1 (h^m - n) of (B1)."""
    out = values.copy()
    for i in range(len(values)):
        for j in range(3):
            total = 0.0
            for k in range(3):
                total += to_field[j, k] * (values[i, k] - iron[k])
            out[i, j] = total
    return out


@njit(cache=True)
def attitudes(values: Array, scale: Array, offset: Array) -> Array:
    """Values (n, WIDTH) whose first four are the quaternion without the errors of roll, pitch and yaw of (B6).

    NaN where roll or yaw, with a scale above 1, may have gone beyond half a turn and then is of two true angles.
    """
    out = values.copy()
    for i in range(len(values)):
        angles = euler_from_quaternion(values[i, :4].copy())
        unclear = False
        for j in range(3):
            angles[j] -= offset[3 + j]
            if j != 1:
                angles[j] = (angles[j] + np.pi) % (2.0 * np.pi) - np.pi
                unclear = unclear or abs(angles[j]) > np.pi * (2.0 - max(scale[3 + j], 1.0))
            angles[j] /= scale[3 + j]
        out[i, :4] = quaternion_from_euler(angles[0], angles[1], angles[2])
        if unclear:
            out[i, :4] = np.nan
    return out
