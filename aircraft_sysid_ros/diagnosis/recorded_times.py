"""Times of a diagnosis, which count from where the filter started, in those of the recording."""

from __future__ import annotations

from collections.abc import Iterable


def in_recording(stamps: Iterable[int], zero: int, recorded_from: int) -> str:
    """Stamps [ns] since the first sample, in words, where the filter started late; empty where it did not.

    ``zero``: stamp [ns] from which times count, ``recorded_from``: that of the first sample.
    """
    late = (zero - recorded_from) * 1e-9
    times = " to ".join(f"{(stamp - recorded_from) * 1e-9:.0f} s" for stamp in stamps)
    if not times or late < 1.0:
        return ""
    return f" ({times} since the first sample: the filter started {late:.0f} s late)"
