"""Simulated sensors: a detector of point-like discs, a laser scanner, and readings of obstacles' outlines."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark.arguments import (
    Count,
    Finite,
    NonNegative,
    Numbers,
    Positive,
    PositiveOrInfinite,
    RandomState,
    Rule,
    Share,
    checked,
    checked_arguments,
    checked_fields,
)
from trailmark.estimation.ekf import refine_points
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.models import RangeBearing
from trailmark.estimation.records import Detection, Scan
from trailmark.se2 import FloatArray, compose, configurations, wrap
from trailmark.shapes import Disc
from trailmark.world import World

if TYPE_CHECKING:
    import shapely


IntArray = NDArray[np.intp]

WALL = -1  # The owner of the bounds' and the boundary's edges.
# Share of an edge's length that a ray may pass beyond its end and still meet it: no ray slips between two edges.
_CORNER = 1e-12
_BEHIND = 2e-6  # Metres that an origin may lie behind an edge and still count as touching it.
_BLOCK = 500_000  # Pairs of ray and edge that are processed together.


Angle = Annotated[float, Rule("radians above 0, at most a full turn", lambda v: 0.0 < v <= 2.0 * math.pi)]


class RayCaster:
    """The edges and discs of a world, and exact distances along rays to the first of them.

    A ray meets an edge only from its free side: one that begins on an edge, as of a sensor that touches a wall, leaves
    it freely on one side and has length 0 on the other.

    Args:
        world: its obstacles, its boundary, and its bounds.
        bounds: whether the bounds are walls that a ray meets.

    Attributes:
        discs: indices of the obstacles that are discs, shape (k,).
    """

    def __init__(self, world: World, *, bounds: bool = True) -> None:
        rings: list[FloatArray] = []
        owners: list[int] = []
        for index, obstacle in enumerate(world.obstacles):
            if not isinstance(obstacle, Disc):
                own = obstacle.polygon().rings()
                rings += own
                owners += [index] * len(own)
        # What is solid lies left of every edge: inside an obstacle, outside a wall.
        if world.boundary is not None:
            rings.append(world.boundary.rings()[0][::-1])
            owners.append(WALL)
        if bounds:
            xmin, ymin, xmax, ymax = world.bounds
            rings.append(np.array([[xmin, ymin], [xmin, ymax], [xmax, ymax], [xmax, ymin]]))
            owners.append(WALL)
        sizes = [len(ring) for ring in rings]
        self._start = np.concatenate([*rings, np.empty((0, 2))])
        self._edge = np.concatenate([*(np.roll(ring, -1, axis=0) - ring for ring in rings), np.empty((0, 2))])
        self._edge_owner = np.repeat(np.array(owners, dtype=np.intp), sizes)
        round_ones = [(i, shape) for i, shape in enumerate(world.obstacles) if isinstance(shape, Disc)]
        self.discs: IntArray = np.array([i for i, _ in round_ones], dtype=np.intp)
        self._center = np.array([shape.center for _, shape in round_ones], dtype=np.float64).reshape(-1, 2)
        self._radius = np.array([shape.radius for _, shape in round_ones], dtype=np.float64)

    def distances(
        self, origin: ArrayLike, angles: ArrayLike, max_range: float = np.inf, passing: ArrayLike | None = None
    ) -> FloatArray:
        """Return how far each ray goes until it meets something, shape (b,), metres; infinite beyond ``max_range``.

        Args:
            origin: x, y in metres, where all rays begin; in free space.
            angles: their directions in the world, shape (b,), radians.
            max_range: metres.
            passing: index of an obstacle that each ray passes through, shape (b,), −2 for none.
        """
        o, angle = np.asarray(origin, dtype=np.float64), np.asarray(angles, dtype=np.float64)
        directions = np.column_stack([np.cos(angle), np.sin(angle)])
        through = np.full(len(angle), -2) if passing is None else np.asarray(passing)
        edges, discs = self._near(o, max_range)
        found = np.full(len(angle), np.inf)
        step = max(1, _BLOCK // max(1, len(edges) + len(discs)))
        for first in range(0, len(angle), step):
            rows = slice(first, first + step)
            d, own = directions[rows], through[rows, None]
            to_edge = _to_edges(self._start[edges] - o, self._edge[edges], d)
            to_disc = _to_discs(self._center[discs] - o, self._radius[discs], d)
            to_edge[own == self._edge_owner[edges]] = np.inf
            to_disc[own == self.discs[discs]] = np.inf
            found[rows] = np.minimum(to_edge.min(axis=1, initial=np.inf), to_disc.min(axis=1, initial=np.inf))
        found[found > max_range] = np.inf
        return found

    def _near(self, o: FloatArray, max_range: float) -> tuple[IntArray, IntArray]:
        """Return the indices of the edges and discs that come within the range."""
        w = o - self._start
        length2 = np.einsum("ij,ij->i", self._edge, self._edge)
        along = np.clip(np.einsum("ij,ij->i", w, self._edge) / length2, 0.0, 1.0)
        off = w - along[:, None] * self._edge
        edges = np.flatnonzero(np.hypot(off[:, 0], off[:, 1]) <= max_range)
        away = np.hypot(*(self._center - o).T)
        return edges, np.flatnonzero(away - self._radius <= max_range)


def _to_edges(w: FloatArray, e: FloatArray, d: FloatArray) -> FloatArray:
    """Return the distances along rays d (b, 2) to edges that begin at w and run along e (m, 2), shape (b, m)."""
    # t d = w + u e; the cross products with e and d give t and u.
    det = d[:, :1] * e[:, 1] - d[:, 1:] * e[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):  # a ray along an edge meets its neighbours' ends
        t = (w[:, 0] * e[:, 1] - w[:, 1] * e[:, 0]) / det
        u = (w[:, 0] * d[:, 1:] - w[:, 1] * d[:, :1]) / det
        # A negative determinant means that the ray leads to the left of the edge, where the obstacle is.
        met = (det < 0.0) & (t >= -_BEHIND) & (u >= -_CORNER) & (u <= 1.0 + _CORNER)
    return np.where(met, np.maximum(t, 0.0), np.inf)


def _to_discs(w: FloatArray, radius: FloatArray, d: FloatArray) -> FloatArray:
    """Return the distances along rays d (b, 2) to discs about w (k, 2), shape (b, k)."""
    along = d[:, :1] * w[:, 0] + d[:, 1:] * w[:, 1]
    # From the cross product: |w|² − along² would lose the digits of a far disc.
    across = d[:, :1] * w[:, 1] - d[:, 1:] * w[:, 0]
    inside = radius**2 - across**2
    met = (inside >= 0.0) & (along >= 0.0)
    return np.where(met, np.maximum(along - np.sqrt(np.maximum(inside, 0.0)), 0.0), np.inf)


@dataclass(frozen=True)
class Detector:
    """A sensor at the robot's origin that reads range and bearing of discs' centres.

    A disc is seen if its centre lies within range and field of view, and the line of sight meets no other obstacle, no
    bound and no boundary before the disc itself.

    Raises:
        EstimationError: a value out of range.
    """

    model: RangeBearing  #: Its noise.
    max_range: Positive = 10.0  #: Metres.
    field_of_view: Angle = 2.0 * math.pi  #: Radians, centred ahead.
    period: Positive = 0.5  #: Seconds from one sweep to the next, the first at the start.
    identities: bool = True  #: Whether it identifies the disc that it reads (the obstacle's index in the world).
    max_radius: PositiveOrInfinite = math.inf  #: Metres; larger discs are no point features.
    detection_rate: Share = 1.0  #: Chance that a disc that is seen is read in a sweep.
    #: Mean number of readings of nothing in a sweep (Poisson), spread evenly over the area in view, without identity.
    false_alarms: NonNegative = 0.0

    def __post_init__(self) -> None:
        checked_fields(self, EstimationError)

    def features(self, world: World) -> FloatArray:
        """Return the discs that it can read, shape (k, 4), rows index, x, y, radius."""
        discs = [
            (i, *shape.center, shape.radius)
            for i, shape in enumerate(world.obstacles)
            if isinstance(shape, Disc) and shape.radius <= self.max_radius
        ]
        return np.array(discs, dtype=np.float64).reshape(-1, 4)

    def sweep(
        self, t: float, pose: FloatArray, features: FloatArray, caster: RayCaster, rng: np.random.Generator
    ) -> list[Detection]:
        """Return what it reads from a pose (x, y, theta) at t: discs in the order of the world, then false alarms."""
        dx, dy = features[:, 1] - pose[0], features[:, 2] - pose[1]
        away, bearing = np.hypot(dx, dy), np.asarray(wrap(np.arctan2(dy, dx) - pose[2]))
        near = (away <= self.max_range) & (np.abs(bearing) <= 0.5 * self.field_of_view)
        seen = features[near]
        met = caster.distances(pose[:2], pose[2] + bearing[near], self.max_range, passing=seen[:, 0].astype(np.intp))
        # A disc in front of a wall, or half in it, is seen as long as its own near side comes first.
        seen = seen[met >= away[near] - seen[:, 3]]
        seen = seen[rng.random(len(seen)) < self.detection_rate]
        readings = self.model.sample(pose, seen[:, 1:3], rng)
        noises = self.model.noise(pose, seen[:, 1:3])
        found = [
            Detection(t, _reading(z), identity=int(index) if self.identities else None, covariance=noise)
            for index, z, noise in zip(seen[:, 0], readings, noises, strict=True)
        ]
        for _ in range(rng.poisson(self.false_alarms)):
            # Even over the area: the range goes by the root of a uniform number.
            z = np.array([self.max_range * math.sqrt(rng.random()), self.field_of_view * (rng.random() - 0.5)])
            place = z[0] * np.array([math.cos(z[1]), math.sin(z[1])])
            found.append(Detection(t, _reading(z), covariance=self.model.noise(np.zeros(3), place)))
        return found


@dataclass(frozen=True)
class Scanner:
    """A laser scanner.

    Raises:
        EstimationError: a value out of range.
    """

    #: Evenly spread over the field of view, its two ends included (one end for a full circle).
    beams: Count = 181
    field_of_view: Angle = math.pi  #: Radians, centred on the scanner's heading.
    max_range: Positive = 10.0  #: Metres; a beam that meets nothing within reads infinity.
    sigma: NonNegative = 0.01  #: Standard deviation of a reading, metres.
    period: Positive = 0.5  #: Seconds from one sweep to the next, the first at the start.
    drop_out: Share = 0.0  #: Chance that a reading is lost (NaN).
    mount: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)  #: Its x, y, theta in the robot's frame.
    bounds: bool = True  #: Whether the world's bounds are walls that it sees; its boundary always is.

    def __post_init__(self) -> None:
        checked_fields(self, EstimationError)

    @property
    def angle_increment(self) -> float:
        """From one beam to the next, radians."""
        full = self.field_of_view >= 2.0 * math.pi
        return self.field_of_view / (self.beams if full else max(1, self.beams - 1))

    @property
    def angle_min(self) -> float:
        """The first beam's bearing, radians."""
        return -0.5 * self.field_of_view if self.beams > 1 else 0.0

    def sweep(self, t: float, pose: FloatArray, caster: RayCaster, rng: np.random.Generator) -> Scan:
        """Return what it reads at t, the robot at a pose (x, y, theta)."""
        own = compose(pose, np.array(self.mount))
        angles = own[2] + self.angle_min + self.angle_increment * np.arange(self.beams)
        ranges = caster.distances(own[:2], angles, self.max_range)
        ranges = np.maximum(ranges + self.sigma * rng.standard_normal(self.beams), 0.0)
        ranges[rng.random(self.beams) < self.drop_out] = np.nan
        return Scan(t, ranges, self.angle_min, self.angle_increment, self.max_range, self.mount)


