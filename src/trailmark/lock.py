"""Lock: what threads that share an object take turns by, and what copies of the object do not share."""

# Tested by tests/planning/test_pickle.py.
from __future__ import annotations

from _thread import RLock

__all__ = ["Lock"]


class Lock(RLock):  # type: ignore[misc]  # final in its stub alone
    """A reentrant lock, of which a copy, by pickle too, is a new one that nobody holds.

    No wrapper: between a wrapper's methods an exception could arrive that leaves the lock held for ever.
    """

    def __reduce__(self) -> tuple[type[Lock], tuple[()]]:
        return Lock, ()
