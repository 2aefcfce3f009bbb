"""What must be installed beside the package, and the sentence for what is not."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from importlib import metadata

from aircraft_sysid_ros.errors import InputError

PACKAGE = "aircraft_sysid_ros"
#: A requirement of setup.py that is no extra: name and lowest version, as its metadata has them.
_REQUIREMENT = re.compile(r"([\w.-]+)[^;>]*(?:>=([\d.]+))?[^;]*$")


class MissingExtra(InputError):
    """A package that only some commands need: ``purpose``, in the plural, needs ``package``, which is in ``extra``."""

    def __init__(self, purpose: str, package: str, extra: str) -> None:
        super().__init__(f"{purpose} need {package}: python3 -m pip install '{PACKAGE}[{extra}]'")


#: How far ROS 2 looks for other nodes.
DISCOVERY = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_OLD_DISCOVERY = "ROS_LOCALHOST_ONLY"


def stay_local() -> str:
    """Let nodes of this process find others on this machine alone, unless the user has said otherwise.

    To be called before ROS starts. Returns what to tell the user; empty where the user has said it.
    """
    if os.environ.get(DISCOVERY) or os.environ.get(_OLD_DISCOVERY):
        return ""
    os.environ[DISCOVERY] = "LOCALHOST"
    return f"nodes of this machine only ({DISCOVERY}=SUBNET for those of the network)"


def start_ros(arguments: Sequence[str] = ()) -> None:
    """Start ROS in this process, with words from ``--ros-args`` on; signals stay those of the process.

    Raises ImportError without ROS, InputError for words that are none of ROS.
    """
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    try:
        rclpy.init(args=[*arguments], signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # rclpy has one for each
        reason = re.split(r"\. Error:|, at /|\[ERROR\]", " ".join(str(error).split()))[0]
        reason = re.sub(r"^\[(.*)\]$", r"ROS does not know \1", reason.removeprefix("failed to initialize rcl: "))
        raise InputError(f"{' '.join(arguments)}: {reason}" if arguments else reason) from None


def missing_ros(error: ImportError) -> InputError:
    """The error for a command that talks to ROS 2, from what could not be imported."""
    return InputError(
        f"ROS 2 is not in this environment ({error}): source its setup.bash, or build an environment that has it "
        "with `make env` in the source tree"
    )


def unmet_requirement() -> str:
    """One sentence on a required package that is missing or too old; empty where all are there.

    pip never leaves one unmet, but rosdep knows no versions and installs what the system has.
    """
    try:
        requirements = metadata.requires(PACKAGE) or []
    except metadata.PackageNotFoundError:  # run from the source tree without an installation
        return ""
    for requirement in requirements:
        if match := _REQUIREMENT.match(requirement):
            name, lowest = match.groups()
            found = _version(name)
            if found is None or (lowest and _numbers(found) < _numbers(lowest)):
                there = "is not installed" if found is None else f"is too old, {found}"
                return f"the required package {name} {there}: python3 -m pip install '{requirement}'"
    return ""


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _numbers(version: str) -> list[int]:
    return [int(number) for number in re.findall(r"\d+", version)[:3]]
