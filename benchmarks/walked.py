"""Commands one after the other in this process, as a user types them, in silence."""

from __future__ import annotations

import contextlib
import io
from typing import Any

from aircraft_sysid_ros.commands.main import main as command


def walked(*commands: list[Any]) -> str:
    """What the first command that fails says; nothing where none does."""
    for arguments in commands:
        errors = io.StringIO()
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(errors):
            status = command([str(argument) for argument in arguments])
        if status:
            return f"{arguments[0]}: {errors.getvalue()[-300:]}"
    return ""
