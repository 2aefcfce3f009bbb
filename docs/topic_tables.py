"""Tables of docs/messages.md: topics and services, from where the code declares them."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from aircraft_sysid_ros.ros_messages.topics import DIAGNOSTICS, INPUTS, OUTPUTS, SERVICES, TRANSFORMS, Topic


def _table(header: tuple[str, ...], topics: Iterable[Topic], *, durability: bool = False) -> str:
    lines = [f"| {' | '.join(header)} |", "|" + "---|" * len(header)]
    for topic in topics:
        cells = [f"`{topic.name}`", topic.type.replace("/msg/", "/").replace("/srv/", "/")]
        if durability:
            cells.append("transient local" if topic.is_latched else "volatile")
        lines.append(f"| {' | '.join([*cells, topic.content])} |")
    return "\n".join(lines) + "\n"


def outputs() -> str:
    """What the nodes publish."""
    listed = [topic for topics in OUTPUTS.values() for topic in topics]
    return _table(("topic", "type", "durability", "content"), [*listed, DIAGNOSTICS, TRANSFORMS], durability=True)


TABLES: dict[str, Callable[[], str]] = {
    "inputs": lambda: _table(("topic", "type", "content"), INPUTS),
    "outputs": outputs,
    "services": lambda: _table(("service", "type", "does"), [s for listed in SERVICES.values() for s in listed]),
}
