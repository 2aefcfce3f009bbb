"""Text in a file, in full or not at all."""

from __future__ import annotations

import os
from pathlib import Path


def write_whole(path: Path, text: str) -> None:
    """Write beside the file and rename, so that whoever reads it finds all of it; raises OSError."""
    part = path.with_name(f".{path.name}.part")
    try:
        part.write_text(text, encoding="utf8")
        os.replace(part, path)
    except OSError:
        part.unlink(missing_ok=True)
        raise
