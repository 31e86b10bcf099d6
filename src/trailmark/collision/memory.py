"""Blocks: memory for versions of the same arrays, used again once nobody holds any array of a version."""

from __future__ import annotations

import math
import weakref
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from trailmark.lock import Lock

__all__ = ["Blocks"]

ALIGNMENT = 64
"""Bytes: where arrays begin in a block."""


class Blocks:
    """Memory for versions of a set of arrays, all of them in one block.

    To allocate memory for a new version takes longer than to change it: the system hands out pages one by one, and all
    the arrays are copied. A block of an older version is free as soon as no array, and no view of one, is referenced
    any more; it still holds that version's content, of which only a part is out of date. Threads may share the object.

    Args:
        arrays: of the first version: their shapes and types are those of all versions.
    """

    def __init__(self, arrays: Sequence[NDArray[Any]]) -> None:
        self._kinds: list[tuple[int, int, tuple[int, ...], DTypeLike]] = []
        self._size = 0
        for array in arrays:
            self._kinds.append((self._size, array.nbytes, array.shape, array.dtype))
            self._size += math.ceil(array.nbytes / ALIGNMENT) * ALIGNMENT
        self._used: list[tuple[bytearray, weakref.ref[NDArray[np.uint8]], object]] = []
        self._lock = Lock()

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_used": []}

    def take(self, version: object, wanted: Sequence[object]) -> tuple[list[NDArray[Any]], object | None]:
        """Return arrays for a new version, and the version whose content they hold; None if it is none of the wanted.

        Args:
            version: stands for the new version.
            wanted: versions whose content would be useful, the most useful first.
        """
        with self._lock:
            free = [entry for entry in self._used if entry[1]() is None]
            self._used = [entry for entry in self._used if entry[1]() is not None]
            # The newest of the others stays for the next time; more are never needed at once.
            free.sort(key=lambda entry: wanted.index(entry[2]) if entry[2] in wanted else len(wanted))
            block, _, content = free[0] if free else (bytearray(self._size), None, None)
            self._used += free[1:2]
            root = np.frombuffer(block, np.uint8)
            self._used.append((block, weakref.ref(root), version))
        # All views of these arrays hold ``root`` itself: numpy names as base what is no array's view.
        arrays = [root[at : at + size].view(kind).reshape(shape) for at, size, shape, kind in self._kinds]
        return arrays, content if content in wanted else None
