"""Random worlds and robots that go for what is hard: slivers, shallow walls, abutting pieces, any scale and place."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from tests.helpers.worlds import ROBOTS, random_world, star_polygon

from trailmark.errors import ShapeError
from trailmark.shapes import Disc, Polygon, Rectangle, Shape
from trailmark.world import Robot, World

__all__ = ["SCALES", "random_car", "random_disc", "random_robot", "random_scene", "scaled", "shallow_ring", "turned"]

FloatArray = NDArray[np.float64]
Rng = np.random.Generator

SCALES: dict[str, tuple[float, tuple[float, float]]] = {
    "plain": (1.0, (0.0, 0.0)),
    "1 mm": (5e-5, (0.0, 0.0)),
    "100 km": (5e3, (-5e4, -5e4)),
    "1e6 m away": (1.0, (1e6, -1e6)),
    "UTM": (1.0, (5e5, 4.5e6)),
    "1e4 m away": (1.0, (1e4, 1e4)),
}
"""Name: metres for one metre of the plain world, which is 20 m wide, and where its corner stands (metres)."""


def turned(points: FloatArray, angle: float) -> FloatArray:
    """Return points, shape (n, 2), turned about the origin."""
    c, s = math.cos(angle), math.sin(angle)
    return np.asarray(points @ np.array([[c, s], [-s, c]]))


def scaled(shape: Shape, scale: float, origin: tuple[float, float] = (0.0, 0.0)) -> Shape:
    """Return a shape ``scale`` times as large, moved by ``origin``."""
    if isinstance(shape, Polygon):
        move = np.asarray(origin)
        return Polygon(scale * shape.vertices + move, tuple(scale * hole + move for hole in shape.holes))
    center = (scale * shape.center[0] + origin[0], scale * shape.center[1] + origin[1])
    if isinstance(shape, Disc):
        return Disc(center, scale * shape.radius)
    return Rectangle(center, scale * shape.length, scale * shape.width, shape.heading)


def random_car(rng: Rng) -> Robot:
    """Return a robot with a random turning radius, that reverses or does not."""
    robot = random_robot(rng)
    return robot.steered(float(robot.circumradius * rng.uniform(0.5, 3.0)), bool(rng.random() < 0.5))


def random_robot(rng: Rng) -> Robot:
    """Return a robot of about a metre: round, rectangular, thin, not convex, spiky, or about another point."""
    kind = rng.integers(9)
    if kind == 0:
        return Robot.disc(float(rng.uniform(0.1, 0.8)))
    if kind == 1:
        return Robot.rectangle(float(rng.uniform(0.3, 2.0)), float(rng.uniform(0.2, 1.0)))
    if kind == 2:
        return Robot.rectangle(float(rng.uniform(0.5, 3.0)), float(10.0 ** rng.uniform(-4.0, -1.0)))
    if kind == 3:
        # A tip with half an angle of 0.01 to 10 degrees.
        half = math.radians(10.0 ** rng.uniform(-2.0, 1.0))
        length = float(rng.uniform(0.5, 1.5))
        return Robot.polygon([(length, 0.0), (0.0, length * math.tan(half)), (0.0, -length * math.tan(half))])
    if kind == 4:
        shift = rng.uniform(-1.0, 1.0, 2)
        return Robot.polygon(star_polygon(rng, (float(shift[0]), float(shift[1])), 0.6).vertices)
    if kind == 5:
        return Robot.polygon(star_polygon(rng, (0.0, 0.0), float(rng.uniform(0.3, 1.0))).vertices)
    names = sorted(ROBOTS)
    return Robot(scaled(ROBOTS[names[int(rng.integers(len(names)))]].footprint, float(rng.uniform(0.3, 1.0))))


def random_disc(rng: Rng) -> Robot:
    """Return a round robot."""
    return Robot.disc(float(rng.uniform(0.05, 0.8)))


def shallow_ring(rng: Rng, low: FloatArray, high: FloatArray, unevenness: float) -> FloatArray:
    """Return a box's outline, shape (n, 2), counter-clockwise, with vertices up to ``unevenness`` (metres) off it."""
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    rows = []
    for k in range(4):
        a, b = corners[k], corners[(k + 1) % 4]
        along = (b - a) / np.hypot(*(b - a))
        t = np.sort(rng.uniform(0.02, 0.98, int(rng.integers(0, 12))))
        off = unevenness * rng.uniform(-1.0, 1.0, len(t)) * 10.0 ** rng.uniform(-3.0, 0.0, len(t))
        rows += [a[None], a + t[:, None] * (b - a) + off[:, None] * np.array([-along[1], along[0]])]
    return np.concatenate(rows)


