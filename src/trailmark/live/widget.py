"""The live page in a notebook: an anywidget whose messages go by the notebook's comm in place of a WebSocket."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from functools import cache, partial
from pathlib import Path as FilePath
from threading import Thread
from typing import TYPE_CHECKING, Any, Final

from trailmark.arguments import whole
from trailmark.errors import ConfigurationError
from trailmark.live.connection import Connection
from trailmark.live.page import page_of
from trailmark.live.session import Session

if TYPE_CHECKING:
    from trailmark.path import Path
    from trailmark.world import Robot, World

try:
    import anywidget
    import traitlets
except ModuleNotFoundError as error:
    problem = f"world.live() needs {error.name}: pip install 'trailmark[notebook]'"
    raise ConfigurationError(problem) from None

__all__ = ["LiveWidget"]

MAX_VIEWS: Final = 16
"""Of one widget: each has a planner of its own."""

LOWEST: Final = 200
"""Pixels, below which a page cannot be read."""


class LiveWidget(anywidget.AnyWidget):
    """A world as a live page in a notebook; where no kernel runs, its picture.

    Args:
        world: to begin with.
        robot: that moves in it; by default the world's own.
        height: of the page, pixels.
        seed: of the planners.

    Raises:
        ConfigurationError: there is no robot, or an argument is out of range.
    """

    _esm = FilePath(__file__).parent / "assets" / "widget.js"
    page = traitlets.Unicode().tag(sync=True)
    picture = traitlets.Unicode().tag(sync=True)
    height = traitlets.Int().tag(sync=True)

    def __init__(self, world: World, robot: Robot | None = None, *, height: int = 640, seed: int = 0) -> None:
        body = robot or world.robot
        if body is None:
            raise ConfigurationError(f"live: expected a robot, for world {world.name!r} names none")
        height, self._seed = whole(height, "live: height:", LOWEST), whole(seed, "live: seed:", 0)
        self._first, self._robot = world.with_robot(body), body
        self._last: Session | None = None
        self._channels: dict[str, _Channel] = {}
        self._serving: set[asyncio.Task[None]] = set()
        picture = self._first._repr_svg_()
        super().__init__(page=page_of(world.name)[0], picture=picture, height=height)
        self.on_msg(self._hear)

    @property
    def world(self) -> World:
        """The world as it was last changed on the page, with what was last asked for as its query."""
        if self._last is None:
            return self._first
        world, query = self._last.world, self._last.query
        return world if query is None else replace(world, queries=(query,))

    @property
    def path(self) -> Path | None:
        """The path that was last found there; None if there is none."""
        return None if self._last is None else self._last.path

    def close(self) -> None:
        """Take the widget away, and end what is under way."""
        _loop().call_soon_threadsafe(self._end)
        super().close()

    def _repr_mimebundle_(self, **options: Any) -> Any:
        """Return the widget, and its picture for those who show no widgets."""
        data, metadata = super()._repr_mimebundle_(**options) or ({}, {})
        return {**data, "image/svg+xml": self.picture, "text/plain": repr(self.world)}, metadata

    def _hear(self, _widget: Any, content: Any, _buffers: Any) -> None:
        """Take a message of the page; called in the kernel's thread."""
        if isinstance(content, dict) and isinstance(view := content.get("view"), str):
            _loop().call_soon_threadsafe(self._pass_on, view, content.get("frame"))

    def _pass_on(self, view: str, frame: Any) -> None:
        """Give a view's frame to its connection, which is made for the first; None ends it."""
        channel = self._channels.get(view)
        if channel is None:
            if not isinstance(frame, str) or len(self._channels) >= MAX_VIEWS:
                return
            channel = self._channels[view] = _Channel(partial(self._tell, view))
            serving = _loop().create_task(Connection(channel, self._begin).serve())
            self._serving.add(serving)
            serving.add_done_callback(self._serving.discard)
        if frame is None:
            del self._channels[view]
        channel.frames.put_nowait(frame)

    def _begin(self, tell: Any) -> Session:
        """Return a view's session: it goes on where the last one is."""
        self._last = Session(self.world, self.world.robot or self._robot, tell, self._seed)
        return self._last

    def _tell(self, view: str, frame: str) -> None:
        self.send({"view": view, "frame": frame})

    def _end(self) -> None:
        for channel in self._channels.values():
            channel.frames.put_nowait(None)
        self._channels.clear()


class _Channel:
    """One view's frames."""

    def __init__(self, tell: Any) -> None:
        self.frames = asyncio.Queue[str | bytes | None]()
        self._tell = tell

    async def receive(self) -> str | bytes | None:
        return await self.frames.get()

    async def send(self, text: str) -> None:
        self._tell(text)


@cache
def _loop() -> asyncio.AbstractEventLoop:
    """Return the loop that all widgets' connections run in: a kernel's own is busy while a cell runs."""
    loop = asyncio.new_event_loop()
    Thread(target=loop.run_forever, name="trailmark-widgets", daemon=True).start()
    return loop
