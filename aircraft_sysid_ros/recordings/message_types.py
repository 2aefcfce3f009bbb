"""Types of messages by way of rosbags: of ROS 2 Jazzy, ours, and what a recording brings along."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from types import NoneType
from typing import TYPE_CHECKING, Any

import numpy as np

from aircraft_sysid_ros.recordings.cdr_layout import PRIMITIVES, Definitions, vector_components
from aircraft_sysid_ros.recordings.message_definitions import PACKAGE, message_definitions
from aircraft_sysid_ros.recordings.raw_messages import Channel
from aircraft_sysid_ros.ros_messages.conversion import NANOSECONDS

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_BASE, _NAME, _ARRAY = 1, 2, 3  # rosbags.interfaces.Nodetype
_IDL_SEPARATOR = "=" * 80 + "\n"


@cache
def known_types() -> Typestore:
    """ROS 2 Jazzy and our messages."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for name, text in message_definitions().items():
        types.update(get_types_from_msg(text, name))
    store.register(types)
    return store


@cache
def channel_types(channel: Channel) -> Typestore:
    """The types of a channel as the recording defines them; as we do where it does not, or is damaged."""
    from rosbags.typesys import Stores, get_typestore

    try:
        types = _parsed(channel)
        if all(known_types().fielddefs.get(name) == definition for name, definition in types.items()):
            return known_types()
        store = get_typestore(Stores.EMPTY)
        store.register(types)
    except Exception:  # the parsers raise all kinds
        return known_types()
    return store


def is_as_known(channel: Channel) -> bool:
    """Whether the recording does not define the type differently from us; unknown types are accepted."""
    return channel.type not in known_types().fielddefs or channel_types(channel) is known_types()


def _parsed(channel: Channel) -> dict[str, Any]:
    """What the definition in a recording defines; nothing when there is none."""
    from rosbags.typesys import get_types_from_idl, get_types_from_msg

    if channel.encoding == "ros2msg":
        return get_types_from_msg(channel.definition, channel.type)
    types: dict[str, Any] = {}
    if channel.encoding == "ros2idl":
        for part in channel.definition.split(_IDL_SEPARATOR):
            text = part.split("\n", 1)[1] if part.startswith("IDL: ") else part
            types.update(get_types_from_idl(text) if text.strip() else {})
    return types


def flat_fields(definitions: Definitions, type_name: str, message: Any, prefix: str = "") -> dict[str, Any]:
    """Fields of a deserialised message by dotted name; a vector (x, y, z) is a tuple."""
    fields: dict[str, Any] = {}
    for name, (node, content) in definitions[type_name][1]:
        value = getattr(message, name)
        if int(node) != _NAME:
            fields[prefix + name] = value
        elif components := vector_components(definitions, content):
            fields[prefix + name] = tuple(getattr(value, component) for component in components)
        else:
            fields.update(flat_fields(definitions, content, value, f"{prefix}{name}."))
    return fields


def message_from_dict(type_name: str, values: Mapping[str, Any]) -> Any:
    """A message to serialise from a mapping of its fields, nested as the type is; a time may be int [ns].

    Fields that are not given are empty or 0, but NaN in our own messages. Raises KeyError for an unknown
    field.
    """
    types = known_types()
    members = dict(types.fielddefs[type_name][1])
    for name in values.keys() - members.keys():
        raise KeyError(f"{type_name} has no field {name}")
    missing = np.nan if type_name.startswith(PACKAGE) else 0.0
    fields = {name: _field_value(description, values.get(name), missing) for name, description in members.items()}
    return types.types[type_name](**fields)


def _field_value(description: Any, value: Any, missing: float) -> Any:
    """Value of a field as rosbags serialises it, from what the caller gave (None: nothing)."""
    node, content = int(description[0]), description[1]
    if node == _BASE:
        return _base_value(content[0], value, missing)
    if node == _NAME:
        if content == "builtin_interfaces/msg/Time" and isinstance(value, (int, np.integer)):
            value = {"sec": int(value) // NANOSECONDS, "nanosec": int(value) % NANOSECONDS}
        return message_from_dict(content, value or {}) if isinstance(value, (Mapping, NoneType)) else value
    inner, count = content
    if int(inner[0]) == _BASE and inner[1][0] != "string":
        scalar = np.dtype(PRIMITIVES[inner[1][0]])
        empty = np.full(count if node == _ARRAY else 0, missing if scalar.kind == "f" else 0, scalar)
        return empty if value is None else np.asarray(value, dtype=scalar).ravel()
    return [_field_value(inner, item, missing) for item in value or ()]


def _base_value(base: str, value: Any, missing: float) -> Any:
    if value is None:
        return "" if base == "string" else missing if base.startswith("float") else 0
    if base == "string":
        return str(value)
    return bool(value) if base == "bool" else float(value) if base.startswith("float") else int(value)