def _reading(z: FloatArray) -> FloatArray:
    """Return range and bearing as a sensor gives them: no range below 0."""
    return np.array([max(z[0], 0.0), wrap(z[1])])


OUTLINE = 1e-3  # Metres: how far a disc's outline, as a polygon, may reach beyond the disc.
SEEN = 1e-6  # Metres before a point, which lies on an obstacle itself, from which on its line of sight may end.


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

    A robot at known poses takes noisy readings of points on the obstacles' outlines: of points spread evenly along each
    from a random place on, and of its leftmost, rightmost, lowest and highest ones, which make the box of Algorithm 2.
    A point is read where it is seen, from poses drawn (with repetition) from those that see it, and the EKF
    (:func:`refine_points`) makes one refined reading of these. So r is at most ``points_per_obstacle`` + 4, and 0 for
    an obstacle that no pose sees.

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
    if np.ndim(poses) == 0:
        x = _free_poses(world, checked(poses, Count, "sense_obstacles: poses", EstimationError), rng)
    else:
        x = np.atleast_2d(configurations(poses, name="poses"))
    caster, refined = RayCaster(world, bounds=False), []
    for obstacle in world.obstacles:
        points = _outline_points(obstacle.polygon(OUTLINE).shapely(), points_per_obstacle, rng)
        seen = np.array([_sees(caster, pose[:2], points, max_range) for pose in x])
        points, seen = points[seen.any(axis=0)], seen[:, seen.any(axis=0)]
        chances = rng.random((len(points), readings_per_point))
        # The j-th of the n poses that see a point, j uniform in 0..n-1.
        order = np.argsort(~seen, axis=0, kind="stable")
        chosen = np.take_along_axis(order.T, (chances * seen.sum(axis=0)[:, None]).astype(int), axis=1)
        origins = x[chosen]
        readings = sensor.sample(origins, np.broadcast_to(points[:, None], (*chosen.shape, 2)), rng)
        refined.append(refine_points(readings, origins, sensor).points)
    return refined


