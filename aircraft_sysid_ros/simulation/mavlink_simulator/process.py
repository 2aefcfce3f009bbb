"""The MAVLink simulator as a process of its own: flies in real time and speaks MAVLink over UDP.

    python -m aircraft_sysid_ros.simulation.mavlink_simulator.process --connect udpout:127.0.0.1:14550

The simulator flies one second ahead of what is sent, so that a sensor's second of samples can be worked out at once.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml

from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict, load_aircraft
from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.mavlink.servo_mapping import load_servo_mapping
from aircraft_sysid_ros.mavlink.transport import Transport, parse_address
from aircraft_sysid_ros.recordings.writer import RecordingWriter
from aircraft_sysid_ros.sensors.truth import Truth
from aircraft_sysid_ros.simulation.jsbsim_flight import (
    DEFAULT_MODEL,
    MODELS,
    RATE,
    fly_jsbsim,
    jsbsim_aircraft_file,
    log_row,
    prepare_jsbsim,
    truth_of_log,
)
from aircraft_sysid_ros.simulation.mavlink_simulator.autopilot import Faults, MavlinkSimulator
from aircraft_sysid_ros.simulation.mavlink_simulator.sensors import Event, FlightSensors, pieces, write_direct
from aircraft_sysid_ros.simulation.simulated_flight import DEFAULT_WIND, simulate_samples
from aircraft_sysid_ros.text_file import write_whole

DEFAULT_CALIBRATION = "mavlink_simulator_servos.yaml"
#: Largest [s] time since start: MAVLink has 32 bits of milliseconds, 49 days.
MOST_OFFSET = 4e6
AHEAD = 1.0  # [s] by which the simulator is ahead
_LOOK = 0.002  # [s] between looks at the link


class Radio:
    """Sends what has become due, hears what comes, until a time of flight; keeps all samples for ``--record``."""

    def __init__(self, simulator: MavlinkSimulator, transport: Transport, reboots: Sequence[float]) -> None:
        self.simulator, self.transport = simulator, transport
        self._reboots = deque(sorted(reboots))
        self._waiting: deque[Event] = deque()
        self._flown = 0.0  # [s] to where the flight is known
        self.events: list[Event] = []
        self.started = time.monotonic()
        self.wall_start = time.time_ns()

    def begin(self) -> None:
        """Time 0 of the flight is now."""
        self.started, self.wall_start = time.monotonic(), time.time_ns()
        self.simulator.unix_start = self.wall_start

    def add(self, events: Sequence[Event], flown: float) -> None:
        """Samples to be sent when their time comes; to where the flight is known with them [s]."""
        self._flown = flown
        self._waiting.extend(events)
        self.events.extend(events)

    def run_until(self, flight_time: float) -> None:
        """Serve the link until the clock shows a time of flight [s]; at least once."""
        while True:
            now = time.monotonic() - self.started
            self._serve(now)
            if now >= flight_time:
                return
            data = self.transport.read(min(_LOOK, flight_time - now))
            if data:
                self.simulator.receive(data, time.monotonic() - self.started)

    def _serve(self, now: float) -> None:
        while self._reboots and self._reboots[0] <= now:
            self._reboots.popleft()
            self.simulator.reboot(now)
        while self._waiting and self._waiting[0].time <= now:
            self.simulator.sense(self._waiting.popleft())
        self.simulator.tick(min(now, self._flown))  # a busy machine is late with all of it, as an autopilot would be
        for packet in self.simulator.packets():
            self.transport.write(packet)


def send_flight(truth: Truth, duration: float, sensors: FlightSensors, radio: Radio) -> None:
    """A flight of the project's own simulator, which flies in no time, sent in real time."""
    radio.begin()
    for piece in pieces(truth):
        radio.run_until(max(float(piece.time[0]) - AHEAD, 0.0))
        radio.add(sensors.events(piece), float(piece.time[-1]))
    radio.run_until(duration)


def fly_jsbsim_live(name: str, duration: float, sensors: FlightSensors, radio: Radio) -> None:
    """JSBSim step by step at the pace of the clock, with the autopilot and the plan of its test flight."""
    setup = prepare_jsbsim(name)
    count = round(duration * RATE) + 1
    wind = np.tile(np.array(DEFAULT_WIND), (count, 1))
    fly_jsbsim(setup, wind, adjust=paced(setup.aircraft, sensors, radio))
    radio.run_until(duration)


