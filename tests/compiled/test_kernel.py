"""Kernels: called from Python and from each other in any order, compiled once for each, by several threads."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from numba.core import event

from trailmark.compiled import njit


class Compilations(event.Listener):  # type: ignore[misc,unused-ignore]  # numba ships types in part
    """The names of the functions that numba compiles."""

    def __init__(self) -> None:
        self.names: list[str] = []

    def on_start(self, event: Any) -> None:
        self.names.append(event.data["dispatcher"].py_func.__name__)

    def on_end(self, event: Any) -> None:
        pass


def make_kernels() -> tuple[Any, Any]:
    @njit()
    def inner(values: Any, n: int) -> float:
        if n < 0:
            raise ValueError("a negative number")
        return float(values[n] + n)

    @njit(nogil=True)
    def outer(values: Any) -> float:
        total = 0.0
        for i in range(len(values)):
            total += inner(values, i)
        return total

    return inner, outer


@pytest.mark.slow
@pytest.mark.parametrize("order", ["inner first", "outer first"])
def test_a_kernel_serves_python_and_other_kernels(order: str) -> None:
    inner, outer = make_kernels()
    values = np.arange(5.0)
    calls: list[Any] = [lambda: inner(values, 3), lambda: outer(values)]
    answers = [call() for call in (calls if order == "inner first" else calls[::-1])]
    assert sorted(answers) == [6.0, 20.0]
    assert [inner(values, 3), outer(values)] == [6.0, 20.0]


@pytest.mark.slow
def test_each_is_compiled_once_for_each_kind_of_caller() -> None:
    inner, outer = make_kernels()
    listener = Compilations()
    with event.install_listener("numba:compile", listener):
        for _ in range(2):
            outer(np.arange(3.0))
            inner(np.arange(3.0), 1)
    assert sorted(listener.names) == ["inner", "inner", "outer"]


@pytest.mark.slow
def test_other_types_are_compiled_anew() -> None:
    _, outer = make_kernels()
    assert outer(np.arange(3.0)) == outer(np.arange(3)) == outer(np.arange(6.0)[::2] / 2) == 6.0


@pytest.mark.slow
def test_errors_of_a_kernel_inside_another_arrive() -> None:
    inner, _ = make_kernels()

    @njit()
    def far(values: Any, n: int) -> float:
        return inner(values, n)  # type: ignore[no-any-return]

    for kernel in (far, inner):
        with pytest.raises(ValueError, match="a negative number"):
            kernel(np.arange(3.0), -1)


@pytest.mark.slow
def test_a_kernel_calls_itself() -> None:
    @njit()
    def factorial(n: int) -> int:
        if n < 2:
            return 1
        return n * factorial(n - 1)

    @njit()
    def twice(n: int) -> int:
        return 2 * factorial(n)

    assert twice(5) == 240
    assert factorial(5) == 120


@pytest.mark.slow
def test_threads_may_compile_at_the_same_time() -> None:
    pairs = [make_kernels() for _ in range(4)]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda pair: (pair[1](np.arange(4.0)), pair[0](np.arange(4.0), 2)), pairs))
    assert found == [(12.0, 4.0)] * 4


@pytest.mark.slow
def test_what_cannot_be_compiled_says_so_and_harms_nothing() -> None:
    @njit()
    def wrong(x: Any) -> Any:
        return x.there_is_no_such_thing

    with pytest.raises(Exception, match="there_is_no_such_thing"):
        wrong(1.0)
    _, outer = make_kernels()
    assert outer(np.arange(3.0)) == 6.0
