"""Obstacles grown so that a path past all of them meets any true one with at most a stated probability.

:func:`trailmark.estimation.grow` gives each obstacle a region. If obstacle i leaves its region with probability δᵢ at
most, then a path that avoids all regions meets an obstacle with probability Σ δᵢ at most, whatever the dependence
between obstacles (Boole's inequality); :func:`regrow` shares 1 − p out. All this takes the errors to be Gaussian with
the covariances given: an estimator that is too sure of itself makes the bound wrong.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from trailmark.checked import Count, Numbers, Probability, Rule, checked_arguments, shaped
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.risk.growth import Spread
from trailmark.se2 import FloatArray, difference, interpolate, transform
from trailmark.shapes import Disc, Polygon, Shape, triangulate
from trailmark.world import ObstacleEstimate, Query, RiskBound, Robot, World

__all__ = ["grown_world", "reallocate", "regrow", "required_risk", "spend_risk", "swept_region"]

Matrix3 = Annotated[ArrayLike, shaped(3, 3)]
Rate = Annotated[float, Rule("a number above 0, at most 1", lambda v: 0.0 < v <= 1.0)]

MIN_RISK = 1e-15
"""What an obstacle far from a path is said to cost (nothing that a Gaussian says below this is worth anything)."""


@checked_arguments(EstimationError)
def grown_world(
    estimates: Sequence[ObstacleEstimate],
    bounds: tuple[float, float, float, float],
    confidence: Probability,
    *,
    name: str = "map",
    robot: Robot | None = None,
    boundary: Polygon | None = None,
    queries: Sequence[Query] = (),
    fixed: Sequence[Shape] = (),
    weights: Numbers | None = None,
    pose_covariance: Matrix3 | None = None,
) -> World:
    """Return a world in which a valid path meets none of the true obstacles with at least the stated probability.

    Args:
        estimates: the obstacles; what share of the risk they carry already is overridden.
        bounds: of the world.
        confidence: above 0 and below 1.
        name: of the world.
        robot: of the world. A pose covariance needs it: its size says what a heading error moves.
        boundary: of the world; counts as known.
        queries: of the world.
        fixed: further obstacles, which count as known.
        weights: see :func:`regrow`; None gives all the same.
        pose_covariance: see :func:`trailmark.estimation.grow`.

    Raises:
        EstimationError: a value out of these ranges, a pose covariance without a robot.
    """
    plain = World(
        name,
        bounds,
        (*(estimate.mean for estimate in estimates), *fixed),
        robot,
        boundary,
        tuple(queries),
        (*estimates, *(None for _ in fixed)),
    )
    return regrow(plain, confidence, weights=_shares(len(estimates), weights), pose_covariance=pose_covariance)


@checked_arguments(EstimationError)
def regrow(
    world: World,
    confidence: Probability,
    *,
    weights: Numbers | None = None,
    pose_covariance: Matrix3 | None = None,
) -> World:
    """Return the world with its estimated obstacles grown anew, from their means.

    Args:
        world: with estimates; obstacles without one stay as they are.
        confidence: above 0 and below 1.
        weights: shape (n,), above 0, one per estimate: an obstacle with twice the weight gets twice the risk, and so
            grows less. None keeps the shares that the estimates carry, and what they leave is shared out equally
            between those that carry none.
        pose_covariance: see :func:`trailmark.estimation.grow`; None keeps the world's.

    Raises:
        EstimationError: a value out of these ranges, a pose covariance and no robot.
    """
    known = [estimate for estimate in world.estimates if estimate is not None]
    shares = _shares_of(known) if weights is None else _shares(len(known), weights)
    before = world.risk or RiskBound(confidence)
    pose = before.pose_covariance if pose_covariance is None else np.asarray(pose_covariance, dtype=np.float64)
    reach = before.reach if world.robot is None else world.robot.sweep_radius
    if pose_covariance is not None and world.robot is None and before.reach == 0.0:
        raise EstimationError("pose_covariance: expected a world with a robot, got one without")
    bound = RiskBound(confidence, pose, 0.0 if pose is None else reach)
    risks, obstacles = iter(((1.0 - confidence) * shares).tolist()), []
    for shape, estimate in zip(world.obstacles, world.estimates or (None,) * len(world.obstacles), strict=True):
        if estimate is None:
            obstacles.append(shape)
        else:
            spread = Spread.of(estimate, bound)
            obstacles.append(spread.region(spread.quantile(next(risks))))
    share = iter(shares.tolist())
    estimates = [None if e is None else replace(e, share=next(share)) for e in world.estimates]
    return replace(world, obstacles=tuple(obstacles), estimates=tuple(estimates), risk=bound)


def required_risk(estimate: ObstacleEstimate, region: Any, bound: RiskBound | None = None, *, steps: int = 24) -> float:
    """Return the least risk for which the grown obstacle keeps off a region, MIN_RISK to 1.

    Args:
        estimate: the obstacle.
        region: what the robot sweeps, a shapely geometry.
        bound: whose pose covariance and reach count; None leaves the robot's errors out.
        steps: of the bisection.
    """
    import shapely

    spread = Spread.of(estimate, bound)
    shapely.prepare(region)
    low, high = 0.0, spread.quantile(MIN_RISK)
    if not _overlap(spread.region(high), region):
        return MIN_RISK
    for _ in range(steps):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if _overlap(spread.region(middle), region) else (middle, high)
    return spread.risk(low) if spread.freedom else 1.0


@checked_arguments(EstimationError)
def reallocate(risks: Numbers, required: Numbers, *, rate: Rate = 0.5) -> FloatArray:
    """Return risks, shape (n,), of the same sum, moved from obstacles that do not need them to those that do.

    A step in the spirit of iterative risk allocation (Ono & Williams 2008, IEEE Conference on Decision and Control):
    obstacles give up ``rate`` of their risk, and get it back in proportion to what the path needs of them. As long
    as the needs add up to no more than there is, none falls below its need: the path stays valid, and the next one
    can cut closer where it matters.

    Args:
        risks: as they were, shape (n,), each above 0.
        required: what the path needs of each, shape (n,), above 0, by :func:`required_risk`.
        rate: above 0 and at most 1.

    Raises:
        EstimationError: other shapes, values out of these ranges.
    """
    before, needed = np.asarray(risks, dtype=np.float64), np.asarray(required, dtype=np.float64)
    if before.ndim != 1 or needed.shape != before.shape or not ((before > 0.0) & (needed > 0.0)).all():
        shapes = f"{before.shape}, {needed.shape}"
        raise EstimationError(f"reallocate: expected risks and needs above 0, shapes (n,), got shapes {shapes}")
    return np.asarray((1.0 - rate) * before + rate * before.sum() * needed / needed.sum())


class SpentRisk(NamedTuple):
    """What :func:`spend_risk` comes to."""

    world: World
    """The world that the best path was planned in."""
    states: FloatArray | None
    """That path's configurations, shape (n, 3), or None if no path was found."""
    costs: tuple[float, ...]
    """The cost of each round's path; infinite where none was found."""


