"""Kernels that own nothing: what only reads and writes arrays of its callers counts no references to them.

Numba counts a reference to each array that a function is given, and to each that it takes from a tuple, by atomic
operations. In a small function that a loop of another calls, they take several times as long as all else that it does.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba.core import ir, types
from numba.core.compiler_machinery import AnalysisPass, register_pass

__all__ = ["Borrowing"]

PLAIN = frozenset({"binop", "inplace_binop", "unary"})
"""Operations of which neither operands nor results may be arrays: those of arrays make new ones."""

TAKING = frozenset(
    {"getattr", "static_getitem", "cast", "phi", "build_tuple", "getiter", "iternext", "pair_first", "pair_second"}
    | {"exhaust_iter"}
)
"""Operations whose results lie in what they are taken from, or consist of what is there."""


@register_pass(mutates_CFG=False, analysis_only=True)
class Borrowing(AnalysisPass):  # type: ignore[misc,unused-ignore]  # numba ships types in part
    """Switches off the counting of references in a function that makes no array and returns none.

    All its arrays then are its callers', which hold them until it returns. Comes after types are inferred, before the
    code is made; changes the compilation's own context only.
    """

    _name = "trailmark_borrowing"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        """Look at the typed function, and note what was found; returns whether it was changed, which it never is."""
        state.metadata["owns_nothing"] = _owns_nothing(state)
        if state.metadata["owns_nothing"]:
            state.targetctx.enable_nrt = False
        return False


def _owns_nothing(state: Any) -> bool:
    models, types_of = state.targetctx.data_model_manager, state.typemap

    def counted(kind: Any) -> bool:
        return bool(models[kind].contains_nrt_meminfo())

    def borrowable(kind: Any) -> bool:
        if isinstance(kind, types.BaseTuple):
            return all(map(borrowable, kind.types))  # type: ignore[attr-defined,unused-ignore]  # all of them have it
        return isinstance(kind, types.Array | types.ArrayIterator) or not counted(kind)

    def plain(*variables: Any) -> bool:
        return not any(counted(types_of[variable.name]) for variable in variables)

    if state.func_id.modname.startswith("numba."):  # its functions may make what cannot be seen here
        return False
    if state.func_ir.is_generator or counted(state.return_type) or not all(map(borrowable, types_of.values())):
        return False
    lines = [line for block in state.func_ir.blocks.values() for line in block.body]
    return all(_borrows(line, plain) for line in lines)


def _borrows(line: Any, plain: Callable[..., bool]) -> bool:
    """Return whether a line makes nothing to which references would have to be counted.

    Args:
        line: of numba's intermediate representation.
        plain: tells whether variables hold no arrays.
    """
    if isinstance(line, ir.SetItem | ir.StaticSetItem):
        return plain(line.value)  # an array that is assigned may be copied first
    if not isinstance(line, ir.Assign):
        return isinstance(line, ir.Del | ir.Jump | ir.Branch | ir.Return | ir.StaticRaise)
    value = line.value
    if not isinstance(value, ir.Expr):
        return isinstance(value, ir.Arg | ir.Const | ir.Global | ir.FreeVar | ir.Var)
    if value.op in PLAIN:
        return plain(line.target, *value.list_vars())
    if value.op == "call":
        return plain(line.target)
    if value.op in ("getitem", "typed_getitem"):
        return plain(value.index)  # an array as an index makes a copy
    return value.op in TAKING
