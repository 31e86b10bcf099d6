"""Chi-square averages: against scipy.stats, and against draws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from trailmark.estimation.covariance import average, nees


def test_errors_of_the_stated_covariance_lie_in_the_band_as_often_as_it_says() -> None:
    rng = np.random.default_rng(1)
    root = rng.normal(size=(3, 3))
    covariance = root @ root.T
    inside = 0
    for _ in range(400):
        errors = rng.normal(size=(50, 3)) @ root.T
        inside += average(nees(errors, covariance), 3).inside
    # 380 of 400 expected, standard deviation 4.4.
    assert 365 <= inside <= 393
    assert average(nees(2.0 * errors, covariance), 3).mean > average(nees(errors, covariance), 3).high


def test_band_of_different_degrees_of_freedom() -> None:
    dof = np.array([2, 4, 6, 2, 2])
    found = average(np.ones(5), dof, 0.9)
    assert (found.mean, found.expected, found.size) == (1.0, 3.2, 5)
    assert found.low == pytest.approx(chi2.ppf(0.05, 16) / 5)
    assert found.high == pytest.approx(chi2.ppf(0.95, 16) / 5)
