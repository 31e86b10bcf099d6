"""The live page's server: one page, one WebSocket, nothing else."""

from __future__ import annotations

import asyncio
import base64
import hashlib
import ipaddress
import secrets
import socket
import sys
from collections.abc import Callable, Mapping
from html import escape
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from trailmark import shown as colours
from trailmark.errors import ConfigurationError
from trailmark.live.connection import Connection
from trailmark.live.messages import MAX_BYTES
from trailmark.live.session import Session
from trailmark.world import World
from trailmark.world.robot import Robot

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.requests import HTTPConnection
    from starlette.websockets import WebSocket

__all__ = ["is_loopback", "listen", "live_app", "page_of", "refusal", "serve"]

MAX_CLIENTS = 16
"""At a time: each has a planner of its own."""

SWITCH = 0.0005
"""Seconds after which a thread that waits is let to its turn; Python's own 5 ms are a third of a screen's frame."""

CLOSED, BUSY = 1008, 1013
"""Why a connection is closed (RFC 6455, section 7.4, and its registry): not allowed; try again later."""


def live_app(world: World, robot: Robot, token: str | None = None, seed: int = 0) -> Starlette:
    """Return the page and its WebSocket as an application for any ASGI server.

    Args:
        world: that each client begins with.
        robot: that moves in it.
        token: that has to be known; None if none, and then only this machine is answered.
        seed: of the planners.
    """
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import PlainTextResponse, Response
    from starlette.routing import Route, WebSocketRoute

    page, policy = page_of(world.name)
    headers = {
        "Content-Security-Policy": policy,
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cache-Control": "no-store",
    }
    clients = set[Connection]()

    async def show(request: Request) -> Response:
        if (problem := _refusal(request, token)) is not None:
            return PlainTextResponse(problem + "\n", status_code=403)
        return Response(page, media_type="text/html; charset=utf-8", headers=headers)

    async def talk(websocket: WebSocket) -> None:
        if (problem := _refusal(websocket, token)) is not None:
            await websocket.close(CLOSED, problem[:100])
            return
        await websocket.accept()
        if len(clients) >= MAX_CLIENTS:
            await websocket.close(BUSY, f"expected at most {MAX_CLIENTS} clients")
            return
        connection = Connection(_Channel(websocket), lambda tell: Session(world, robot, tell, seed))
        clients.add(connection)
        try:
            await connection.serve()
        finally:
            clients.discard(connection)

    return Starlette(routes=[Route("/", show), WebSocketRoute("/ws", talk)])


def listen(host: str, port: int, token: str | None) -> socket.socket:
    """Return a socket that listens.

    Raises:
        ConfigurationError: the address cannot be listened at, or it is not this machine's alone and there is no token.
    """
    if token is None and not is_loopback(host):
        raise ConfigurationError(f"--host: expected a loopback address, or --token with it, got {host!r}")
    try:
        listening = socket.create_server((host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET)
    except OSError as error:
        raise ConfigurationError(f"expected an address that is free, got {host}:{port} ({error.strerror})") from None
    # Connections inherit it: else a path waits up to 40 ms until the one before is acknowledged (Nagle's algorithm).
    listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listening


def serve(app: Starlette, listening: socket.socket, on_ready: Callable[[], None]) -> None:
    """Serve until Ctrl-C.

    Args:
        app: :func:`live_app`.
        listening: :func:`listen`.
        on_ready: called once clients are answered.
    """
    import uvicorn

    config = uvicorn.Config(
        app,
        ws="websockets-sansio",
        # One that is a little too long is told so; one that is far too long ends its connection.
        ws_max_size=4 * MAX_BYTES,
        log_level="warning",
        access_log=False,
        lifespan="off",
        timeout_graceful_shutdown=2,
    )

    class Server(uvicorn.Server):
        async def startup(self, sockets: list[socket.socket] | None = None) -> None:
            await super().startup(sockets)
            on_ready()

    # Planning in one thread must not keep messages from being read in another.
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH)
    try:
        asyncio.run(Server(config).serve([listening]))
    finally:
        sys.setswitchinterval(before)


def _refusal(request: HTTPConnection, token: str | None) -> str | None:
    return refusal(request.headers, token, request.query_params.get("token"))


class _Channel:
    """A WebSocket's frames."""

    def __init__(self, websocket: WebSocket) -> None:
        self._websocket = websocket

    async def receive(self) -> str | bytes | None:
        message: dict[str, Any] = dict(await self._websocket.receive())
        if message["type"] == "websocket.disconnect":
            return None
        text: str | None = message.get("text")
        return message["bytes"] if text is None else text

    async def send(self, text: str) -> None:
        from starlette.websockets import WebSocketDisconnect

        try:
            await self._websocket.send_text(text)
        except (WebSocketDisconnect, RuntimeError):
            # It is gone; what receives notices it, too.
            return


def is_loopback(host: str) -> bool:
    """Return whether a host is this machine alone."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def refusal(headers: Mapping[str, str], token: str | None, given: str | None) -> str | None:
    """Return why a request is refused; None if it is not.

    A page of another origin, to which a browser would hand what is told here, is refused by its Origin. A name that was
    made to lead to this machine (DNS rebinding) is refused where no token is asked for.

    Args:
        headers: of the request, names in small letters.
        token: that has to be known; None if none.
        given: the request's own.
    """
    host, origin = headers.get("host", ""), headers.get("origin")
    name = urlsplit(f"//{host}").hostname
    if name is None:
        return "expected a Host header"
    if token is None and not is_loopback(name):
        return f"expected this machine by its loopback address, got the host {name!r}"
    if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
        return f"expected a page of {host}, got one of {origin}"
    if token is not None and not secrets.compare_digest(token.encode(), (given or "").encode()):
        return "expected the token (?token=...)"
    return None


SCRIPTS = "geometry.js", "view.js", "scene.js", "link.js", "page.js"
"""In the order in which they build on each other."""


def page_of(name: str) -> tuple[str, str]:
    """Return the page and its Content-Security-Policy.

    Args:
        name: of the world that it begins with.
    """
    folder = Path(__file__).parent / "assets"
    script = "\n".join((folder / file).read_text(encoding="utf-8") for file in SCRIPTS)
    parts = {"title": escape(f"{name} · trailmark live"), "script": script}
    parts |= {color: getattr(colours, color) for color in ("MARGIN", "OBSTACLE", "PATH", "GOAL", "START")}
    page = Template((folder / "page.html").read_text(encoding="utf-8")).substitute(parts)
    digest = base64.b64encode(hashlib.sha256(f"\n{script}\n".encode()).digest()).decode()
    policy = (
        f"default-src 'none'; script-src 'sha256-{digest}'; style-src 'unsafe-inline'; img-src data: blob:; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    return page, policy
