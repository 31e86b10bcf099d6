"""What kernels are compiled for: results and errors are numba's own, and so are those of functions without us."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import pytest
from numba.core import types
from numpy.typing import NDArray

from trailmark.compiled import kernel as kernel_module
from trailmark.compiled import njit
from trailmark.compiled.kernel import Kernel

Array = NDArray[Any]
OURS: Any = njit()
NUMBAS: Any = numba.njit


def _work(n: int) -> float:
    a = np.arange(n).astype(np.float64)
    rows = np.full((n, 2), 0.5)
    rows[1:, 0] = a[1:]
    more = np.zeros(2 * n)
    more[:n] = a
    return float(max(a[0], 2.0) + min(n, 3) + rows.sum() + more[n - 1])


def _assigned(target: Array, source: Array) -> None:
    target[1:] = source


@pytest.mark.slow
def test_results_are_those_of_numba_and_python() -> None:
    assert OURS(_work)(7) == NUMBAS(_work)(7) == _work(7)


@pytest.mark.slow
def test_functions_of_numba_that_kernels_call_are_compiled_as_kernels_are() -> None:
    kernel = OURS(lambda n: np.full((n, 1, n), np.complex64(2)).sum())  # of a type that nothing else compiles
    assert kernel(3) == 18
    (code,) = kernel.overloads.values()
    libraries = [library for library in code.library._linking_libraries if library.name != "nrt"]  # numba's runtime
    assert len(libraries) > 1
    assert {type(library) for library in libraries} == {kernel_module._CodeOfCallers}


@pytest.mark.slow
def test_functions_outside_use_what_kernels_compiled_and_the_other_way_round() -> None:
    def cubes(n: int) -> Array:
        return np.full((n, n, n), np.float32(2.0)) ** 3

    def twos(n: int) -> Array:
        return np.full((n, n, n), np.int16(2))

    for function in (cubes, twos):
        first, second = (OURS, NUMBAS) if function is cubes else (NUMBAS, OURS)
        assert first(function)(3).tolist() == second(function)(3).tolist() == function(3).tolist()


@pytest.mark.slow
@pytest.mark.parametrize("length", [2, 4])
def test_an_array_of_another_length_is_refused_as_numpy_does(length: int) -> None:
    target = np.zeros(4)
    for function in (OURS(_assigned), NUMBAS(_assigned), _assigned):
        with pytest.raises(ValueError, match=r"shape|length"):
            function(target, np.ones(length))
    assert not target.any()


def test_one_of_length_1_goes_everywhere_and_overlapping_ones_are_copied_first() -> None:
    assign = OURS(_assigned)
    target = np.zeros(4)
    assign(target, np.ones(1))
    assert target.tolist() == [0, 1, 1, 1]
    target[:] = np.arange(4.0)
    assign(target, target[:-1])
    assert target.tolist() == [0, 0, 1, 2]


def test_constants_are_no_types_of_their_own() -> None:
    @njit()
    def inner(a: int, flag: bool) -> int:
        return a + 1 if flag else a

    @njit()
    def outer(a: int) -> int:
        return inner(1, True) + inner(2, False) + inner(a, a > 3) + inner(a=4, flag=True)

    assert outer(5) == 2 + 2 + 6 + 5
    kernel: Any = inner
    assert isinstance(kernel, Kernel)
    assert list(kernel.overloads) == [(types.int64, types.boolean)]
