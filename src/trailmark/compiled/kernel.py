"""Kernels: functions that numba compiles to machine code, each for as many callers as it has, once.

Numba makes machine code of every function that it compiles, in two or three forms, also of those that only other
compiled functions call; and optimises a function's code again in each of its callers, which contain it. Here a function
that is compiled because another calls it stays as it is, until the caller's code, of which it is a part, is optimised
and becomes machine code as a whole. If Python calls it too, it is compiled for Python then.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba.core import sigutils
from numba.core.caching import NullCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import IRLegalization
from numba.core.types import unliteral

from trailmark.compiled.borrowing import Borrowing
from trailmark.compiled.cache import KernelCache, cache_of
from trailmark.compiled.garbage import collection_waits
from trailmark.compiled.python_api import CheckedPythonAPI
from trailmark.compiled.signals import signals_wait
from trailmark.compiled.target import KernelTarget, for_kernels, register

__all__ = ["Kernel", "KernelCompiler"]


class _CodeOfCallers(JITCodeLibrary):
    """Code that is optimised, and becomes machine code, only as part of the code of callers."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True


class KernelCompiler(Compiler):
    """Numba's compiler, which makes no C function of a kernel, and no machine code of one for other kernels alone."""

    def __init__(self, typingctx: Any, targetctx: Any, library: Any, args: Any, *others: Any) -> None:
        super().__init__(typingctx, targetctx, library, args, *others)
        self.state.flags.no_cfunc_wrapper = True
        # The context is this compilation's own copy.
        context = self.state.targetctx
        context.target = KernelTarget
        context.get_python_api = lambda builder: CheckedPythonAPI(context, builder)
        if Kernel.compiling > 1:
            self.state.flags.no_cpython_wrapper = True
            # Callers find the code by this key, whatever it is.
            context.get_executable = lambda library, descriptor, environment: object()

    def define_pipelines(self) -> Any:
        """Return numba's passes; functions that other kernels call count no references where they own nothing."""
        pipelines = super().define_pipelines()
        if Kernel.compiling > 1:
            for passes in pipelines:
                passes.add_pass_after(Borrowing, IRLegalization)
                passes.finalize()
        return pipelines

    def compile_extra(self, func: Callable[..., Any]) -> Any:
        """Compile a function, for Python or for the kernel that calls it."""
        if Kernel.compiling > 1:
            self.state.library = _CodeOfCallers(self.state.targetctx.codegen(), func.__qualname__)
        return super().compile_extra(func)


class Kernel(CPUDispatcher):
    """Numba's dispatcher of one function: compiles it for the types that it is called with, or finds the code.

    Attributes:
        compiling: kernels of which the compilation has begun and not ended, one inside the other: all but the first are
            compiled because another calls them.
    """

    compiling = 0

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._of_numba = self.py_func.__module__.startswith("numba.")
        self._machine_code: dict[Any, Any] = {}
        """What was loaded for Python, where other kernels contain code compiled for them."""

    def enable_caching(self) -> None:
        """Cache what Python calls (:mod:`trailmark.compiled.cache`): the code of those that it calls is part of it."""
        self._cache = cache_of(self.py_func)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return what numba needs to know of a call with these types: constants are compiled as all other values are.

        Numba's own functions may ask for constants; ours would only be compiled several times.
        """
        if not self._of_numba:
            args, kws = [unliteral(kind) for kind in args], {name: unliteral(kind) for name, kind in kws.items()}
        return super().get_call_template(args, kws)

    def compile(self, sig: Any) -> Any:
        """Compile the kernel for a signature, or find the code; returns numba's handle on it."""
        # With the lock, hence no two threads count at the same time.
        with signals_wait(), for_kernels(), global_compiler_lock, collection_waits():
            Kernel.compiling += 1
            try:
                return self._compile_for_python(sig) if Kernel.compiling == 1 else self._compile_for_kernel(sig)
            finally:
                Kernel.compiling -= 1

    def add_overload(self, cres: Any) -> None:
        """Take note of the code compiled for one signature."""
        if isinstance(cres.library, _CodeOfCallers):
            self.overloads[tuple(cres.signature.args)] = cres  # and not where calls from Python look
        else:
            super().add_overload(cres)

    def _compile_for_python(self, sig: Any) -> Any:
        types = _types_of(sig)
        overloads: dict[Any, Any] = self.overloads
        before = self._machine_code.get(types) or overloads.get(types)
        if before is not None:
            if not isinstance(before.library, _CodeOfCallers):
                return before.entry_point
            del overloads[types]
        if isinstance(self._cache, KernelCache):
            with self._cache.only_one_process(sig):
                handle = super().compile(sig)
        else:
            handle = super().compile(sig)
        result = overloads[types]
        # What the kernels inside need while they run is known only now that there is machine code of them.
        for environment in result._find_referenced_environments():
            result.library.codegen.set_env(environment.env_name, environment)
        return handle

    def _compile_for_kernel(self, sig: Any) -> Any:
        types = _types_of(sig)
        overloads: dict[Any, Any] = self.overloads
        if types in overloads and overloads[types].metadata is None:  # loaded from the cache: no caller can contain it
            self._machine_code[types] = overloads.pop(types)
        cache, self._cache = self._cache, NullCache()
        try:
            return super().compile(sig)
        finally:
            self._cache = cache


def _of_numba(**options: Any) -> Callable[[Callable[..., Any]], Kernel]:
    """Return what makes a kernel of a function of numba's own that kernels call."""

    def compiled(function: Callable[..., Any]) -> Kernel:
        return Kernel(function, targetoptions={**options, "nopython": True}, pipeline_class=KernelCompiler)

    return compiled


register(Kernel, _of_numba)


def _types_of(sig: Any) -> Any:
    return tuple(sigutils.normalize_signature(sig)[0])
