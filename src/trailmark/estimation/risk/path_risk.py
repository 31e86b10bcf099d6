"""The probability that a path meets one of the true obstacles, of which only estimates are known.

The obstacles are drawn from their distributions, with the robot's own pose error, and the draws that meet what the
robot covers along the path are counted: Janson, Schmerling & Pavone, "Monte Carlo motion planning for robot trajectory
optimization under uncertainty", ISRR 2015, section 3. The counts of all obstacles are added up (Boole's inequality), so
that nothing is assumed of how the obstacles' errors depend on one another. All this takes the errors to be Gaussian
with the covariances given: an estimator that is too sure of itself makes the figure too small.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike
from scipy.special import chdtri

from trailmark.arguments import Count, NonNegative, Seed, checked_arguments, shaped
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.risk.swept_region import swept_region
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc, Polygon, Rectangle
from trailmark.world import ObstacleEstimate, RiskBound, World

__all__ = ["PathRisk", "path_risk"]

SURE = 1e-3
"""Probability with which the upper bound may be below the true sum, by bad luck with the draws."""

FAR = 8.0
"""Standard deviations: an obstacle that would have to move farther to meet the path is not drawn (its share of the risk
is below 1e-13)."""

ROUNDING = 1e-6
"""Metres by which distances may be rounded, far from the origin."""


class PathRisk(NamedTuple):
    """How often drawn obstacles meet a path.

    Attributes:
        hits: draws that meet the path, of all obstacles together.
        draws: of each obstacle.
    """

    hits: int
    draws: int

    @property
    def probability(self) -> float:
        """The sum of the obstacles' probabilities of a collision, as the draws have it; at most 1."""
        return min(1.0, self.hits / self.draws)

    @property
    def upper_bound(self) -> float:
        """What that sum is at most, but for bad luck with the draws (of probability 0.001).

        The count is a sum of independent trials, which spreads no wider than a Poisson variable of the same mean:
        the exact bound for that one (Garwood 1936) holds.
        """
        return min(1.0, 0.5 * float(chdtri(2.0 * (self.hits + 1), SURE)) / self.draws)


@checked_arguments(EstimationError)
def path_risk(
    world: World,
    states: Annotated[ArrayLike, shaped(None, 3, minimum=1)],
    *,
    draws: Count = 20_000,
    seed: Seed = 0,
    margin: NonNegative = 0.0,
) -> PathRisk:
    """Return how often the true obstacles would meet a path.

    Args:
        world: with estimates and a robot; how far its obstacles are grown makes no difference, but the pose covariance
            of its ``risk`` counts. Obstacles without an estimate are known exactly and do not count.
        states: the path's configurations, shape (n, 3); straight motions in between.
        draws: of each obstacle, >= 1.
        seed: the same one draws the same errors.
        margin: metres by which the robot may be off the straight motions between the states.

    Raises:
        EstimationError: a world without a robot, an argument out of range.
    """
    if world.robot is None:
        raise EstimationError("path_risk: expected a world with a robot, got one without")
    region = swept_region(world.robot, states)
    shapely.prepare(region)
    hits = 0
    for index, estimate in enumerate(world.estimates):
        if estimate is not None:
            rng = np.random.default_rng([seed, index])
            hits += _hits(estimate, region, margin, world.risk, world.robot.sweep_radius, draws, rng)
    return PathRisk(hits, draws)


def _hits(
    estimate: ObstacleEstimate,
    region: Any,
    margin: float,
    bound: RiskBound | None,
    sweep_radius: float,
    draws: int,
    rng: np.random.Generator,
) -> int:
    """Return in how many draws of an obstacle, and of the robot's pose, the two meet."""
    shape, k = estimate.mean, len(estimate.covariance)
    pose = np.zeros((3, 3)) if bound is None or bound.pose_covariance is None else bound.pose_covariance
    gap = float(shapely.distance(region, shape.polygon().shapely())) - margin
    spread = math.sqrt(np.linalg.eigvalsh(estimate.covariance)[-1])
    spread *= 1.5 + (0.0 if isinstance(shape, Disc) else _arm(shape))
    if gap > FAR * (spread + math.sqrt(np.linalg.eigvalsh(pose)[-1]) * (1.0 + sweep_radius)):
        return 0
    errors = rng.multivariate_normal(np.zeros(k), estimate.covariance, draws, method="eigh")
    robot = rng.multivariate_normal(np.zeros(3), pose, draws, method="eigh")
    # Relative to the robot's idea of itself the obstacle is displaced the other way. A turn of the robot about its
    # reference point moves no point of it by more than this.
    errors[:, :2] -= robot[:, :2]
    beyond = margin + sweep_radius * np.abs(robot[:, 2])
    # Most draws leave the obstacle so near to where it was estimated that it cannot meet the path.
    near = gap + margin <= _displacements(shape, errors) + beyond
    errors, beyond = errors[near], beyond[near]
    if isinstance(shape, Disc):
        radius = shape.radius + (errors[:, 2] if k > 2 else 0.0)
        centres = shapely.points(np.asarray(shape.center) + errors[:, :2])
        return int(np.count_nonzero(shapely.dwithin(region, centres, np.maximum(radius, 0.0) + beyond)))
    return int(np.count_nonzero(shapely.dwithin(region, _drawn(shape, errors), beyond)))


def _displacements(shape: Disc | Rectangle | Polygon, errors: FloatArray) -> FloatArray:
    """Return metres by which each of the errors, shape (n, k), brings a shape nearer to anything, at most."""
    moved = np.hypot(errors[:, 0], errors[:, 1]) + ROUNDING
    if isinstance(shape, Disc):
        return np.asarray(moved + np.abs(errors[:, 2])) if errors.shape[1] > 2 else moved
    if errors.shape[1] > 2:
        moved += _arm(shape) * np.abs(errors[:, 2])
    # A rectangle's corners move by half of what its sides grow.
    return np.asarray(moved + 0.5 * np.hypot.reduce(errors[:, 3:], axis=1)) if errors.shape[1] > 3 else moved


def _arm(shape: Rectangle | Polygon) -> float:
    """Return the largest distance of a shape's vertices from the point that it turns about, metres."""
    if isinstance(shape, Rectangle):
        return 0.5 * math.hypot(shape.length, shape.width)
    return float(np.hypot(*(shape.vertices - shape.vertices.mean(axis=0)).T).max())


def _drawn(shape: Rectangle | Polygon, errors: FloatArray) -> Any:
    """Return a rectangle or polygon with each of the errors (n, k), as n shapely polygons."""
    k = errors.shape[1]
    turn = errors[:, 2] if k > 2 else np.zeros(len(errors))
    if isinstance(shape, Rectangle):
        sides = np.tile([shape.length, shape.width], (len(errors), 1))
        sides[:, : max(0, k - 3)] += errors[:, 3:]
        corners = 0.5 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        rings, centre = [corners * np.maximum(sides, 1e-9)[:, None]], np.asarray(shape.center)
        turn = turn + shape.heading
    else:
        centre = shape.vertices.mean(axis=0)
        rings = [np.broadcast_to(ring - centre, (len(errors), *ring.shape)) for ring in (shape.vertices, *shape.holes)]
    c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
    placed = []
    for ring in rings:
        x, y = ring[..., 0], ring[..., 1]
        moved = np.stack([c * x - s * y, s * x + c * y], axis=-1)
        placed.append(shapely.linearrings(centre + errors[:, None, :2] + moved))
    holes = np.stack(placed[1:], axis=-1) if len(placed) > 1 else None
    return shapely.polygons(placed[0], holes=holes)
