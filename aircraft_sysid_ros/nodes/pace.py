"""How often samples of each kind come, and the largest gap between them, by their own stamps."""

from __future__ import annotations

from collections.abc import Iterable

from aircraft_sysid_ros.samples import Kind, Samples

_SECOND = 1e9


class Pace:
    """Counts the samples between two readings."""

    def __init__(self) -> None:
        self._counts: dict[int, int] = {}
        self._begin: dict[int, int] = {}  # stamps [ns]: of the newest sample at the last reading, or of the first
        self._newest: dict[int, int] = {}
        self._gaps: dict[int, int] = {}  # [ns]

    def add(self, parts: Iterable[Samples]) -> None:
        """Samples of one message, each part of one kind; a stamp that goes back starts over."""
        for part in parts:
            if not len(part):
                continue
            kind, stamp = int(part.kind[0]), int(part.stamp[0])
            before = self._newest.get(kind)
            self._newest[kind] = stamp
            if before is None or stamp < before:
                self._begin[kind], self._counts[kind] = stamp, 0
                continue
            self._counts[kind] = self._counts.get(kind, 0) + 1
            self._gaps[kind] = max(self._gaps.get(kind, 0), stamp - before)

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
