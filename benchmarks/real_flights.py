"""The chain on real flights against what is known of them: results and figures for docs/.

    python benchmarks/real_flights.py [--data ../shared/data]

Thor flight 75 (University of Minnesota): wind triangle, onboard filter and the lab's own aerodynamic model
are references, not truth. It is also played through the live nodes. InertialNav: innovations with the stated sensor
delays and without.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.configuration import Aircraft, load_aircraft
from aircraft_sysid_ros.aircraft.frames import euler_from_quaternion
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.recordings.mat_import import import_mat
from aircraft_sysid_ros.recordings.reader import Recording, read_recording

Array = npt.NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[1]
#: NOTES of the data set: wind triangle with the onboard angles, mean NED [m/s].
THOR_WIND = np.array([-0.6, 6.5, -0.8])
THOR_AIRBORNE = (211.0, 579.0)  # [s]
#: The lab's simulation model, wind axes, per rad, rates q c/2V: here in our axes and with q c/V.
THOR_MODEL = {
    "CZ_alpha": -4.58, "CZ_q": -3.08, "CZ_de": -0.0983, "CY_beta": -0.4889, "CY_p": -0.0375, "CY_r": 0.15,
    "CY_dr": 0.1913, "Cl_beta": -0.0545, "Cl_p": -0.4496, "Cl_r": 0.1086, "Cl_da": -0.1646,
    "Cm_alpha": -0.723, "Cm_q": -6.785, "Cm_de": -0.8488, "Cn_beta": 0.0723, "Cn_p": 0.118,
    "Cn_r": -0.1833, "Cn_da": 0.0574, "Cn_dr": -0.1811,
}  # fmt: skip


def replayed(aircraft: Aircraft, recording: Recording) -> tuple[Pipeline, Array, Array]:
    """Pipeline, rows of StateField and of CoefficientSample."""
    pipeline = Pipeline(aircraft)
    parts = [pipeline.push(recording.samples[i : i + 5000]) for i in range(0, len(recording.samples), 5000)]
    parts.append(pipeline.flush())
    return pipeline, np.vstack([rows for rows, _ in parts]), np.vstack([points for _, points in parts])


def imported(data: Path, name: str, folder: Path) -> Recording:
    """A log of the data sets as a recording."""
    import_mat(data / name, folder / Path(name).stem)
    return read_recording(folder / Path(name).stem)


def time_in_log(pipeline: Pipeline, recording: Recording, times: Array) -> Array:
    """Seconds since the start of the recording."""
    assert pipeline.state.epoch is not None
    return times + (pipeline.state.epoch - recording.start) * 1e-9


def thor(data: Path, folder: Path) -> tuple[dict[str, Any], dict[str, Array]]:
    """Figures of Thor flight 75, and series for the plots."""
    import scipy.io

    recording = imported(data, "umn_thor_flight75/flight75.mat", folder)
    pipeline, rows, points = replayed(load_aircraft(config_path("umn_thor.yaml")), recording)
    log = scipy.io.loadmat(data / "umn_thor_flight75" / "flight75.mat", squeeze_me=True, struct_as_record=False)[
        "flight_data"
    ]
    time = time_in_log(pipeline, recording, rows[:, StateField.TIME])
    airborne = (time > THOR_AIRBORNE[0]) & (time < THOR_AIRBORNE[1])
    rows, time = rows[airborne], time[airborne]
    log_time = 0.02 * np.arange(len(log.p))
    euler = np.array([euler_from_quaternion(q) for q in rows[:, StateField.ATTITUDE]])
    angles = [np.unwrap(getattr(log, name)) for name in ("phi", "theta", "psi")]
    onboard = np.stack([np.interp(time, log_time, angle) for angle in angles], axis=1)
    difference = np.degrees((euler - onboard + np.pi) % (2.0 * np.pi) - np.pi)
    biases = np.array([np.interp(time, log_time, getattr(log, f"{n}_bias")).mean() for n in "pqr"])
    wind = rows[:, StateField.WIND].mean(axis=0)
    estimates = {p.name: p for p in pipeline.parameters.snapshot().parameters}
    result = {
        "wind_mean": wind.tolist(),
        "wind_reference": THOR_WIND.tolist(),
        "wind_horizontal_difference": float(np.hypot(*(wind - THOR_WIND)[:2])),
        "gyro_bias_mean": rows[:, StateField.GYRO_BIAS].mean(axis=0).tolist(),
        "gyro_bias_onboard": biases.tolist(),
        "gyro_bias_difference": np.abs(rows[:, StateField.GYRO_BIAS].mean(axis=0) - biases).tolist(),
        "attitude_rms_deg": np.sqrt(np.mean(difference**2, axis=0)).tolist(),
        "innovation_consistency": pipeline.state.innovation_consistency(),
        "parameters": [
            {
                "name": p.name,
                "value": p.value,
                "std": p.std,
                "reference": THOR_MODEL.get(p.name),
                "status": p.status.name,
                "reason": p.reason,
            }
            for p in estimates.values()
        ],
    }
    series = {"time": time, "euler": euler, "onboard": onboard, "wind": rows[:, StateField.WIND]}
    series["points_time"] = time_in_log(pipeline, recording, points[:, CoefficientSample.TIME])
    series["measured"] = points[:, CoefficientSample.MEASURED]
    series["fitted"] = fitted(pipeline, points)
    return result, series


def thor_live(folder: Path, rate: float = 8.0) -> dict[str, Any]:
    """The flight that ``thor`` imported, through replay and, on ROS 2 topics, the live nodes: the same files?"""
    recording, aircraft = folder / "flight75", str(config_path("umn_thor.yaml"))
    # at this rate half a second of flight is a sixteenth of a second of the machine's: samples may be later
    horizon = ["--horizon", "4"]
    _command("replay", recording, "--aircraft", aircraft, "--out", folder / "replayed", *horizon)
    ready = folder / "ready"
    options = ["--out", folder / "live", "--reliable", "--ready-file", ready, "--until-idle", "3", "--json", *horizon]
    live = subprocess.Popen(_words("live", "--aircraft", aircraft, *options), stdout=subprocess.PIPE, text=True)
    try:
        while not ready.exists():
            if live.poll() is not None:
                raise RuntimeError("live did not start")
            time.sleep(0.1)
        sent = _command("play", recording, "--rate", rate, "--wait", 60)
        received = json.loads(live.communicate(timeout=120.0)[0])
    finally:
        live.kill()
    names = ("parameters.json", "state.json")
    files = [[json.loads((folder / run / name).read_text()) for run in ("replayed", "live")] for name in names]
    for run in files[1]:
        for own in ("duration", "realtime_factor", "notes"):  # replay tells notes that live keeps in the run
            run.pop(own)
    heard = received["received"]
    return {
        "rate": rate,
        "horizon": 4.0,
        "messages": {topic: [count, heard.get(topic.lstrip("/"), 0)] for topic, count in sent["messages"].items()},
        "late": received["late"],
        "same": all(one == other for one, other in files),
    }


def _words(*arguments: Any) -> list[str]:
    return [sys.executable, "-m", "aircraft_sysid_ros.commands.main", *map(str, arguments)]


def _command(*arguments: Any) -> dict[str, Any]:
    done = subprocess.run([*_words(*arguments), "--json"], capture_output=True, text=True, check=True)
    said: dict[str, Any] = json.loads(done.stdout)
    return said


def fitted(pipeline: Pipeline, points: Array) -> Array:
    """Coefficients (n, 6) by the final parameters."""
    model = pipeline.parameters.model
    values = np.array([p.value for p in pipeline.parameters.snapshot().parameters])
    columns = [points[:, CoefficientSample.TERMS :][:, model.axis_slice(a)] @ values[model.axis_slice(a)] for a in AXES]
    return np.stack(columns, axis=1)


def inertialnav(data: Path, folder: Path) -> dict[str, Any]:
    """Innovation consistency of both logs, with the stated delays and without."""
    result: dict[str, Any] = {}
    for name, configuration in (
        ("SwissLog1", "inertialnav_swisslog.yaml"),
        ("TestLog2", "inertialnav_testlog2.yaml"),
    ):
        recording = imported(data, f"inertialnav/{name}.mat", folder)
        aircraft = load_aircraft(config_path(configuration))
        undelayed = {key: replace(sensor, delay=0.0) for key, sensor in aircraft.sensors.items()}
        without = replace(aircraft, sensors=undelayed)
        for label, variant in (("with delays", aircraft), ("without delays", without)):
            pipeline, rows, _ = replayed(variant, recording)
            counts = pipeline.state.counts()
            result.setdefault(name, {})[label] = {
                "innovation_consistency": pipeline.state.innovation_consistency(),
                "rejected": {kind: c["rejected"] for kind, c in counts.items() if c["rejected"]},
                "realignments": pipeline.state.realignments,
                "finite": bool(np.all(np.isfinite(rows[:, : StateField.AIRSPEED + 1]))),
                "largest_roll_deg": float(
                    np.degrees(np.abs([euler_from_quaternion(q)[0] for q in rows[:, StateField.ATTITUDE]]).max())
                ),
            }
    return result


def draw_thor(series: dict[str, Array], folder: Path) -> None:
    """Figures of Thor: attitude and wind; measured and predicted coefficients."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(4, 1, figsize=(12, 10), sharex=True, layout="constrained")
    for i, name in enumerate(("roll", "pitch", "yaw")):
        offset = 2.0 * np.pi * np.round((series["euler"][:, i] - series["onboard"][:, i]) / (2.0 * np.pi))
        axes[i].plot(series["time"], np.degrees(series["onboard"][:, i]), "k", lw=0.8, label="onboard filter")
        ours = np.degrees(series["euler"][:, i] - offset)
        axes[i].plot(series["time"], ours, color="#D55E00", lw=0.8, ls="--", label="ours")
        axes[i].set_ylabel(f"{name} [deg]")
    for i, (label, colour) in enumerate((("north", "#0072B2"), ("east", "#D55E00"), ("down", "#009E73"))):
        axes[3].plot(series["time"], series["wind"][:, i], color=colour, lw=0.8, label=label)
        axes[3].axhline(THOR_WIND[i], color=colour, ls=":", lw=1.0)
    axes[3].set_ylabel("wind [m/s], dotted: wind triangle")
    axes[3].set_xlabel("time in log [s]")
    for plot in (axes[0], axes[3]):
        plot.legend(ncols=3, fontsize=8)
    figure.savefig(folder / "thor_state.png", dpi=100)
    figure, axes = plt.subplots(6, 1, figsize=(12, 11), sharex=True, layout="constrained")
    part = (series["points_time"] > 310.0) & (series["points_time"] < 410.0)
    for i, axis in enumerate(AXES):
        time, measured, fitted = series["points_time"][part], series["measured"], series["fitted"]
        axes[i].plot(time, measured[part, i], "k", lw=0.8, label="measured")
        axes[i].plot(time, fitted[part, i], color="#D55E00", lw=0.8, label="predicted")
        axes[i].set_ylabel(f"{axis} [-]")
    axes[0].legend(ncols=2, fontsize=8)
    axes[-1].set_xlabel("time in log [s]")
    figure.savefig(folder / "thor_coefficients.png", dpi=100)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        flight, series = thor(arguments.data, Path(folder))
        flight["live"] = thor_live(Path(folder))
        result = {"thor": flight, "inertialnav": inertialnav(arguments.data, Path(folder))}
    (ROOT / "benchmarks" / "results" / "real_flights.json").write_text(
        json.dumps(result, indent=1) + "\n", encoding="utf8"
    )
    (ROOT / "docs" / "figures").mkdir(parents=True, exist_ok=True)
    draw_thor(series, ROOT / "docs" / "figures")
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
