"""The library of effects: everything that a model may lack and that this program knows by name.

A new effect is one more entry in ``aerodynamic``, ``change`` or ``measurement``; docs/effects.md shows how.
"""

from __future__ import annotations

from aircraft_sysid_ros.effects import aerodynamic, change, measurement
from aircraft_sysid_ros.effects.effect import Effect
from aircraft_sysid_ros.errors import InputError

#: All effects; those of the measurement stand first, since they are tried before aerodynamics is blamed.
LIBRARY: tuple[Effect, ...] = (*measurement.EFFECTS, *aerodynamic.EFFECTS, *change.EFFECTS)
#: What a servo does that looks like a record of its surface that comes late.
OF_SERVOS = frozenset({"rate_limit", "free_play"})
BY_ID: dict[str, Effect] = {effect.identifier: effect for effect in LIBRARY}


def effect_of(identifier: str) -> Effect:
    """Effect of an id; InputError names all ids."""
    if identifier not in BY_ID:
        raise InputError(f"'{identifier}' is not an effect of the library: it has {' '.join(sorted(BY_ID))}")
    return BY_ID[identifier]
