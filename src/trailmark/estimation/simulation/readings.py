# ruff: noqa: N802, N806 # the names are the filter's own symbols: x, P, H, R, S, K
"""Point features refined from range-bearing readings by the EKF: the first step of the source method's Algorithm 2.

The filter is filterpy's. Its state holds the positions (x, y) of some features, which stand: F is the identity, and
W Q Wᵀ, which a prediction adds to P, is 0. The poses of the readings are known here, and of which feature each is. The
first reading places a feature (the sensor's inverse), every further one is an update with V R Vᵀ as its noise.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark.arguments import Count, Numbers, PositiveOrInfinite, RandomState, checked, checked_arguments, shaped
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.filter.sensors import RangeBearing
from trailmark.se2 import FloatArray, configurations
from trailmark.world import World

if TYPE_CHECKING:
    import shapely

__all__ = ["RefinedPoints", "refine_points", "sense_obstacles"]

BoolArray = NDArray[np.bool_]
Readings = Annotated[ArrayLike, shaped(None, 2, minimum=1)]
ReadingsOfMany = Annotated[ArrayLike, shaped(None, None, 2)]

OUTLINE = 1e-3
"""Metres: how far a disc's outline, as a polygon, may reach beyond the disc."""

GROUP = 32
"""Features in the state of one filter, at most: an update costs the cube of their number."""

STAND_OFF = 1e-6
"""Metres: a line of sight ends this far before its point, which lies on an obstacle itself."""


class RefinedPoints(NamedTuple):
    """Point features, each estimated by itself."""

    points: FloatArray
    """Positions in the world, shape (b, 2), metres."""
    covariances: FloatArray
    """Shape (b, 2, 2), square metres."""


@checked_arguments(EstimationError)
def refine_points(readings: ReadingsOfMany, poses: Numbers, sensor: RangeBearing) -> RefinedPoints:
    """Return many static point features, each from its own readings, by the extended Kalman filter.

    Args:
        readings: range (metres) and bearing (radians), shape (b, m, 2), m >= 1, in the order they were taken.
        poses: where from, shape (b, m, 3), (m, 3) or (3,).
        sensor: its noise.

    Raises:
        EstimationError: other shapes, or values that are not finite.
    """
    z = np.asarray(readings)
    x = _poses_of(poses, z.shape[:2])
    groups = [slice(i, i + GROUP) for i in range(0, max(1, len(z)), GROUP)]
    refined = [_refined(z[group], x[group], sensor) for group in groups]
    return RefinedPoints(*(np.concatenate(column) for column in zip(*refined, strict=True)))


@checked_arguments(EstimationError)
def sense_obstacles(
    world: World,
    poses: Numbers,
    sensor: RangeBearing,
    *,
    points_per_obstacle: Count = 24,
    readings_per_point: Count = 8,
    max_range: PositiveOrInfinite = math.inf,
    random_state: RandomState = None,
) -> list[FloatArray]:
    """Return the refined readings of each obstacle, an array of shape (r, 2) per obstacle of the world.

    A robot at known poses takes noisy readings of points on the obstacles' outlines. The points of an obstacle are
    spread evenly along its outer outline from a random place on, and its leftmost, rightmost, lowest and highest
    points are among them, since those make the box of Algorithm 2. A point is read where it is seen: within the
    sensor's range of a pose, and no obstacle nor the world's boundary in between. Each point that some pose sees
    gets ``readings_per_point`` readings from poses drawn at random (with repetition) from those that see it, and
    the EKF (:func:`refine_points`) makes one refined reading of them. So r is at most ``points_per_obstacle`` + 4,
    and 0 for an obstacle that no pose sees.

    Args:
        world: obstacles, and the region to draw poses from.
        poses: where the robot reads from, shape (p, 3) or (3,); or how many such poses to draw uniformly from the
            free region (the robot as a point).
        sensor: its noise.
        points_per_obstacle: spread along each outline, >= 1.
        readings_per_point: >= 1.
        max_range: metres, the farthest that the sensor reads.
        random_state: seed or generator; the same one gives the same readings.

    Raises:
        EstimationError: a count below 1, a range that is not positive, no free region to draw poses from.
    """
    rng = np.random.default_rng(random_state)
    blockers = _Blockers(world)
    if np.ndim(poses) == 0:
        x = blockers.free_poses(checked(poses, Count, "sense_obstacles: poses", EstimationError), rng)
    else:
        x = np.atleast_2d(configurations(poses, name="poses"))
    refined = []
    for obstacle in world.obstacles:
        points = _outline_points(obstacle.polygon(OUTLINE).shapely(), points_per_obstacle, rng)
        seen = blockers.sees(x, points, max_range)
        points, seen = points[seen.any(axis=0)], seen[:, seen.any(axis=0)]
        chances = rng.random((len(points), readings_per_point))
        # The j-th of the n poses that see a point, j uniform in 0..n-1.
        order = np.argsort(~seen, axis=0, kind="stable")
        chosen = np.take_along_axis(order.T, (chances * seen.sum(axis=0)[:, None]).astype(int), axis=1)
        origins = x[chosen]
        readings = sensor.sample(origins, np.broadcast_to(points[:, None], (*chosen.shape, 2)), rng)
        refined.append(refine_points(readings, origins, sensor).points)
    return refined


