"""``njit`` for all kernels: numba's, compiled in half the time, with a cache that is always found and never stale.

See :mod:`trailmark.compiled.kernel` and :mod:`trailmark.compiled.cache`; for functions that are chosen by the type of
an argument, :mod:`trailmark.compiled.variants`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numba
from numba.core import event

from trailmark.compiled.kernel import Kernel, KernelCompiler
from trailmark.compiled.report import CompilingReport
from trailmark.compiled.variants import by_type, variant_of

__all__ = ["by_type", "njit", "variant_of"]

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


event.register("numba:compile", CompilingReport())
