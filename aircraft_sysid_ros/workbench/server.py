"""The server of the page, on this machine."""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import itertools
import socket
from collections.abc import Callable

import uvicorn
from fastapi import FastAPI, Request
from fastapi.responses import HTMLResponse
from markupsafe import Markup
from nicegui import Client, ui
from nicegui import app as pages

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.workbench import markup
from aircraft_sysid_ros.workbench.frame import STYLE
from aircraft_sysid_ros.workbench.guard import SameOrigin

#: In the address of a page, of which run it is.
RUN = "run"
#: Time [s] between looks whether what a browser has missed is on its way to it.
_LOOK = 0.1


def serve(
    make: Callable[[str | None, str | None], object],
    title: str,
    host: str,
    listener: socket.socket,
    ready: Callable[[list[str]], None],
) -> None:
    """Serve a page until Ctrl-C on what ``listen`` gave; ``ready`` hears its addresses, that for this machine first.

    ``make`` builds the page of one browser, which remembers "light" or "dark" where its user has chosen, else what the
    system wanted last, or nothing; of the run that its address names, if any.
    """
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)

    @ui.page("/", title=f"{title} · workbench", response_timeout=30.0)
    def _page(request: Request) -> None:
        make(request.cookies.get("theme"), request.query_params.get(RUN))
        _bring_up_to_date_when_back(ui.context.client)

    pages.add_exception_handler(404, _not_found)
    ui.run_with(
        app,
        tailwind=False,
        show_welcome_message=False,
        gzip_middleware_factory=None,  # nothing to gain on this machine
        favicon=FAVICON,
        reconnect_timeout=30.0,  # a busy machine is late to answer: else the page would load anew and forget its window
    )
    config = uvicorn.Config(
        SameOrigin(app, host), log_level="error", ws_per_message_deflate=False, timeout_graceful_shutdown=1
    )
    ready(addresses(host, listener.getsockname()[1]))
    with contextlib.suppress(KeyboardInterrupt):
        uvicorn.Server(config).run(sockets=[listener])


async def _not_found(request: Request, _: Exception) -> HTMLResponse:
    """What stands at an address that is none, with the way back."""
    style = Markup(STYLE.read_text(encoding="utf8"))
    return HTMLResponse(markup.page("not_found.html", address=request.url.path, style=style), status_code=404)


def _bring_up_to_date_when_back(client: Client) -> None:
    """Send all of a page again to a browser that lost its connection for a moment.

    NiceGUI repeats what the browser missed, after what is newer: texts and lists would stay as they were then.
    """
    connections = itertools.count()

    async def connected() -> None:
        if not next(connections):
            return
        while client.outbox.messages:
            await asyncio.sleep(_LOOK)
        for element in list(client.elements.values()):
            element.update()

    client.on_connect(connected)


def is_private(host: str) -> bool:
    """Whether only this machine can reach what listens there."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


def addresses(host: str, port: int) -> list[str]:
    """What to type into a browser, first on this machine: a wildcard such as 0.0.0.0 is no address to go to."""
    try:
        is_wildcard = ipaddress.ip_address(host).is_unspecified
    except ValueError:
        is_wildcard = False
    hosts = list(dict.fromkeys(["127.0.0.1", _outward()])) if is_wildcard else [f"[{host}]" if ":" in host else host]
    return [f"http://{name}:{port}/" for name in hosts]


def _outward() -> str:
    """Address of this machine in its network, without sending anything; that of loopback where it is in none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # for documentation, RFC 5737: only a route is looked up
            return str(probe.getsockname()[0])
        except OSError:
            return "127.0.0.1"


#: A wing with its angle of attack.
FAVICON = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 32 32"><path d="M3 21C9 9 22 9 29 17C20 17 12 19 3 21Z" '
    'fill="#0072b2"/></svg>'
)


def listen(host: str, port: int) -> socket.socket:
    """A socket that listens, on any free port for 0. Raises InputError where it cannot."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen(128)
    except (OSError, OverflowError) as error:
        listener.close()
        reason = getattr(error, "strerror", None) or error
        hint = "choose another --host, or --port (0 takes any that is free)"
        raise InputError(f"cannot listen on {host} port {port}: {reason}; {hint}") from None
    return listener