class _Blockers:
    """What a line of sight cannot pass: the obstacles' regions and the world's boundary."""

    def __init__(self, world: World) -> None:
        import shapely

        boundary = None if world.boundary is None else world.boundary.shapely()
        self._blocked = shapely.union_all([obstacle.polygon(OUTLINE).shapely() for obstacle in world.obstacles])
        self._wall = shapely.LinearRing() if boundary is None else boundary.exterior
        box = shapely.box(*world.bounds)
        self._free = shapely.difference(box if boundary is None else boundary & box, self._blocked)
        for region in (self._blocked, self._wall):
            shapely.prepare(region)

    def free_poses(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Return ``count`` poses, shape (count, 3), uniform in the free region."""
        import shapely

        if not self._free.area > 0.0:
            raise EstimationError("poses: the world has no free region to draw them from")
        parts = shapely.get_parts(shapely.constrained_delaunay_triangles(self._free))
        a, b, c = np.swapaxes(shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3], 0, 1)
        area = shapely.area(parts)
        own = rng.choice(len(parts), count, p=area / area.sum())
        u, v = rng.random((2, count, 1))
        # The half of the parallelogram beyond the triangle's third side, folded back.
        u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
        places = a[own] + u * (b - a)[own] + v * (c - a)[own]
        return np.column_stack([places, rng.uniform(-np.pi, np.pi, count)])

    def sees(self, poses: FloatArray, points: FloatArray, max_range: float) -> BoolArray:
        """Return which of the poses (p, 3) see which of the points (m, 2), shape (p, m)."""
        import shapely

        eye = np.broadcast_to(poses[:, None, :2], (len(poses), len(points), 2))
        sight = points[None] - eye
        length = np.hypot(sight[..., 0], sight[..., 1])
        near = (length <= max_range) & (length > STAND_OFF)
        start = eye[near]
        end = start + sight[near] * (1.0 - STAND_OFF / length[near])[:, None]
        lines = shapely.linestrings(np.stack([start, end], axis=1))
        blocked = shapely.intersects(self._blocked, lines) | shapely.intersects(self._wall, lines)
        seen = np.zeros(near.shape, dtype=bool)
        seen[near] = ~blocked
        return seen


def _outline_points(region: shapely.Polygon, count: int, rng: np.random.Generator) -> FloatArray:
    """Return points on the outer outline, shape (count + 4, 2): spread evenly, and the four outermost ones."""
    import shapely

    outline = region.exterior
    at = (np.arange(count) + rng.random()) / count
    spread = shapely.get_coordinates(shapely.line_interpolate_point(outline, at, normalized=True))
    corners = shapely.get_coordinates(outline)
    extreme = corners[np.concatenate([corners.argmin(axis=0), corners.argmax(axis=0)])]
    return np.concatenate([spread, extreme])


def _refined(z: FloatArray, x: FloatArray, sensor: RangeBearing) -> RefinedPoints:
    """Return b points from their readings, shape (b, m, 2), from poses (b, m, 3), by one filter."""
    from filterpy.kalman import ExtendedKalmanFilter

    b, first = len(z), sensor.inverse(x[:, 0], z[:, 0])
    ekf = ExtendedKalmanFilter(dim_x=2 * b, dim_z=2 * b)
    ekf.x, ekf.Q = first.feature.reshape(-1), np.zeros((2 * b, 2 * b))
    ekf.P = _diagonal(first.G_z @ sensor.noise(x[:, 0], first.feature) @ np.swapaxes(first.G_z, 1, 2))

    def h(x: FloatArray, pose: FloatArray) -> FloatArray:
        return sensor.h(pose, x.reshape(b, 2)).reshape(-1)

    def H(x: FloatArray, pose: FloatArray) -> FloatArray:
        return _diagonal(sensor.H_feature(pose, x.reshape(b, 2)))

    def residual(z: FloatArray, z_hat: FloatArray) -> FloatArray:
        return sensor.residual(z.reshape(b, 2), z_hat.reshape(b, 2)).reshape(-1)

    for pose, reading in zip(np.swapaxes(x, 0, 1)[1:], np.swapaxes(z, 0, 1)[1:], strict=True):
        ekf.predict()
        R = _diagonal(sensor.noise(pose, ekf.x.reshape(b, 2)))
        ekf.update(reading.reshape(-1), H, h, R, args=(pose,), hx_args=(pose,), residual=residual)
    P = ekf.P.reshape(b, 2, b, 2)[np.arange(b), :, np.arange(b)]
    return RefinedPoints(ekf.x.reshape(b, 2), 0.5 * (P + np.swapaxes(P, 1, 2)))


def _diagonal(blocks: FloatArray) -> FloatArray:
    """Return a matrix, shape (b m, b n), with these blocks (b, m, n) along its diagonal."""
    b, m, n = blocks.shape
    matrix, each = np.zeros((b, m, b, n)), np.arange(b)
    matrix[each, :, each] = blocks
    return matrix.reshape(b * m, b * n)


def _poses_of(poses: Numbers, shape: tuple[int, ...]) -> FloatArray:
    """Return poses, shape (*shape, 3): one for each reading."""
    try:
        return np.broadcast_to(np.asarray(poses), (*shape, 3))
    except ValueError:
        given = np.shape(poses)
        raise EstimationError(f"poses: expected one x, y, theta for each of {shape} readings, got {given}") from None
