"""The targets by name: the ending of their files, the versions that are known, and who writes them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.export import ardupilot_sitl, gazebo, jsbsim, px4
from aircraft_sysid_ros.export.exported import Exported
from aircraft_sysid_ros.export.learnt_model import SURFACES, LearntModel
from aircraft_sysid_ros.export.matlab import export_matlab
from aircraft_sysid_ros.export.table import export_table

Array = npt.NDArray[np.float64]
#: Deflection [rad] at full command of a surface that hardly moved.
LEAST = np.radians(1.0)
#: Model, full deflections (3,) [rad] or None, version.
Writer = Callable[[LearntModel, Array | None, str], Exported]


@dataclass(frozen=True)
class Target:
    """One target; the first version is the default."""

    suffix: str
    versions: tuple[str, ...]
    write: Writer
    is_commanded: bool = False  # its surfaces go from -1 to 1, so that it must know how far that is


def flown_deflections(learnt: LearntModel) -> Array:
    """Largest deflections (3,) [rad] of elevator, aileron and rudder that were learnt in; 0 where none was."""
    return np.array([max(map(abs, learnt.ranges.get(name, (0.0, 0.0)))) for name in SURFACES])


def reached(learnt: LearntModel) -> Array:
    """Full command (3,) [rad] of elevator, aileron and rudder as far as the flight says it: at least ``LEAST``."""
    return np.maximum(flown_deflections(learnt), LEAST)


def _commanded(write: Callable[[LearntModel, Array], Exported]) -> Writer:
    """Of a target whose surfaces have a full command: where nobody said how far they go, as far as was flown."""
    return lambda learnt, full, version: write(learnt, reached(learnt) if full is None else full)


TARGETS = {
    "jsbsim": Target(".xml", jsbsim.VERSIONS, _commanded(jsbsim.export_jsbsim), True),
    "ardupilot-sitl": Target(".json", ardupilot_sitl.VERSIONS, _commanded(ardupilot_sitl.export_ardupilot_sitl), True),
    "gazebo": Target(".sdf", gazebo.VERSIONS, _commanded(gazebo.export_gazebo), True),
    "px4": Target(".params", px4.VERSIONS, px4.export_px4),
    "matlab": Target(".mat", ("5",), lambda learnt, full, version: export_matlab(learnt)),
    "csv": Target(".csv", ("1",), lambda learnt, full, version: export_table(learnt)),
}


def version_of(name: str, asked: str | None) -> str:
    """The version that is written. Raises InputError, which lists those that are known."""
    known = TARGETS[name].versions
    if asked is not None and asked not in known:
        raise InputError(f"--target-version {asked[:40]} of {name} is not known: it is {' or '.join(known)}")
    return known[0] if asked is None else asked
