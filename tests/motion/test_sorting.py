"""Sorting in compiled code against Python's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.motion.density import sort_in_place


@pytest.mark.slow
@given(st.lists(st.floats(allow_nan=False) | st.sampled_from([0.0, -0.0, 1.0]), max_size=60), st.integers(0, 60))
def test_the_first_values_are_sorted_and_the_others_left_alone(numbers: list[float], count: int) -> None:
    count = min(count, len(numbers))
    values = np.array(numbers, dtype=np.float64)
    sort_in_place(values, count)
    assert values.tolist() == sorted(numbers[:count]) + numbers[count:]
