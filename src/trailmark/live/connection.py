"""One client of the live page: its messages in, its answers out, and the thread in which they are found."""

from __future__ import annotations

import asyncio
import json
import math
import sys
import traceback
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from threading import Event
from time import monotonic
from typing import Any, Final, Protocol

from trailmark.errors import TrailmarkError
from trailmark.live.messages import Identity, Message, MessageError, read_message
from trailmark.live.session import Answer, Session

__all__ = ["Channel", "Connection"]

RATE, BURST = 200.0, 400.0
"""Messages a second, and at once: dragging sends two for each frame of a screen."""

MAX_WAITING: Final = 1000
"""Messages that wait: one that asks for more than is answered is told so."""

YIELD: Final = 0.01
"""Seconds that planning waits at most for a path to be sent, before it goes on to better it."""

MAX_UNSENT: Final = 20
"""Answers that a slow client has not taken yet, from which on paths that are not final are left out, and all else
waits: nobody is told more than he takes."""

ENDING = ("world", "edit", "plan", "replan", "stop")
"""What ends a plan: a newer one, and what changes the world that it is made in."""


class Channel(Protocol):
    """Where frames come from and go to."""

    async def receive(self) -> str | bytes | None:
        """Return the next frame; None once the other side is gone."""

    async def send(self, text: str) -> None:
        """Send a frame."""


class Connection:
    """Answers a client's messages until it goes away.

    Args:
        channel: to the client.
        session: makes what the client works on; ``tell`` sends an answer, from any thread.
    """

    def __init__(self, channel: Channel, session: Callable[[Callable[[Answer], None]], Session]) -> None:
        self._channel = channel
        self._loop = asyncio.get_running_loop()
        self._unsent: asyncio.Queue[Answer | None] = asyncio.Queue()
        self._session = session(self._tell)
        self._waiting: deque[Message] = deque()
        self._come = asyncio.Event()
        self._stop, self._sent = Event(), Event()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="trailmark-live")
        self._tokens, self._seen = BURST, monotonic()

    async def serve(self) -> None:
        """Answer messages until the client is gone; what is under way then is ended."""
        sender, worker = asyncio.create_task(self._send_all()), asyncio.create_task(self._work())
        try:
            while (frame := await self._channel.receive()) is not None:
                self._take(frame)
                # Refusals, too, are taken before there are more of them.
                await self._until_unsent(MAX_WAITING)
        finally:
            self._stop.set()
            worker.cancel()
            # What is under way ends in its own time; nobody waits for it.
            self._thread.shutdown(wait=False, cancel_futures=True)
            self._unsent.put_nowait(None)
            await asyncio.gather(sender, worker, return_exceptions=True)

    def _take(self, frame: str | bytes) -> None:
        """Put a message in its place."""
        try:
            message = self._understood(frame)
        except MessageError as error:
            self._refuse(error.id, str(error))
            return
        if message.type in ENDING:
            self._stop.set()
            superseded = [waiting for waiting in self._waiting if waiting.type in ("plan", "replan")]
            self._waiting = deque(waiting for waiting in self._waiting if waiting not in superseded)
            for waiting in superseded:
                self._tell(self._session.not_planned(waiting))
        if message.type != "stop":
            self._waiting.append(message)
            self._come.set()

    def _understood(self, frame: str | bytes) -> Message:
        """Return the message that a frame holds.

        Raises:
            MessageError: it holds none, or messages come faster than they are answered.
        """
        if isinstance(frame, bytes):
            raise MessageError(None, "message: expected a text frame, got a binary one")
        self._require_patience()
        message = read_message(frame)
        if len(self._waiting) >= MAX_WAITING:
            raise MessageError(message.id, f"expected at most {MAX_WAITING} messages that wait for an answer")
        return message

    def _require_patience(self) -> None:
        """Raise if more messages come than a screen can show."""
        now = monotonic()
        self._tokens = min(BURST, self._tokens + RATE * (now - self._seen))
        self._seen = now
        if self._tokens < 1.0:
            raise MessageError(None, f"expected at most {RATE:g} messages a second; this one was not read")
        self._tokens -= 1.0

    async def _work(self) -> None:
        """Answer what waits, one after the other, in a thread of its own."""
        while True:
            await self._until_unsent(MAX_UNSENT)
            if not self._waiting:
                self._come.clear()
                await self._come.wait()
                continue
            message, stop = self._waiting.popleft(), Event()
            self._stop = stop
            work = partial(self._session.handle, message, stop)
            await self._loop.run_in_executor(self._thread, self._answer, message, work)

    async def _until_unsent(self, most: int) -> None:
        """Wait until no more answers than that have not been taken."""
        await asyncio.sleep(0)  # what was told is in the queue after that
        while self._unsent.qsize() > most:
            await asyncio.sleep(YIELD)

    def _answer(self, message: Message, work: Callable[[], None]) -> None:
        try:
            work()
        except TrailmarkError as error:
            self._tell(_error(message.id, str(error)))
        except Exception as error:  # one message must not end the connection, whatever it does
            traceback.print_exc(file=sys.stderr)
            self._tell(_error(message.id, f"internal error: {type(error).__name__}: {error}"))

    def _refuse(self, identity: Identity, problem: str) -> None:
        self._tell(_error(identity, problem))

    def _tell(self, answer: Answer) -> None:
        self._sent.clear()
        self._loop.call_soon_threadsafe(self._unsent.put_nowait, answer)
        if answer.get("final") is False:
            # Else planning, which goes on, would keep the interpreter from sending it.
            self._sent.wait(YIELD)

    async def _send_all(self) -> None:
        while (answer := await self._unsent.get()) is not None:
            better_comes = answer["type"] == "path" and not answer["final"]
            if not better_comes or self._unsent.qsize() <= MAX_UNSENT:
                await self._channel.send(json_text(answer))
            self._sent.set()


def _error(identity: Identity, problem: str) -> Answer:
    return {"type": "error", "id": identity, "message": problem}


def json_text(answer: Answer) -> str:
    """Return an answer as JSON, which knows no infinity."""
    try:
        return json.dumps(answer, allow_nan=False, separators=(",", ":"))
    except ValueError:
        return json.dumps(_finite(answer), allow_nan=False, separators=(",", ":"))


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
