"""Starts in keep-out zones, and motions at the corners of one-way zones and in contact: scenes, and what judges paths.

The judge knows the convex pieces that zones and robots were made of, and takes depths from their Minkowski differences
by shapely: it shares no code with the planner or the audit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark.shapes import Disc, Polygon, Rectangle
from trailmark.trajectories.path import Path
from trailmark.verify import check_path
from trailmark.world import Robot, World
from trailmark.world.zones import KeepOutZone, OneWayZone

__all__ = ["ROBOTS", "Leaving", "corner_query", "depth", "judge_leaving", "leaving_scene"]

FloatArray = NDArray[np.float64]
Rng = np.random.Generator

SIZE = 12.0
"""Metres: side of the worlds."""

TOUCH, RISE, STEP = 1e-7, 1e-4, 0.02
"""Metres that count as touching, that depths may rise by on the way out, and between two places that are looked at."""

L_PIECES = ((-0.4, -0.3, 0.5, 0.0), (-0.4, -0.3, -0.1, 0.5))
L_ROBOT = Robot.polygon([(-0.4, -0.3), (0.5, -0.3), (0.5, 0.0), (-0.1, 0.0), (-0.1, 0.5), (-0.4, 0.5)])
RECTANGLE = Robot.rectangle(0.8, 0.4)
ROBOTS = {
    "disc": Robot.disc(0.3),
    "rectangle": RECTANGLE,
    "L": L_ROBOT,
    "differential": RECTANGLE.differential(),
    "differential, reversing": RECTANGLE.differential(reverse=True),
    "differential L": L_ROBOT.differential(reverse=True),
    "car": RECTANGLE.steered(0.8),
    "car, forward-only": RECTANGLE.steered(0.8, reverse=False),
}


@dataclass(frozen=True)
class Leaving:
    """A query that starts in keep-out zones.

    Attributes:
        world: with its robot.
        pieces: convex pieces of each zone.
        start: in at least one of them.
        goal: in none.
    """

    world: World
    pieces: tuple[tuple[shapely.Polygon, ...], ...]
    start: FloatArray
    goal: FloatArray


def body_of(robot: Robot) -> list[shapely.Geometry]:
    """Return a robot's convex pieces; a disc's is its centre."""
    if isinstance(robot.footprint, Disc):
        return [shapely.Point(0.0, 0.0)]
    if robot.outline == L_ROBOT.outline:
        return [shapely.box(*piece) for piece in L_PIECES]
    return [robot.outline.shapely()]


def placed(piece: shapely.Geometry, q: FloatArray) -> FloatArray:
    """Return the corners of a piece at a configuration."""
    c, s = math.cos(q[2]), math.sin(q[2])
    return np.asarray(shapely.get_coordinates(piece) @ np.array([[c, s], [-s, c]]) + q[:2])


def depth(robot: Robot, zone: tuple[shapely.Polygon, ...], q: FloatArray) -> float:
    """Return the length (metres) of the shortest translation that takes a robot out of a zone; 0 if it is out."""
    parts = [
        shapely.MultiPoint((shapely.get_coordinates(z)[:, None] - placed(piece, q)).reshape(-1, 2)).convex_hull
        for z in zone
        for piece in body_of(robot)
    ]
    # No slits between abutting pieces.
    blocked = shapely.union_all(parts, grid_size=1e-9)
    origin = shapely.Point(0.0, 0.0)
    if isinstance(robot.footprint, Disc):
        radius = robot.footprint.radius
        if len(zone) == 1:
            away = float(blocked.boundary.distance(origin))
            return radius + away if blocked.contains(origin) else max(0.0, radius - away)
        # In a bay the nearest way out of one part may lead into another.
        blocked = blocked.buffer(radius, quad_segs=512)
    return float(blocked.boundary.distance(origin)) if blocked.contains(origin) else 0.0


def judge_leaving(asked: Leaving, path: Path) -> str | None:
    """Return what is wrong with a path out of zones; None if nothing is."""
    robot = asked.world.robot
    assert robot is not None
    if not np.array_equal(path.states[[0, -1]], [asked.start, asked.goal]):
        return "ends elsewhere"
    states = path.at(np.linspace(0.0, 1.0, int(np.clip(path.cost / STEP, 100, 2000))))
    reach = robot.circumradius
    for i, zone in enumerate(asked.pieces):
        union = shapely.union_all(zone)
        shapely.prepare(union)
        least, out = np.inf, False
        for q, near in zip(states, shapely.dwithin(union, shapely.points(states[:, :2]), reach), strict=True):
            found = depth(robot, zone, q) if near else 0.0
            if out and found > 2.0 * TOUCH:
                return f"back in zone {i}, it overlaps by {found:.3g} m at {q.tolist()}"
            if found > least + 1.01 * RISE:
                return f"overlaps zone {i} by {found - least:.3g} m more than before at {q.tolist()}"
            least = min(least, found)
            out = out or found == 0.0
        if not out:
            return f"overlaps zone {i} to its end"
    audit = check_path(asked.world, robot, path)
    return None if audit.free else f"check_path: collides {audit.collisions}"


def _rectangles(rng: Rng, size: float) -> list[tuple[float, float, float, float]]:
    """Return a rectangle, an L or a U made of rectangles that abut, about the origin."""
    w, h = size * rng.uniform(0.3, 1.0, 2)
    t = float(rng.uniform(0.15, 0.45))
    kind = rng.integers(4)
    if kind <= 1:
        return [(-w, -h, w, h)]
    foot = (-w, -h, w, -h + 2 * t * h)
    left = (-w, -h + 2 * t * h, -w + 2 * t * w, h)
    return [foot, left] if kind == 2 else [foot, left, (w - 2 * t * w, -h + 2 * t * h, w, h)]


def _zone(rng: Rng, center: FloatArray, size: float, angle: float) -> tuple[shapely.Polygon, ...]:
    turned = [shapely.affinity.rotate(shapely.box(*box), angle, (0.0, 0.0), True) for box in _rectangles(rng, size)]
    return tuple(shapely.affinity.translate(piece, *center) for piece in turned)


def _region(zone: tuple[shapely.Polygon, ...]) -> Polygon:
    union = shapely.union_all(zone, grid_size=1e-9)
    return Polygon(shapely.get_coordinates(union.exterior)[:-1])


def leaving_scene(rng: Rng, robot: Robot) -> Leaving | None:
    """Return a query that starts in one to three zones of any size, nested, overlapping or abutting; None by chance."""
    angle = float(rng.choice([0.0, rng.uniform(0.0, math.pi)]))
    center, size = rng.uniform(3.0, SIZE - 3.0, 2), float(10.0 ** rng.uniform(-0.7, 0.5))
    zones = [_zone(rng, center, size, angle)]
    for _ in range(int(rng.integers(0, 3))):
        how = rng.integers(3)
        if how == 0:  # nested
            zones.append(_zone(rng, center, size * float(rng.uniform(1.2, 2.5)), angle))
        elif how == 1:  # overlapping
            zones.append(
                _zone(rng, center + size * rng.uniform(-1.5, 1.5, 2), size * rng.uniform(0.3, 1.5), angle + 0.3)
            )
        else:  # abutting: mirrored at an edge
            first = zones[0][0]
            (x1, y1), (x2, y2) = shapely.get_coordinates(first)[1:3]
            shift = 2.0 * (np.array([0.5 * (x1 + x2), 0.5 * (y1 + y2)]) - shapely.get_coordinates(first.centroid)[0])
            zones.append((shapely.affinity.translate(first, *shift),))
    try:
        regions = [_region(zone) for zone in zones]
    except Exception:  # what fell apart in rounding is no zone
        return None
    obstacles = []
    for _ in range(int(rng.integers(0, 4))):
        at = rng.uniform(0.5, SIZE - 0.5, 2)
        x, y = float(at[0]), float(at[1])
        obstacles.append(
            Disc((x, y), 0.4) if rng.random() < 0.5 else Rectangle((x, y), 1.5, 0.3, float(rng.uniform(0, 3)))
        )
    world = World(
        "zones", (0.0, 0.0, SIZE, SIZE), tuple(obstacles), robot, zones=tuple(KeepOutZone(region) for region in regions)
    )
    blocked = shapely.union_all([shape.polygon(1e-3).shapely() for shape in obstacles])
    everywhere = shapely.union_all([piece for zone in zones for piece in zone])
    around = everywhere.buffer(float(rng.choice([0.02, 0.2, 1.0])) * robot.circumradius)
    low, high = np.array(around.bounds[:2]), np.array(around.bounds[2:])
    start = goal = None
    for _ in range(100):
        q = np.array([*rng.uniform(low, high), rng.choice([0.0, rng.uniform(-3.1, 3.1)])])
        if any(depth(robot, zone, q) > 1e-3 for zone in zones) and _clear(robot, blocked, q):
            start = q
            break
    for _ in range(100):
        q = np.array([*rng.uniform(0.5, SIZE - 0.5, 2), rng.uniform(-3.1, 3.1)])
        if _clear(robot, shapely.union_all([blocked, everywhere]), q):
            goal = q
            break
    return None if start is None or goal is None else Leaving(world, tuple(zones), start, goal)


def _clear(robot: Robot, blocked: shapely.Geometry, q: FloatArray) -> bool:
    """Return whether a robot is clear of something, and inside of the bounds, by a centimetre."""
    pieces = [placed(piece, q) for piece in body_of(robot)]
    radius = robot.footprint.radius if isinstance(robot.footprint, Disc) else 0.0
    corners = np.concatenate(pieces)
    if corners.min() - radius < 0.01 or corners.max() + radius > SIZE - 0.01:
        return False
    bodies = [shapely.MultiPoint(piece).convex_hull for piece in pieces]
    return min(float(blocked.distance(body)) if not blocked.is_empty else np.inf for body in bodies) > radius + 0.01


def corner_query(rng: Rng) -> tuple[World, FloatArray]:
    """Return a world with a one-way zone or an obstacle, and ends, (2, 3), between which the way all but misses it."""
    angle, d = float(rng.choice([0.0, rng.uniform(0.0, math.pi)])), float(10.0 ** rng.uniform(-9.0, -5.0))
    place = rng.uniform(0.0, 2.0, 2) + 2.0
    square = Rectangle((0.5, -0.5), 1.0, 1.0)
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, s], [-s, c]])
    region = Polygon(square.polygon().vertices @ turn + place)
    tilt = float(rng.uniform(0.2, 1.3))
    ahead, aside = np.array([math.cos(tilt), math.sin(tilt)]), np.array([math.sin(tilt), -math.cos(tilt)])
    ends = np.zeros((2, 3))
    if rng.random() < 0.5:
        zone = OneWayZone(region, float(angle + tilt + math.pi), float(rng.uniform(0.0, 2.0)))
        world = World("corner", (0.0, 0.0, 6.0, 6.0), robot=Robot.disc(0.2), zones=(zone,))
        reach = -rng.uniform(0.3, 0.6), rng.uniform(0.3, 0.6)
    else:
        # A square that drives along the diagonal past the corner, its own corner behind it by next to nothing.
        half = 0.2
        world = World("touch", (0.0, 0.0, 6.0, 6.0), (region,), Robot.rectangle(2.0 * half, 2.0 * half))
        ends[:, 2] = angle
        ahead, aside = np.array([1.0, 1.0]), np.array([1.0, -1.0])
        reach = -half - rng.uniform(0.1, 0.6), float(rng.choice([0.5 * d, d, 2.0 * d])) - d
        aside = aside - half * np.array([1.0, -1.0]) / d
    ends[:, :2] = np.array([along * ahead + d * aside for along in reach]) @ turn + place
    return world, ends
