"""How often samples of each kind come, and the largest gap between them, by their own stamps."""

from __future__ import annotations

from collections.abc import Iterable

from aircraft_sysid_ros.samples import Kind, Samples

_SECOND = 1e9
_LATE = 1_000_000_000  # [ns] a sample is late at most


class SampleRates:
    """Counts the samples between two readings."""

    def __init__(self) -> None:
        self._counts: dict[int, int] = {}
        self._begin: dict[int, int] = {}  # stamps [ns]: of the newest sample at the last reading, or of the first
        self._newest: dict[int, int] = {}
        self._gaps: dict[int, int] = {}  # [ns]

    def add(self, parts: Iterable[Samples]) -> None:
        """Samples of one message; one that is late counts, and a clock that goes back starts over."""
        for part in parts:
            for kind, stamp in zip(part.kind.tolist(), part.stamp.tolist(), strict=True):
                self._take(kind, stamp)

    def _take(self, kind: int, stamp: int) -> None:
        before = self._newest.get(kind)
        if before is None or stamp < before - _LATE:
            self._newest[kind], self._begin[kind], self._counts[kind] = stamp, stamp, 0
            return
        self._counts[kind] = self._counts.get(kind, 0) + 1
        if stamp > before:
            self._gaps[kind], self._newest[kind] = max(self._gaps.get(kind, 0), stamp - before), stamp

    def read(self) -> dict[str, str]:
        """Rate [Hz] and largest gap [s] since the last reading, of each kind that has ever come."""
        found = {}
        for kind, newest in self._newest.items():
            name, elapsed = Kind(kind).name.lower(), (newest - self._begin[kind]) / _SECOND
            found[f"{name}.rate"] = f"{self._counts.get(kind, 0) / elapsed:.4g}" if elapsed > 0.0 else "0"
            if kind in self._gaps:
                found[f"{name}.largest_gap"] = f"{self._gaps[kind] / _SECOND:.4g}"
        self._begin, self._counts, self._gaps = dict(self._newest), {}, {}
        return found
