"""Signals while kernels are compiled: handlers are called when numba's tables are whole again."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from types import FrameType
from typing import Any

import pytest
from numba.core import event

from trailmark.compiled import njit
from trailmark.compiled.signals import signals_wait


@pytest.fixture
def called() -> Iterator[list[int]]:
    """The signals for which this test's handler of SIGUSR1 and SIGUSR2 was called, which raises KeyboardInterrupt."""
    numbers: list[int] = []

    def handler(number: int, frame: FrameType | None) -> None:
        numbers.append(number)
        raise KeyboardInterrupt

    before = {number: signal.signal(number, handler) for number in (signal.SIGUSR1, signal.SIGUSR2)}
    yield numbers
    for number, old in before.items():
        signal.signal(number, old)


def test_a_handler_is_called_once_what_must_not_be_interrupted_has_ended(called: list[int]) -> None:
    handler, ended = signal.getsignal(signal.SIGUSR1), []

    def run() -> None:
        with signals_wait():
            signal.raise_signal(signal.SIGUSR1)
            assert called == []
            ended.append(True)

    with pytest.raises(KeyboardInterrupt):
        run()
    assert ended
    assert called == [signal.SIGUSR1]
    assert signal.getsignal(signal.SIGUSR1) is handler


def test_a_second_signal_of_a_kind_does_not_wait(called: list[int]) -> None:
    handler = signal.getsignal(signal.SIGUSR1)

    def run() -> None:
        with signals_wait():
            signal.raise_signal(signal.SIGUSR1)
            signal.raise_signal(signal.SIGUSR1)
            pytest.fail("the second one waited")

    with pytest.raises(KeyboardInterrupt):
        run()
    assert called == [signal.SIGUSR1] * 2  # the second at once, the first at the end
    assert signal.getsignal(signal.SIGUSR1) is handler


def test_an_error_and_a_signal_leave_the_handlers_as_they_were(called: list[int]) -> None:
    handlers = [signal.getsignal(number) for number in sorted(signal.valid_signals())]

    def run() -> None:
        with signals_wait():
            signal.raise_signal(signal.SIGUSR2)
            raise ValueError("an error of the compiler")

    with pytest.raises(KeyboardInterrupt) as raised:
        run()
    assert isinstance(raised.value.__context__, ValueError)
    assert [signal.getsignal(number) for number in sorted(signal.valid_signals())] == handlers


def test_other_threads_run_no_handlers_and_change_none() -> None:
    handler = signal.getsignal(signal.SIGINT)
    seen = []

    def run() -> None:
        with signals_wait():
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert seen == [handler]


def test_an_interrupt_leaves_a_kernel_and_those_that_it_calls_compiled(
    called: list[int],
) -> None:
    @njit()
    def inner(x: float) -> float:
        return 2.0 * x

    @njit()
    def outer(x: float) -> float:
        return float(inner(x) + 1.0)

    class Interrupting(event.Listener):  # type: ignore[misc,unused-ignore]  # numba ships types in part
        def on_start(self, event: Any) -> None:
            if event.data["dispatcher"] is inner:
                signal.raise_signal(signal.SIGUSR1)

        def on_end(self, event: Any) -> None:
            pass

    with event.install_listener("numba:compile", Interrupting()), pytest.raises(KeyboardInterrupt):
        outer(3.0)
    assert called == [signal.SIGUSR1]
    kernel: Any = outer
    assert len(kernel.signatures) == 1
    assert outer(3.0) == 7.0
    assert len(kernel.signatures) == 1