@checked_arguments(EstimationError)
def spend_risk(
    world: World, plan: Callable[[World], tuple[FloatArray, float] | None], *, rounds: Count = 4, rate: Rate = 0.5
) -> SpentRisk:
    """Plan a path and spend the world's risk where that path needs it, in turns.

    Args:
        world: grown, with a robot.
        plan: gives a path's configurations, shape (n, 3), and its cost, in a world; None if it finds none.
        rounds: plans at most, >= 1.
        rate: see :func:`reallocate`.

    Returns:
        The best round; its world states the same confidence as ``world``.

    Raises:
        EstimationError: a world that was not grown, or without a robot.
    """
    if world.risk is None or world.robot is None:
        raise EstimationError("spend_risk: expected a grown world with a robot, got one without risk or robot")
    best, costs = SpentRisk(world, None, ()), list[float]()
    for i in range(rounds):
        found = plan(world)
        costs.append(math.inf if found is None else found[1])
        if found is None:
            break
        if costs[-1] <= min(costs):
            best = SpentRisk(world, found[0], ())
        if i == rounds - 1:
            break
        region = swept_region(world.robot, found[0])
        known = [estimate for estimate in world.estimates if estimate is not None]
        risks = (1.0 - world.risk.confidence) * _shares_of(known)
        needed = [required_risk(estimate, region, world.risk) for estimate in known]
        world = regrow(world, world.risk.confidence, weights=reallocate(risks, needed, rate=rate))
    return best._replace(costs=tuple(costs))


