"""``njit`` for all kernels: numba's, with a cache that is found everywhere, never stale, and never a reason to fail.

Numba keeps compiled code beside the source or in the user's cache folder, and raises where it can write to neither, as
in containers. Here a folder of the user's own among the temporary files comes next, and then no cache. Numba also takes
a kernel's code from the cache as long as the kernel's own file is unchanged, although code of the kernels that it calls
is part of it: here the key holds all that a kernel was compiled from, so that after an update no old code certifies
anything. A first compilation takes minutes: one line on stderr says so.
"""

from __future__ import annotations

import hashlib
import os
import stat
import sys
import tempfile
import types
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial, wraps
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numba
import numpy as np
from numba.core import event
from numba.core.caching import FunctionCache, NullCache
from numba.core.dispatcher import Dispatcher
from numba.extending import overload

__all__ = ["by_type", "njit", "variant_of"]

REPORT_AFTER = 1.0
"""Seconds of compiling before it is reported."""

PAUSE = 1.0
"""Seconds without compiling after which compiling is reported again."""

F = TypeVar("F", bound=Callable[..., Any])

_LITERAL = (bool, int, float, complex, str, bytes, type(None), np.generic)


if TYPE_CHECKING:
    from numba import njit as njit
else:

    def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
        """Return numba's decorator ``njit`` with these options; ``cache=True`` caches as described above."""
        cached = options.pop("cache", False)

        def compiled(function: Callable[..., Any]) -> Any:
            kernel = numba.njit(**options)(function)
            if cached and isinstance(kernel, Dispatcher):  # a plain function where NUMBA_DISABLE_JIT is set
                kernel._cache = _cache_of(function)
                _kernels.append(kernel)
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


class _KernelCache(FunctionCache):
    """Numba's cache of one kernel, keyed by all that it was compiled from; a damaged or full disk does no harm."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        _origin(self._py_func)  # an error in here is ours, and no damaged file
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # whatever reading a file cut short raises: compiling anew mends it
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        save = partial(super().save_overload, sig, data)
        try:
            try:
                save()
            except OSError:
                raise
            except Exception:  # an index that was cut short: a new one
                self.flush()
                save()
        except Exception as error:
            _once(f"compiled kernels cannot be cached: {getattr(error, 'strerror', None) or error}")

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return (*super()._index_key(sig, codegen), _origin(self._py_func))


def _cache_of(function: Callable[..., Any]) -> Any:
    """Return the kernel's cache, in the first place that can be written to."""
    try:
        return _KernelCache(function)
    except RuntimeError:  # numba knows no such place
        pass
    folder = _own_temporary_folder()
    if folder is not None:
        config: Any = numba.config
        before, config.CACHE_DIR = config.CACHE_DIR, folder
        try:
            kept = _KernelCache(function)
        except RuntimeError:
            pass
        else:
            _once(f"no cache folder for compiled kernels can be written to, they are cached in {folder}")
            return kept
        finally:
            config.CACHE_DIR = before
    _once("no folder can be written to: the kernels are compiled anew by each process (NUMBA_CACHE_DIR names one)")
    return NullCache()


@cache
def _own_temporary_folder() -> str | None:
    """Return a folder that only this user can write to, or None: who writes there decides what runs here."""
    try:
        folder = Path(tempfile.gettempdir()) / f"trailmark-{os.getuid()}"
        with suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        facts = folder.lstat()
        mine = stat.S_ISDIR(facts.st_mode) and facts.st_uid == os.getuid() and not facts.st_mode & 0o022
        return str(folder) if mine else tempfile.mkdtemp(prefix="trailmark-")
    except OSError:
        return None


# --- what a kernel is compiled from --------------------------------------------------------------------------------


@cache
def _origin(function: Callable[..., Any]) -> str:
    """Return a digest of a kernel's code, of the constants it reads and of all kernels that it calls, near and far."""
    found = [function]
    for kernel in found:  # grows by those that they call
        found += [called for called in _parts(kernel)[1] if called not in found]
    return hashlib.sha256("".join(sorted(_parts(kernel)[0] for kernel in found)).encode()).hexdigest()


@cache
def _parts(function: Callable[..., Any]) -> tuple[str, list[Callable[..., Any]]]:
    """Return a digest of a function's own code and of the values its names stand for, and the kernels it calls."""
    codes = [function.__code__]
    for code in codes:  # grows by the code of functions and comprehensions inside
        codes += [inner for inner in code.co_consts if isinstance(inner, types.CodeType)]
    values, parts = list(function.__defaults__ or ()), []
    for code in codes:
        parts += [repr(code.co_code), repr(code.co_names)]
        values += code.co_consts
        for name in code.co_names:
            value = function.__globals__.get(name)
            values.append(value)
            if isinstance(value, types.ModuleType) and value.__name__.startswith("trailmark"):
                values += [getattr(value, attribute, None) for attribute in code.co_names]
    parts += map(_text, values)
    for value in list(values):
        values += getattr(value, "variants", {}).values()
    called = [value.py_func for value in values if isinstance(value, Dispatcher)]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest(), called


def _text(value: Any) -> str:
    """Return what tells a value apart from another, the same in any process."""
    if isinstance(value, Dispatcher):
        return f"{value.py_func.__module__}.{value.py_func.__qualname__}"
    if isinstance(value, _LITERAL):
        return repr(value)
    if isinstance(value, tuple | frozenset):
        return str([*map(_text, value)] if isinstance(value, tuple) else sorted(map(_text, value)))
    if isinstance(value, np.ndarray):
        return f"{value.dtype.str} {value.shape} {value.tobytes()!r}"
    module = getattr(value, "__module__", None)
    if isinstance(module, str) and module.startswith("trailmark"):
        # A tuple's fields, or code that numba reads: all of its file counts.
        return _file_digest(module)
    return type(value).__name__


@cache
def _file_digest(module: str) -> str:
    file = getattr(sys.modules.get(module), "__file__", None)
    return hashlib.sha256(Path(file).read_bytes()).hexdigest() if file else module


# --- reports -------------------------------------------------------------------------------------------------------

_kernels: list[Any] = []


def _on_stderr(line: str) -> None:
    if sys.stderr is not None:
        print(f"trailmark: {line}", file=sys.stderr, flush=True)  # noqa: T201  # the only way to reach a user of a library


@cache
def _once(line: str) -> None:
    _announcer.report(line)


class _Announcer(event.Listener):
    """Tells that kernels are being compiled, once it has gone on for a while; again after a pause."""

    def __init__(self) -> None:
        self.report: Callable[[str], None] = _on_stderr
        self._begun = self._last = -PAUSE
        self._reported = self._reported_before = False

    def on_start(self, event: Any) -> None:
        kernel, now = event.data["dispatcher"], perf_counter()
        if not kernel.py_func.__module__.startswith("trailmark"):
            return
        if now - self._last > PAUSE:
            self._begun, self._reported = now, False
        self._last = now
        if not self._reported and now - self._begun > REPORT_AFTER:
            which = (
                f"further kernels for {kernel.py_func.__module__}"
                if self._reported_before
                else f"{len(_kernels)} kernels"
            )
            self._reported = self._reported_before = True
            self.report(
                f"compiling {which} for this machine, once: up to four minutes ('trailmark warmup' makes them all)"
            )

    def on_end(self, event: Any) -> None:
        self._last = perf_counter()


_announcer = _Announcer()
event.register("numba:compile", _announcer)
