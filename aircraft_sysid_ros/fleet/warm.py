"""What every flight needs, loaded when this is imported: once per worker, before the process of a flight is forked."""

from __future__ import annotations

from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.state_estimator import warm_up
from aircraft_sysid_ros.recordings.message_types import known_types

_AIRCRAFT = load_aircraft(config_path(DEFAULT_AIRCRAFT))
Pipeline(_AIRCRAFT).warm_up()
warm_up(_AIRCRAFT, smoother=True)
known_types()
