"""The definitions of our own messages, for reading and writing recordings without ROS."""

from functools import cache

from aircraft_sysid_ros.config_files import shipped_folder
from aircraft_sysid_ros.errors import InputError

PACKAGE = "aircraft_sysid_msgs"


@cache
def message_definitions() -> dict[str, str]:
    """Definition text of every message by its type name, such as `aircraft_sysid_msgs/msg/AirData`.

    Raises InputError where the installation lacks them.
    """
    folder = shipped_folder("msg_defs") / "msg"
    files = sorted(folder.glob("*.msg"))
    if not files:
        raise InputError(f"the definitions of {PACKAGE} are not in {folder}: reinstall the package")
    return {f"{PACKAGE}/msg/{file.stem}": file.read_text(encoding="utf-8") for file in files}
