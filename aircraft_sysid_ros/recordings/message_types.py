"""Types of messages by way of rosbags: of ROS 2 Jazzy, ours, and what a recording brings along."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from types import NoneType
from typing import TYPE_CHECKING, Any

import numpy as np

from aircraft_sysid_ros.recordings.cdr_layout import PRIMITIVES, Definitions, vector_components
from aircraft_sysid_ros.recordings.message_definitions import PACKAGE, message_definitions
from aircraft_sysid_ros.recordings.raw_messages import Channel
from aircraft_sysid_ros.stamps import NANOSECONDS

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_BASE, _NAME, _ARRAY = 1, 2, 3  # rosbags.interfaces.Nodetype
_TIME = "builtin_interfaces/msg/Time"
_IDL_SEPARATOR = "=" * 80 + "\n"
_Converter = Callable[[Any], Any]


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


def as_written(channel: Channel, messages: Sequence[bytes]) -> Channel:
    """A channel without a definition with the older one that its first messages have, where they are none of ours.

    Before Iron sensor_msgs/Range had no variance, and sqlite3 recordings had no definitions.
    """
    if channel.encoding or channel.type not in known_types().fielddefs or _fits(known_types(), channel.type, messages):
        return channel
    older = _older_types()
    if channel.type not in older.fielddefs or not _fits(older, channel.type, messages):
        return channel
    return replace(channel, encoding="ros2msg", definition=older.generate_msgdef(channel.type, ros_version=2)[0])


@cache
def _older_types() -> Typestore:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


def _fits(types: Typestore, type_name: str, messages: Sequence[bytes]) -> bool:
    """Whether any of the messages is of a type."""
    for message in messages:
        try:
            types.deserialize_cdr(message, type_name)
        except Exception:  # what is of another type raises all kinds
            continue
        return True
    return False


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
    message, converters = _fields(type_name)
    for name in values.keys() - converters.keys():
        raise KeyError(f"{type_name} has no field {name}")
    return message(**{name: converted(values.get(name)) for name, converted in converters.items()})


@cache
def _fields(type_name: str) -> tuple[Any, dict[str, _Converter]]:
    """The class of a message, and what makes each of its fields from what the caller gave."""
    types, missing = known_types(), np.nan if type_name.startswith(PACKAGE) else 0.0
    members = types.fielddefs[type_name][1]
    return types.types[type_name], {name: _converter(description, missing) for name, description in members}


def _converter(description: Any, missing: float) -> _Converter:
    """What makes a field, as rosbags serialises it, from what the caller gave (None: nothing)."""
    node, content = int(description[0]), description[1]
    if node == _BASE:
        return _base_converter(content[0], missing)
    if node == _NAME:
        return partial(_time if content == _TIME else _message, content)
    inner, count = content
    if int(inner[0]) == _BASE and inner[1][0] != "string":
        scalar = np.dtype(PRIMITIVES[inner[1][0]])
        empty = np.full(count if node == _ARRAY else 0, missing if scalar.kind == "f" else 0, scalar)
        return lambda value: empty.copy() if value is None else np.asarray(value, dtype=scalar).ravel()
    one = _converter(inner, missing)
    return lambda value: [one(item) for item in value or ()]


def _message(type_name: str, value: Any) -> Any:
    return message_from_dict(type_name, value or {}) if isinstance(value, (Mapping, NoneType)) else value


def _time(type_name: str, value: Any) -> Any:
    if isinstance(value, (int, np.integer)):
        value = {"sec": int(value) // NANOSECONDS, "nanosec": int(value) % NANOSECONDS}
    return _message(type_name, value)


def _base_converter(base: str, missing: float) -> _Converter:
    if base == "string":
        return lambda value: "" if value is None else str(value)
    if base.startswith("float"):
        return lambda value: missing if value is None else float(value)
    kind = bool if base == "bool" else int
    return lambda value: 0 if value is None else kind(value)