def _sees(caster: RayCaster, eye: FloatArray, points: FloatArray, max_range: float) -> NDArray[np.bool_]:
    """Return which points, shape (m, 2), are seen from a place."""
    sight = points - eye
    away = np.hypot(*sight.T)
    return np.asarray((away <= max_range) & (caster.distances(eye, np.arctan2(*sight.T[::-1])) >= away - SEEN))


def _free_poses(world: World, count: int, rng: np.random.Generator) -> FloatArray:
    """Return ``count`` poses, shape (count, 3), uniform in the free region."""
    import shapely

    free = (
        shapely.box(*world.bounds) if world.boundary is None else world.boundary.shapely() & shapely.box(*world.bounds)
    )
    free = shapely.difference(free, shapely.union_all([shape.polygon(OUTLINE).shapely() for shape in world.obstacles]))
    if not free.area > 0.0:
        raise EstimationError("poses: the world has no free region to draw them from")
    # Triangles, since a small region in large bounds is hardly ever met by chance.
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(free))
    a, b, c = np.swapaxes(shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3], 0, 1)
    own = rng.choice(len(parts), count, p=shapely.area(parts) / shapely.area(parts).sum())
    u, v = rng.random((2, count, 1))
    # The half of the parallelogram beyond the triangle's third side, folded back.
    u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
    places = a[own] + u * (b - a)[own] + v * (c - a)[own]
    return np.column_stack([places, rng.uniform(-np.pi, np.pi, count)])


def _outline_points(region: shapely.Polygon, count: int, rng: np.random.Generator) -> FloatArray:
    """Return points on the outer outline, shape (count + 4, 2): spread evenly, and the four outermost ones."""
    import shapely

    at = (np.arange(count) + rng.random()) / count
    spread = shapely.get_coordinates(shapely.line_interpolate_point(region.exterior, at, normalized=True))
    corners = shapely.get_coordinates(region.exterior)
    return np.concatenate([spread, corners[np.concatenate([corners.argmin(axis=0), corners.argmax(axis=0)])]])