def paced(
    aircraft: Aircraft, sensors: FlightSensors, radio: Radio
) -> Callable[[Any, int, npt.NDArray[np.float64]], npt.NDArray[np.float64]]:
    """What JSBSim calls before every step: waits for the clock, and makes samples of every whole second."""
    rows: list[npt.NDArray[np.float64]] = []
    each = round(RATE)

    def adjust(executive: Any, i: int, commands: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        if i == 0:
            radio.begin()
        rows.append(log_row(executive))
        if i and i % each == 0:
            radio.add(sensors.events(_piece(aircraft, rows[-each - 1 :], i)), i / RATE)
            del rows[:-1]
        if i % 4 == 0:
            radio.run_until(i / RATE - AHEAD)
        return commands

    return adjust


def _piece(aircraft: Aircraft, rows: list[npt.NDArray[np.float64]], last: int) -> Truth:
    times = (last - len(rows) + 1 + np.arange(len(rows))) / RATE
    return truth_of_log(aircraft, times, np.array(rows))


def parser() -> argparse.ArgumentParser:
    """Options of the process."""
    options = argparse.ArgumentParser(
        prog="mavlink_simulator", description="A simulated autopilot that speaks MAVLink as ArduPlane does."
    )
    add = options.add_argument
    add("--connect", default="udpout:127.0.0.1:14550", metavar="CONNECTION", help="default: udpout:127.0.0.1:14550")
    add("--simulator", choices=("jsbsim", "textbook"), default="jsbsim")
    add("--jsbsim-aircraft", choices=tuple(MODELS), default=DEFAULT_MODEL)
    add("--aircraft", metavar="FILE", help=f"aircraft file of the textbook simulator (default: {DEFAULT_AIRCRAFT})")
    add("--calibration", metavar="FILE", help=f"default: {DEFAULT_CALIBRATION}")
    add("--duration", type=float, default=120.0, metavar="S")
    add("--seed", type=int, default=0)
    add("--no-vanes", action="store_true", help="no angle of attack and sideslip, as on most aircraft")
    add("--clock-offset", type=float, default=100.0, metavar="S", help="time since start when the flight begins")
    add("--drift", type=float, default=0.0, metavar="PPM", help="by which the autopilot's clock runs faster")
    add("--loss", type=float, default=0.0, metavar="SHARE", help="of packets, either way: 0 to 0.9")
    add("--reboot", type=float, nargs="+", default=[], metavar="S", help="times of flight at which it restarts")
    add("--record", metavar="BAG", help="the samples themselves as a recording, to compare with")
    add("--overwrite", action="store_true", help="replace a recording that is there")
    add("--write-aircraft", metavar="FILE", help="write the aircraft file of the aeroplane there")
    return options


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly; returns the exit status."""
    args = parser().parse_args(arguments)
    try:
        fly(args)
    except InputError as error:
        print(f"mavlink_simulator: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return 0


def fly(args: argparse.Namespace) -> None:
    """One flight; raises InputError for bad options, before anything is written."""
    _check(args)
    recording = RecordingWriter(args.record, overwrite=args.overwrite) if args.record else None
    mapping = load_servo_mapping(args.calibration or config_path(DEFAULT_CALIBRATION))
    faults = Faults(args.clock_offset, 1e-6 * args.drift, args.loss)
    flown: Truth | None = None
    if args.simulator == "jsbsim":
        aircraft = aircraft_from_dict(jsbsim_aircraft_file(args.jsbsim_aircraft))
    else:
        aircraft = load_aircraft(args.aircraft or config_path(DEFAULT_AIRCRAFT))
        flown = simulate_samples(aircraft, seed=args.seed, duration=args.duration).truth
    transport = Transport(parse_address(args.connect))
    transport.open()
    sensors = FlightSensors(aircraft, args.seed, vanes=not args.no_vanes)
    radio = Radio(MavlinkSimulator(mapping, faults, args.seed), transport, args.reboot)
    try:
        _write_files(args, aircraft)
        print(f"{aircraft.name} speaks MAVLink on {args.connect}", file=sys.stderr, flush=True)
        if late := [name for name, sensor in aircraft.sensors.items() if sensor.delay != 0.0]:
            words = f"take the delay of {', '.join(late)} out of the file for the estimators"
            print(f"sensors have no delay here: {words}", file=sys.stderr, flush=True)
        if flown is None:
            fly_jsbsim_live(args.jsbsim_aircraft, args.duration, sensors, radio)
        else:
            send_flight(flown, args.duration, sensors, radio)
    finally:
        transport.close()
        sent = [event for event in radio.events if event.time <= args.duration]
        if recording is not None and sent:  # also what was flown before Ctrl-C
            with recording:
                write_direct(sent, radio.wall_start, recording)


def _check(args: argparse.Namespace) -> None:
    """Numbers that would otherwise fail in flight."""
    if not (0.0 <= args.loss <= 0.9 and 5.0 <= args.duration <= 36000.0 and abs(args.drift) <= 500.0):
        raise InputError("--loss is from 0 to 0.9, --duration from 5 to 36000 s, --drift at most 500 ppm")
    if args.aircraft and args.simulator != "textbook":
        raise InputError("--aircraft is for --simulator textbook: JSBSim flies its own (--jsbsim-aircraft)")
    if args.seed < 0:
        raise InputError(f"--seed must not be negative, not {args.seed}")
    if not 0.0 <= args.clock_offset <= MOST_OFFSET:
        raise InputError(f"--clock-offset must be from 0 to {MOST_OFFSET:.0f} s, not {args.clock_offset:g}")
    for time_of_flight in args.reboot:
        if not 0.0 <= time_of_flight <= args.duration:
            raise InputError(
                f"--reboot must be from 0 to the --duration of {args.duration:g} s, not {time_of_flight:g}"
            )


def _write_files(args: argparse.Namespace, aircraft: Aircraft) -> None:
    """The aircraft file, and the folder of the recording: what cannot be written is said before the flight."""
    try:
        if args.record:
            Path(args.record).parent.mkdir(parents=True, exist_ok=True)
        if args.write_aircraft:
            text = yaml.safe_dump(aircraft.source, sort_keys=False)
            write_whole(Path(args.write_aircraft), text)
    except OSError as error:
        raise InputError(f"cannot write {error.filename}: {error.strerror}") from None


if __name__ == "__main__":
    sys.exit(main())
