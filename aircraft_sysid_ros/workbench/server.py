"""The server of the page, on this machine."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Callable

import uvicorn
from fastapi import FastAPI, Request
from nicegui import ui

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.workbench.guard import SameOrigin


def serve(
    make: Callable[[str | None], object], title: str, host: str, port: int, ready: Callable[[str], None]
) -> None:
    """Serve a page until Ctrl-C; ``ready`` hears its address. Port 0 is any that is free.

    ``make`` builds the page of one browser, which remembers "light", "dark" or nothing.

    Raises InputError where host and port cannot be used.
    """
    listener = listen(host, port)
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)

    @ui.page("/", title=f"{title} · workbench", response_timeout=30.0)
    def _page(request: Request) -> None:
        make(request.cookies.get("theme"))

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
    name = f"[{host}]" if ":" in host else host
    ready(f"http://{name}:{listener.getsockname()[1]}/")
    with contextlib.suppress(KeyboardInterrupt):
        uvicorn.Server(config).run(sockets=[listener])


#: A wing with its angle of attack.
FAVICON = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 32 32"><path d="M3 21C9 9 22 9 29 17C20 17 12 19 3 21Z" '
    'fill="#0072b2"/></svg>'
)


def listen(host: str, port: int) -> socket.socket:
    """A socket that listens. Raises InputError where it cannot."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen(128)
    except (OSError, OverflowError) as error:
        listener.close()
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"cannot listen on {host} port {port}: {reason}; choose other --host, --port") from None
    return listener
