# ruff: noqa: N803, N806 # the names are those of the formulas: A, C, J
"""Lines and circles fitted to points of unequal noise, with the covariances of what they come to."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark.estimation.errors import EstimationError
from trailmark.se2 import FloatArray, wrap

__all__ = ["DiscFit", "LineFit", "fit_circle_roughly", "fit_disc", "fit_line"]

IntArray = NDArray[np.intp]

STEPS = 25
"""Gauss-Newton steps of a fit at most; a handful do."""

SETTLED = 1e-8
"""A step this small, relative to the points' extent, ends a fit."""


class LineFit(NamedTuple):
    """A stretch of a straight line."""

    line: FloatArray
    """ρ (metres), α (radians), shape (2,)."""
    covariance: FloatArray
    """Of ρ and α, shape (2, 2)."""
    span: tuple[float, float]
    """First and last place of its end points along (−sin α, cos α), metres."""
    misfit: float
    """Sum of squared residuals over variances, per degree of freedom."""
    indices: IntArray
    """Its end points' places in the arrays that it was fitted to, in the order of the sweep."""


class DiscFit(NamedTuple):
    """An arc of a circle."""

    disc: FloatArray
    """x, y, radius (metres), shape (3,)."""
    covariance: FloatArray
    """Of x, y and radius, shape (3, 3)."""
    misfit: float
    """As for a line."""
    indices: IntArray
    """As for a line."""


def fit_line(points: ArrayLike, covariances: ArrayLike, origin: ArrayLike = (0.0, 0.0)) -> LineFit:
    """Return the line that makes the points likeliest: weighted total least squares.

    Each point counts by its variance across the line, nᵀ C n (Pfister, Roumeliotis & Burdick 2003, IEEE International
    Conference on Robotics and Automation). The covariance is the inverse of the information Σ j jᵀ / nᵀ C n with
    j = (1, −p·t), by which ρ − p·n changes with ρ and α; it agrees with the error propagation of Arras & Siegwart
    1997 where their weights are these variances.

    Args:
        points: shape (n, 2), n >= 2, not all the same.
        covariances: shape (n, 2, 2), positive definite.
        origin: where the points were seen from, shape (2,): the normal points away from there.

    Raises:
        EstimationError: another shape, or points that are all the same.
    """
    p, C = _checked(points, covariances, 2)
    centre = p.mean(axis=0)
    # From the centre, so that ρ and α are hardly correlated and far from the origin no digits are lost.
    q = p - centre
    _, values, axes = np.linalg.svd(q, full_matrices=False)
    if not values[0] > 0.0:
        raise EstimationError(f"points: expected two or more different ones, got {len(p)} equal ones")
    alpha, rho = math.atan2(float(axes[0, 0]), -float(axes[0, 1])), 0.0
    for _ in range(STEPS):
        residual, _, _, information, gradient = _line_system(q, C, rho, alpha)
        (a, b), (_, d) = information
        det = a * d - b * b
        turn = (a * gradient[1] - b * gradient[0]) / det
        shift = (d * gradient[0] - b * gradient[1]) / det
        rho, alpha = rho + shift, alpha + turn
        if abs(shift) < SETTLED * values[0] and abs(turn) < SETTLED:
            break
    if float(_axes(alpha)[0] @ (centre - np.asarray(origin, dtype=np.float64)) + rho) < 0.0:
        rho, alpha = -rho, alpha + math.pi
    alpha = float(wrap(alpha))
    n, t = _axes(alpha)
    residual, variance, along, information, _ = _line_system(q, C, rho, alpha)
    # Back from the centre c: ρ + c·n, whose change with α is c·t.
    back = np.array([[1.0, float(centre @ t)], [0.0, 1.0]])
    covariance = back @ np.linalg.inv(information) @ back.T
    places = along + float(centre @ t)
    misfit = float((residual**2 / variance).sum()) / max(1, len(p) - 2)
    line = np.array([rho + float(centre @ n), alpha])
    span = (float(places.min()), float(places.max()))
    return LineFit(line, 0.5 * (covariance + covariance.T), span, misfit, np.arange(len(p)))