def swept_region(robot: Robot, states: ArrayLike, *, turn: float = 0.02) -> Any:
    """Return a region that contains what the robot covers along a path, as a shapely geometry.

    Args:
        robot: its footprint.
        states: the path's configurations, shape (n, 3), n >= 1.
        turn: radians: motions are cut into pieces that turn by no more. The region reaches at most R·turn beyond
            the truth, R the robot's circumradius, and for a disc its outline's 1 mm.
    """
    import shapely

    q = np.atleast_2d(np.array(states, dtype=np.float64))
    # Relative to where it begins: overlays round, and may snap, by shares of their coordinates.
    origin = q[0, :2].copy()
    q[:, :2] -= origin
    placed = [q[:1]]
    for a, b in itertools.pairwise(q):
        n = 1 if robot.sweep_radius == 0.0 else max(1, math.ceil(abs(float(difference(a, b)[2])) / turn))
        placed.append(interpolate(a, b, np.arange(1, n + 1) / n))
    outline = robot.outline
    solid = shapely.area(shapely.convex_hull(outline.shapely())) <= outline.area * (1.0 + 1e-12)
    pieces = outline.vertices[None] if solid else triangulate(outline)
    poses = np.concatenate(placed)
    # Shape (pieces, poses, corners, 2); what lies between two poses is the hull of a piece at both.
    corners = np.stack([transform(poses, piece) for piece in pieces])
    pairs = np.concatenate([corners[:, :-1], corners[:, 1:]], axis=2) if len(poses) > 1 else corners
    swept = shapely.convex_hull(shapely.multipoints(pairs.reshape(-1, pairs.shape[2], 2)))
    # Within a piece a point keeps within R·turn²/8 of the line from its first to its last place. The arcs of a
    # buffer are drawn inside of it, by 1.1 % at most; what else it does to outlines makes them larger.
    region = shapely.buffer(shapely.union_all(swept), 1.02 * robot.sweep_radius * turn**2 / 8.0)
    return shapely.transform(region, lambda points: points + origin)


def _overlap(shape: Shape, region: Any) -> bool:
    import shapely

    if isinstance(shape, Disc):
        return bool(shapely.distance(region, shapely.Point(shape.center)) < shape.radius)
    return bool(shapely.intersects(region, shape.polygon().shapely()))


def _shares(n: int, weights: ArrayLike | None) -> FloatArray:
    if weights is None:
        return np.full(n, 1.0 / n) if n else np.empty(0)
    w = np.asarray(weights, dtype=np.float64)
    if w.shape != (n,) or not (np.isfinite(w).all() and (w > 0.0).all()):
        raise EstimationError(f"weights: expected {n} finite numbers above 0, got shape {w.shape}")
    return np.asarray(w / w.sum())


def _shares_of(estimates: Sequence[ObstacleEstimate]) -> FloatArray:
    """Return the shares that estimates carry; what those leave goes to the others in equal parts."""
    given = np.array([np.nan if e.share is None else e.share for e in estimates], dtype=np.float64)
    open_ones = np.isnan(given)
    left = 1.0 - float(np.nansum(given))
    if open_ones.any() and not left > 0.0:
        raise EstimationError("estimates: expected shares of the risk that leave some for those without, got all of it")
    return np.where(open_ones, left / max(1, int(open_ones.sum())), given)
