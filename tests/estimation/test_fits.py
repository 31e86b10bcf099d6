"""Lines and circles fitted to noisy points: exact without noise, and as uncertain as they say with it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares

from trailmark.estimation.covariance import average, nees
from trailmark.estimation.scan_features import fit_circle_roughly, fit_disc, fit_line

angles = st.floats(-math.pi, math.pi)
seeds = st.integers(0, 2**32 - 1)


def beam_noise(points: np.ndarray, sigma_range: float, sigma_bearing: float) -> np.ndarray:
    """Covariances of points seen from the origin, shape (n, 2, 2)."""
    r = np.hypot(*points.T)
    u = points / r[:, None]
    v = np.column_stack([-u[:, 1], u[:, 0]])
    along, across = u[:, :, None] * u[:, None], v[:, :, None] * v[:, None]
    return np.asarray(sigma_range**2 * along + ((sigma_bearing * r) ** 2)[:, None, None] * across)


def drawn(rng: np.random.Generator, covariances: np.ndarray) -> np.ndarray:
    """Errors with covariances of shape (n, 2, 2), shape (n, 2)."""
    return np.asarray(np.einsum("nij,nj->ni", np.linalg.cholesky(covariances), rng.normal(size=(len(covariances), 2))))


def on_line(rho: float, alpha: float, places: np.ndarray) -> np.ndarray:
    n, t = np.array([math.cos(alpha), math.sin(alpha)]), np.array([-math.sin(alpha), math.cos(alpha)])
    return np.asarray(rho * n + places[:, None] * t)


def on_arc(x: float, y: float, radius: float, turns: np.ndarray) -> np.ndarray:
    return np.array([x, y]) + radius * np.column_stack([np.cos(turns), np.sin(turns)])


# --- Lines


@pytest.mark.slow
@given(seeds)
def test_unequal_noise_gives_the_likeliest_line(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = on_line(2.0, 0.5, rng.uniform(-3, 3, 25))
    covariances = beam_noise(points, 0.03, 0.01) * rng.uniform(0.2, 5.0, 25)[:, None, None]
    noisy = points + drawn(rng, covariances)
    fit = fit_line(noisy, covariances)

    # Weights belong to the noise at the line that is found; the oracle takes them from there.
    n = np.array([math.cos(fit.line[1]), math.sin(fit.line[1])])
    sigma = np.sqrt(np.einsum("i,nij,j->n", n, covariances, n))

    def residuals(line: np.ndarray) -> np.ndarray:
        return np.asarray((noisy @ [math.cos(line[1]), math.sin(line[1])] - line[0]) / sigma)

    oracle = least_squares(residuals, [2.0, 0.5], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    assert fit.line == pytest.approx(oracle.x, abs=1e-5)
    jacobian = np.asarray(oracle.jac, dtype=np.float64)
    assert fit.covariance == pytest.approx(np.linalg.inv(jacobian.T @ jacobian), rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(("rho", "alpha", "first"), [(1.0, 0.2, -2.0), (4.0, -2.5, 1.0), (0.5, 1.6, 3.0)])
def test_a_lines_covariance_is_that_of_its_errors(rho: float, alpha: float, first: float) -> None:
    rng = np.random.default_rng(0)
    true = on_line(rho, alpha, np.linspace(first, first + 3.0, 30))
    covariances = beam_noise(true, 0.02, 0.003)
    errors, stated = [], []
    for _ in range(300):
        noisy = true + drawn(rng, covariances)
        fit = fit_line(noisy, covariances)
        errors.append([fit.line[0] - rho, math.remainder(fit.line[1] - alpha, 2 * math.pi)])
        stated.append(fit.covariance)
    assert average(nees(errors, stated), 2.0, probability=0.999).inside


# --- Discs


@pytest.mark.slow
def test_a_discs_covariance_is_that_of_its_errors() -> None:
    rng = np.random.default_rng(1)
    true = on_arc(3.0, 1.0, 0.4, np.linspace(2.0, 4.6, 25))
    covariances = beam_noise(true, 0.01, 0.002)
    errors, stated = [], []
    for _ in range(300):
        fit = fit_disc(true + drawn(rng, covariances), covariances)
        assert fit is not None
        errors.append(fit.disc - [3.0, 1.0, 0.4])
        stated.append(fit.covariance)
    assert average(nees(errors, stated), 3.0, probability=0.999).inside


def test_points_that_are_no_arc() -> None:
    line = on_line(1.0, 0.3, np.linspace(0, 1, 10))
    noise = np.broadcast_to(1e-4 * np.eye(2), (10, 2, 2))
    assert fit_circle_roughly(line) is None
    assert fit_disc(line, noise) is None
    assert fit_disc(np.ones((10, 2)), noise) is None


# --- Bad input
