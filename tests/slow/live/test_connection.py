from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from threading import Event
from typing import Any

import pytest

from trailmark.live import connection
from trailmark.live.connection import MAX_UNSENT, MAX_WAITING, Connection
from trailmark.live.messages import Message
from trailmark.live.session import Session


class SlowClient:
    """A channel whose client sends what it likes, and takes no answer before it is told to."""

    def __init__(self) -> None:
        self.frames, self.takes = asyncio.Queue[str | None](), asyncio.Event()
        self.taken: list[dict[str, Any]] = []
        self.read = 0

    async def receive(self) -> str | None:
        frame = await self.frames.get()
        self.read += 1
        return frame

    async def send(self, text: str) -> None:
        await self.takes.wait()
        self.taken.append(json.loads(text))


class EchoSession:
    """Answers each message, a plan by paths that get better."""

    world = None

    def __init__(self, tell: Callable[[dict[str, Any]], None]) -> None:
        self.tell, self.handled, self.planned = tell, 0, Event()

    def handle(self, message: Message, _stop: object) -> None:
        self.handled += 1
        if message.type == "plan":
            for _ in range(3 * MAX_UNSENT):
                self.tell({"type": "path", "id": message.id, "final": False})
            self.tell({"type": "path", "id": message.id, "final": True})
            self.planned.set()
        else:
            self.tell({"type": "world", "id": message.id})


async def at_rest(count: Callable[[], int]) -> int:
    """Return a count once it has stayed the same for a while."""
    last, same = -1, 0
    while same < 10:
        now = count()
        last, same = now, same + 1 if now == last else 0
        await asyncio.sleep(0.02)
    return last


def meet(story: Callable[[SlowClient, list[EchoSession]], Any]) -> None:
    """Run a client's story with a connection, which ends with it."""

    async def run() -> None:
        client, sessions = SlowClient(), list[EchoSession]()

        def session(tell: Callable[[dict[str, Any]], None]) -> Session:
            sessions.append(EchoSession(tell))
            return sessions[-1]  # type: ignore[return-value]  # stands for one

        serving = asyncio.create_task(Connection(client, session).serve())
        await asyncio.wait_for(story(client, sessions), 60.0)
        client.takes.set()
        client.frames.put_nowait(None)
        await asyncio.wait_for(serving, 30.0)

    asyncio.run(run())


@pytest.fixture(autouse=True)
def _without_a_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "BURST", 1e9)


def test_one_who_takes_no_answers_is_not_answered_for_ever() -> None:
    async def story(client: SlowClient, sessions: list[EchoSession]) -> None:
        count = 5 * MAX_WAITING
        for i in range(count):
            client.frames.put_nowait(json.dumps({"type": "hello", "id": i}))
        assert await at_rest(lambda: sessions[0].handled) <= MAX_UNSENT + 2
        assert client.read <= 2 * MAX_WAITING + MAX_UNSENT + 10
        # Once answers are taken, each message gets its own.
        client.takes.set()
        while len(client.taken) < count:
            await asyncio.sleep(0.01)
        assert sorted(answer["id"] for answer in client.taken) == list(range(count))

    meet(story)


def test_paths_that_are_not_the_last_are_left_out() -> None:
    async def story(client: SlowClient, sessions: list[EchoSession]) -> None:
        client.frames.put_nowait(json.dumps({"type": "plan", "id": 1, "start": [], "goal": []}))
        while not sessions[0].planned.is_set():
            await asyncio.sleep(0.01)
        client.takes.set()
        while not any(answer["final"] for answer in client.taken):
            await asyncio.sleep(0.01)
        assert len(client.taken) < 3 * MAX_UNSENT

    meet(story)
