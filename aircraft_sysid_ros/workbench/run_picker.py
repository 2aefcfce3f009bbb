"""The way from the page of one run to another one of the same server."""

from __future__ import annotations

import urllib.parse
from typing import Any

from nicegui import ui

from aircraft_sysid_ros.workbench.server import RUN
from aircraft_sysid_ros.workbench.shelf import Shelf


def go_to(name: str) -> None:
    """Open the page of another run."""
    ui.navigate.to(f"/?{urllib.parse.urlencode({RUN: name})}")


def run_picker(shelf: Shelf, name: str) -> Any:
    """All runs as a menu of the header, and the way to the list."""
    with ui.element("div").classes("run-picker"):
        button = ui.button(icon="list", on_click=lambda: ui.navigate.to("/"))
        button.props('flat round dense color=grey-7 aria-label="All runs" data-testid=all-runs')
        names = sorted({name, *shelf.names})
        picker = ui.select(names, value=name, label="run", on_change=lambda event: go_to(str(event.value)))
        return picker.props("outlined dense options-dense data-testid=run-picker")
