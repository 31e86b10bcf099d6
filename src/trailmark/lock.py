"""Lock: what threads that share an object take turns by, and what copies of the object do not share."""

from __future__ import annotations

import os
from _thread import RLock
from weakref import WeakSet

__all__ = ["Lock"]

_all: WeakSet[Lock] = WeakSet()


class Lock(RLock):  # type: ignore[misc]  # final in its stub alone
    """A reentrant lock; copies, by pickle too, are new ones, and in a forked process nobody holds it.

    What locks guard is left sound by an exception at any place, hence by a fork too. No wrapper: between a wrapper's
    methods an exception could arrive that leaves the lock held for ever.
    """

    def __init__(self) -> None:
        _all.add(self)

    def __reduce__(self) -> tuple[type[Lock], tuple[()]]:
        return Lock, ()


def _renew_all() -> None:
    for lock in _all:
        # As the standard library renews its own; there is no other way, and stubs do not know this one.
        lock._at_fork_reinit()  # type: ignore[attr-defined]


os.register_at_fork(after_in_child=_renew_all)
