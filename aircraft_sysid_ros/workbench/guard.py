"""Who may speak to the page's server: only the page that this server gave out.

A page of another site in the same browser can send requests to this machine. What writes must therefore name this
server as its origin, and every request must name this server as its host, or a name that somebody else's name server
turns to this machine would pass for it (DNS rebinding). Addresses in figures cannot be turned.

Every answer tells the browser that the page loads from nowhere else and is shown in no frame of another page, where
somebody could be made to press its buttons. NiceGUI compiles its templates in the browser: it needs 'unsafe-eval'.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Any]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

_READS = frozenset({"GET", "HEAD", "OPTIONS"})
_POLICY = "; ".join(
    (
        "default-src 'none'", "script-src 'self' 'unsafe-inline' 'unsafe-eval'", "style-src 'self' 'unsafe-inline'",
        "img-src 'self' data: blob:", "font-src 'self' data:", "connect-src 'self'", "base-uri 'none'",
        "form-action 'none'", "frame-ancestors 'none'",
    )
)  # fmt: skip
HEADERS = [
    (b"content-security-policy", _POLICY.encode()),
    (b"x-frame-options", b"DENY"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
]
REFUSED = b"refused: not from the page of this program; open the address that aircraft-sysid workbench has printed\n"


class SameOrigin:
    """ASGI application around another one that passes on what comes from its own page."""

    def __init__(self, app: App, host: str) -> None:
        self.app = app  # NiceGUI looks for its application here
        own = socket.gethostname().lower()
        self._names = {"localhost", host.lower(), own, f"{own}.local"}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request or websocket."""

        async def send_guarded(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                message = {**message, "headers": [*message.get("headers", ()), *HEADERS]}
            await send(message)

        if scope["type"] == "lifespan" or self.allows(scope):
            await self.app(scope, receive, send_guarded)
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1008})
        else:
            headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"content-length", b"%d" % len(REFUSED))]
            await send_guarded({"type": "http.response.start", "status": 403, "headers": headers})
            await send({"type": "http.response.body", "body": REFUSED})

    def allows(self, scope: Scope) -> bool:
        """Whether a request names this server as its host and, where it can write, as its origin too."""
        headers = {name.lower(): value.decode("latin-1") for name, value in scope["headers"]}
        host, origin = headers.get(b"host", ""), headers.get(b"origin")
        if not self._is_ours(host):
            return False
        writes = scope["type"] == "websocket" or scope["method"] not in _READS
        if origin is None:
            return not writes
        return origin in (f"http://{host}", f"https://{host}")

    def _is_ours(self, host: str) -> bool:
        """Whether a Host header is an address, or a name of this machine."""
        name = host.rpartition(":")[0] if host.rpartition(":")[2].isdigit() else host
        name = name.strip("[]").lower()
        if name in self._names:
            return True
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return False
        return True
