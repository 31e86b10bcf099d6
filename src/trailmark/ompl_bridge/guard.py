"""Errors and Ctrl-C while OMPL plans: stored until it has ended, then raised.

An exception must not pass through OMPL's C++: PRM aborts the process on one. So callbacks catch everything, store the
first error and ask the planning to end. Python raises KeyboardInterrupt wherever it happens to be, even at a
callback's first instruction, before any ``try``; while OMPL plans, a handler of our own only stores it. What ignores
the termination condition (OMPL's path simplifier, or a planner started with another condition) would continue until
its time is up, so a second Ctrl-C is raised at once, through OMPL. It leaves OMPL's objects in an unknown state, and
PRM and PRMstar of OMPL 2.0 abort the process on it.
"""

from __future__ import annotations

import signal
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from types import FrameType
from typing import Any

from ompl import base as ob
from ompl import geometric as og

from trailmark.arguments import number

__all__ = ["caught", "planning", "returns_on_error", "solve"]


class _Session:
    """One planning in progress: its thread, how to end it, and its first error."""

    def __init__(self, condition: Any) -> None:
        self.thread = threading.get_ident()
        self.condition = condition
        self.error: BaseException | None = None
        self.interrupts = 0

    def fail(self, error: BaseException) -> None:
        if self.error is None:
            self.error = error
        if self.condition is not None:
            self.condition.terminate()

    def interrupted(self, number: int, frame: FrameType | None) -> None:
        self.interrupts += 1
        if self.interrupts > 1:
            raise KeyboardInterrupt
        self.fail(KeyboardInterrupt())


_sessions: list[_Session] = []


def caught(error: BaseException) -> None:
    """Store an error in a callback: the planning ends and the error is raised where it was started.

    Where it was started neither by :func:`solve` nor within :func:`planning`, the error becomes a warning.

    Raises:
        KeyboardInterrupt: the second Ctrl-C.
    """
    mine = [session for session in _sessions if session.thread == threading.get_ident()]
    for session in (mine or _sessions)[-1:]:
        if session.interrupts > 1:
            raise KeyboardInterrupt from error
        session.fail(error)
        return
    try:
        warnings.warn(
            f"a callback failed while OMPL planned: {error!r}; plan with trailmark.ompl_bridge.solve to have it raised",
            RuntimeWarning,
            stacklevel=3,
        )
    except RuntimeWarning:
        # A warning that is raised as an error must not pass through OMPL's C++ either.
        return


def returns_on_error(value: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return a decorator for callbacks: an error in one goes to :func:`caught`, and ``value`` to OMPL."""

    def decorate(callback: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(callback)
        def call(*arguments: Any) -> Any:
            try:
                return callback(*arguments)
            except BaseException as error:  # nothing may pass through OMPL's C++
                caught(error)
                return value

        return call

    return decorate


@contextmanager
def planning(condition: Any = None) -> Iterator[None]:
    """Raise the first error of a callback, or a Ctrl-C, at the end of the block in which OMPL plans.

    A second Ctrl-C within the block is raised at once.

    Args:
        condition: the ``PlannerTerminationCondition`` of the planning; without one, it ends by itself.
    """
    session = _Session(condition)
    before = signal.getsignal(signal.SIGINT)
    # Only a handler in Python makes Ctrl-C an exception; a program that ignores Ctrl-C continues to do so.
    main = threading.current_thread() is threading.main_thread() and callable(before)
    if main:
        signal.signal(signal.SIGINT, session.interrupted)
    _sessions.append(session)
    try:
        yield
    finally:
        _sessions.remove(session)
        if main:
            signal.signal(signal.SIGINT, before)
    if session.error is not None:
        raise session.error


def solve(setup: Any, limit: Any = 1.0) -> Any:
    """Run ``setup.solve`` and return its status; an error in a callback, or Ctrl-C, ends it and is raised.

    Args:
        setup: a ``SimpleSetup`` with any of trailmark's parts in it.
        limit: seconds, or a ``PlannerTerminationCondition``.

    Raises:
        ConfigurationError: neither.
    """
    condition = limit
    if not isinstance(limit, ob.PlannerTerminationCondition):
        condition = ob.timedPlannerTerminationCondition(number(limit, "limit:", minimum=0.0, unit="s"))
    with planning(condition):
        return og.SimpleSetup.solve(setup, condition)
