"""Worlds made to break proofs: shallow walls, slivers, abutting rectangles, and obstacles carved around a known path.

Each generator returns a world together with a path through it that is known to be free, because the obstacles were made
around it: whatever says that there is no way, or none as short as that, is wrong.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark import se2
from trailmark.shapes import Polygon, Rectangle, Shape
from trailmark.world import Robot, World

__all__ = ["SHAPES", "Attack", "abutting", "carved", "collinear", "slit", "uneven"]

FloatArray = NDArray[np.float64]

SHAPES: dict[str, list[tuple[float, float]]] = {
    "rectangle": [(-0.5, -0.3), (0.5, -0.3), (0.5, 0.3), (-0.5, 0.3)],
    "behind": [(-0.1, -0.2), (0.9, -0.2), (0.9, 0.2), (-0.1, 0.2)],
    "triangle": [(-0.4, -0.4), (0.6, 0.0), (-0.4, 0.4)],
    "angle": [(-0.5, -0.5), (0.5, -0.5), (0.5, -0.2), (-0.2, -0.2), (-0.2, 0.5), (-0.5, 0.5)],
}
"""Outlines (metres) that robots are made of."""


class Attack(NamedTuple):
    """A world, a robot, and a path of it that is free.

    Attributes:
        world: what to plan in.
        robot: its footprint.
        states: shape (n, 3), joined by straight motions.
        cost: of the path, metres.
    """

    world: World
    robot: Robot
    states: FloatArray
    cost: float


class _Frame(NamedTuple):
    """How a world that was made about the origin is scaled, turned and moved."""

    scale: float
    turn: float
    offset: FloatArray

    @classmethod
    def random(cls, rng: np.random.Generator, scale: float, offset: float) -> _Frame:
        angle = rng.uniform(-math.pi, math.pi)
        return cls(scale, float(rng.choice([0.0, angle])), offset * rng.uniform(-1.0, 1.0, 2))

    def points(self, points: Any) -> FloatArray:
        c, s = math.cos(self.turn), math.sin(self.turn)
        turn = np.array([[c, s], [-s, c]])
        return np.asarray(self.scale * np.asarray(points, dtype=np.float64) @ turn + self.offset)

    def states(self, states: FloatArray) -> FloatArray:
        return np.column_stack([self.points(states[:, :2]), se2.wrap(states[:, 2] + self.turn)])

    def attack(self, obstacles: list[Any], robot: Robot, states: FloatArray, room: FloatArray) -> Attack:
        """Return the attack with obstacles (shapely polygons) in bounds about ``room``, shape (n, 2)."""
        shapes: list[Shape] = []
        for region in obstacles:
            holes = tuple(self.points(shapely.get_coordinates(ring)) for ring in region.interiors)
            shapes.append(Polygon(self.points(shapely.get_coordinates(region.exterior)), holes))
        corners = self.points(room)
        world = World("attack", (*corners.min(axis=0), *corners.max(axis=0)), tuple(shapes))
        placed = self.states(states)
        return Attack(world, robot, placed, cost_of(placed))


def cost_of(states: FloatArray) -> float:
    """Return the cost of straight motions (metres): way and half the turning."""
    steps = np.diff(states, axis=0)
    turns = np.abs((steps[:, 2] + math.pi) % (2.0 * math.pi) - math.pi)
    return float(np.hypot(steps[:, 0], steps[:, 1]).sum() + 0.5 * turns.sum())


def uneven(seed: int, *, scale: float = 1.0, offset: float = 0.0) -> Attack:
    """Return a disc of radius 1 that passes between a post and a ceiling that is uneven by some millimetres."""
    rng = np.random.default_rng(seed)
    frame = _Frame.random(rng, scale, offset)
    x = rng.uniform(-4.0, 4.0, int(rng.integers(1, 8)))
    # Some with another beside it: a step.
    x = np.sort(np.concatenate([x, x[rng.random(len(x)) < 0.5] + 1e-3]))
    y = 2.0 + rng.uniform(0.0, rng.choice([0.005, 0.01, 0.05]), len(x))
    ceiling = np.array([(-5.0, 2.0), *zip(x, y, strict=True), (5.0, 2.0)])
    play = float(10.0 ** rng.uniform(-4.5, -2.5))
    # As high as the disc can be at each place, less half the play; 1e-6 is more than sampling misses.
    u = np.linspace(-3.9, 3.9, 2001)
    above = shapely.get_coordinates(shapely.segmentize(shapely.LineString(ceiling), 2e-3))
    way = np.column_stack([u, _under(above, u) - 1e-6 - 0.5 * play])
    # Where the disc is highest, most is lost if the ceiling counts as even.
    middle = np.abs(u) < 3.0
    at = float(u[middle][np.argmax(way[middle, 1])])
    beside = np.maximum(0.0, np.abs(u - at) - 0.02)
    near = beside < 1.0
    top = float((way[near, 1] - np.sqrt(1.0 - beside[near] ** 2)).min()) - 0.5 * play
    post = shapely.box(at - 0.02, -5.5, at + 0.02, top)
    hole = [(-5.0, -5.0), (5.0, -5.0), *ceiling[::-1]]
    wall = shapely.Polygon([(-6, -6), (6, -6), (6, 3), (-6, 3)], [hole])
    states = np.column_stack([way, np.zeros(len(way))])
    return frame.attack([wall, post], Robot.disc(scale), states, np.array([(-6, -6), (6, -6), (6, 3), (-6, 3)]))


def _under(points: FloatArray, x: FloatArray) -> FloatArray:
    """Return how high a unit disc's centre may be at each x (n,) below points (m, 2)."""
    high = np.empty(len(x))
    for k, place in enumerate(x):
        off = points[:, 0] - place
        near = np.abs(off) <= 1.0
        high[k] = (points[near, 1] - np.sqrt(1.0 - off[near] ** 2)).min()
    return high


