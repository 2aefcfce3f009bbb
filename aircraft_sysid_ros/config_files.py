"""Where the configuration files that come with the package are, in a source tree and after installation."""

from __future__ import annotations

import os
import site
import sys
from collections.abc import Iterator
from pathlib import Path

from aircraft_sysid_ros.errors import InputError

PACKAGE = "aircraft_sysid_ros"
DEFAULT_AIRCRAFT = "ultra_stick_25e.yaml"


def config_path(name: str) -> Path:
    """Path of a configuration file by its name; InputError lists the folders where it is not."""
    folders = list(_folders())
    for folder in folders:
        if (folder / name).is_file():
            return folder / name
    raise InputError(
        f"the configuration file {name} is in none of {', '.join(map(str, folders))}: reinstall the package"
    )


def _folders() -> Iterator[Path]:
    """Source tree (also pip -e), then what colcon and pip install."""
    yield Path(__file__).resolve().parents[1] / "config"
    prefixes = [
        *filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)),
        sys.prefix,
        site.getuserbase(),
    ]
    for prefix in dict.fromkeys(prefixes):
        yield Path(prefix) / "share" / PACKAGE / "config"