def fit_circle_roughly(points: ArrayLike) -> FloatArray | None:
    """Return centre and radius, shape (3,), by Kåsa's algebraic fit; None for points on a line.

    It is quick, and short arcs bias it towards small circles (Kåsa 1976, IEEE Transactions on Instrumentation and
    Measurement).

    Args:
        points: shape (n, 2), n >= 3.
    """
    p = np.asarray(points, dtype=np.float64)
    centre = p.mean(axis=0)
    q = p - centre
    # x² + y² = 2ax + 2by + c.
    A = np.column_stack([2.0 * q, np.ones(len(q))])
    (a, b, c), _, rank, _ = np.linalg.lstsq(A, (q**2).sum(axis=1), rcond=None)
    square = float(c + a * a + b * b)
    return np.array([a + centre[0], b + centre[1], math.sqrt(square)]) if rank == 3 and square > 0.0 else None


def fit_disc(points: ArrayLike, covariances: ArrayLike) -> DiscFit | None:
    """Return the circle that makes the points likeliest, or None where they are too straight for one.

    The rough circle is refined by Gauss-Newton steps on the distances to it, each weighted by the point's variance
    along the radius. The covariance is the inverse of their information.

    Args:
        points: shape (n, 2), n >= 3.
        covariances: shape (n, 2, 2), positive definite.

    Raises:
        EstimationError: another shape.
    """
    p, C = _checked(points, covariances, 3)
    first = fit_circle_roughly(p)
    if first is None:
        return None
    centre = p.mean(axis=0)
    q, disc = p - centre, first - [*centre, 0.0]
    size = float(np.abs(q).max())
    for _ in range(STEPS):
        away = q - disc[:2]
        distance = np.hypot(*away.T)
        if not (distance.min() > 0.0 and disc[2] < 1e3 * size):
            return None
        u = away / distance[:, None]
        variance = np.einsum("ni,nij,nj->n", u, C, u)
        J = np.column_stack([u, np.ones(len(q))])
        information = J.T @ (J / variance[:, None])
        try:
            step = np.linalg.solve(information, J.T @ ((distance - disc[2]) / variance))
        except np.linalg.LinAlgError:
            return None
        disc = disc + step
        if np.abs(step).max() < SETTLED * size:
            break
    if not 0.0 < disc[2] < 1e3 * size or np.abs(step).max() > 1e-3 * size:
        return None
    misfit = float((((np.hypot(*(q - disc[:2]).T) - disc[2]) ** 2) / variance).sum()) / max(1, len(p) - 3)
    disc[:2] += centre
    covariance = np.linalg.inv(information)
    if not (np.diag(covariance) > 0.0).all():
        return None
    return DiscFit(disc, 0.5 * (covariance + covariance.T), misfit, np.arange(len(p)))


def _line_system(
    q: FloatArray, C: FloatArray, rho: float, alpha: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return residuals, their variances, places along the line, and the normal equations of a Gauss-Newton step."""
    n, t = _axes(alpha)
    variance = n[0] * n[0] * C[:, 0, 0] + 2.0 * n[0] * n[1] * C[:, 0, 1] + n[1] * n[1] * C[:, 1, 1]
    residual, along = q @ n - rho, q @ t
    weight = 1.0 / variance
    moment = -float(weight @ along)
    information = np.array([[weight.sum(), moment], [moment, weight @ along**2]])
    gradient = np.array([weight @ residual, -float((weight * along) @ residual)])
    return residual, variance, along, information, gradient


def _axes(alpha: float) -> tuple[FloatArray, FloatArray]:
    cos, sin = math.cos(alpha), math.sin(alpha)
    return np.array([cos, sin]), np.array([-sin, cos])


def _checked(points: ArrayLike, covariances: ArrayLike, minimum: int) -> tuple[FloatArray, FloatArray]:
    p, C = np.asarray(points, dtype=np.float64), np.asarray(covariances, dtype=np.float64)
    if p.ndim != 2 or p.shape[1] != 2 or len(p) < minimum or C.shape != (len(p), 2, 2):
        raise EstimationError(
            f"points, covariances: expected shapes (n, 2), (n, 2, 2), n >= {minimum}, got {p.shape}, {C.shape}"
        )
    return p, C
