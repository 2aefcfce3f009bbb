"""The inputs that the aircraft file names: whether they move, how fast they come, and where their range ends.

What is outside the limits of the file is left out by `replay`, and here. That an input is not recorded at all is said
by ``absence``; gaps and jitter of each are looked at by ``sampling``.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.named_inputs import NamedInput
from aircraft_sysid_ros.flight_check.finding import INFO, WARNING, Finding
from aircraft_sysid_ros.flight_check.identifiable import white_noise
from aircraft_sysid_ros.flight_check.laws.values import LEAST_RUN, held, run_lengths, saturated
from aircraft_sysid_ros.flight_check.signals import INPUTS, Flight, Stream, inside_limits
from aircraft_sysid_ros.identification.coefficients.signals import INPUT_HELD
from aircraft_sysid_ros.identification.options import ParameterOptions

Array = npt.NDArray[np.float64]

#: Share of the values outside the limits from which the unit or the limits are wrong, and not the transmission.
_MANY = 0.05
#: Fewer different values are those of a switch or of steps, which may come at regular times.
_LEVELS = 10


def findings(flight: Flight) -> list[Finding]:
    """Of every named input that the recording holds."""
    found = []
    for item in flight.inputs:
        stream = flight.input_streams.get(INPUTS + item.name)
        if stream is not None and len(stream.time):
            inside = inside_limits(stream.values[:, 0], item)
            found += _outside(item, stream, inside) + _motion(item, stream, inside)
    return found


def _outside(item: NamedInput, stream: Stream, inside: npt.NDArray[np.bool_]) -> list[Finding]:
    count, (low, high) = int(np.sum(~inside)), item.limits
    if not count:
        return []
    most = float(np.max(np.abs(stream.values[~inside, 0])))
    many = count > _MANY * len(inside)
    cause = (
        "give its unit, or wider limits, in the aircraft file"
        if many
        else "remove transmission faults, or give wider limits in the aircraft file"
    )
    return [Finding(
        (stream.name,), "unit" if many else "noise", WARNING,
        f"{count} of {len(inside)} values, up to {most:.3g}, are outside its limits, {low:.4g} to {high:.4g} in SI, "
        f"and are left out: {cause}",
    )]  # fmt: skip


def _motion(item: NamedInput, stream: Stream, inside: npt.NDArray[np.bool_]) -> list[Finding]:
    values, time = stream.values[inside, 0], stream.time[inside]
    if len(values) < 2:
        return []
    spread = float(np.std(values))
    if spread < item.noise:
        size = f"stays at {values[0]:.4g}" if not np.ptp(values) else f"moves by {spread:.2g}, less than its noise"
        return [Finding((stream.name,), "held", INFO, f"it {size}: move it, or its parameters cannot be found")]
    settle = ParameterOptions().settle
    if stream.interval > settle:
        return [Finding(
            (stream.name,), "rate", WARNING,
            f"it moves and comes at {stream.rate:.3g} Hz: each value holds for up to {INPUT_HELD:g} s and is then not "
            f"known, record it at {1.0 / settle:g} Hz or faster",
        )]  # fmt: skip
    found = held((stream.name,), stream, slice(0, 1)) if len(np.unique(values)) >= _LEVELS else []
    found += _at_limits(stream.name, values, item.limits)
    if not found and white_noise(stream, 0) > 0.0:  # what is noisy does not stand by itself
        found = saturated(stream.name, values, time)
    return found


def _at_limits(name: str, values: Array, limits: tuple[float, float]) -> list[Finding]:
    room = 1e-6 * (limits[1] - limits[0])
    at = (values <= limits[0] + room) | (values >= limits[1] - room)
    if max(run_lengths(at), default=0) < LEAST_RUN:
        return []
    return [Finding(
        (name,), "saturated", WARNING,
        f"{int(np.sum(at))} of {len(values)} values stand at its limits, {limits[0]:.4g} and {limits[1]:.4g}: what was "
        "commanded beyond them is not known, record its deflection or leave these stretches out",
    )]  # fmt: skip
