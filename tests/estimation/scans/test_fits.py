"""Lines and circles fitted to noisy points: exact without noise, and as uncertain as they say with it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares

from trailmark.estimation.errors import EstimationError
from trailmark.estimation.filter.consistency import average, nees
from trailmark.estimation.scans.fits import fit_circle_roughly, fit_disc, fit_line

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


@given(st.floats(0.1, 50.0), angles, st.floats(-30, 30), st.floats(0.1, 10), st.integers(2, 50), seeds)
def test_points_on_a_line_give_that_line(
    rho: float, alpha: float, first: float, length: float, n: int, seed: int
) -> None:
    places = first + length * np.linspace(0.0, 1.0, n)
    points = on_line(rho, alpha, places)
    noise = np.random.default_rng(seed).uniform(0.5, 2.0, n)[:, None, None] * 1e-4 * np.eye(2)
    fit = fit_line(points, noise)
    assert fit.line[0] == pytest.approx(rho, abs=1e-8 * (1 + abs(first) / length) * (1 + rho))
    assert abs(math.remainder(fit.line[1] - alpha, 2 * math.pi)) < 1e-8 * (1 + rho) / length
    assert fit.span == pytest.approx((places[0], places[-1]), abs=1e-6 * (1 + rho))
    assert fit.misfit == pytest.approx(0.0, abs=1e-9)


def test_the_normal_points_away_from_who_sees_it() -> None:
    points = on_line(1.0, 0.3, np.linspace(-1, 1, 9))
    noise = np.broadcast_to(1e-4 * np.eye(2), (9, 2, 2))
    assert fit_line(points, noise, (0.0, 0.0)).line == pytest.approx([1.0, 0.3])
    beyond = fit_line(points, noise, (3.0, 0.5))
    assert beyond.line == pytest.approx([-1.0, 0.3 - math.pi])
    assert beyond.covariance == pytest.approx(fit_line(points, noise).covariance * [[1, -1], [-1, 1]])


@given(seeds, st.integers(3, 40))
def test_equal_round_noise_gives_total_least_squares(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    points = on_line(3.0, rng.uniform(-3, 3), np.linspace(-2, 2, n)) + 0.05 * rng.normal(size=(n, 2))
    fit = fit_line(points, np.broadcast_to(0.0025 * np.eye(2), (n, 2, 2)))
    centred = points - points.mean(axis=0)
    values, vectors = np.linalg.eigh(centred.T @ centred)
    normal = np.array([math.cos(fit.line[1]), math.sin(fit.line[1])])
    assert abs(normal @ vectors[:, 0]) == pytest.approx(1.0, abs=1e-10)
    assert normal @ points.mean(axis=0) == pytest.approx(fit.line[0], abs=1e-9)
    assert fit.misfit == pytest.approx(values[0] / 0.0025 / max(1, n - 2), rel=1e-5)


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


@given(st.floats(-5, 5), st.floats(-5, 5), st.floats(0.05, 3.0), angles, st.floats(0.6, 6.0), st.integers(4, 40))
def test_points_on_an_arc_give_that_circle(x: float, y: float, r: float, start: float, arc: float, n: int) -> None:
    points = on_arc(x, y, r, np.linspace(start, start + arc, n))
    fit = fit_disc(points, np.broadcast_to(1e-4 * np.eye(2), (n, 2, 2)))
    assert fit is not None
    assert fit.disc == pytest.approx([x, y, r], abs=1e-6)
    rough = fit_circle_roughly(points)
    assert rough == pytest.approx([x, y, r], abs=1e-6)


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


def test_shapes_that_do_not_fit() -> None:
    with pytest.raises(
        EstimationError,
        match=r"expected shapes .*, got \(1, 2\), \(1, 2, 2\)",
    ):
        fit_line([[0, 0]], np.ones((1, 2, 2)))
    with pytest.raises(EstimationError, match=r"got \(3, 2\), \(2, 2, 2\)"):
        fit_line(np.ones((3, 2)), np.ones((2, 2, 2)))
    with pytest.raises(EstimationError, match="3 equal ones"):
        fit_line(np.ones((3, 2)), np.broadcast_to(np.eye(2), (3, 2, 2)))
    with pytest.raises(EstimationError, match="n >= 3"):
        fit_disc([[0, 0], [1, 1]], np.ones((2, 2, 2)))
