"""Functions with variants: compiled code and Python choose the same one, by the type of the first argument."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import pytest
from numba.core.errors import TypingError

from trailmark.jit import njit
from trailmark.variants import by_type, variant_of


class Circle(NamedTuple):
    radius: float


class Square(NamedTuple):
    side: float


class Point(NamedTuple):
    x: float


def _areas() -> Callable[[Any, float], float]:
    @by_type
    def area(shape: Any, factor: float) -> float:
        """Return a shape's area, times a factor."""
        raise NotImplementedError

    @variant_of(area, Circle)
    @njit
    def _of_circle(circle: Circle, factor: float) -> float:
        return 3.0 * circle.radius * circle.radius * factor

    @variant_of(area, Square)
    @njit
    def _of_square(square: Square, factor: float) -> float:
        return square.side * square.side * factor

    return area


@pytest.mark.slow
def test_python_and_compiled_code_choose_alike() -> None:
    area = _areas()

    @njit
    def both(circle: Circle, square: Square) -> float:
        return area(circle, 1.0) + area(square, 10)

    assert area(Circle(2.0), 1.0) == 12.0
    assert area(Square(2.0), 1.0) == 4.0
    assert both(Circle(2.0), Square(2.0)) == 12.0 + 40.0


def test_functions_of_one_name_have_variants_of_their_own() -> None:
    first, second = _areas(), _areas()

    @variant_of(second, Circle)
    @njit
    def _other(circle: Circle, factor: float) -> float:
        return -circle.radius * factor

    @njit
    def both(circle: Circle) -> tuple[float, float]:
        return first(circle, 1.0), second(circle, 1.0)

    assert both(Circle(2.0)) == (12.0, -2.0)


def test_a_type_without_a_variant_is_refused() -> None:
    area = _areas()
    with pytest.raises(KeyError):
        area(Point(1.0), 1.0)
    with pytest.raises((TypingError, KeyError)):
        njit(lambda point: area(point, 1.0))(Point(1.0))


def test_the_name_and_the_text_are_the_function_s() -> None:
    area: Any = _areas()
    assert (area.__name__, area.__doc__) == ("area", "Return a shape's area, times a factor.")
