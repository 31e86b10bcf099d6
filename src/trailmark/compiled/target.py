"""The target that kernels are compiled for: the processor, with numba's own functions compiled as kernels are.

What numba brings for ``np.empty``, ``min`` and the like is compiled for each type that they are called with, and made
machine code of, which nobody calls: callers contain their code.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any, cast

from numba.core import types
from numba.core.target_extension import CPU, dispatcher_registry, jit_registry, target_override, target_registry
from numba.extending import overload
from numba.np import arrayobj

__all__ = ["KernelTarget", "for_kernels", "register"]

NAME = "trailmark"


class KernelTarget(CPU):  # type: ignore[misc,unused-ignore]  # numba ships types in part
    """The processor, with what is said here in place of what numba has for it."""


target_registry[NAME] = KernelTarget


def register(dispatcher: type, decorate: Callable[..., Any]) -> None:
    """Say what compiles numba's own functions for this target: a class of dispatchers, and a decorator like ``jit``."""
    dispatcher_registry[KernelTarget] = dispatcher
    jit_registry[KernelTarget] = decorate


def for_kernels() -> AbstractContextManager[None]:
    """Return a context in which this thread compiles for this target, also what numba asks for while it makes code."""
    return cast("AbstractContextManager[None]", target_override(NAME))


def _refuse_shapes(source: Any, target: Any) -> Any:
    """Refuse an array that does not fit the slice that it is assigned to.

    Numba's own says which shapes, for which it compiles 40 functions of texts, 4 seconds altogether.
    """
    if isinstance(source, types.UniTuple) and isinstance(target, types.UniTuple):

        def refuse(source: Any, target: Any) -> None:
            raise ValueError("expected an array as long as the slice that it is assigned to, got another length")

        return refuse
    return None


if hasattr(arrayobj, "raise_with_shape_context"):
    overload(arrayobj.raise_with_shape_context, target=NAME, strict=False)(_refuse_shapes)