def collinear(seed: int, *, scale: float = 1.0, offset: float = 0.0) -> Attack:
    """Return a disc that goes round a wall with vertices all but in a row, which a spike joins from one side."""
    rng = np.random.default_rng(seed)
    frame = _Frame.random(rng, scale, offset)
    x = np.concatenate([[0.0], np.sort(rng.uniform(0.2, 9.8, int(rng.integers(2, 20)))), [10.0]])
    off = rng.choice([0.0, 1e-12, 1e-9, 1e-6]) * rng.uniform(-1.0, 1.0, len(x))
    wall = shapely.Polygon([(0, 0), (10, 0), *zip(x[::-1], 1.0 + off, strict=True)])
    at = float(rng.uniform(2.0, 8.0))
    spike = shapely.Polygon([(at - 0.1, -9.0), (at + 0.1, -9.0), (at + 0.1, 0.5), (at - 0.1, 0.5)])
    # Squares about the corners, 0.5 and some more away from them.
    r = 0.5 + 1e-5
    over = [(1, -1), (-r, -1), (-r, 1), (-r, 1 + r), (0, 1 + r), (10, 1 + r), (10 + r, 1 + r), (10 + r, -1), (9, -1)]
    states = np.array([(u, v, 0.0) for u, v in over])
    room = np.array([(-3, -12), (13, -12), (13, 4), (-3, 4)])
    return frame.attack([wall, spike], Robot.disc(0.5 * scale), states, room)


def abutting(seed: int, *, scale: float = 1.0, offset: float = 0.0) -> Attack:
    """Return a disc that goes round a row of rectangles that abut or overlap, each turned alike."""
    rng = np.random.default_rng(seed)
    heading, n = float(rng.uniform(-math.pi, math.pi)), int(rng.integers(2, 6))
    along = np.array([math.cos(heading), math.sin(heading)])
    across = np.array([-along[1], along[0]])
    middle = offset * rng.uniform(-1.0, 1.0, 2)
    step = float(rng.choice([1.0, 1.0, 0.999999, 1.0 - 1e-9, 0.7]))
    shapes: list[Shape] = []
    for k in range(n):
        length = float(rng.choice([1.0, 1.0, 0.5]))
        x, y = middle + scale * step * (k - 0.5 * (n - 1)) * along
        shapes.append(
            Rectangle((float(x), float(y)), scale * length, 0.5 * scale, heading + float(rng.choice([0, math.pi])))
        )
    reach = 0.5 * step * (n - 1) + 0.5 + 0.4 + 1e-5
    corners = [-1.0 * across, -reach * along - across, -reach * along + across, across]
    points = middle + scale * np.array(corners)
    size = scale * (reach + 4.0)
    world = World("attack", (*(middle - size), *(middle + size)), tuple(shapes))
    states = np.column_stack([points, np.zeros(len(points))])
    return Attack(world, Robot.disc(0.4 * scale), states, cost_of(states))


