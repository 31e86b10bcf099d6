"""Calls of Python from machine code whose failures are looked at: numba's results are made without.

What a kernel returns becomes a Python object by calls that run a few lines of Python. A signal that arrived while the
kernel ran (Ctrl-C) is handled there: the call fails, and numba goes on with a null pointer, which ends the process.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils
from numba.core.pythonapi import PythonAPI

__all__ = ["CheckedPythonAPI"]


class CheckedPythonAPI(PythonAPI):  # type: ignore[misc,unused-ignore]  # numba ships types in part
    """Numba's, where a failed call ends what called the kernel for Python: the exception is raised there.

    What the kernel had made of its result by then stays in memory.
    """

    def call(self, callee: Any, args: Any = None, kws: Any = None) -> Any:
        """Return a new reference on what a Python object returns that is called."""
        return self._checked(super().call(callee, args, kws))

    def unserialize(self, structptr: Any) -> Any:
        """Return a new reference on a Python object that was pickled when the kernel was compiled."""
        return self._checked(super().unserialize(structptr))

    def _checked(self, result: Any) -> Any:
        # Only functions that Python calls may return without an object.
        if self.builder.function.function_type.return_type == self.pyobj:
            with self.builder.if_then(cgutils.is_null(self.builder, result), likely=False):
                self.builder.ret(ir.Constant(self.pyobj, None))
        return result
