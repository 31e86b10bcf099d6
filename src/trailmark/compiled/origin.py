"""What a kernel is compiled from: its own code, the constants that it reads, and the code of all that it calls."""

from __future__ import annotations

import hashlib
import sys
import types
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher

__all__ = ["origin_of"]

COMPILER = tuple(f"trailmark.compiled.{name}" for name in ("kernel", "borrowing", "python_api", "target", "variants"))
"""Modules that decide how kernels are compiled: all of their files count."""

_LITERAL = (bool, int, float, complex, str, bytes, type(None), np.generic)


@cache
def origin_of(function: Callable[..., Any]) -> str:
    """Return a digest of a kernel's code, of the constants it reads and of all kernels that it calls, near and far.

    How kernels are compiled counts as well.
    """
    found = [function]
    for kernel in found:  # grows by those that they call
        found += [called for called in _parts(kernel)[1] if called not in found]
    digests = [*map(_file_digest, COMPILER), *sorted(_parts(kernel)[0] for kernel in found)]
    return hashlib.sha256("".join(digests).encode()).hexdigest()


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
