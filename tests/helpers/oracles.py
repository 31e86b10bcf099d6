"""The referees of tests and benchmarks: shapely, exact fractions and dense sampling, none of trailmark's own checks.

Obstacle polygons go to shapely as they are given; discs and bounds are compared by exact formulas; the robot is
placed by complex multiplication. They are meant to be right and simple.
"""

from __future__ import annotations

import math
from fractions import Fraction
from functools import cache
from itertools import pairwise, product
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely.affinity import rotate

from trailmark import CostZone, Disc, Objective, Robot, SpeedZone, StateChecker, Trajectory, World, se2

__all__ = [
    "BAND",
    "SLACK",
    "Oracle",
    "assert_within_limits",
    "checker_and_oracle",
    "free_somewhere",
    "judge",
    "motion_states",
    "sampled_cost",
    "sampled_density",
    "sign_of_turn",
    "signed_distances",
]

FloatArray = NDArray[np.float64]

BAND = 1e-6
"""Metres of gap or overlap within which a configuration counts as touching: no verdict is wrong there."""


class Oracle:
    """Exact distances and overlaps of one robot in one world.

    Args:
        world: obstacles, bounds, boundary.
        robot: footprint, and the clearance that it keeps.
        band: overlap (metres) from which :meth:`collides` calls a collision.
    """

    def __init__(self, world: World, robot: Robot, band: float = BAND) -> None:
        self.bounds = world.bounds
        self.band, self.kept = band, robot.clearance
        self.radius = robot.footprint.radius if isinstance(robot.footprint, Disc) else None
        self.outline = np.zeros(1, complex)
        self.core = np.zeros(1, complex)
        if self.radius is None:
            ring = shapely.Polygon(robot.footprint.polygon().vertices)
            # What is left of the footprint after the band is taken off all round.
            core = shapely.buffer(ring, -band)
            self.outline = _complex(ring)
            self.core = _complex(max(shapely.get_parts(core), key=shapely.area))
        self.reach = float(np.abs(self.outline).max()) + (self.radius or 0.0)
        # Obstacles are kept apart, not merged: a union would move vertices by rounding.
        polygons = [shape.polygon().shapely() for shape in world.obstacles if not isinstance(shape, Disc)]
        if world.boundary is not None:
            xmin, ymin, xmax, ymax = world.bounds
            far = 4.0 * self.reach + 10.0
            frame = shapely.box(xmin - far, ymin - far, xmax + far, ymax + far)
            polygons.append(shapely.difference(frame, world.boundary.shapely()))
        self.polygons = np.array(polygons, dtype=object)
        shapely.prepare(self.polygons)
        self.tree = shapely.STRtree(self.polygons)
        # Overlap counts either way: of the robot less the band, or of an obstacle less the band. A corner of either
        # may lie deep in the other although little of it does.
        shrunk = shapely.buffer(self.polygons, -band) if polygons else self.polygons
        self.shrunk_tree = shapely.STRtree(shrunk[~shapely.is_empty(shrunk)] if polygons else shrunk)
        discs = [(*shape.center, shape.radius) for shape in world.obstacles if isinstance(shape, Disc)]
        self.discs = np.array(discs, dtype=np.float64).reshape(-1, 3)

    def clearance(self, q: FloatArray) -> FloatArray:
        """Return the distance (metres) from the footprint at q, (n, 3), to what blocks; 0 on overlap, outside."""
        bodies = self._bodies(q, self.outline)
        best = np.maximum(0.0, -self._beyond(q))
        if len(self.polygons):
            (body, _), gap = self.tree.query_nearest(bodies, return_distance=True, all_matches=False)
            best[body] = np.minimum(best[body], np.maximum(0.0, gap - (self.radius or 0.0)))
        for x, y, r in self.discs:
            gap = shapely.distance(bodies, shapely.Point(x, y)) - r - (self.radius or 0.0)
            best = np.minimum(best, np.maximum(0.0, gap))
        return np.asarray(best)

    def collides(self, q: FloatArray) -> NDArray[np.bool_]:
        """Return which configurations, shape (n, 3), overlap an obstacle or leave the bounds by more than band."""
        hit = self._beyond(q) > self.band
        if self.kept > 0.0:
            hit |= self.clearance(q) < self.kept - self.band
        near = np.flatnonzero(~hit & self._near(q))
        if self.radius is not None:
            points = shapely.points(q[near, :2])
            if self.radius > self.band:
                found = self.tree.query(points, predicate="dwithin", distance=self.radius - self.band)[0]
            else:
                found = self.tree.query(points, predicate="intersects")[0]
        else:
            found = self.tree.query(self._bodies(q[near], self.core), predicate="intersects")[0]
            hit[near[found]] = True
            near = near[~hit[near]]
            found = self.shrunk_tree.query(self._bodies(q[near], self.outline), predicate="intersects")[0]
        hit[near[found]] = True
        return hit | self._hits_disc(q)

    def _near(self, q: FloatArray) -> NDArray[np.bool_]:
        """Return which reference points have a polygon within the robot's reach: the others cannot overlap one."""
        near = np.zeros(len(q), bool)
        if len(self.polygons):
            found = self.tree.query(shapely.points(q[:, :2]), predicate="dwithin", distance=self.reach)[0]
            near[found] = True
        return near

    def _hits_disc(self, q: FloatArray) -> NDArray[np.bool_]:
        hit = np.zeros(len(q), bool)
        for x, y, r in self.discs:
            near = np.flatnonzero(np.hypot(q[:, 0] - x, q[:, 1] - y) <= r + self.reach)
            if self.radius is not None:
                hit[near] |= np.hypot(q[near, 0] - x, q[near, 1] - y) < r + self.radius - self.band
            else:
                hit[near] |= shapely.distance(self._bodies(q[near], self.outline), shapely.Point(x, y)) < r - self.band
        return hit

    def disagrees(self, q: FloatArray, valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return where ``valid``, shape (n,), is wrong: a collision called valid, or clear space called invalid."""
        collides = self.collides(q)
        wrong = valid & collides
        refused = np.flatnonzero(~valid & ~collides)
        wrong[refused] = self.clearance(q[refused]) > self.kept + self.band
        return wrong

    def _beyond(self, q: FloatArray) -> FloatArray:
        """Return how far (metres) the robot reaches over the bounds; negative where it stays inside."""
        xmin, ymin, xmax, ymax = self.bounds
        # Only its outermost points matter, and those stand on the outline.
        z = np.exp(1j * q[:, 2, None]) * self.outline
        x, y, r = q[:, 0, None] + z.real, q[:, 1, None] + z.imag, self.radius or 0.0
        beyond = np.maximum(np.maximum(xmin - x, x - xmax), np.maximum(ymin - y, y - ymax)).max(axis=1) + r
        return np.asarray(beyond)

    def _bodies(self, q: FloatArray, ring: NDArray[np.complex128]) -> NDArray[np.object_]:
        """Return the robot placed at each configuration: points for a disc, else polygons with outline ``ring``."""
        if self.radius is not None:
            return np.asarray(shapely.points(q[:, :2]))
        z = np.exp(1j * q[:, 2, None]) * ring
        rings = np.stack([q[:, 0, None] + z.real, q[:, 1, None] + z.imag], axis=-1)
        return np.asarray(shapely.polygons(rings))


def motion_states(a: FloatArray, b: FloatArray, samples: int) -> FloatArray:
    """Return ``samples`` configurations of each motion, shape (n, samples, 3), both ends among them.

    x and y go linearly, the heading along the shorter arc; half a turn goes counter-clockwise.
    """
    turn = b[:, 2] - a[:, 2]
    turn = turn - 2.0 * math.pi * np.round(turn / (2.0 * math.pi))
    turn = np.where(turn <= -math.pi, math.pi, turn)
    way = np.column_stack([b[:, :2] - a[:, :2], turn])
    return a[:, None] + np.linspace(0.0, 1.0, samples)[None, :, None] * way[:, None]


def _complex(ring: shapely.Polygon) -> NDArray[np.complex128]:
    points = shapely.get_coordinates(ring.exterior)[:-1]
    return np.asarray(points[:, 0] + 1j * points[:, 1])


@cache
def checker_and_oracle(world: World, robot: Robot) -> tuple[StateChecker, Oracle]:
    """Return a checker, which takes a while to make, and the oracle that shares no code with it."""
    return StateChecker(world, robot), Oracle(world, robot)


def judge(
    world: World, robot: Robot, start: ArrayLike, goal: ArrayLike, states: FloatArray, fine: float = 0.02
) -> float:
    """Assert that states are a path from start to goal free of collision; return its cost (metres)."""
    assert np.array_equal(states[0], start)
    assert np.array_equal(states[-1], goal)
    assert ((states[:, 2] > -math.pi) & (states[:, 2] <= math.pi)).all()
    oracle = Oracle(world, robot)
    cost, samples = 0.0, [states[:1]]
    for a, b in pairwise(states):
        turn = abs(math.atan2(math.sin(b[2] - a[2]), math.cos(b[2] - a[2])))
        way = math.dist(a[:2], b[:2])
        cost += way + 0.5 * turn
        samples.append(motion_states(a[None], b[None], 2 + int((way + oracle.reach * turn) / (fine * oracle.reach)))[0])
    q = np.concatenate(samples)
    hit = oracle.collides(q)
    assert not hit.any(), q[hit][0]
    return cost


def signed_distances(world: World, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the distance of points (n, 2) to all that blocks them (0 inside), and the depth in what is deepest."""
    places, free = shapely.points(points), shapely.box(*world.bounds)
    if world.boundary is not None:
        free = shapely.intersection(free, world.boundary.shapely())
    depth = shapely.distance(free, places)
    gap = np.where(depth > 0.0, 0.0, shapely.distance(shapely.boundary(free), places))
    for shape in world.obstacles:
        if isinstance(shape, Disc):
            off = np.hypot(*(points - np.array(shape.center)).T) - shape.radius
        else:
            region = shape.polygon().shapely()
            away = shapely.distance(region, places)
            off = np.where(away > 0.0, away, -shapely.distance(shapely.boundary(region), places))
        gap, depth = np.minimum(gap, np.maximum(off, 0.0)), np.maximum(depth, -off)
    return gap, depth


def sign_of_turn(a: FloatArray, b: FloatArray, c: FloatArray) -> int:
    """Return 1 if a, b, c turn to the left, -1 if to the right, 0 if they lie in a row, by exact fractions."""
    (ax, ay), (bx, by), (cx, cy) = ([Fraction(float(v)) for v in p] for p in (a, b, c))
    value = (ax - cx) * (by - cy) - (ay - cy) * (bx - cx)
    return (value > 0) - (value < 0)


# --- Cells of SE(2): where a proof by cells is wrong, a way leads through one of those that shut the robot in. What it
# covers at every configuration of a cell meets an obstacle, or the cell is divided.

HALVINGS = 7
"""Times that a cell's edges are halved: to a hundredth, some millimetres of a cell as large as a robot."""

MOST = 200_000
"""Cells that are looked at: a second or two, if it comes to that."""

BATCH = 2_000
"""Cells that are looked at together."""

HEADINGS = 17
"""Headings of a box at which the robot, eroded by how far it moves from one to the next, is intersected with itself."""

_CHILDREN = np.array(list(product((-0.5, 0.5), repeat=3)))


def free_somewhere(world: World, robot: Robot, middle: FloatArray, extent: FloatArray, pivot: FloatArray) -> bool:
    """Return whether a configuration in one of the boxes is found at which the robot meets nothing.

    Args:
        world: obstacles, bounds, boundary.
        robot: footprint.
        middle: of each box: place of the pivot (metres) and heading (radians), shape (n, 3).
        extent: half the box's edges, those along x and y alike, shape (n, 3).
        pivot: in the robot's frame, shape (2,).
    """
    space = _Space(world, robot.clearance)
    outline = np.asarray(robot.outline.rings()[0]) - pivot
    left = MOST
    # Boxes of one size are looked at together: the robot's middle is the same in all.
    sizes, kind = np.unique(extent, axis=0, return_inverse=True)
    kind = kind.ravel()
    for _ in range(HALVINGS + 1):
        unsettled = []
        for n, size in enumerate(sizes):
            core = _core(outline, size)
            boxes = np.flatnonzero(kind == n)
            for first in range(0, len(boxes), BATCH):
                of = boxes[first : first + BATCH]
                left -= len(of)
                if left < 0:
                    return False
                # Where what the robot covers throughout meets something, so does the robot at the centre.
                for ring in core:
                    of = of[~space.meets(_placed(ring, middle[of]))]
                if not space.meets(_placed(outline, middle[of])).all():
                    return True
                unsettled.append(of)
        open_ = np.concatenate(unsettled) if unsettled else np.empty(0, np.int64)
        if len(open_) == 0:
            return False
        middle = (middle[open_][:, None] + _CHILDREN * sizes[kind[open_]][:, None]).reshape(-1, 3)
        sizes, kind = 0.5 * sizes, np.repeat(kind[open_], len(_CHILDREN))
    return False


class _Space:
    """What the robot must not come nearer to than its clearance, metres."""

    def __init__(self, world: World, clearance: float) -> None:
        self._clearance = clearance
        # Discs as polygons about them, by 1 mm at most: what is said to be free is.
        self._tree = shapely.STRtree([shape.polygon().shapely() for shape in world.obstacles])
        self._rooms = [shapely.box(*world.bounds)]
        if world.boundary is not None:
            self._rooms.append(world.boundary.shapely())
        shapely.prepare(self._rooms)

    def meets(self, pieces: Any) -> NDArray[np.bool_]:
        """Return which of n pieces of the robot, an array of shapely's polygons, meet an obstacle or leave a room."""
        found = np.zeros(len(pieces), np.bool_)
        if self._clearance > 0.0:
            near = self._tree.query(pieces, predicate="dwithin", distance=self._clearance)
        else:
            near = self._tree.query(pieces, predicate="intersects")
        found[near[0]] = True
        for room in self._rooms:
            found |= ~shapely.covers(room, pieces)
            if self._clearance > 0.0:
                found |= shapely.distance(room.exterior, pieces) < self._clearance
        return found


def _placed(ring: FloatArray, q: FloatArray) -> Any:
    """Return an array of n polygons: a ring about the pivot at configurations (n, 3)."""
    c, s = np.cos(q[:, 2]), np.sin(q[:, 2])
    turn = np.stack([np.stack([c, s], axis=-1), np.stack([-s, c], axis=-1)], axis=-2)
    return shapely.polygons(ring @ turn + q[:, None, :2])


def _core(outline: FloatArray, extent: FloatArray) -> list[FloatArray]:
    """Return rings around what the robot covers at every configuration in a box, in its frame at the box's centre."""
    turn = min(float(extent[2]), np.pi)
    # No heading of the box is farther than half a step from one of these.
    headings, half = np.linspace(-turn, turn, HEADINGS), turn / (HEADINGS - 1)
    moves = np.sqrt(2.0) * extent[0] + 2.0 * float(np.hypot(*outline.T).max()) * np.sin(0.5 * half) + 1e-9
    robot = shapely.Polygon(outline)
    inside = shapely.buffer(robot, -1.03 * moves, join_style="mitre")
    # Buffers are not exact: measured anew.
    if inside.is_empty or inside.distance(robot.exterior) < moves or not robot.covers(inside):
        return []
    throughout = shapely.intersection_all([rotate(inside, a, origin=(0.0, 0.0), use_radians=True) for a in headings])
    # A part's outline is all that can meet first.
    parts = shapely.get_parts(throughout)
    return [shapely.get_coordinates(part.exterior) for part in parts if part.area > 0.0]


# --- Costs under an objective.


def sampled_density(world: World, objective: Objective, xy: FloatArray) -> FloatArray:
    """Return what a metre costs at places (n, 2), shape (n,)."""
    factor, speed = np.ones(len(xy)), np.full(len(xy), objective.max_speed)
    for zone in world.zones:
        # Along an outline the cheaper side counts.
        cheap = isinstance(zone, CostZone) and zone.factor < 1.0
        inside = (shapely.intersects_xy if cheap else shapely.contains_xy)(zone.region.shapely(), xy)
        if isinstance(zone, CostZone):
            factor[inside] *= zone.factor
        if isinstance(zone, SpeedZone):
            speed[inside] = np.minimum(speed[inside], zone.limit)
    density = objective.length * factor + objective.time / speed
    if objective.clearance:
        blocked = [shapely.box(*world.bounds).exterior, *(shape.polygon().shapely() for shape in world.obstacles)]
        distance = shapely.distance(shapely.union_all(blocked), shapely.points(xy))
        density += objective.clearance * np.exp(-distance / objective.decay)
    return np.asarray(density)


def sampled_cost(world: World, objective: Objective, states: FloatArray, step: float = 1e-3) -> float:
    """Return the cost of a path of straight motions, shape (n, 3), by the midpoint rule on pieces of a millimetre."""
    total = 0.0
    for a, b in pairwise(states):
        length = float(np.hypot(*(b - a)[:2]))
        count = max(1, int(np.ceil(length / step)))
        places = a[:2] + (np.arange(count)[:, None] + 0.5) / count * (b - a)[:2]
        turned = abs((b[2] - a[2] + np.pi) % (2.0 * np.pi) - np.pi)
        total += length * float(sampled_density(world, objective, places).mean()) + objective.rotation * turned
    return total


# --- Trajectories.

SLACK = 1.0 + 1e-6


def assert_within_limits(trajectory: Trajectory, samples: int = 20_001, jump: float = 1e-9) -> None:
    """Speeds and accelerations exceed no limit, by differences of configurations and of velocities.

    Velocities may jump by ``jump`` of their limits.
    """
    limits = trajectory.limits
    for t in (np.linspace(0.0, trajectory.duration, samples), trajectory.t):
        dt = np.diff(t)
        if len(dt) == 0:
            continue
        q, dq = trajectory.at(t), trajectory.velocity(t)
        moved, change = se2.difference(q[:-1], q[1:]), np.diff(dq, axis=0)
        # Coordinates and velocities are rounded, which short times magnify.
        place = 1e-14 * (1.0 + np.abs(q).max()) / dt
        assert (np.hypot(*moved[:, :2].T) / dt <= limits.max_speed * SLACK + place).all()
        assert (np.abs(moved[:, 2]) / dt <= limits.max_turn_rate * SLACK + place).all()
        assert (np.hypot(*change[:, :2].T) <= limits.max_acceleration * SLACK * dt + jump * limits.max_speed).all()
        if limits.max_turn_acceleration is not None:
            allowed = limits.max_turn_acceleration * SLACK * dt
            assert (np.abs(change[:, 2]) <= allowed + jump * limits.max_turn_rate).all()