def slit(seed: int, *, scale: float = 1.0, offset: float = 0.0) -> Attack:
    """Return a disc that passes a gap wider than itself by 1e-5 to 1e-2 of its size, between slivers and blocks."""
    rng = np.random.default_rng(seed)
    frame = _Frame.random(rng, scale, offset)
    play = float(10.0 ** rng.uniform(-5.0, -2.0))
    half = 0.5 + 0.5 * play
    solid = []
    for side in (-1.0, 1.0):
        for _ in range(int(rng.integers(1, 5))):
            x, thick = rng.uniform(-1.0, 1.0), 10.0 ** rng.uniform(-6.0, 0.0)
            tip = half + rng.choice([0.0, 0.0, 1e-9, 1e-6, 1e-3])
            inner = [
                (x - thick, side * tip),
                (x + rng.uniform(-1.0, 1.0) * thick, side * half),
                (x + thick, side * tip),
            ]
            solid.append(shapely.Polygon([*inner, (x + thick, side * 5.0), (x - thick, side * 5.0)]))
    states = np.array([(-4.0, 0.0, 0.0), (4.0, 0.0, 0.0)])
    room = np.array([(-6, -6), (6, -6), (6, 6), (-6, 6)])
    return frame.attack([p for p in solid if p.is_valid and p.area > 0.0], Robot.disc(0.5 * scale), states, room)


def carved(seed: int, shape: str = "disc", *, scale: float = 1.0, offset: float = 0.0) -> Attack:
    """Return a robot in a corridor that was cut around its path, with 1e-5 to 1e-1 of its size to spare.

    Args:
        seed: of numpy's default generator.
        shape: ``disc`` or one of SHAPES.
        scale: metres that one of these is long.
        offset: metres at most from the origin, along each axis.
    """
    rng = np.random.default_rng(seed)
    frame = _Frame.random(rng, scale, offset)
    n = int(rng.integers(2, 6))
    states = np.column_stack([np.cumsum(rng.normal(0.0, 1.5, (n, 2)), axis=0), rng.uniform(-math.pi, math.pi, n)])
    if shape == "disc":
        states[:, 2] = 0.0
        robot = Robot.disc(0.5 * scale)
        swept: Any = shapely.LineString(states[:, :2])
        radius = 0.5
    else:
        robot = Robot.polygon(scale * np.array(SHAPES[shape]))
        swept, radius = _swept(np.array(SHAPES[shape]), states), 0.0
    margin = float(10.0 ** rng.uniform(-5.0, -1.0))
    # Arcs are drawn inside of circles: from outside instead.
    corridor = shapely.buffer(swept, (radius + margin) / math.cos(math.pi / 256), quad_segs=64)
    low, high = states[:, :2].min(axis=0) - 3.0, states[:, :2].max(axis=0) + 3.0
    box = shapely.box(*low, *high)
    solid = shapely.get_parts(shapely.difference(box, corridor))
    if rng.random() < 0.5:
        # In strips that abut or overlap.
        cuts = np.sort(rng.uniform(low[0], high[0], int(rng.integers(1, 4))))
        edges = [low[0], *cuts, high[0]]
        lap = float(rng.choice([0.0, 1e-9, 0.05]))
        strips = shapely.box(np.array(edges[:-1]) - lap, low[1], np.array(edges[1:]) + lap, high[1])
        solid = shapely.get_parts([shapely.intersection(part, strip) for part in solid for strip in strips])
    solid = [p for p in solid if p.geom_type == "Polygon" and p.is_valid and p.area > 1e-9]
    room = np.array([low, (high[0], low[1]), high, (low[0], high[1])])
    # Where it is turned, the corners of the bounds are open to it; that adds ways, which does no harm.
    return frame.attack(solid, robot, states, room)


def _swept(outline: FloatArray, states: FloatArray) -> Any:
    """Return a region that contains what an outline sweeps along straight motions between states."""
    pieces, reach, turn = [], float(np.hypot(*outline.T).max()), 0.01
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(shapely.Polygon(outline)))
    triangles = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3]
    for a, b in pairwise(states):
        by = (b[2] - a[2] + math.pi) % (2.0 * math.pi) - math.pi
        steps = max(1, math.ceil(abs(by) / turn))
        t = np.linspace(0.0, 1.0, steps + 1)
        c, s = np.cos(a[2] + t * by), np.sin(a[2] + t * by)
        turned = np.stack([np.stack([c, s], axis=-1), np.stack([-s, c], axis=-1)], axis=-2)
        placed = np.einsum("kvi,nij->nkvj", triangles, turned) + (a[:2] + t[:, None] * (b[:2] - a[:2]))[:, None, None]
        both = np.concatenate([placed[:-1], placed[1:]], axis=2)
        pieces += list(shapely.convex_hull(shapely.multipoints(both.reshape(-1, 6, 2))))
    # A point leaves its chord by no more than this; buffers are drawn inside of circles.
    rise = reach * turn**2 / 8.0 * 1.01
    return shapely.buffer(shapely.union_all(pieces), rise)
