"""Sorting in compiled code against Python's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.sorting import order_of, sort_in_place

VALUES = st.lists(st.floats(allow_nan=False) | st.sampled_from([0.0, -0.0, 1.0]), max_size=60)


@pytest.mark.slow
@given(VALUES, st.integers(0, 60))
def test_the_first_values_are_sorted_and_the_others_left_alone(numbers: list[float], count: int) -> None:
    count = min(count, len(numbers))
    values = np.array(numbers, dtype=np.float64)
    sort_in_place(values, count)
    assert values.tolist() == sorted(numbers[:count]) + numbers[count:]


@pytest.mark.slow
@given(VALUES)
def test_the_order_holds_each_index_once_and_sorts_the_keys(numbers: list[float]) -> None:
    keys = np.array(numbers, dtype=np.float64)
    order = order_of(keys)
    assert sorted(order.tolist()) == list(range(len(numbers)))
    assert keys[order].tolist() == sorted(numbers)
    assert keys.tolist() == numbers


def test_thousands_of_values_in_the_worst_orders() -> None:
    for values in (np.arange(5000.0), np.arange(5000.0)[::-1].copy(), np.tile([1.0, 0.0], 2500)):
        expected = sorted(values.tolist())
        assert values[order_of(values)].tolist() == expected
        sort_in_place(values, len(values))
        assert values.tolist() == expected
