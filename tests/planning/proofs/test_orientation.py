"""Orientations have the right sign, whatever the rounding: against exact fractions."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.trials import few

from trailmark.planning.proofs.mesh import orientation, orientations


def exactly(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> int:
    (ax, ay), (bx, by), (cx, cy) = ([Fraction(float(v)) for v in p] for p in (a, b, c))
    value = (ax - cx) * (by - cy) - (ay - cy) * (bx - cx)
    return (value > 0) - (value < 0)


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1.0, 1e3, 1e6, 1e7]), st.integers(0, 8))
@settings(max_examples=few(200), deadline=None)
def test_the_sign_is_exact(seed: int, offset: float, ulps: int) -> None:
    rng = np.random.default_rng(seed)
    a, d = rng.uniform(-1.0, 1.0, (2, 2)) + offset
    shares = rng.choice([0.0, 0.25, 0.5, 1.0, 2.0, rng.uniform(-2.0, 3.0)], 2)
    b, c = a + shares[0] * (d - a), a + shares[1] * (d - a)
    c = c + rng.integers(-ulps, ulps + 1, 2) * np.spacing(c)
    for p, q, r in ((a, b, c), (b, c, a), (c, b, a), (a, a, b)):
        assert np.sign(orientation(*p, *q, *r)) == exactly(p, q, r)


@pytest.mark.slow
def test_many_at_once_are_those_one_by_one() -> None:
    grid = np.array([(0.1 * i, 0.1 * j) for i in range(4) for j in range(4)])
    triples = np.array([(i, j, k) for i in range(16) for j in range(16) for k in range(16)])
    found = np.sign(orientations(grid, triples))
    wanted = [exactly(*grid[row]) for row in triples]
    assert (found == wanted).all()
    # In a row on paper, beside the row as doubles.
    assert 0 < np.count_nonzero(np.abs(wanted)) < len(triples)
