"""Files in YAML that people write. A key that is there twice is refused: PyYAML would take the last of the two."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from aircraft_sysid_ros.errors import InputError

#: Characters of a key that a message shows.
_LONGEST_SHOWN = 60


class _Loader(yaml.SafeLoader):
    """Refuses repeated keys, which YAML itself forbids and PyYAML does not notice."""

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        node = super().compose_mapping_node(anchor)
        lines: dict[str, int] = {}
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                line = key.start_mark.line + 1
                if key.value in lines:
                    raise _twice(key.value, lines[key.value], line)
                lines[key.value] = line
        return node


def _twice(key: str, first: int, second: int) -> InputError:
    shown = " ".join(key.split())[:_LONGEST_SHOWN]
    where = f"at lines {first} and {second}" if first != second else f"at line {first}"
    return InputError(f"the key '{shown}' is there twice, {where}: remove one")


def read_yaml(path: str | Path, what: str) -> Any:
    """The content of a file, which InputError calls ``what``; it must be there, and be valid YAML."""
    try:
        text = Path(path).read_text(encoding="utf8")
    except (OSError, UnicodeDecodeError) as error:
        reason = (error.strerror or error) if isinstance(error, OSError) else "it is not a text file"
        raise InputError(f"cannot read the {what} {path}: {reason}") from None
    try:
        return yaml.load(text, _Loader)
    except InputError as error:
        raise InputError(f"{what} {path}: {error}") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" at line {mark.line + 1}" if mark else ""
        raise InputError(f"{what} {path}: it is not valid YAML{where}") from None
    except (ValueError, RecursionError):  # of YAML's own conversions, such as the date 2024-13-45
        raise InputError(f"{what} {path}: it is not valid YAML: a value is not what it looks like") from None
