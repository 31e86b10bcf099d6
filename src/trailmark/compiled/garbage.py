"""Garbage collection that waits: it looks at millions of numba's objects again and again while they are needed."""

# Tested by tests/compiled/test_garbage.py.
from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["collection_waits"]


@contextmanager
def collection_waits() -> Iterator[None]:
    """Do not collect garbage meanwhile, a fifth of the time that compiling takes; to be entered by one thread alone."""
    before = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if before:
            gc.enable()
