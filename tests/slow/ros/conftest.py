from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest


def pytest_itemcollected(item: pytest.Item) -> None:
    """Try tests of the node again: the middleware now and then loses an answer or a goal while the machine is busy."""
    item.add_marker(pytest.mark.flaky(reruns=2))


@pytest.fixture(scope="session")
def shared() -> Iterator[Any]:
    from tests.slow.ros.support import SQUARE, Client, name_space, running

    space = name_space()
    with running(space, footprint=f"'{SQUARE}'", path_spacing=0.05) as process:
        client = Client(space)
        client.process = process
        yield client
        client.close()


@pytest.fixture
def client(shared: Any) -> Iterator[Any]:
    """A client of the node that all tests share, which plans for a rectangle in the two rooms."""
    from tests.slow.ros.support import SQUARE, room

    if shared.changed:
        shared.set(footprint=SQUARE, motion_model="omnidirectional", time_limit=1.0)
    shared.changed = False
    shared.show(room())
    before = len(shared.process.said())
    yield shared
    said = shared.process.said()[before:]
    assert shared.process.process.poll() is None, said
    assert "Traceback" not in said, said[said.find("Traceback") :][:3000]
