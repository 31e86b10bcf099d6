"""``njit`` for all kernels: numba's, compiled in half the time, with a cache that is always found and never stale.

See :mod:`trailmark.compiled.kernel` and :mod:`trailmark.compiled.cache`.
"""

# Tested by tests/compiled/test_kernel.py and, for functions that are chosen by type, by tests/motion/test_motion.py.
from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numba
from numba.core import event
from numba.extending import overload

from trailmark.compiled.kernel import Kernel, KernelCompiler
from trailmark.compiled.report import CompilingReport

__all__ = ["by_type", "njit", "variant_of"]

F = TypeVar("F", bound=Callable[..., Any])

if TYPE_CHECKING:
    from numba import njit as njit
else:

    def njit(cache: bool = False, **options: Any) -> Callable[[Callable[..., Any]], Any]:
        """Return numba's decorator ``njit`` with these options; ``cache=True`` caches as described above."""

        def compiled(function: Callable[..., Any]) -> Any:
            if numba.config.DISABLE_JIT:
                return function
            kernel = Kernel(function, targetoptions={"nopython": True, **options}, pipeline_class=KernelCompiler)
            if cache:
                kernel.enable_caching()
            return kernel

        return compiled


def by_type(function: F) -> F:
    """Return a function that compiled code and Python call alike, with a variant for each type of the first argument.

    The decorated function states arguments and result; it is never run. Its variants (:func:`variant_of`) are kernels,
    for first arguments that are named tuples. Compiled code chooses while it is compiled
    (``numba.extending.overload``), so that the choice costs nothing when it runs.
    """
    variants: dict[type, Any] = {}

    @wraps(function)
    def call(*arguments: Any) -> Any:
        return variants[type(arguments[0])](*arguments)

    @overload(call)
    def chosen(*arguments: Any) -> Any:
        kernel = variants[arguments[0].instance_class]

        def run(*arguments: Any) -> Any:
            return kernel(*arguments)

        # By the name numba tells compiled functions apart, also those of two processes.
        run.__module__, run.__qualname__ = function.__module__, f"{function.__qualname__}.run"
        return run

    choosing: Any = call
    choosing.variants = variants
    return cast(F, choosing)


def variant_of(function: Callable[..., Any], kind: type) -> Callable[[F], F]:
    """Return what makes a kernel the variant of a function (:func:`by_type`) for first arguments of a type."""

    def register(kernel: F) -> F:
        function.variants[kind] = kernel  # type: ignore[attr-defined]  # by_type puts it there
        return kernel

    return register


event.register("numba:compile", CompilingReport())
