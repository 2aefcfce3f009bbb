"""An IMU that is turned by a quarter about one of its axes: what its gyros and its accelerometers say together."""

from __future__ import annotations

from aircraft_sysid_ros.flight_check.finding import ERROR, Finding
from aircraft_sysid_ros.flight_check.repair import with_columns, with_factor
from aircraft_sysid_ros.flight_check.signals import FORCE, GYRO, Flight
from aircraft_sysid_ros.flight_check.triple import Triple

_AXES = "xyz"


class Turned:
    """By which axes: of ``first`` and ``second`` each shows the other, with the ``signs`` of a turn about ``about``.

    ``correlations`` of the gyros, and of those of the accelerometers that are sure, by axis.
    """

    def __init__(self, rates: Triple, forces: Triple, first: int, second: int) -> None:
        self.first, self.second, self.about = first, second, 3 - first - second
        self.rates, self.forces = rates, forces
        self.signs = (rates.correlation(first, second), rates.correlation(second, first))

    @property
    def is_sound(self) -> bool:
        """Whether all of it fits: a turn, and no mirror, by the gyros; the accelerometers follow as far as they show.

        One of them at least must, and neither shows its own.
        """
        about = self.about
        if self.signs[0] * self.signs[1] >= 0.0 or not self.rates.correlation(about, about) > 0.0:
            return False
        pairs = ((self.first, self.second, self.signs[0]), (self.second, self.first, self.signs[1]))
        if any(self.forces.correlation(i, i) or self.forces.correlation(i, j) * sign < 0.0 for i, j, sign in pairs):
            return False
        follows = any(self.forces.follows.get(i) == j for i, j, _ in pairs)
        return follows and self.forces.correlation(about, about) >= 0.0

    @property
    def finding(self) -> Finding:
        """One sentence of gyros and accelerometers."""
        i, j = _AXES[self.first], _AXES[self.second]
        minus = ["minus " if sign < 0.0 else "" for sign in self.signs]
        shown = [
            f"{_AXES[a]} {self.forces.correlation(a, b):.2f}"
            for a, b in ((self.first, self.second), (self.second, self.first))
            if self.forces.correlation(a, b)
        ]
        gyros = f"{i} {self.signs[0]:.2f}, {j} {self.signs[1]:.2f}"
        text = (
            f"the IMU is turned by 90 deg about its {_AXES[self.about]} axis: {i} follows {minus[0]}what {j} should be "
            f"and {j} {minus[1]}what {i} should be, of the gyros by {self.rates.words} (correlation {gyros}) and of "
            f"the accelerometers by {self.forces.words} (correlation {', '.join(shown)}): of both take {minus[1]}{j} "
            f"for {i} and {minus[0]}{i} for {j}"
        )
        return Finding(tuple(self._names), "sign", ERROR, text)

    @property
    def _names(self) -> list[str]:
        return [names[axis] for names in (FORCE, GYRO) for axis in sorted((self.first, self.second))]

    def taken_out(self, flight: Flight) -> Flight:
        """The flight of an IMU that is not turned."""
        pairs = ((self.first, self.second, self.signs[0]), (self.second, self.first, self.signs[1]))
        for names in (FORCE, GYRO):
            flight = with_columns(flight, {names[i]: names[j] for i, j, _ in pairs})
            for _, j, sign in pairs:
                flight = with_factor(flight, names[j], -1.0) if sign < 0.0 else flight
        return flight


def turned(rates: Triple, forces: Triple) -> Turned | None:
    """What turns the IMU: ``rates`` of the gyros and ``forces`` of the accelerometers, each beside what they should be.

    None where they do not show all of it.
    """
    exchanged = {i: j for i, j in rates.follows.items() if rates.follows.get(j) == i}
    if len(exchanged) != 2:
        return None
    found = Turned(rates, forces, *sorted(exchanged))
    return found if found.is_sound else None
