"""Ctrl-C, kept until what is under way is done."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

__all__ = ["postponed_interrupts"]


@contextmanager
def postponed_interrupts() -> Iterator[Callable[[], bool]]:
    """Yield a function that says whether Ctrl-C was pressed, which interrupts nothing; a second one does as before.

    An interrupt between any two lines would leave the map and the planner's world at odds. In threads other than the
    main one, which Ctrl-C never interrupts, the function always says no.
    """
    received = list[int]()
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    # SIGTERM likewise where somebody made an exception of it, as the shell command does; else it ends the process.
    before = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)}
    handlers = {n: handler for n, handler in before.items() if callable(handler)}

    def receive(number: int, frame: FrameType | None) -> None:
        received.append(number)
        if len(received) > 1:
            handlers[signal.Signals(number)](number, frame)

    for number in handlers:
        signal.signal(number, receive)
    try:
        yield lambda: bool(received)
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
