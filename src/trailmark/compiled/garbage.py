"""Garbage collection that waits: it looks at millions of numba's objects again and again while they are needed."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["collection_waits"]


@contextmanager
def collection_waits() -> Iterator[None]:
    """Collect no garbage meanwhile, which saves a tenth of compiling; only one thread at a time may be in it."""
    before = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if before:
            gc.enable()
