# ruff: noqa: N806 # the names are those of the literature: x, P, F, W, Q, H, R, S, K
"""Obstacles known up to a covariance: regions that contain them with a stated probability, and the risk of a path.

An obstacle whose numbers have covariance Σ lies, with probability p, among the shapes with ξᵀ Σ⁻¹ ξ <= χ²ₖ(p), ξ the
error of its k numbers; its region contains all of those. If obstacle i leaves its region with probability δᵢ at most,
a path that avoids all regions meets an obstacle with probability Σ δᵢ at most, whatever the dependence between them
(Boole's inequality). The risk of a path is also counted in draws of obstacles and of the robot's pose error: Janson,
Schmerling & Pavone 2015, "Monte Carlo motion planning for robot trajectory optimization under uncertainty", section 3.
All this takes the errors to be Gaussian with the covariances given: an estimator that is too sure of itself makes it
wrong.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike

from trailmark.arguments import Count, NonNegative, Numbers, Probability, Rule, Seed, checked_arguments, shaped
from trailmark.estimation.errors import EstimationError
from trailmark.se2 import FloatArray, difference, interpolate, transform
from trailmark.shapes import Disc, Polygon, Rectangle, Shape, triangulate
from trailmark.world import ObstacleEstimate, RiskBound, World
from trailmark.world.changes import Change, Changes, Obstacles, index_of
from trailmark.world.robot import Robot

SIDES = 16  # Sides of the polygons that stand for ellipses: they reach 1/cos(π/16) − 1 = 2 % of the ellipse beyond it.
# Metres that the polygon of a disc may reach beyond it, where its ellipse is too long for a disc again.
DISC_ERROR = 1e-3
OUTWARDS = 1e-9  # Regions are this fraction of their ellipse wider than calculated: more than rounding takes away.


@checked_arguments(EstimationError)
def grow(
    estimate: ObstacleEstimate,
    confidence: Probability,
    *,
    pose_covariance: Annotated[ArrayLike, shaped(3, 3)] | None = None,
    reach: NonNegative = 0.0,
    sides: Annotated[int, Rule("a whole number of 4 or more", lambda v: v >= 4)] = SIDES,
) -> Shape:
    """Return a region that contains the true obstacle with at least the stated probability.

    For a covariance of x and y it is the Minkowski sum of the mean shape with the ellipse {x : xᵀ Σ⁻¹ x <= χ²₂(p)},
    drawn as a polygon about it: it contains that sum, and is contained in the sum with the ellipse scaled by
    1/cos(π/sides) (discs: and by DISC_ERROR). Other numbers enter to first order at each vertex of the shape, and
    the second order as a bound: a turn δ moves a vertex at distance b from the centre by at most b·δ²/2 away from
    its tangent. A disc whose ellipse is as good as round stays a disc. No covariance leaves the shape as it is.

    The robot's own pose error e, constant along a path, counts too: relative to the robot the obstacle is displaced
    by −(e_x, e_y), and a point of the robot by at most ``reach`` times e_θ. This adds the pose's covariance to Σ and,
    since a displacement and a dilation of variance v in one ellipsoid add up to no more than a displacement with v·I
    added to its covariance, reach²·Var(θ) to both variances. Errors that change along the path are bounded at each
    moment, not over the whole path.

    Args:
        estimate: the obstacle.
        confidence: p, above 0 and below 1.
        pose_covariance: shape (3, 3), of the robot's x, y, theta in the world's frame; independent of the obstacle's.
        reach: metres that a radian moves a point of the robot, ``Robot.sweep_radius``.
        sides: of the polygon for an ellipse, >= 4.

    Raises:
        EstimationError: a value out of these ranges.
    """
    bound = RiskBound(confidence, None if pose_covariance is None else np.asarray(pose_covariance), reach)
    spread = Spread.of(estimate, bound)
    return spread.region(spread.quantile(1.0 - confidence), sides)


class Spread(NamedTuple):
    """How an obstacle's vertices move with the errors ξ of its k numbers and of the robot's pose."""

    mean: Shape
    points: FloatArray  # Shape (m, 2): its vertices, or a disc's centre.
    covariance: FloatArray  # Shape (m, 2, 2): that of each vertex, dilations included.
    turn: float  # Standard deviation of the obstacle's heading, radians.
    arms: FloatArray  # Shape (m,), metres from the centre of turning to each vertex.
    stretch: float  # Standard deviation of half the diagonal, metres.
    # Degrees of freedom of what ξ does to the obstacle relative to the robot: the rank of the covariance of relative
    # displacement, turn, change of size and dilations. A robot's displacement adds none.
    freedom: int

    @classmethod
    def of(cls, estimate: ObstacleEstimate, bound: RiskBound | None = None) -> Spread:
        """Return that of an obstacle relative to a robot whose pose error ``bound`` states; None: it has none."""
        shape, k = estimate.mean, len(estimate.covariance)
        points, pivot = _vertices(shape)
        arms = points - pivot
        # The obstacle's k numbers, then the robot's x, y, theta.
        sigma = np.zeros((k + 3, k + 3))
        sigma[:k, :k] = estimate.covariance
        J = np.zeros((len(points), 2, k + 3))
        J[:, 0, 0] = J[:, 1, 1] = 1.0
        dilations = np.zeros((2, k + 3))
        if isinstance(shape, Disc):
            dilations[0, 2:k] = 1.0
        elif k > 2:
            J[:, 0, 2], J[:, 1, 2] = -arms[:, 1], arms[:, 0]
        if isinstance(shape, Rectangle):
            J[:, :, 3:k] = _stretches(shape, arms)[:, :, : max(0, k - 3)]
        if bound is not None and bound.pose_covariance is not None:
            used = 3 if bound.reach > 0.0 else 2
            sigma[k : k + used, k : k + used] = bound.pose_covariance[:used, :used]
            J[:, 0, k] = J[:, 1, k + 1] = -1.0
            dilations[1, k + 2] = bound.reach
        covariance = J @ sigma @ np.swapaxes(J, 1, 2)
        # u·Jξ + |d·ξ| reaches √(χ²(uᵀAu ± 2uᵀb + c)), A = JΣJᵀ, b = JΣd, c = dᵀΣd; at most that with A + (c + 2‖b‖)I.
        c = np.einsum("ij,jk,ik", dilations, sigma, dilations)
        b = np.linalg.norm(J @ sigma @ dilations.T, axis=1).sum(axis=-1)
        covariance = covariance + (c + 2.0 * b)[:, None, None] * np.eye(2)
        turns = k > 2 and not isinstance(shape, Disc)
        turn = math.sqrt(sigma[2, 2]) if turns else 0.0
        stretch = 0.5 * math.sqrt(float(np.trace(sigma[3:k, 3:k])))
        # All of the above depends on ξ through these combinations only, so their ellipsoid is enough.
        relative = np.zeros((2, k + 3))
        relative[:, :2] = np.eye(2)
        if bound is not None and bound.pose_covariance is not None:
            relative[:, k : k + 2] = -np.eye(2)
        M = np.vstack([relative, np.eye(k + 3)[2:k], dilations[1]])
        return cls(shape, points, covariance, turn, np.hypot(*arms.T), stretch, _rank(M @ sigma @ M.T))

    def quantile(self, risk: float) -> float:
        """Return the radius, in standard deviations, of the ellipsoid that ξ leaves with probability ``risk``."""
        from scipy.special import chdtri

        return math.sqrt(float(chdtri(self.freedom, risk))) if self.freedom else 0.0

    def risk(self, q: float) -> float:
        """Return the probability with which ξ leaves the ellipsoid of radius q standard deviations."""
        from scipy.special import chdtrc

        return float(chdtrc(self.freedom, q * q)) if self.freedom else 0.0

    def region(self, q: float, sides: int = SIDES) -> Shape:
        """Return what contains all shapes whose errors lie in the ellipsoid of radius q standard deviations."""
        if q <= 0.0 or not self.freedom:
            return self.mean
        ellipses = q * q * self.covariance
        # R(δ)(b + β) − (b + δ·b⊥ + β), β the stretch: at most |b|·δ²/2 + |δ|·|β| long.
        beyond = 0.5 * self.arms * (q * self.turn) ** 2 + q * self.turn * q * self.stretch
        roots = _roots(_widened(ellipses, beyond)) * (1.0 + OUTWARDS)
        points, beyond_circle = self.points, 1.0 / math.cos(math.pi / sides)
        if isinstance(self.mean, Disc):
            narrow, wide = np.linalg.eigvalsh(roots[0])
            if wide - narrow <= (beyond_circle - 1.0) * wide:
                return Disc(self.mean.center, self.mean.radius + float(wide))
            points = self.mean.polygon(DISC_ERROR).vertices
        angles = np.pi * (2.0 * np.arange(sides) + 1.0) / sides
        circle = np.column_stack([np.cos(angles), np.sin(angles)]) / math.cos(math.pi / sides)
        # Shape (m, sides, 2): a polygon about each vertex's ellipse. The roots are symmetric.
        clouds = points[:, None] + circle @ roots
        return _hull(clouds) if _convex(self.mean) else _outlined(self.mean.polygon(), clouds)


def _hull(points: FloatArray) -> Polygon:
    hull = shapely.convex_hull(shapely.multipoints(points.reshape(-1, 2)))
    return Polygon(shapely.get_coordinates(hull.exterior))


def _outlined(shape: Polygon, clouds: FloatArray) -> Polygon:
    """Return the shape together with what its edges sweep: a moved shape sweeps nothing but with its edges."""
    # Relative to a vertex: overlays round, and may snap, by shares of their coordinates.
    origin = shape.vertices[0]
    pieces, first = [shapely.transform(shape.shapely(), lambda points: points - origin)], 0
    for ring in (shape.vertices, *shape.holes):
        own = clouds[first : first + len(ring)] - origin
        edges = np.concatenate([own, np.roll(own, -1, axis=0)], axis=1)
        pieces += shapely.convex_hull(shapely.multipoints(edges)).tolist()
        first += len(ring)
    # An error along an edge sweeps no area.
    region = shapely.union_all([piece for piece in pieces if shapely.get_dimensions(piece) == 2])
    size = float(np.abs(clouds - origin).max())
    if shapely.get_num_geometries(region) > 1:
        # Rounding parted what touches: a hair's breadth joins it.
        region = shapely.buffer(region, 1e-9 * size, join_style="mitre")
    # Whatever an overlay has lost, nothing of the obstacle may be missing: its hull has it all.
    around = shapely.get_coordinates(shapely.segmentize(pieces, 0.1 * size))
    shapely.prepare(region)
    whole = shapely.dwithin(region, shapely.points(around), 1e-9 * size).all()
    if not whole or shapely.get_num_geometries(region) > 1:
        return _hull(around + origin)
    region = shapely.get_parts(region)[0]
    holes = [ring for ring in region.interiors if shapely.Polygon(ring).area > 1e-12]
    rings = (shapely.get_coordinates(hole) + origin for hole in holes)
    return Polygon(shapely.get_coordinates(region.exterior) + origin, tuple(rings))


def _vertices(shape: Shape) -> tuple[FloatArray, FloatArray]:
    """Return a shape's vertices, (m, 2), and the point that it turns about, (2,)."""
    if isinstance(shape, Polygon):
        return np.concatenate([shape.vertices, *shape.holes]), shape.vertices.mean(axis=0)
    centre = np.asarray(shape.center)
    return (centre[None] if isinstance(shape, Disc) else shape.polygon().vertices), centre


