"""Carved worlds: a drive comes first, obstacles are put around all that the robot sweeps on it; so a way is known."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from tests.helpers.worlds import star_polygon

from benchmarks.soundness.reference import Reference, moves
from benchmarks.soundness.scenes import SCALES, random_robot, scaled, turned
from trailmark.errors import ShapeError, WorldError
from trailmark.shapes import Polygon, Shape
from trailmark.world import Robot, World

__all__ = ["Carved", "carved_world", "drive_along", "random_drive"]

FloatArray = NDArray[np.float64]
Rng = np.random.Generator

SLACK = 0.05
"""Part of the margin that the swept region may be too small by."""


class Carved(NamedTuple):
    """A world with a way that is known.

    Attributes:
        world: with its robot.
        way: shape (n, 3): of straight motions, or places along a car's drive; metres and radians.
        cost: of the way, metres.
        margin: metres of room along it, at least.
    """

    world: World
    way: FloatArray
    cost: float
    margin: float


def random_drive(rng: Rng, radius: float, reverse: bool, arcs: int) -> FloatArray:
    """Return sides (1, 0, -1) and ways (metres, negative: backwards) of a car's drive, shape (arcs + 2, 2).

    It begins and ends straight: the shortest curve between the ends of arcs alone may be a full circle longer once the
    ends are rounded.
    """
    sides = np.array([0.0, *rng.choice([-1.0, 1.0], arcs), 0.0])
    ways = np.where(sides == 0.0, rng.uniform(0.2, 3.0, arcs + 2), radius * rng.uniform(0.1, 2.5, arcs + 2))
    return np.column_stack([sides, ways * np.where(reverse & (rng.random(arcs + 2) < 0.4), -1.0, 1.0)])


def drive_along(q: FloatArray, drive: FloatArray, radius: float, step: float) -> FloatArray:
    """Return places at most ``step`` metres apart on a drive from q, shape (n, 3), by the formulas of the circle."""
    rows, (x, y, theta) = [q[None]], q
    for side, way in drive:
        along = way * np.arange(1, (n := max(1, math.ceil(abs(way) / step))) + 1) / n
        turn = side * along / radius
        if side == 0.0:
            places = np.column_stack([x + along * math.cos(theta), y + along * math.sin(theta), np.full(n, theta)])
        else:
            heading = theta + turn
            places = np.column_stack(
                [
                    x + side * radius * (np.sin(heading) - math.sin(theta)),
                    y - side * radius * (np.cos(heading) - math.cos(theta)),
                    heading,
                ]
            )
        rows.append(places)
        x, y, theta = places[-1]
    found = np.concatenate(rows)
    found[:, 2] = np.angle(np.exp(1j * found[:, 2]))
    return found


def swept(robot: Robot, places: FloatArray) -> Any:
    """Return what a robot covers on straight motions from place to place, without the bulge of turning between them."""
    reference = Reference(World("open", (-1e6, -1e6, 1e6, 1e6)), robot)
    if reference.round:
        return shapely.buffer(
            shapely.LineString(places[:, :2]), reference.radius / math.cos(math.pi / 64), quad_segs=32
        )
    whole = shapely.Polygon(np.column_stack([reference.ring.real, reference.ring.imag]))
    parts = [whole]
    if not shapely.equals(whole, shapely.convex_hull(whole)):
        parts = list(shapely.get_parts(shapely.constrained_delaunay_triangles(whole)))
    hulls = []
    for part in parts:
        ring = shapely.get_coordinates(part)[:-1] @ np.array([1.0, 1j])
        z = np.exp(1j * places[:, 2, None]) * ring + (places[:, 0] + 1j * places[:, 1])[:, None]
        both = np.concatenate([z[:-1], z[1:]], axis=1)
        points = shapely.multipoints(
            shapely.points(np.stack([both.real, both.imag], axis=-1).reshape(-1, 2)).reshape(len(both), -1)
        )
        hulls.append(shapely.convex_hull(points))
    return shapely.union_all(np.concatenate(hulls))


def carved_world(rng: Rng, car: bool = False, scale: str = "plain") -> Carved | None:
    """Return a carved world; None where no simple shapes came out, or the way has less room than it should."""
    robot = random_robot(rng)
    margin = float(10.0 ** rng.uniform(-5.0, -1.0))
    if robot.circumradius < 0.05:
        return None
    start = np.array([*rng.uniform(-1.0, 1.0, 2), rng.uniform(-math.pi, math.pi)])
    most = math.sqrt(8.0 * SLACK * margin / robot.circumradius)
    if car:
        radius = float(robot.circumradius * rng.uniform(0.5, 3.0))
        robot = robot.steered(radius, bool(rng.random() < 0.5))
        drive = random_drive(rng, radius, robot.reverse, int(rng.integers(1, 4)))
        way, cost = drive_along(start, drive, radius, radius * min(most, 0.1)), float(np.abs(drive[:, 1]).sum())
        places = way
        # Between two places on an arc the chord lies off by no more than this.
        bulge = SLACK * margin * (1.0 + radius / robot.circumradius)
    else:
        way = _straight_way(rng, start)
        if rng.random() < 0.4:
            way = _wavering(rng, way, robot.circumradius)
        places, cost = _fine(way, most), float(_costs(way).sum())
        bulge = SLACK * margin
    if len(places) > 4000:
        return None
    free = shapely.buffer(swept(robot, places), margin + bulge, quad_segs=4)
    if rng.random() < 0.4:
        free = shapely.simplify(free, 0.3 * margin)
    if rng.random() < 0.5:
        free = _with_hollows(rng, free)
    factor, origin = SCALES[scale]
    try:
        world = _around(rng, free, robot, factor, origin)
    except (ShapeError, WorldError):
        return None
    move = np.array([*origin, 0.0])
    size = np.array([factor, factor, 1.0])
    way = way * size + move
    known = Carved(world, way, cost * factor if car else float(_costs(way).sum()), 0.5 * margin * factor)
    return known if _has_room(known, places * size + move) else None


def _has_room(known: Carved, places: FloatArray) -> bool:
    """Return whether the judge finds room all along the way: it was made so, but shapely rounds."""
    robot = known.world.robot
    assert robot is not None
    reference = Reference(known.world, robot)
    n = len(places) - 1
    between = moves(places[:-1], places[1:])(np.arange(n), np.full(n, 0.5))
    return bool(reference.clearance(np.concatenate([places, between])).min() >= known.margin)


def _straight_way(rng: Rng, start: FloatArray) -> FloatArray:
    rows = [start]
    heading = rng.uniform(-math.pi, math.pi)
    for _ in range(int(rng.integers(1, 5))):
        heading += rng.normal(0.0, 0.8)
        length = rng.uniform(0.3, 4.0) * (rng.random() < 0.9)
        turn = float(rng.choice([0.0, rng.normal(0.0, 0.5), rng.uniform(-3.0, 3.0)]))
        last = rows[-1]
        theta = float(np.angle(np.exp(1j * (last[2] + turn))))
        rows.append(np.array([last[0] + length * math.cos(heading), last[1] + length * math.sin(heading), theta]))
    return np.array(rows)


def _wavering(rng: Rng, way: FloatArray, size: float) -> FloatArray:
    """Return a way that wavers to both sides by up to a hundredth of the robot: its walls are shallow waves."""
    rows, most = [way[:1]], size * 10.0 ** rng.uniform(-4.0, -1.8)
    for a, b in pairwise(way):
        t = np.sort(rng.uniform(0.05, 0.95, int(rng.integers(1, 8))))
        turn = float(np.angle(np.exp(1j * (b[2] - a[2]))))
        between = a + t[:, None] * np.array([b[0] - a[0], b[1] - a[1], turn])
        between[:, :2] += most * rng.uniform(-1.0, 1.0, (len(t), 2))
        between[:, 2] = np.angle(np.exp(1j * between[:, 2]))
        rows += [between, b[None]]
    return np.concatenate(rows)


def _costs(way: FloatArray) -> FloatArray:
    step = np.diff(way, axis=0)
    return np.asarray(np.hypot(step[:, 0], step[:, 1]) + 0.5 * np.abs(np.angle(np.exp(1j * step[:, 2]))))


def _fine(way: FloatArray, most: float) -> FloatArray:
    """Return places on straight motions no more than ``most`` radians apart."""
    rows = [way[:1]]
    for i in range(len(way) - 1):
        turn = float(np.angle(np.exp(1j * (way[i + 1, 2] - way[i, 2]))))
        t = np.arange(1, (n := max(1, math.ceil(abs(turn) / most))) + 1) / n
        rows.append(moves(way[i : i + 1], way[i + 1 : i + 2])(np.zeros(n, np.int64), t))
    return np.concatenate(rows)


def _around(rng: Rng, free: Any, robot: Robot, factor: float, origin: tuple[float, float]) -> World:
    """Return a world whose free space holds ``free``: walls all round, whole or in pieces, and more obstacles."""
    free = max(shapely.get_parts(free), key=shapely.area)
    room = float(rng.choice([0.3, 2.0]))
    xmin, ymin, xmax, ymax = (float(v) for v in shapely.bounds(free) + np.array([-room, -room, room, room]))
    box = shapely.box(xmin, ymin, xmax, ymax)
    outline, islands = shapely.Polygon(free.exterior), [shapely.Polygon(ring) for ring in free.interiors]
    kind = rng.integers(4)
    boundary: Polygon | None = None
    pieces: list[Any] = list(islands)
    if kind == 0:
        boundary = Polygon(shapely.get_coordinates(outline)[:-1])
    elif kind == 1:
        pieces.append(shapely.difference(box, outline))
    elif kind == 2:
        wall = [shapely.difference(box, outline)]
        for _ in range(int(rng.integers(1, 5))):
            wall = _cut(rng, wall, np.array([xmin, ymin]), np.array([xmax, ymax]))
        pieces += wall
    else:
        blocks = [
            star_polygon(rng, (float(x), float(y)), float(rng.uniform(0.2, 1.0))).shapely()
            for x, y in rng.uniform((xmin, ymin), (xmax, ymax), (int(rng.integers(5, 40)), 2))
        ]
        pieces += [part for block in blocks for part in shapely.get_parts(shapely.difference(block, free))]
    shapes: list[Shape] = []
    for piece in pieces:
        for part in shapely.get_parts(piece):
            if part.geom_type != "Polygon" or shapely.area(part) < 1e-12:
                continue
            holes = tuple(shapely.get_coordinates(ring)[:-1] for ring in part.interiors)
            shapes.append(scaled(Polygon(shapely.get_coordinates(part.exterior)[:-1], holes), factor, origin))
    if boundary is not None:
        moved = scaled(boundary, factor, origin)
        assert isinstance(moved, Polygon)
        boundary = moved
    bounds = tuple(factor * v + o for v, o in zip((xmin, ymin, xmax, ymax), (*origin, *origin), strict=True))
    steering = None if robot.turning_radius is None else factor * robot.turning_radius
    body = Robot(scaled(robot.footprint, factor), steering, robot.reverse)
    return World("carved", (bounds[0], bounds[1], bounds[2], bounds[3]), tuple(shapes), body, boundary)


def _with_hollows(rng: Rng, free: Any) -> Any:
    """Return a region that holds ``free``, with shallow hollows in the walls around it where edges are long."""
    largest = max(shapely.get_parts(free), key=shapely.area)
    ring = shapely.get_coordinates(shapely.Polygon(largest.exterior).normalize().exterior)[::-1]
    rows, depth = [], 10.0 ** rng.uniform(-4.0, -1.3)
    for a, b in pairwise(ring):
        length = float(np.hypot(*(b - a)))
        t = np.sort(rng.uniform(0.02, 0.98, int(rng.integers(1, 6)) if length > 0.2 else 0))
        # Counter-clockwise, the outside lies on the right.
        off = min(depth, 0.1 * length) * rng.uniform(0.05, 1.0, len(t))[:, None] * np.array([b[1] - a[1], a[0] - b[0]])
        rows += [a[None], a + t[:, None] * (b - a) + off / length if len(t) else a[None][:0]]
    found = shapely.Polygon(np.concatenate(rows), [shapely.get_coordinates(hole) for hole in largest.interiors])
    return found if shapely.is_valid(found) and shapely.covers(shapely.buffer(found, 1e-9), largest) else free


def _cut(rng: Rng, regions: list[Any], low: FloatArray, high: FloatArray) -> list[Any]:
    """Return regions cut along a line: pieces that abut."""
    at, far = rng.uniform(low, high), 2.0 * float(np.hypot(*(high - low)))
    half = turned(np.array([[-far, 0.0], [far, 0.0], [far, far], [-far, far]]), rng.uniform(0.0, math.pi)) + at
    side = shapely.Polygon(half)
    return [
        part
        for region in regions
        for piece in (shapely.intersection(region, side), shapely.difference(region, side))
        for part in shapely.get_parts(piece)
    ]
