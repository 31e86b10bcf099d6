"""Estimated features to estimated obstacles: points to discs, lines to walls.

What comes out is an :class:`trailmark.world.ObstacleEstimate`: a mean shape and the covariance of the numbers that
place it. :mod:`trailmark.estimation.risk.allocation` grows it into an obstacle of a world.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from trailmark.checked import NonNegative, Numbers, Positive, checked_arguments, shaped
from trailmark.estimation.errors import EstimationError
from trailmark.shapes import Disc, Rectangle
from trailmark.world import ObstacleEstimate

__all__ = ["disc_estimates", "wall_estimate"]


@checked_arguments(EstimationError)
def disc_estimates(
    points: Annotated[ArrayLike, shaped(None, 2)],
    covariances: Annotated[ArrayLike, shaped(None, 2, 2)],
    radius: Numbers,
    radius_sigma: Numbers = 0.0,
) -> list[ObstacleEstimate]:
    """Return a disc for each point-like feature, such as a tree or a post.

    Args:
        points: estimated centres, shape (m, 2), metres.
        covariances: shape (m, 2, 2), square metres.
        radius: metres, one for all or shape (m,): known, or half of the diameters that a detector measured.
        radius_sigma: standard deviation of the radius, metres, one for all or shape (m,); assumed to be independent
            of the centre's error.

    Raises:
        EstimationError: shapes that do not fit together.
        ShapeError: a radius that is not positive, a centre that is not finite.
        WorldError: a covariance that is none.
    """
    centres, blocks = np.asarray(points, dtype=np.float64), np.asarray(covariances, dtype=np.float64)
    try:
        radii, sigmas, _ = (np.broadcast_to(v, len(centres)) for v in (radius, radius_sigma, np.empty(len(blocks))))
    except ValueError:
        shapes = [np.shape(given) for given in (points, covariances, radius, radius_sigma)]
        raise EstimationError(
            f"disc_estimates: expected shapes (m, 2), (m, 2, 2), and (m,) or () twice, got {shapes}"
        ) from None
    estimates = []
    for centre, block, r, sigma in zip(centres, blocks, radii, sigmas, strict=True):
        covariance = np.zeros((3, 3))
        covariance[:2, :2], covariance[2, 2] = block, sigma**2
        disc = Disc((float(centre[0]), float(centre[1])), float(r))
        estimates.append(ObstacleEstimate(disc, covariance if sigma else block))
    return estimates


@checked_arguments(EstimationError)
def wall_estimate(
    line: Annotated[ArrayLike, shaped(2)],
    covariance: Annotated[ArrayLike, shaped(2, 2)],
    span: tuple[float, float],
    *,
    thickness: Positive,
    along_sigma: NonNegative = 0.0,
    end_sigma: NonNegative = 0.0,
) -> ObstacleEstimate:
    """Return a wall: a rectangle whose front is a stretch of an estimated line and that lies behind it.

    With n = (cos α, sin α) and t = (−sin α, cos α), the front is {ρ n + s t : span[0] <= s <= span[1]} and the wall
    reaches from there along n: give the line by that of its two names whose normal points away from who saw it.
    A change of ρ and α moves the front's middle, at s = m, along n by δρ − m·δα, and turns the wall by δα. Where
    the wall ends is measured by the readings themselves, not by the line.

    Args:
        line: ρ (metres, of either sign) and α (radians), shape (2,).
        covariance: of ρ and α, shape (2, 2).
        span: where the front begins and ends along t, metres.
        thickness: of the wall, metres. The readings do not show it.
        along_sigma: standard deviation of the wall's place along the line, metres.
        end_sigma: further standard deviation of each of the two ends by itself, metres.

    Returns:
        A rectangle with the covariance of x, y and heading; of length too, if the ends have errors of their own.

    Raises:
        ShapeError: a span or thickness that is not positive.
        WorldError: a covariance that is none.
    """
    (rho, alpha), (low, high) = (float(v) for v in np.asarray(line, dtype=np.float64)), span
    cos, sin = math.cos(alpha), math.sin(alpha)
    middle, half = 0.5 * (low + high), 0.5 * thickness
    # Columns: ρ, α, the shift of the middle along the line, the change of length.
    J = np.zeros((4, 4))  # noqa: N806 # a Jacobian
    along, across = np.array([-sin, cos]), np.array([cos, sin])
    J[:2, 0], J[:2, 1], J[:2, 2] = across, half * along - middle * across, along
    J[2, 1] = J[3, 3] = 1.0
    sources = np.zeros((4, 4))
    sources[:2, :2] = covariance
    sources[2, 2], sources[3, 3] = along_sigma**2 + 0.5 * end_sigma**2, 2.0 * end_sigma**2
    total = J @ sources @ J.T
    centre = (rho + half) * across + middle * along
    wall = Rectangle((float(centre[0]), float(centre[1])), high - low, thickness, alpha + 0.5 * math.pi)
    total = 0.5 * (total + total.T)
    return ObstacleEstimate(wall, total if end_sigma else total[:3, :3])
