"""LazyShapes: a sequence of obstacles that are made when somebody asks for one of them."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Any, cast, overload

from trailmark.shapes import Shape

__all__ = ["LazyShapes"]


class LazyShapes(Sequence[Shape]):
    """Obstacles that some file or array describes otherwise; equal to a tuple of the same shapes."""

    @abstractmethod
    def make(self) -> tuple[Shape, ...]:
        """Return the shapes, made anew."""

    def as_tuple(self) -> tuple[Shape, ...]:
        """Return this object, which does what a tuple does, under the type that worlds state."""
        return cast(Any, self)  # type: ignore[no-any-return]  # a tuple cannot be filled later

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:
        """The shapes, made once."""
        return self.make()

    @overload
    def __getitem__(self, index: int) -> Shape: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[Shape, ...]: ...

    def __getitem__(self, index: int | slice) -> Shape | tuple[Shape, ...]:
        return self.shapes[index]

    def __len__(self) -> int:
        return len(self.shapes)

    def __iter__(self) -> Iterator[Shape]:
        return iter(self.shapes)

    def __add__(self, others: Sequence[Shape]) -> tuple[Shape, ...]:
        return (*self, *others)

    def __radd__(self, others: Sequence[Shape]) -> tuple[Shape, ...]:
        return (*others, *self)

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        return tuple(other) == self.shapes if isinstance(other, tuple | LazyShapes) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.shapes)

    def __repr__(self) -> str:
        return repr(self.shapes)

    def __getstate__(self) -> dict[str, Any]:
        # They take many times the memory of what describes them.
        return {key: value for key, value in self.__dict__.items() if key != "shapes"}
