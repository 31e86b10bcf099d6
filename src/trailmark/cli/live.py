"""``trailmark live``: a world in the browser, whose certified path follows the dragged objects."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from importlib.util import find_spec
from typing import Annotated
from urllib.parse import quote

from trailmark.cli import console, options
from trailmark.cli.options import Kind, UsageError, argument, flag, option

__all__ = ["live"]


def _token(text: str) -> str:
    if not (text.isascii() and text.isprintable() and 8 <= len(text) <= 200):
        raise ValueError
    return text


TOKEN = Kind("TEXT", "8 to 200 letters, digits and signs", _token)
"""A secret in an address."""


def live(
    world: Annotated[str, argument("WORLD", "World file, as for plan, or name of a shipped world.")] = "office",
    robot: options.RobotOption = None,
    host: Annotated[
        str, option(Kind("ADDRESS"), "Address to listen on; other than this machine it needs --token.")
    ] = "127.0.0.1",
    port: Annotated[int, option(options.Count(high=65535), "Port to listen on; 0 picks a free one.")] = 8765,
    token: Annotated[
        str | None, option(TOKEN, "Secret that the browser must send; part of the printed address.")
    ] = None,
    no_browser: Annotated[bool, flag("--no-browser", "Print the address without opening a browser.")] = False,
    seed: options.SeedOption = 0,
    unknown: options.UnknownOption = None,
) -> None:
    """Open a world in the browser, where start, goal and obstacles can be dragged.

    Prints one line with the address once it listens; Ctrl-C ends it. Needs the extra 'live'.
    """
    if not all(map(find_spec, ("starlette", "uvicorn", "websockets"))):
        raise UsageError("trailmark live needs starlette, uvicorn and websockets: pip install 'trailmark[live]'")
    from trailmark.live.server import listen, live_app, serve
    from trailmark.planning import LandmarkPlanner

    with listen(host, port, token) as listening:
        with console.progress("loading") as progress:
            loaded = options.load_world(world, unknown)
            body = options.robot_of(loaded, robot)
            progress.stage("preparing (compiles on first use)")
            # Loads the kernels, and reports errors of the world before the first request.
            LandmarkPlanner(loaded, body, seed=seed)
        address = f"http://{f'[{host}]' if ':' in host else host}:{listening.getsockname()[1]}/"
        if token is not None:
            address += f"?token={quote(token, safe='')}"

        def ready() -> None:
            console.say(f"trailmark live: {loaded.name} at {address} (Ctrl-C ends it)")
            sys.stdout.flush()
            if not no_browser:
                _open(address)

        with suppress(KeyboardInterrupt):
            serve(live_app(loaded, body, token, seed), listening, ready)


def _open(address: str) -> None:
    """Open the address in a browser, if there is one with a window."""
    import webbrowser

    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY") and not os.environ.get("WAYLAND_DISPLAY"):
        return
    webbrowser.open(address)
