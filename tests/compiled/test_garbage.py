"""Garbage collection while kernels are compiled: it waits, and goes on as it was."""

from __future__ import annotations

import gc
from collections.abc import Iterator

import pytest
from numba.core import event

from trailmark.compiled import njit
from trailmark.compiled.garbage import collection_waits


@pytest.fixture(autouse=True)
def _collection_as_it_was() -> Iterator[None]:
    before = gc.isenabled()
    yield
    (gc.enable if before else gc.disable)()


@pytest.mark.parametrize("collecting", [True, False])
def test_afterwards_it_goes_on_as_before_also_after_an_exception(collecting: bool) -> None:
    (gc.enable if collecting else gc.disable)()
    seen = []

    def interrupted() -> None:
        with collection_waits():
            seen.append(gc.isenabled())
            with collection_waits():
                pass
            seen.append(gc.isenabled())
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert seen == [False, False]
    assert gc.isenabled() == collecting


def test_no_garbage_is_collected_while_a_kernel_is_compiled() -> None:
    class Seen(event.Listener):  # type: ignore[misc,unused-ignore]  # numba ships types in part
        def on_start(self, event: object) -> None:
            collecting.append(gc.isenabled())

        def on_end(self, event: object) -> None:
            collecting.append(gc.isenabled())

    @njit()
    def inner(x: float) -> float:
        return x + 1.0

    @njit()
    def outer(x: float) -> float:
        return 2.0 * inner(x)

    collecting: list[bool] = []
    gc.enable()
    with event.install_listener("numba:compile", Seen()):
        assert outer(1.0) == 4.0
    assert collecting
    assert not any(collecting)
    assert gc.isenabled()
