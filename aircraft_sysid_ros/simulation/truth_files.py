"""A simulated flight on disk: its recording, and the truth beside it.

``truth.json`` has the coefficients, biases and wind; ``truth.npz`` the time series. Both lie in the folder of
a rosbag2, whose readers look only at what its metadata lists, and beside a bare MCAP file.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import yaml

from aircraft_sysid_ros.aircraft.aerodynamic_model import term_label
from aircraft_sysid_ros.aircraft.expression import parse_expression
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.writer import RecordingWriter
from aircraft_sysid_ros.ros_messages.conversion import INPUTS_TOPIC, TOPICS, frame_of
from aircraft_sysid_ros.run_reader import UNREADABLE
from aircraft_sysid_ros.sensors.sensor_models import EPOCH, stamps_of
from aircraft_sysid_ros.sensors.truth import SERIES
from aircraft_sysid_ros.simulation.jsbsim_derivatives import derived_truth
from aircraft_sysid_ros.simulation.simulated_flight import SimulatedFlight
from aircraft_sysid_ros.stamps import NANOSECONDS

#: Rate [Hz] of the time series in truth.npz.
TRUTH_RATE = 50.0


def write_flight(flight: SimulatedFlight, path: str | Path, *, overwrite: bool = False) -> None:
    """Write the recording, logged as it arrives, and the truth; InputError where the path is taken."""
    with RecordingWriter(path, overwrite=overwrite) as writer:
        for stream in flight.streams:
            frame = frame_of(stream.topic)
            if stream.topic == INPUTS_TOPIC:
                names = [item.name for item in flight.aircraft.inputs]
                writer.write_inputs(
                    stream.stamp, names, stream.fields["position"], log_time=stream.arrival, frame_id=frame
                )
                continue
            topic_type = TOPICS[stream.topic]
            writer.write(stream.topic, topic_type, stream.stamp, stream.fields, log_time=stream.arrival, frame_id=frame)
        for place, content in _files(flight, path).items():
            writer.add_file(place, content)


def _files(flight: SimulatedFlight, path: str | Path) -> dict[Path, bytes]:
    """The truth, and of an aeroplane of JSBSim the aircraft file."""
    series = BytesIO()
    np.savez_compressed(series, **cast("dict[str, Any]", truth_series(flight)))
    files = {
        truth_path(path, ".json"): (json.dumps(truth_document(flight), indent=1) + "\n").encode(),
        truth_path(path, ".npz"): series.getvalue(),
    }
    if flight.simulator == "jsbsim":
        files[aircraft_path(path)] = yaml.safe_dump(flight.aircraft.source, sort_keys=False).encode()
    return files


def aircraft_path(recording: str | Path) -> Path:
    """Where the aircraft file of a recorded aeroplane of JSBSim is."""
    path = truth_path(recording, ".json")
    return path.with_name(path.name.replace("truth.json", "aircraft.yaml"))


def truth_path(recording: str | Path, suffix: str) -> Path:
    """Where the truth of a recording is: ``truth.json`` in a folder, ``NAME.truth.json`` beside NAME.mcap."""
    recording = Path(recording)
    if recording.suffix == ".mcap":
        return recording.with_suffix(".truth" + suffix)
    return recording / ("truth" + suffix)


def load_truth(recording: str | Path) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
    """Content of truth.json and arrays of truth.npz of a recording; InputError when it has none."""
    try:
        document = json.loads(truth_path(recording, ".json").read_text(encoding="utf8"))
        with np.load(truth_path(recording, ".npz"), allow_pickle=False) as archive:
            return document, {name: archive[name] for name in archive.files}
    except UNREADABLE as error:
        raise InputError(f"{recording} has no truth beside it: it is not a simulated flight ({error})") from None


def truth_document(flight: SimulatedFlight) -> dict[str, Any]:
    """truth.json: biases (FRD) and wind (NED) at the end of the flight, and at its start or on average.

    A JSBSim aeroplane has no coefficients; ``derived_coefficients`` are what its forces say they are.
    """
    truth, biases = flight.truth, flight.biases
    return {
        "aircraft": flight.aircraft.name,
        "simulator": flight.simulator,
        "seed": flight.seed,
        "duration": float(truth.time[-1] - truth.time[0]),
        "model": flight.aircraft.model.identifier,
        "coefficients": flight.aircraft.coefficients if flight.simulator == "textbook" else None,
        "derived_coefficients": _derived(flight),
        "effects": [{"axis": e.axis, "expression": e.expression, "value": e.value} for e in flight.effects],
        "hidden": [effect.document() for effect in flight.hidden],
        "manoeuvres": flight.manoeuvres,
        "calibration": flight.calibration,
        "accelerometer_bias": biases.accelerometer[-1].tolist(),
        "gyro_bias": biases.gyro[-1].tolist(),
        "accelerometer_bias_start": biases.accelerometer[0].tolist(),
        "gyro_bias_start": biases.gyro[0].tolist(),
        "wind_ned": truth.wind[-1].tolist(),
        "wind_ned_mean": truth.wind.mean(axis=0).tolist(),
        "origin": {"latitude": truth.origin[0], "longitude": truth.origin[1], "altitude": truth.origin[2]},
    }


def _derived(flight: SimulatedFlight) -> dict[str, Any] | None:
    if flight.simulator != "jsbsim":
        return None
    name = flight.aircraft.name.removeprefix("JSBSim ")
    return derived_truth(name, flight.aircraft, flight.truth)


def truth_series(flight: SimulatedFlight) -> dict[str, npt.NDArray[Any]]:
    """Arrays of truth.npz: fields of Truth, biases, ``stamp`` [ns], ``time`` [s] since the first stamp."""
    first = min(stream.stamp[0] for stream in flight.streams)
    begin = (first - EPOCH) / NANOSECONDS
    time = begin + np.arange(int((flight.truth.time[-1] - begin) * TRUTH_RATE) + 1) / TRUTH_RATE
    truth, stamp = flight.truth.at(time), stamps_of(time)
    series = {name: getattr(truth, name) for name in SERIES}
    for name in ("accelerometer", "gyro"):
        values = getattr(flight.biases, name)
        columns = [np.interp(stamp, flight.biases.stamp, column) for column in values.T]
        series[name + "_bias"] = np.stack(columns, axis=1)
    return {**series, "stamp": stamp, "time": time - begin, "origin": truth.origin}


def true_values(truth: Mapping[str, Any]) -> dict[str, float]:
    """True parameters by name from truth.json: those of the model, terms that were asked for, and what was hidden."""
    values = dict(truth["coefficients"])
    for term in (*truth.get("effects", ()), *(term for effect in truth["hidden"] for term in effect["terms"])):
        name = f"{term['axis']}_{term_label(parse_expression(term['expression']).text)}"
        values[name] = values.get(name, 0.0) + term["value"]
    return values
