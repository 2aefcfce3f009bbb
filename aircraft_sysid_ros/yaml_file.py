"""Files in YAML that people write. A key that is there twice is refused: PyYAML would take the last of the two.

So is a file whose aliases (``*name``) repeat each other, since some lines of those stand for a thousand million values.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from aircraft_sysid_ros.errors import InputError, echo

#: [bytes] More is no file that people write.
LARGEST = 10_000_000
#: Values that a file may have, each counted as often as aliases repeat it.
MOST_VALUES = 200_000
_DEEPEST = 100


class _Limits:
    """A loader that refuses what is too large."""

    def get_single_node(self) -> yaml.Node | None:
        """The content, composed; its aliases are not repeated yet."""
        node: yaml.Node | None = super().get_single_node()  # type: ignore[misc]
        if node is not None and _count(node, {}) > MOST_VALUES:
            raise InputError(
                f"it has more than {MOST_VALUES} values: write them into a recording, or leave out aliases"
            )
        return node


#: libyaml, where PyYAML has it.
_Fast: Any = type("_Fast", (_Limits, getattr(yaml, "CSafeLoader", yaml.SafeLoader)), {})


class _Loader(_Limits, yaml.SafeLoader):
    """Refuses repeated keys as well, which YAML itself forbids and PyYAML does not notice."""

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


def _count(node: yaml.Node, known: dict[int, float]) -> float:
    """Values of a node, with those that aliases repeat; of one that holds itself, once."""
    if isinstance(node, yaml.ScalarNode):
        return 1.0
    if id(node) not in known:
        known[id(node)] = 1.0
        parts = [part for item in node.value for part in (item if isinstance(item, tuple) else (item,))]
        known[id(node)] = 1.0 + sum(_count(part, known) for part in parts)
    return known[id(node)]


def _twice(key: str, first: int, second: int) -> InputError:
    where = f"at lines {first} and {second}" if first != second else f"at line {first}"
    return InputError(f"the key '{echo(key)}' is there twice, {where}: remove one")


def parse_yaml(text: bytes) -> Any:
    """The content of a file that a program has written, fast. Raises YAMLError or ValueError."""
    depth = 0
    for event in yaml.parse(text, _Fast):  # libyaml descends into what it composes until the stack is full
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEEPEST:
            raise InputError("it is nested too deeply")
    return yaml.load(text, _Fast)


def read_yaml(path: str | Path, what: str) -> Any:
    """The content of a file, which InputError calls ``what``; it must be there, and be valid YAML."""
    try:
        if Path(path).stat().st_size > LARGEST:
            raise InputError(f"the {what} {path} is larger than {LARGEST // 10**6} MB: write numbers into a recording")
        text = Path(path).read_text(encoding="utf8")
    except (OSError, UnicodeDecodeError) as error:
        reason = (error.strerror or error) if isinstance(error, OSError) else "it is not text in UTF-8"
        raise InputError(f"cannot read the {what} {path}: {reason}") from None
    try:
        return yaml.load(text, _Loader)
    except InputError as error:
        raise InputError(f"{what} {path}: {error}") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" at line {mark.line + 1}" if mark else ""
        raise InputError(f"{what} {path}: it is not valid YAML{where}") from None
    except RecursionError:
        raise InputError(f"{what} {path}: it is nested too deeply: simplify it") from None
    except ValueError:  # of YAML's own conversions, such as the date 2024-13-45
        raise InputError(f"{what} {path}: it is not valid YAML: a value is not what it looks like") from None
