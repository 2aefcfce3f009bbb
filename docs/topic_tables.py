"""Tables of docs/messages.md: topics and services, from where the code declares them."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from results import Rows

from aircraft_sysid_ros.ros_messages.topics import DIAGNOSTICS, INPUTS, OUTPUTS, SERVICES, TRANSFORMS, Topic


def _cells(topic: Topic) -> list[str]:
    return [f"`{topic.name}`", topic.type.replace("/msg/", "/").replace("/srv/", "/"), topic.content]


def inputs() -> Rows:
    """What the nodes listen to."""
    return ["topic", "type", "content"], [_cells(topic) for topic in INPUTS]


def outputs() -> Rows:
    """What the nodes publish."""
    rows = []
    for topic in [*_of_all(OUTPUTS.values()), DIAGNOSTICS, TRANSFORMS]:
        name, kind, content = _cells(topic)
        rows.append([name, kind, "transient local" if topic.is_latched else "volatile", content])
    return ["topic", "type", "durability", "content"], rows


def services() -> Rows:
    """What the nodes can be asked for."""
    return ["service", "type", "does"], [_cells(service) for service in _of_all(SERVICES.values())]


def _of_all(listed: Iterable[Iterable[Topic]]) -> list[Topic]:
    return [topic for topics in listed for topic in topics]


TABLES: dict[str, Callable[[], Rows]] = {"inputs": inputs, "outputs": outputs, "services": services}
