"""Files that come with the package: aircraft files and the definitions of its messages."""

from __future__ import annotations

from pathlib import Path

from aircraft_sysid_ros.errors import InputError

DEFAULT_AIRCRAFT = "ultra_stick_25e.yaml"
_PACKAGE = Path(__file__).resolve().parent


def shipped_folder(name: str) -> Path:
    """The folder `config` or `msg_defs`: in the package where setup.py built it, beside it in the source tree."""
    inside = _PACKAGE / name
    return inside if inside.is_dir() else _PACKAGE.parent / name


def config_path(name: str) -> Path:
    """Path of a configuration file by its name; InputError says where it is not."""
    path = shipped_folder("config") / name
    if not path.is_file():
        raise InputError(f"the configuration file {path} is missing: reinstall the package")
    return path
