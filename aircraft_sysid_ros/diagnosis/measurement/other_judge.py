"""Whether a filter that has all constant errors of the air data as states finds the one that a setting is, too."""

from __future__ import annotations

from aircraft_sysid_ros.diagnosis.flight.constant_errors import NAMES, air_data_errors, is_told, offset_of, scale_of
from aircraft_sysid_ros.diagnosis.flight.reconstruction import AIR_DATA, Reconstruction
from aircraft_sysid_ros.diagnosis.measurement.setting import Setting

#: Share of an error that the other judge must find: where one was there it found 0.9 to 1.1 in twelve flights of two
#: makers (five errors, calm and gusty), and -0.2 and 0.02 of two that were not there.
_SHARE = 0.5
#: Share of the doubt before the flight from which on it has no word: straight flight tells of no scale.
_UNTOLD = 0.5


def is_found_by_states(setting: Setting, flight: Reconstruction) -> bool:
    """Whether the filter finds at least half of a scale or an offset, of a flight that has been reconstructed without.

    True of other settings, and where it cannot say: of a flight in pieces, and of what the flight has not told it.
    """
    if not setting.feigns_wind or setting.variant.setting[-1] == "drift":
        return True
    sensor, quantity = setting.variant.setting[1:]
    known = air_data_errors(flight.aircraft, flight.samples)
    name = f"{'lambda' if quantity == 'scale' else 'b'}_{NAMES[AIR_DATA[sensor]]}"
    if not known or not is_told(known, name, _UNTOLD):
        return True
    if quantity == "scale":
        here = setting.value / setting.nominal - 1.0
        there = scale_of(known, flight.samples, AIR_DATA[sensor]) - 1.0
    else:
        here, there = setting.value - setting.nominal, -offset_of(known, flight.samples, AIR_DATA[sensor]).value
    return there * here >= _SHARE * here**2
