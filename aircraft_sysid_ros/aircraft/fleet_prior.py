"""What the flights before this one say of the parameters: the key ``prior`` of an aircraft file.

    prior:
      flights: 12 flights of N1         # whose, in words
      parameters: {Cm_de: [-0.85, 0.043], …}    # value in the next flight, and its standard deviation

``fleet`` writes it for each of its airframes, and for one that it does not know, to ``prior.json`` in its folder.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.errors import InputError, echo

#: The file of a fleet: {"airframes": {name: prior}, "all": prior of an airframe that it does not know, or null}.
FILE = "prior.json"
_KEYS = ("flights", "parameters")


@dataclass(frozen=True)
class FleetPrior:
    """Parameters of the next flight as a fleet expects them."""

    flights: str  # whose, in words
    parameters: Mapping[str, tuple[float, float]]  # value and standard deviation by name


def prior_from_dict(data: Any) -> FleetPrior | None:
    """Check the content of the key ``prior``; None where there is none. Raises InputError."""
    if data is None:
        return None
    if not isinstance(data, Mapping) or set(data) != set(_KEYS):
        raise InputError(f"prior must be a mapping with {' and '.join(_KEYS)}, as `fleet` writes it to {FILE}")
    parameters = data["parameters"]
    if not isinstance(parameters, Mapping):
        raise InputError("prior: parameters must be a mapping such as {Cm_de: [-0.85, 0.04]}")
    return FleetPrior(echo(str(data["flights"])), {str(name): _pair(str(name), p) for name, p in parameters.items()})


def _pair(name: str, given: Any) -> tuple[float, float]:
    try:
        value, std = (float(number) for number in given)
    except (TypeError, ValueError):
        value, std = np.nan, np.nan
    if not (np.isfinite(value) and 0.0 < std < np.inf):
        raise InputError(f"prior: {echo(name)} must be [value, standard deviation], two numbers, the second positive")
    return value, std


def read_prior(fleet: str | Path, airframe: str | None, aircraft: str) -> dict[str, Any]:
    """The content of the key ``prior`` from the folder of a fleet, or its file. Raises InputError.

    ``airframe``: its name in that fleet. Without one that of the only airframe, or of the one that is called as the
    ``aircraft`` file calls its aeroplane, and else what all airframes have in common.
    """
    path = Path(fleet) / FILE if Path(fleet).is_dir() else Path(fleet)
    try:
        content = json.loads(path.read_text(encoding="utf8"))
        known, common = dict(content["airframes"]), content["all"]
    except OSError:
        raise InputError(
            f"--prior {fleet}: there is no {path}, which `aircraft-sysid fleet` writes into its folder"
        ) from None
    except (ValueError, LookupError, TypeError, RecursionError):
        raise InputError(f"--prior {fleet}: {path} is damaged: run the fleet again, which writes it again") from None
    if airframe is None and len(known) == 1:
        found = next(iter(known.values()))
    elif airframe is None and aircraft not in known:
        found = common
    else:
        found = known.get(aircraft if airframe is None else airframe)
    if found is None:
        listed = echo(", ".join(known), 200) or "none: an airframe needs three flights with a parameter to USE"
        which = "name one with --airframe" if airframe is None else f"'{echo(airframe)}' is not one of its airframes"
        raise InputError(f"--prior {fleet}: {which}; it knows {listed}")
    prior_from_dict(found)
    return dict(found)
