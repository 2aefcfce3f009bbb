"""What goes back to the autopilot, and how often: options of the bridge."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.option import option, options

#: Letters of a name in MAVLink, and places of an array.
NAME_LENGTH, ARRAY_LENGTH = 10, 58
#: Largest rate [Hz] that a link can bear.
_FASTEST = 50.0


@options
class BackOptions:
    """What goes back, and at most how often."""

    parameters: tuple[str, ...] = option((), "Names of the parameters to send to the autopilot.")
    form: Literal["named", "array"] = option(
        "named", "named: NAMED_VALUE_FLOAT; array: DEBUG_FLOAT_ARRAY with their standard errors."
    )
    wind_rate: float = option(1.0, "Rate of WIND_COV; 0: none.", "Hz", 0.0, _FASTEST)
    parameter_rate: float = option(1.0, "Rate of the whole set of parameters; 0: none.", "Hz", 0.0, _FASTEST)

    @model_validator(mode="after")
    def _fits(self) -> BackOptions:
        """They are names of parameters, told apart in MAVLink, and fit."""
        strange = next((name for name in self.parameters if name.partition("_")[0] not in AXES), None)
        if strange is not None:
            raise InputError(
                f"'{strange}' is not a parameter to send back: give an axis and a term, such as CZ_alpha "
                f"(axes: {', '.join(AXES)})"
            )
        short = [name[:NAME_LENGTH] for name in self.parameters]
        twice = next((name for name in short if short.count(name) > 1), None)
        if self.form == "named" and twice is not None:
            raise InputError(
                f"two of the parameters to send back begin with '{twice}', and MAVLink has {NAME_LENGTH} letters: "
                "use array"
            )
        if len(self.parameters) > ARRAY_LENGTH:
            raise InputError(f"at most {ARRAY_LENGTH} parameters can be sent back, not {len(self.parameters)}")
        return self