def _stretches(shape: Rectangle, arms: FloatArray) -> FloatArray:
    """Return how a rectangle's vertices move with its length and its width, shape (4, 2, 2)."""
    along = np.array([math.cos(shape.heading), math.sin(shape.heading)])
    across = np.array([-along[1], along[0]])
    moves = [0.5 * np.sign(arms @ axis)[:, None] * axis for axis in (along, across)]
    return np.stack(moves, axis=-1)


def _rank(covariance: FloatArray) -> int:
    """Return the rank; combinations with less than 1e-12 of their numbers' variance count as known exactly."""
    sigma = np.sqrt(np.diag(covariance))
    used = sigma > 0.0
    if not used.any():
        return 0
    correlation = covariance[np.ix_(used, used)] / np.outer(sigma[used], sigma[used])
    return int(np.count_nonzero(np.linalg.eigvalsh(correlation) > 1e-12))


def _widened(ellipses: FloatArray, beyond: FloatArray) -> FloatArray:
    """Return ellipses xᵀ C⁻¹ x <= 1, shape (m, 2, 2), that contain the sum of others with discs of radii (m,)."""
    longest = np.sqrt(np.linalg.eigvalsh(ellipses)[:, 1])
    s = np.where(longest > 0.0, beyond / np.where(longest > 0.0, longest, 1.0), 0.0)[:, None, None]
    square = (beyond**2)[:, None, None] * np.eye(2)
    with np.errstate(divide="ignore", invalid="ignore"):
        wider = (1.0 + s) * ellipses + np.where(s > 0.0, (1.0 + 1.0 / s) * square, square)
    return np.asarray(np.where(beyond[:, None, None] > 0.0, wider, ellipses))


