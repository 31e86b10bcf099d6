"""The live page's server: one page, one WebSocket, nothing else."""

from __future__ import annotations

import asyncio
import socket
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from trailmark.errors import ConfigurationError
from trailmark.live.access import is_loopback, refusal
from trailmark.live.connection import Connection
from trailmark.live.messages import MAX_BYTES
from trailmark.live.page import page_of
from trailmark.live.session import Session
from trailmark.robot import Robot
from trailmark.world import World

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.requests import HTTPConnection
    from starlette.websockets import WebSocket

__all__ = ["listen", "live_app", "serve"]

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
