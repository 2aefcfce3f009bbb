"""Calibrations on Thor flight 75, a real five-hole probe: one half of the flight calibrates, the other judges.

What it is compared with are references and no truth: the firmware's calibration of the probe, the onboard airspeed, and
the wind triangle that both give.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft, load_aircraft
from aircraft_sysid_ros.calibration import five_hole_probe, magnetometer
from aircraft_sysid_ros.calibration.navigation import series
from aircraft_sysid_ros.calibration.procedure import Answer, solve
from aircraft_sysid_ros.calibration.report import calibrate_compatibility
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.recordings.mat_import import import_mat
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.recordings.tables import read_table
from aircraft_sysid_ros.samples import Kind, Samples, concatenate, samples_of

Array = npt.NDArray[np.float64]

#: Halves of the flight in the air [s].
HALVES = {"first": (215.0, 395.0), "second": (395.0, 575.0)}


def thor(path: Path) -> dict[str, Any]:
    """All calibrations on the flight."""
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "thor"
        import_mat(path, bag)
        samples, raw = read_recording(bag).samples, read_table(bag, "imu/mag_raw")
    aircraft = load_aircraft(config_path("umn_thor.yaml"))
    as_measured = raw.fields["magnetic_field"] * np.array([1.0, -1.0, -1.0])  # FLU to FRD
    others = samples[samples.kind != Kind.MAGNETIC_FIELD]
    magnetic = concatenate([others, samples_of(Kind.MAGNETIC_FIELD, raw.stamp, as_measured)])
    return {
        "probe": [probe(samples, aircraft, half, other) for half, other in (("first", "second"), ("second", "first"))],
        "magnetometer": [field(magnetic, aircraft, *pair) for pair in (("first", "second"), ("second", "first"))],
        "compatibility": motion(samples, aircraft),
    }


def probe(samples: Samples, aircraft: Aircraft, half: str, other: str) -> dict[str, Any]:
    """Calibrated on one half, judged on the other."""
    answer, steady = five_hole_probe.probe_flight(samples, aircraft, HALVES[half]).solve()
    judge = five_hole_probe.probe_flight(samples, aircraft, HALVES[other])
    xi, data = answer.xi, judge.data
    reference = {
        kind: np.interp(judge.grid.time, *flat(series(samples, kind, judge.navigation.epoch, 1)))
        for kind in (Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP)
    }
    alpha, beta = data.angles(xi[5:])
    speed = (1.0 + xi[0]) * data.indicated + xi[1]
    mount = five_hole_probe.mount_matrix(float(xi[9]))
    ours = triangle(data, speed, alpha, beta, mount)
    firmware = triangle(data, *reference.values(), np.eye(3))
    return {
        "calibrated_on": half,
        "parameters": told(answer),
        "steady": steady,
        "angles_deg": {
            name: spread(np.degrees(mine - reference[kind]))
            for name, mine, kind in (("alpha", alpha, Kind.ANGLE_OF_ATTACK), ("beta", beta, Kind.SIDESLIP))
        },
        "airspeed": spread(speed - reference[Kind.AIRSPEED]),
        "wind": {"calibration": xi[2:5].tolist(), "ours": ours.mean(axis=0).tolist(),
                 "firmware": firmware.mean(axis=0).tolist()},
        "wind_scatter": {"ours": ours.std(axis=0).tolist(), "firmware": firmware.std(axis=0).tolist()},
        "velocity_rms": np.sqrt(np.mean((ours - xi[2:5]) ** 2, axis=0)).tolist(),
        "noise_std": np.sqrt(answer.noise).tolist(),
        "probe_noise": judge.probe_noise,
    }  # fmt: skip


def flat(pair: tuple[Array, Array]) -> tuple[Array, Array]:
    """Times and one column of values."""
    return pair[0], pair[1][:, 0]


def triangle(data: five_hole_probe.ProbeData, speed: Array, alpha: Array, beta: Array, mount: Array) -> Array:
    """Wind NED (n, 3) of (37) of the two-stage paper."""
    flow = np.stack([np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)], axis=1)
    body = speed[:, None] * flow @ mount.T - data.arm
    return np.asarray(data.velocity - np.einsum("nij,nj->ni", data.rotation, body))


def spread(difference: Array) -> dict[str, float]:
    """Mean and scatter."""
    return {"mean": float(np.mean(difference)), "std": float(np.std(difference))}


def told(answer: Answer) -> dict[str, list[float]]:
    """Estimate and standard error of what is determined."""
    rows = zip(answer.problem.names, answer.xi, answer.std, answer.determined, strict=True)
    return {name: [float(value), float(std)] for name, value, std, there in rows if there}


def field(samples: Samples, aircraft: Aircraft, half: str, other: str) -> dict[str, Any]:
    """Spread of the field strength over its mean, uncalibrated and calibrated, on the half that judges."""
    answer = solve(magnetometer.magnetic_flight(samples, aircraft, HALVES[half]).task())
    judge = magnetometer.magnetic_flight(samples, aircraft, HALVES[other]).data.measured
    matrix = magnetometer.sensor_matrix(answer.xi[:3], answer.xi[6:])
    corrected = np.linalg.solve(matrix, (judge - answer.xi[3:6]).T).T
    strengths = [np.linalg.norm(h, axis=1) for h in (judge, corrected)]
    return {
        "calibrated_on": half,
        "parameters": told(answer),
        "spread": [float(np.std(strength) / np.mean(strength)) for strength in strengths],
    }


def motion(samples: Samples, aircraft: Aircraft) -> dict[str, Any]:
    """Compatibility of IMU and air data, on the first half."""
    report = calibrate_compatibility(samples, aircraft, HALVES["first"], samples=16)
    found = report.json()
    rows = {p["name"]: [p["value"], p["std"]] for p in report.parameters if p["determined"]}
    return {"parameters": rows, "residuals": found["residuals"], "notes": found["notes"]}
