"""Kernels that own nothing: results, references and memory are as where all references are counted."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest
from numba.core.runtime import nrt
from numpy.typing import NDArray

from trailmark.compiled import njit

Array = NDArray[np.float64]


class Pair(NamedTuple):
    first: Array
    second: Array


@njit()
def element(a: Array, i: int) -> float:
    return float(a[i])


@njit()
def same(a: Array) -> Array:
    return a


@njit()
def rest(a: Array) -> Array:
    return a[1:]


@njit()
def swapped(pair: Pair) -> Pair:
    return Pair(pair.second, pair.first)


@njit()
def chosen(a: Array, indices: NDArray[np.int64]) -> float:
    return float(a[indices].sum())


@njit()
def doubled(a: Array) -> float:
    return float((a + a)[0])


@njit()
def filled(a: Array, b: Array) -> None:
    a[1:] = b[:-1]


@njit()
def copied(a: Array) -> float:
    b = a.copy()
    b[0] = -1.0
    return float(a[0] + b[0])


@njit()
def longer(pair: Pair) -> Array:
    return pair.first if len(pair.first) >= len(pair.second) else pair.second


@njit()
def total(rows: Array) -> float:
    found = 0.0
    for row in rows:
        for x in row[1:]:
            found += x
    return found


@njit()
def quotient(pair: Pair, i: int) -> float:
    return float(pair.first[i] / pair.second[i])


def _elements(n: int) -> float:
    a, found = np.arange(4.0), 0.0
    for i in range(n):
        found += element(a, i % 4)
    return found


def _returned(n: int) -> float:
    found = 0.0
    for _ in range(n):
        a = np.arange(4.0)
        b = rest(same(a))
        a = np.zeros(4)  # of what b lies in no other name is left
        c = np.full(4, 7.0)
        found += b[0] + b[2] + a[0] + c[0]
    return found


def _pairs(n: int) -> float:
    found = 0.0
    for k in range(n):
        pair = swapped(Pair(np.arange(3.0), np.full(4, 2.0)))
        other = np.full(4, float(k))
        found += longer(pair)[3] + pair.second[2] + other[0]
    return found


def _copies(n: int) -> float:
    found = 0.0
    for _ in range(n):
        a = np.arange(5.0)
        found += chosen(a, np.array([1, 3])) + doubled(a) + copied(a)
        filled(a, a)
        found += a[4]
    return found


def _rows(n: int) -> float:
    found = 0.0
    for _ in range(n):
        found += total(np.arange(12.0).reshape(3, 4))
    return found


@pytest.fixture(scope="module")
def counting() -> Iterator[None]:
    """Numba counts what kernels allocate and free."""
    memory: Any = nrt
    memory._nrt.memsys_enable_stats()
    yield
    memory._nrt.memsys_disable_stats()


@pytest.mark.slow
@pytest.mark.parametrize("function", [_elements, _returned, _pairs, _copies, _rows])
def test_results_are_pythons_and_no_memory_stays(function: Callable[[int], float], counting: None) -> None:
    kernel: Any = njit()(function)
    assert kernel(100) == function(100)
    memory: Any = nrt.rtsys
    before = memory.get_allocation_stats()
    assert kernel(1000) == function(1000)
    after = memory.get_allocation_stats()
    assert after.alloc - before.alloc == after.free - before.free


@pytest.mark.slow
def test_arrays_of_python_keep_their_references() -> None:
    @njit()
    def outer(pair: Pair) -> float:
        found = 0.0
        for i in range(len(pair.first)):
            found += element(pair.first, i) + quotient(pair, i)
        return found

    pair = Pair(np.arange(50.0), np.full(50, 2.0))
    before = [sys.getrefcount(array) for array in pair]
    for _ in range(20):
        assert outer(pair) == pytest.approx(1.5 * np.arange(50.0).sum())
    assert [sys.getrefcount(array) for array in pair] == before


def test_an_error_inside_comes_out(counting: None) -> None:
    @njit()
    def outer(pair: Pair) -> float:
        return quotient(pair, 1)

    pair = Pair(np.arange(3.0), np.array([1.0, 0.0, 1.0]))
    before = [sys.getrefcount(array) for array in pair]
    for _ in range(5):
        with pytest.raises(ZeroDivisionError):
            outer(pair)
    # Numba itself lets go of no reference of an outer function where an inner one raises; none is lost beyond those.
    assert all(now - then <= 5 for now, then in zip(map(sys.getrefcount, pair), before, strict=True))


@pytest.mark.slow
def test_what_makes_or_returns_arrays_counts_and_nothing_else_does() -> None:
    @njit()
    def at(a: Array, i: int) -> float:  # one that no other test has compiled with all references counted
        return float(a[i])

    @njit()
    def outer(pair: Pair, indices: NDArray[np.int64]) -> float:
        a, pair = pair.first, swapped(pair)
        filled(a, a)
        found = at(a, 1) + quotient(pair, 2) + total(a.reshape(2, 2)) + chosen(a, indices)
        return float(found + same(a)[0] + rest(a)[0] + longer(pair)[0] + doubled(a) + copied(a))

    outer(Pair(np.arange(4.0), np.ones(4)), np.array([1, 2]))
    kernels: tuple[Any, ...] = at, same, rest, swapped, chosen, doubled, filled, copied, longer, total, quotient
    borrowing = {
        kernel.py_func.__name__
        for kernel in kernels
        for code in kernel.overloads.values()
        if code.metadata.get("owns_nothing")  # what Python calls was not asked
    }
    assert borrowing == {"at", "quotient"}