def _uneven_walls(rng: Rng) -> list[Shape]:
    """Long walls whose vertices lie nearly on a line."""
    found: list[Shape] = []
    angle = float(rng.choice([0.0, rng.uniform(0.0, math.pi)]))
    for _ in range(int(rng.integers(2, 6))):
        size = np.array([rng.uniform(3.0, 10.0), rng.uniform(0.2, 1.5)])
        ring = shallow_ring(rng, -0.5 * size, 0.5 * size, float(10.0 ** rng.uniform(-8.0, -1.5)))
        turn = angle + float(rng.choice([0.0, 0.5 * math.pi]))
        found.append(Polygon(turned(ring, turn) + rng.uniform(3.0, 17.0, 2)))
    return found


def _slivers(rng: Rng) -> list[Shape]:
    """Long triangles and quadrangles with angles of next to nothing."""
    found: list[Shape] = []
    for _ in range(int(rng.integers(5, 25))):
        length, width = rng.uniform(0.5, 8.0), 10.0 ** rng.uniform(-6.0, -1.0)
        ring = np.array([[0.0, -width], [length, width * rng.uniform(-1.0, 1.0)], [0.0, width]])
        if rng.random() < 0.3:
            ring = np.concatenate([ring, [[-length * rng.random(), 0.0]]])
        found.append(Polygon(turned(ring, rng.uniform(0.0, 2.0 * math.pi)) + rng.uniform(2.0, 18.0, 2)))
    return found


def _abutting(rng: Rng) -> list[Shape]:
    """Rows of turned rectangles side by side, and tiles."""
    found: list[Shape] = []
    for _ in range(int(rng.integers(1, 5))):
        angle = float(rng.choice([0.0, 0.7, rng.uniform(0.0, math.pi)]))
        length, width = float(rng.uniform(0.5, 2.0)), float(rng.uniform(0.2, 1.0))
        along, at = np.array([math.cos(angle), math.sin(angle)]), rng.uniform(4.0, 16.0, 2)
        for k in range(int(rng.integers(2, 6))):
            x, y = at + k * length * along
            found.append(Rectangle((float(x), float(y)), length, width, angle))
    return found


def _clutter(rng: Rng) -> list[Shape]:
    """Polygons, some with holes, and discs."""
    world = random_world(
        int(rng.integers(2**31)),
        int(rng.integers(5, 50)),
        size=20.0,
        radii=(0.2, 2.0),
        discs=float(rng.choice([0.0, 0.3, 1.0])),
        holes=float(rng.choice([0.0, 0.3])),
    )
    return list(world.obstacles)


KINDS: tuple[Callable[[Rng], list[Shape]], ...] = (_uneven_walls, _slivers, _abutting, _clutter, _clutter)


def random_scene(rng: Rng, scale: str = "plain", make: Callable[[Rng], Robot] = random_robot) -> World:
    """Return a world with its robot.

    Args:
        rng: where chance comes from.
        scale: one of SCALES.
        make: the robot, which is scaled with the world.
    """
    factor, origin = SCALES[scale]
    while True:
        try:
            shapes = KINDS[int(rng.integers(len(KINDS)))](rng)
            boundary = None
            if rng.random() < 0.25:
                ring = shallow_ring(
                    rng, np.array([0.5, 0.5]), np.array([19.5, 19.5]), float(10.0 ** rng.uniform(-6, -1))
                )
                boundary = scaled(Polygon(ring), factor, origin)
            chosen = make(rng)
            body = scaled(chosen.footprint, factor)
            steering = None if chosen.turning_radius is None else factor * chosen.turning_radius
            # Half of the clearances are of the size of what counts as touching.
            kept = float(
                rng.choice(
                    [0.0, 10.0 ** rng.uniform(-8.5, -6.0), factor * 10.0 ** rng.uniform(-6.0, 0.0)], p=[0.7, 0.15, 0.15]
                )
            )
            x, y = origin
            return World(
                f"scene ({scale})",
                (x, y, x + 20.0 * factor, y + 20.0 * factor),
                tuple(scaled(shape, factor, origin) for shape in shapes),
                Robot(body, steering, chosen.reverse, kept),
                boundary if isinstance(boundary, Polygon) else None,
            )
        except ShapeError:
            # What is too thin for its place after rounding is no polygon any more.
            continue
