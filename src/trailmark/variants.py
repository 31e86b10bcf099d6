"""Functions with a kernel for each type of their first argument, chosen while what calls them is compiled.

Numba's own way (``numba.extending.overload``) compiles a function in between for each choice, a tenth of a second.
"""

# Kernels are made of this file too: trailmark.jit counts it.
from __future__ import annotations

from collections.abc import Callable
from functools import update_wrapper
from typing import Any, TypeVar, cast

from numba.core import types
from numba.core.imputils import lower_constant
from numba.extending import models, register_model

__all__ = ["by_type", "variant_of"]

F = TypeVar("F", bound=Callable[..., Any])


class _Choice:
    """A function that calls the variant for the type of its first argument, from Python and in compiled code."""

    def __init__(self, function: Callable[..., Any]) -> None:
        update_wrapper(self, function)
        self.variants: dict[type, Any] = {}
        # By this attribute numba learns the type of a value that it does not know.
        self._numba_type_ = _ChoiceType(self, f"{function.__module__}.{function.__qualname__}")

    def __call__(self, *arguments: Any) -> Any:
        return self.variants[type(arguments[0])](*arguments)


class _ChoiceType(types.Callable, types.Dummy):  # type: ignore[misc,unused-ignore]  # numba ships types in part
    """The type of a :class:`_Choice` in compiled code, where a call of it is a call of the variant."""

    def __init__(self, choice: _Choice, name: str) -> None:
        self._choice = choice
        super().__init__(f"by_type({name})")

    @property
    def key(self) -> int:
        """What tells two types apart: their functions, also of the same name."""
        return id(self._choice)

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        """Return the signature of the variant for these types, which is compiled for them."""
        return self._variant(args).get_call_type(context, args, kws)

    def get_call_signatures(self) -> tuple[tuple[()], bool]:
        """Return the signatures known beforehand, none, and whether there may be others."""
        return (), True

    def get_impl_key(self, sig: Any) -> Any:
        """Return the key under which numba keeps the variant's code for a signature."""
        return self._variant(sig.args).get_impl_key(sig)

    def _variant(self, args: Any) -> Any:
        return self._choice.variants[args[0].instance_class]._numba_type_


register_model(_ChoiceType)(models.OpaqueModel)


@lower_constant(_ChoiceType)  # type: ignore[untyped-decorator,unused-ignore]  # as above
def _constant(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    return context.get_dummy_value()


def by_type(function: F) -> F:
    """Return a function that compiled code and Python call alike, with a variant for each type of the first argument.

    The decorated function states arguments and result; it is never run. Its variants (:func:`variant_of`) are kernels,
    for first arguments that are named tuples. Compiled code chooses while it is compiled, so that the choice costs
    nothing when it runs.
    """
    return cast(F, _Choice(function))


def variant_of(function: Callable[..., Any], kind: type) -> Callable[[F], F]:
    """Return what makes a kernel the variant of a function (:func:`by_type`) for first arguments of a type."""

    def register(kernel: F) -> F:
        function.variants[kind] = kernel  # type: ignore[attr-defined]  # by_type puts it there
        return kernel

    return register
