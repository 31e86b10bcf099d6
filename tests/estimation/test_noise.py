"""Variances and correlation found again in noise that was drawn with them."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark.estimation.noise_fit import correlation_time, updated_variances


def test_two_sources_are_told_apart() -> None:
    rng = np.random.default_rng(1)
    r = rng.uniform(1.0, 8.0, 4000)
    true = np.array([0.04, 0.003])
    components = np.zeros((len(r), 2, 1, 1))
    components[:, 0, 0, 0], components[:, 1, 0, 0] = 1.0, r**2
    error = rng.normal(0.0, np.sqrt(true[0] + true[1] * r**2))
    variances = np.array([1.0, 1.0])
    for _ in range(200):
        sigma = np.sqrt(variances @ components[:, :, 0, 0].T)
        roots = (1.0 / sigma)[:, None, None]
        variances = updated_variances(variances, components, roots, (error / sigma)[:, None], np.ones((len(r), 1)))
    assert variances == pytest.approx(true, rel=0.2)


def test_an_absorbed_share_is_given_back() -> None:
    rng = np.random.default_rng(2)
    error = 0.3 * rng.standard_normal(5000)
    half = np.full((5000, 1), 0.5)  # the estimate followed half of the noise's power
    found = updated_variances(
        np.array([1.0]), np.ones((5000, 1, 1, 1)), np.ones((5000, 1, 1)), np.sqrt(0.5) * error[:, None], half
    )
    assert found == pytest.approx([0.09], rel=0.1)


@pytest.mark.parametrize("share", [0.0, 0.5, 0.8])
def test_errors_that_last(share: float) -> None:
    rng = np.random.default_rng(3)
    sequences = []
    for _ in range(30):
        e = rng.standard_normal(400)
        for i in range(1, len(e)):
            e[i] = share * e[i - 1] + np.sqrt(1.0 - share**2) * e[i]
        sequences.append(e)
    # Of an autoregression of the first order, τ = (1 + ρ) / (1 − ρ).
    assert correlation_time(sequences) == pytest.approx((1.0 + share) / (1.0 - share), rel=0.15)
