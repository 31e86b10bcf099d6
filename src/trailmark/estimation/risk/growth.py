# ruff: noqa: N806 # a Jacobian is J
"""Regions that contain an obstacle, known up to a covariance, with a stated probability.

An obstacle whose numbers have covariance Σ lies, with probability p, among the shapes with ξᵀ Σ⁻¹ ξ <= χ²ₖ(p), ξ the
error of its k numbers. The region contains all of those: it is the Minkowski sum of the shape with the covariance's
ellipse where Σ is that of a displacement.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtrc, chdtri

from trailmark.arguments import NonNegative, Probability, Rule, checked_arguments, shaped
from trailmark.estimation.errors import EstimationError
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc, Polygon, Rectangle, Shape
from trailmark.world import ObstacleEstimate, RiskBound

__all__ = ["DISC_ERROR", "SIDES", "Spread", "grow"]

SIDES = 16
"""Sides of the polygons that stand for ellipses: they reach 1/cos(π/16) − 1 = 2 % of the ellipse beyond it."""

DISC_ERROR = 1e-3
"""Metres that the polygon of a disc may reach beyond it, where its ellipse is too long for a disc again."""

OUTWARDS = 1e-9
"""Regions are this fraction of their ellipse wider than calculated: more than rounding takes away."""


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

    Returns:
        A Disc or Polygon, or ``estimate.mean``.

    Raises:
        EstimationError: a value out of these ranges.
    """
    bound = RiskBound(confidence, None if pose_covariance is None else np.asarray(pose_covariance), reach)
    spread = Spread.of(estimate, bound)
    return spread.region(spread.quantile(1.0 - confidence), sides)


class Spread(NamedTuple):
    """How an obstacle's vertices move with the errors ξ of its k numbers and of the robot's pose.

    Attributes:
        mean: the obstacle's mean shape.
        points: shape (m, 2): its vertices, or a disc's centre.
        covariance: shape (m, 2, 2): that of each vertex, dilations included.
        turn: standard deviation of the obstacle's heading, radians.
        arms: shape (m,), metres from the centre of turning to each vertex.
        stretch: standard deviation of half the diagonal, metres.
        freedom: degrees of freedom of what ξ does to the obstacle relative to the robot: the rank of the covariance of
            relative displacement, turn, change of size and dilations. A robot's displacement adds none.
    """

    mean: Shape
    points: FloatArray
    covariance: FloatArray
    turn: float
    arms: FloatArray
    stretch: float
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
        return math.sqrt(float(chdtri(self.freedom, risk))) if self.freedom else 0.0

    def risk(self, q: float) -> float:
        """Return the probability with which ξ leaves the ellipsoid of radius q standard deviations."""
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
    import shapely

    hull = shapely.convex_hull(shapely.multipoints(points.reshape(-1, 2)))
    return Polygon(shapely.get_coordinates(hull.exterior))


def _outlined(shape: Polygon, clouds: FloatArray) -> Polygon:
    """Return the shape together with what its edges sweep: a moved shape sweeps nothing but with its edges.

    Args:
        shape: m vertices, those of its outline first.
        clouds: shape (m, sides, 2), what contains each vertex.
    """
    import shapely

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
    """Return ellipses xᵀ C⁻¹ x <= 1, shape (m, 2, 2), that contain the sum of others with discs of radii (m,).

    (a + e)² <= (1 + s)a² + (1 + 1/s)e² for all s > 0, with equality at s = e/a: taken at the long axis.
    """
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
    import shapely

    return not isinstance(shape, Polygon) or shapely.area(_hull(shape.vertices).shapely()) <= shape.area * (1.0 + 1e-12)
