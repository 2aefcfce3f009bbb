"""How much a compressed file may hold: a few hundred kilobytes can stand for more than a machine has."""

from __future__ import annotations

import zipfile
from pathlib import Path

#: A flight that stands still compresses well, and a small file may hold much of it: bytes in all, and per byte.
_ALWAYS, _RATIO = 1 << 28, 300


def allowed_size(compressed: int) -> int:
    """Bytes that a file of so many may hold decompressed."""
    return _ALWAYS + _RATIO * compressed


def is_bomb(path: str | Path) -> bool:
    """Whether a ZIP archive, such as .npz and .xlsx, says that it holds more. Raises OSError, BadZipFile."""
    with zipfile.ZipFile(path) as archive:
        return sum(item.file_size for item in archive.infolist()) > allowed_size(Path(path).stat().st_size)
