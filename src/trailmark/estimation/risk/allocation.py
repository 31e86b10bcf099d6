"""Obstacles grown so that a path past all of them meets any true one with at most a stated probability.

:func:`trailmark.estimation.grow` gives each obstacle a region. If obstacle i leaves its region with probability δᵢ at
most, then a path that avoids all regions meets an obstacle with probability Σ δᵢ at most, whatever the dependence
between obstacles (Boole's inequality); :func:`regrow` shares 1 − p out. All this takes the errors to be Gaussian with
the covariances given: an estimator that is too sure of itself makes the bound wrong.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from trailmark.arguments import Numbers, Probability, checked_arguments, shaped
from trailmark.changes import Change, Changes, Obstacles, index_of
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.risk.growth import Spread
from trailmark.se2 import FloatArray
from trailmark.shapes import Shape
from trailmark.world import ObstacleEstimate, RiskBound, World

__all__ = ["refined", "regrow"]

Matrix3 = Annotated[ArrayLike, shaped(3, 3)]


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
    share = iter(shares.tolist())
    estimates = tuple(None if e is None else replace(e, share=next(share)) for e in world.estimates)
    return _grown(replace(world, estimates=estimates, risk=bound), bound)


@checked_arguments(EstimationError)
def refined(world: World, estimates: Mapping[str | int, ObstacleEstimate]) -> World:
    """Return the world with some obstacles known better, or at all; the others stay as they are.

    What changed is remembered as that of :meth:`trailmark.world.World.edited`. In a world that is grown for a risk,
    those obstacles are grown anew, with the share of the risk that the estimate carries, else that of the one before.

    Args:
        world: grown or not.
        estimates: by obstacle: its id or its index.

    Raises:
        WorldError: an unknown obstacle, or shares of the risk that add up to more than 1.
        EstimationError: an obstacle to be grown for which there is no share of the risk.
    """
    bound = world.risk
    if bound is None:
        return world.edited(replace=estimates)
    obstacles = Obstacles(world.obstacles, world.ids, world.estimates, world.moving)
    items = []
    for name, estimate in estimates.items():
        i = index_of(obstacles, name, "refined")
        before = world.estimates[i] if world.estimates else None
        share = before.share if before is not None and estimate.share is None else estimate.share
        if share is None:
            raise EstimationError(
                f"refined: obstacle {name!r}: expected an estimate with a share of the risk, got none"
            )
        shared = replace(estimate, share=share)
        known_as = world.ids[i] if world.ids else None
        items.append(Change(known_as, world.obstacles[i], _region(shared, bound), i, i, shared))
    return world.apply(Changes(tuple(items)))


def _grown(world: World, bound: RiskBound) -> World:
    """Return the world with its estimated obstacles grown by what their shares of the risk ask for."""
    obstacles = []
    for shape, estimate in zip(world.obstacles, world.estimates or (None,) * len(world.obstacles), strict=True):
        if estimate is None or estimate.share is None:
            obstacles.append(shape)
        else:
            obstacles.append(_region(estimate, bound))
    return replace(world, obstacles=tuple(obstacles))


def _region(estimate: ObstacleEstimate, bound: RiskBound) -> Shape:
    """Return an obstacle grown by what its share of the risk asks for."""
    assert estimate.share is not None  # noqa: S101 # callers know that
    spread = Spread.of(estimate, bound)
    return spread.region(spread.quantile((1.0 - bound.confidence) * estimate.share))


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
