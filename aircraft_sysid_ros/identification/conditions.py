"""In which conditions parameters were learnt, and which signals the flight has had."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AerodynamicModel
from aircraft_sysid_ros.aircraft.signals import SIGNAL_COUNT, SIGNAL_INDEX
from aircraft_sysid_ros.identification.coefficients.layout import LEARNT, SIGNALS_OF_SAMPLE, CoefficientSample
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.samples import CONTROL_COLUMNS

Array = npt.NDArray[np.float64]

_RANGED = tuple(SIGNALS_OF_SAMPLE + SIGNAL_INDEX[name] for name in ("V", "alpha", "beta"))


_TIME = CoefficientSample.TIME
#: Longest time [s] that a sample stands for.
_LONGEST_STEP = 0.2
#: Signals that stand in the samples of the controls.
CONTROL_SIGNALS = frozenset(CONTROL_COLUMNS)


def needs(names: Sequence[str]) -> str:
    """That a model reads signals which were not measured, and what to do about it, in words."""
    are, them, their = ("are", "them", "their") if len(names) > 1 else ("is", "it", "its")
    ground = ", or give ground_altitude in the aircraft file" if "height" in names else ""
    record = f"record {them}{ground}, or take {their} terms out of the model"
    return f"needs {listed(names)}, which {are} not measured: {record}"


#: What lets wind and attitude tell angles of flow that they do not tell, or makes that needless.
TELL_FLOW = "fit a vane, or fly more turns at several speeds in calmer air"


_OF_THROTTLE = "throttle/qbar, throttle/V"


def throttle_instead(terms: Mapping[str, Sequence[str]]) -> str:
    """Terms by axis that read the throttle where those of a model read a thrust, as an aircraft file says them.

    Thrust falls with speed, T = throttle (T0 - k V), and its coefficient is T / (qbar S).
    """
    reads = {axis: texts for axis, texts in terms.items() if "Tc" in texts}
    return "; ".join(
        f"{axis}: [{', '.join(_OF_THROTTLE if text == 'Tc' else text for text in texts)}]"
        for axis, texts in reads.items()
    )


def listed(names: Sequence[str]) -> str:
    """``a, b and c``."""
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


class LearntConditions:
    """Ranges of airspeed, angle of attack and sideslip that were learnt in; signals that were measured."""

    def __init__(self) -> None:
        self.ranges = np.full((len(_RANGED), 2), np.nan)  # lowest and highest
        self.seconds = np.zeros(6)  # that each axis has learnt from
        self._seen = np.zeros(SIGNAL_COUNT, np.bool_)
        self._newest = np.nan  # [s]

    def add(self, samples: Array) -> None:
        """New samples (m, …) of ``CoefficientSample``, m > 0."""
        self._newest = _follow(samples, self._newest, self.ranges, self.seconds, self._seen)

    def learn_anew(self, axis: int, samples: Array) -> None:
        """An axis has changed: of what it learnt from, these samples (m, …) are left."""
        steps, learnt = np.diff(samples[:, _TIME]), samples[1:, LEARNT + axis] > 0.0
        self.seconds[axis] = np.clip(steps, 0.0, _LONGEST_STEP)[learnt].sum()

    def signals_of(self, model: AerodynamicModel, axis: int) -> tuple[tuple[str, ...], list[str]]:
        """Signals that an axis needs, and those of them that no sample of the flight had."""
        used = model.signals_of_axes[axis]
        return used, [name for name in used if not self._seen[model.signal_names.index(name)]]


@njit(cache=True)
def _follow(samples: Array, newest: float, ranges: Array, seconds: Array, seen: npt.NDArray[np.bool_]) -> float:
    """Widen the ranges (3, 2) to the samples that any axis learnt from, count the seconds (6,) that each did, and mark
    the signals that were measured; returns the time [s] of the last sample, ``newest`` is that before.
    """
    for i in range(len(samples)):
        since = samples[i, _TIME] - newest
        newest = samples[i, _TIME]
        for k in range(len(seen)):
            seen[k] |= np.isfinite(samples[i, SIGNALS_OF_SAMPLE + k])
        learnt = False
        for axis in range(6):
            if samples[i, LEARNT + axis] > 0.0:
                learnt = True
                seconds[axis] += min(since, _LONGEST_STEP) if since > 0.0 else 0.0
        for k in range(len(_RANGED) if learnt else 0):
            value = samples[i, _RANGED[k]]
            if not ranges[k, 0] <= value and np.isfinite(value):
                ranges[k, 0] = value
            if not ranges[k, 1] >= value and np.isfinite(value):
                ranges[k, 1] = value
    return newest