def _roots(matrices: FloatArray) -> FloatArray:
    """Return symmetric square roots, shape (m, 2, 2)."""
    values, vectors = np.linalg.eigh(matrices)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]) @ np.swapaxes(vectors, 1, 2))


def _convex(shape: Shape) -> bool:
    return not isinstance(shape, Polygon) or shapely.area(_hull(shape.vertices).shapely()) <= shape.area * (1.0 + 1e-12)


Matrix3 = Annotated[ArrayLike, shaped(3, 3)]


@checked_arguments(EstimationError)
def regrow(
    world: World, confidence: Probability, *, weights: Numbers | None = None, pose_covariance: Matrix3 | None = None
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


def swept_region(robot: Robot, states: ArrayLike, *, turn: float = 0.02) -> Any:
    """Return a region that contains what the robot covers along a path, as a shapely geometry.

    Args:
        robot: its footprint.
        states: the path's configurations, shape (n, 3), n >= 1.
        turn: radians: motions are cut into pieces that turn by no more. The region reaches at most R·turn beyond
            the truth, R the robot's circumradius, and for a disc its outline's 1 mm.
    """
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


SURE = 1e-3  # Probability with which the upper bound may be below the true sum, by bad luck with the draws.
# Standard deviations: an obstacle that would have to move farther to meet the path is not drawn (its share of the
# risk is below 1e-13).
FAR = 8.0
ROUNDING = 1e-6  # Metres by which distances may be rounded, far from the origin.


class PathRisk(NamedTuple):
    """How often drawn obstacles meet a path."""

    hits: int  #: Draws that meet the path, of all obstacles together.
    draws: int  #: Of each obstacle.

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
        from scipy.special import chdtri

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
    region, reach = swept_region(world.robot, states), world.robot.sweep_radius
    shapely.prepare(region)
    stated = None if world.risk is None else world.risk.pose_covariance
    pose = np.zeros((3, 3)) if stated is None else stated
    hits = (
        _hits(estimate, region, margin, pose, reach, draws, [seed, index])
        for index, estimate in enumerate(world.estimates)
        if estimate is not None
    )
    return PathRisk(sum(hits), draws)


def _hits(
    estimate: ObstacleEstimate, region: Any, margin: float, pose: FloatArray, reach: float, draws: int, seed: list[int]
) -> int:
    """Return in how many draws of an obstacle, and of the robot's pose with a covariance, the two meet."""
    shape, k, rng = estimate.mean, len(estimate.covariance), np.random.default_rng(seed)
    gap = float(shapely.distance(region, shape.polygon().shapely())) - margin
    spread = math.sqrt(np.linalg.eigvalsh(estimate.covariance)[-1])
    spread *= 1.5 + (0.0 if isinstance(shape, Disc) else _arm(shape))
    if gap > FAR * (spread + math.sqrt(np.linalg.eigvalsh(pose)[-1]) * (1.0 + reach)):
        return 0
    errors = rng.multivariate_normal(np.zeros(k), estimate.covariance, draws, method="eigh")
    robot = rng.multivariate_normal(np.zeros(3), pose, draws, method="eigh")
    # Relative to the robot's idea of itself the obstacle is displaced the other way. A turn of the robot about its
    # reference point moves no point of it by more than this.
    errors[:, :2] -= robot[:, :2]
    beyond = margin + reach * np.abs(robot[:, 2])
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
    c, s = np.cos(turn), np.sin(turn)
    back = np.array([[c, s], [-s, c]]).transpose(2, 0, 1)  # rows times it are turned
    placed = [shapely.linearrings(centre + errors[:, None, :2] + ring @ back) for ring in rings]
    holes = np.stack(placed[1:], axis=-1) if len(placed) > 1 else None
    return shapely.polygons(placed[0], holes=holes)
