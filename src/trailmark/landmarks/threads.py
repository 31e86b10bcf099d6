"""One thread for scikit-learn, so that the same seed gives the same centres."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

__all__ = ["one_thread"]


def one_thread() -> AbstractContextManager[object]:
    """Return a context in which scikit-learn computes in one thread.

    With more threads its sums are rounded in an order that changes from run to run.
    """
    context: AbstractContextManager[object] = _thread_pools().limit(limits=1)
    return context


@lru_cache(maxsize=1)
def _thread_pools() -> Any:
    import sklearn.cluster  # noqa: F401  # loads the thread pools that the controller then finds
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
