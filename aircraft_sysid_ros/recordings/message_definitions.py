"""The definitions of our own messages, for reading and writing recordings without ROS."""

import os
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from aircraft_sysid_ros.errors import InputError

PACKAGE = "aircraft_sysid_msgs"


def definition_folders() -> Iterator[Path]:
    """Folders that may hold `msg/*.msg`, best first.

    What is installed goes before the source tree: it is what the compiled messages were made from.
    """
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        if prefix:
            yield Path(prefix) / "share" / PACKAGE
    yield Path(sys.prefix) / "share" / PACKAGE
    yield Path(__file__).resolve().parents[2] / "msg_defs"


@cache
def message_definitions() -> dict[str, str]:
    """Definition text of every message by its type name, such as `aircraft_sysid_msgs/msg/AirData`.

    Raises InputError where the messages are neither installed nor in the source tree.
    """
    folders = list(definition_folders())
    for folder in folders:
        files = sorted((folder / "msg").glob("*.msg"))
        if files:
            return {f"{PACKAGE}/msg/{file.stem}": file.read_text(encoding="utf-8") for file in files}
    searched = ", ".join(str(folder) for folder in folders)
    raise InputError(
        f"the definitions of {PACKAGE} were not found in {searched}; run `make env` or source the workspace"
    )
