"""How the filter comes to its first state: the alignment, with the GPS that is there or that is waited for."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.atmosphere import STANDARD_GRAVITY
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.reconstruction.alignment import GPS, Alignment
from aircraft_sysid_ros.reconstruction.gps_wait import Batch, GpsWait
from aircraft_sysid_ros.samples import Kind

Array = npt.NDArray[np.float64]


class StartUp:
    """Takes samples until the filter can start, and again after it was lost."""

    def __init__(self, aircraft: Aircraft) -> None:
        self.alignment = _alignment_of(aircraft)
        self._wait = GpsWait()
        self._had: frozenset[int] | None = None  # kinds of GPS samples of the starts of this manoeuvre

    def begin_anew(self, aircraft: Aircraft) -> None:
        """Another manoeuvre begins, of which nothing is known."""
        self.alignment = _alignment_of(aircraft)
        self._wait.reconsider()
        self._had = None

    def forget(self) -> None:
        """The filter was lost: what has been seen is of no use, and which GPS there is will be seen."""
        self.alignment.forget()
        self.alignment.seen = frozenset()
        self._wait.forget()

    def reconsider(self) -> None:
        """GPS has come that was taken as not there."""
        self._wait.reconsider()

    @property
    def gps(self) -> frozenset[int]:
        """Kinds of GPS samples that there are; all while it is not decided."""
        return GPS if self._wait.decided is None else self._wait.decided

    @property
    def gps_had(self) -> frozenset[int]:
        """Kinds of GPS samples that the manoeuvre has had, whenever the filter started; all where it did not."""
        return GPS if self._had is None else self._had

    @property
    def origin(self) -> Array:
        """Latitude and longitude [rad] and height [m] of the first start (3,); after it. NaN: no place is known."""
        assert self.alignment.origin is not None
        height = self.alignment.origin[2]
        return self.alignment.origin if Kind.GPS_POSITION in self.gps else np.array([np.nan, np.nan, height])

    def feed(
        self, batch: Batch, at: int, shown: Callable[[float, int, Array], Array], wind: tuple[Array, Array]
    ) -> tuple[Batch, int, tuple[Array, Array] | None]:
        """Take samples from number ``at`` on, until there is a start.

        ``shown``: what is left of the values (WIDTH,) of a sample without known errors of its sensor. ``wind``: NED
        (3,) [m/s] with standard deviations (3,). Returns the samples to go on with, the number of that which the start
        is at, or of the next to take, and state (19,) and covariance (18, 18) of the start, or None.
        """
        times, kinds, values = batch
        for i in range(at, len(times)):
            time, kind = float(times[i]), int(kinds[i])
            is_imu = self.alignment.take(time, kind, shown(time, kind, values[i]))
            self._wait.keep((time, kind, values[i]), self.alignment.seen)
            if not is_imu:
                continue
            start = self._started(wind)
            if start is not None:
                return batch, i, start
            if self._wait.is_over(time, self.alignment.flies()):
                return self._decided().followed_by(Batch(times[i + 1 :], kinds[i + 1 :], values[i + 1 :])), 0, None
        return batch, len(times), None

    def rest(self) -> Batch | None:
        """What was kept while GPS was waited for, at the end of a recording; None where nothing is waited for."""
        return self._decided() if self._wait.waits else None

    def settle(self) -> None:
        """The filter has started: what GPS there is, is decided."""
        if self._wait.decided is None:
            self._wait.decided = GPS
            self._wait.forget()
        self._had = self.gps | (self._had or frozenset())

    def before_new_gps(self, kinds: npt.NDArray[np.int64]) -> int:
        """How many samples there are before the first of a kind of GPS that was taken as not there."""
        new = np.flatnonzero(np.isin(kinds, [*(GPS - self.gps)]))
        return int(new[0]) if len(new) else len(kinds)

    def _started(self, wind: tuple[Array, Array]) -> tuple[Array, Array] | None:
        """State and covariance where a start is possible with the GPS that is there, or that is waited for."""
        return self.alignment.start(*wind) if self.gps == GPS else self.alignment.start_with(self.gps, *wind)

    def _decided(self) -> Batch:
        """What has come is what there is: the samples that were kept, with which the alignment begins anew."""
        kept = self._wait.decide(self.alignment.seen)
        self.alignment.forget()
        return kept


def _alignment_of(aircraft: Aircraft) -> Alignment:
    ground = aircraft.ground_altitude or 0.0
    return Alignment(STANDARD_GRAVITY, aircraft.minimum_airspeed, aircraft.magnetic_declination, ground)
