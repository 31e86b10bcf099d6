"""The shipped worlds: sound, and each query as feasible as its name says.

Nothing here uses trailmark's own collision checks: regions are built with shapely from the fields of the shapes.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely
import shapely.affinity
from numpy.typing import NDArray
from scipy import ndimage, sparse

from trailmark import Disc, Polygon, Rectangle, Robot, World
from trailmark.library import shipped_worlds

NAMES = list(shipped_worlds())
Configuration = tuple[float, float, float]


@pytest.fixture(scope="module", params=NAMES)
def world(request: pytest.FixtureRequest) -> World:
    return World.load(shipped_worlds()[request.param])


def test_shipped_worlds_cover_what_they_should() -> None:
    loaded = {name: World.load(file) for name, file in shipped_worlds().items()}
    assert len(loaded) >= 10
    assert len(loaded["clutter"].obstacles) == 200
    assert {type(shape) for shape in loaded["field2000"].obstacles} == {Disc, Rectangle, Polygon}
    assert len(loaded["field2000"].obstacles) == 2000
    assert loaded["lake"].boundary is not None
    assert any(isinstance(shape, Polygon) and shape.holes for shape in loaded["gate"].obstacles)
    assert {type(each.robot.footprint) for each in loaded.values() if each.robot} == {Disc, Rectangle, Polygon}
    assert shipped_worlds()["field2000"].stat().st_size < 400_000


def test_name_and_queries(world: World) -> None:
    assert world.name in NAMES
    assert world.robot is not None
    assert 1 <= len(world.queries) <= 4
    assert all(query.name.startswith("infeasible") == (world.name == "enclosed") for query in world.queries)


# --- starts and goals --------------------------------------------------------------------------------------------


def region(shape: Disc | Rectangle | Polygon) -> shapely.Geometry:
    """The shape's region; for a disc its centre alone, the radius is subtracted from distances."""
    if isinstance(shape, Disc):
        return shapely.Point(shape.center)
    if isinstance(shape, Rectangle):
        a, b = shape.length / 2, shape.width / 2
        turned = shapely.affinity.rotate(shapely.box(-a, -b, a, b), shape.heading, (0, 0), use_radians=True)
        return shapely.affinity.translate(turned, *shape.center)
    return shapely.Polygon(shape.vertices, shape.holes)


def radius(shape: Disc | Rectangle | Polygon) -> float:
    return shape.radius if isinstance(shape, Disc) else 0.0


def outside(world: World) -> shapely.Geometry:
    """What bounds and boundary leave out, in a frame about the world."""
    x0, y0, x1, y1 = world.bounds
    inside = shapely.box(x0, y0, x1, y1)
    if world.boundary is not None:
        inside = inside.intersection(shapely.Polygon(world.boundary.vertices))
    return shapely.box(x0 - 5, y0 - 5, x1 + 5, y1 + 5).difference(inside)


class Oracle:
    """Clearance of the robot in a world, by shapely."""

    def __init__(self, world: World) -> None:
        assert world.robot is not None
        self.footprint = world.robot.footprint
        solid = [each for each in world.obstacles if not isinstance(each, Disc)]
        self.solid = np.array([*(region(each) for each in solid), outside(world)])
        self.discs = np.array([(*each.center, each.radius) for each in world.obstacles if isinstance(each, Disc)])

    def clearance(self, q: Configuration) -> float:
        """Distance (metres) from the robot to what is not free; 0 or less if they meet."""
        placed = shapely.affinity.rotate(region(self.footprint), q[2], (0, 0), use_radians=True)
        placed = shapely.affinity.translate(placed, q[0], q[1])
        distances = [shapely.distance(self.solid, placed)]
        if len(self.discs):
            distances.append(shapely.distance(shapely.points(self.discs[:, :2]), placed) - self.discs[:, 2])
        return float(np.concatenate(distances).min()) - radius(self.footprint)


def test_starts_and_goals_keep_clear(world: World) -> None:
    oracle = Oracle(world)
    for query in world.queries:
        for end in (query.start, query.goal):
            assert oracle.clearance(end) > 0.09, query.name


# --- feasible ----------------------------------------------------------------------------------------------------


def distances(world: World, h: float, limit: float) -> NDArray[np.float64]:
    """Distance (metres) from each cell's centre to what is not free, or ``limit`` if larger; shape (nx, ny)."""
    x0, y0, x1, y1 = world.bounds
    x, y = np.meshgrid(np.arange(x0 + h / 2, x1, h), np.arange(y0 + h / 2, y1, h), indexing="ij")
    field = np.minimum(limit, np.minimum(np.minimum(x - x0, x1 - x), np.minimum(y - y0, y1 - y)))
    for each in [*world.obstacles, outside(world)] if world.boundary is not None else world.obstacles:
        solid, r = (each, 0.0) if isinstance(each, shapely.Geometry) else (region(each), radius(each))
        low, high = np.array(solid.bounds[:2]), np.array(solid.bounds[2:])
        i0, j0 = np.maximum((low - r - limit - (x0, y0)) / h - 1, 0).astype(int)
        i1, j1 = np.maximum((high + r + limit - (x0, y0)) / h + 1, 0).astype(int)
        near = (slice(i0, i1), slice(j0, j1))
        # The box around it is no farther away, and is itself what is meant if it is a disc's centre or not turned.
        gap = to_box(x[near], y[near], low, high) - r
        if not isinstance(each, Disc) and solid.area < (1.0 - 1e-12) * np.prod(high - low):
            closer = gap < field[near]
            gap[closer] = shapely.distance(shapely.points(x[near][closer], y[near][closer]), solid)
        field[near] = np.minimum(field[near], gap)
    return np.asarray(field)


def to_box(
    x: NDArray[np.float64], y: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distance from points to a box that is not turned, 0 within it."""
    dx, dy = np.maximum(low[0] - x, x - high[0]), np.maximum(low[1] - y, y - high[1])
    return np.asarray(np.hypot(np.maximum(dx, 0.0), np.maximum(dy, 0.0)))


def cover(robot: Robot, side: float) -> tuple[NDArray[np.float64], float]:
    """Centres, shape (m, 2), and the one radius of discs that cover the footprint: those about squares of a grid."""
    if isinstance(robot.footprint, Disc):
        return np.zeros((1, 2)), robot.footprint.radius
    body = region(robot.footprint)
    x0, y0, x1, y1 = body.bounds
    nx, ny = math.ceil((x1 - x0) / side - 1e-9), math.ceil((y1 - y0) / side - 1e-9)
    dx, dy = (x1 - x0) / nx, (y1 - y0) / ny
    squares = [
        shapely.box(x0 + i * dx, y0 + j * dy, x0 + (i + 1) * dx, y0 + (j + 1) * dy)
        for i in range(nx)
        for j in range(ny)
    ]
    used = [square for square in squares if square.intersection(body).area > 1e-12]
    return np.array([square.centroid.coords[0] for square in used]), math.hypot(dx, dy) / 2


def connected(world: World, h: float, headings: int, side: float) -> dict[str, bool]:
    """For each query: is there provably a path? A flood through cells of (x, y, theta) that are free as a whole.

    A cell counts as free if the robot, covered by discs of radius rho, is free at every configuration in the cell.
    The distance at the grid point next to a disc's centre p must be at least rho, plus the way from p to that grid
    point, plus half the cell's diagonal, plus what half a step of heading moves p: then no configuration of the
    cell brings the disc to an obstacle. Neighbouring free cells touch, so a path runs through them.
    """
    assert world.robot is not None
    points, rho = cover(world.robot, side)
    arms = np.hypot(*points.T)
    limit = rho + arms.max() * math.pi / headings + 2 * h  # more is never needed
    field = distances(world, h, limit)
    reach = int(arms.max() / h) + 2
    # Distances in whole steps, rounded to the safe side: bytes compare fast.
    step = limit / 255
    steps = np.pad(np.clip(field / step, 0, 255).astype(np.uint8), reach)
    free = np.ones((headings, *field.shape), bool)
    room = np.empty(field.shape, bool)
    # A rectangle half a turn on is the same rectangle.
    half = headings // 2 if isinstance(world.robot.footprint, Rectangle) and headings % 2 == 0 else headings
    for k in range(half):
        cos, sin = math.cos(2 * math.pi * k / headings), math.sin(2 * math.pi * k / headings)
        places = points @ np.array([[cos, sin], [-sin, cos]]) / h
        cells = np.rint(places).astype(int)
        slack = np.hypot(*(places - cells).T) * h + h / math.sqrt(2) + arms * math.pi / headings
        needed = np.ceil((rho + slack) / step).astype(int)
        assert needed.max() <= 255
        for (i, j), least in zip(cells + reach, needed.astype(np.uint8), strict=True):
            np.greater_equal(steps[i : i + field.shape[0], j : j + field.shape[1]], least, out=room)
            np.logical_and(free[k], room, out=free[k])
    free[half:] = free[: headings - half]
    labels, count = ndimage.label(free)
    # The last heading neighbours the first one.
    a, b = labels[0][free[0] & free[-1]], labels[-1][free[0] & free[-1]]
    wrap = sparse.coo_array((np.ones(len(a), bool), (a, b)), shape=(count + 1, count + 1))
    _, component = sparse.csgraph.connected_components(wrap, directed=False)

    def find(q: Configuration) -> int | None:
        i, j = int((q[0] - world.bounds[0]) / h), int((q[1] - world.bounds[1]) / h)
        label = labels[round(q[2] / (2 * math.pi) * headings) % headings, i, j]
        return int(component[label]) if label else None

    return {
        query.name: find(query.start) is not None and find(query.start) == find(query.goal) for query in world.queries
    }


# Cell side (metres), number of headings, side of the covering squares (metres): as coarse as the proof allows.
GRIDS = {
    "bugtrap": (0.12, 36, 0.27),
    "clutter": (0.25, 24, 0.5),
    "corridor": (0.04, 48, 0.13),
    "discs": (0.05, 1, 1.0),
    "environment1": (0.3, 24, 0.45),
    "environment2": (0.06, 1, 1.0),
    "gate": (0.12, 36, 0.27),
    "factory": (0.1, 24, 0.3),
    "lake": (0.3, 24, 0.45),
    "long": (0.15, 36, 0.25),
    "lshape": (0.04, 72, 0.125),
    "maze": (0.12, 24, 0.3),
    "office": (0.08, 32, 0.14),
    "parking": (0.08, 120, 0.23),
    "warehouse": (0.12, 36, 0.3),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", GRIDS)
def test_query_is_feasible(name: str) -> None:
    world = World.load(shipped_worlds()[name])
    assert connected(world, *GRIDS[name]) == {query.name: True for query in world.queries}


@pytest.mark.slow
def test_field2000_is_feasible_for_the_circumscribed_disc() -> None:
    world = World.load(shipped_worlds()["field2000"])
    assert world.robot is not None
    disc = world.with_robot(Robot.disc(world.robot.circumradius))
    assert connected(disc, 0.2, 1, 1.0) == {query.name: True for query in world.queries}


# Too narrow for a grid: the ways through are given, and each motion is proven free.
SLANT = (math.cos(0.5), math.sin(0.5))
FIRST: list[Configuration] = [(1.6, 8.56, 0.0), (7.4, 8.56, 0.0)]
SECOND: list[Configuration] = [(11.75 + s * SLANT[0], 5.6 + s * SLANT[1], 0.5) for s in (-2.6, 2.6)]
THIRD: list[Configuration] = [(16.6, 3.42, 0.0), (21.4, 3.42, 0.0)]
WAYS: dict[str, list[Configuration]] = {
    "first": FIRST,
    "second": SECOND,
    "third": THIRD,
    "all": [*FIRST, *SECOND, *THIRD],
}


def proven_free(oracle: Oracle, a: Configuration, b: Configuration, arm: float) -> bool:
    """Is every configuration between a and b free? A clearance of d covers the motion for d on both sides."""
    delta = (b[0] - a[0], b[1] - a[1], b[2] - a[2])
    middle = (a[0] + delta[0] / 2, a[1] + delta[1] / 2, a[2] + delta[2] / 2)
    reach = (math.hypot(delta[0], delta[1]) + arm * abs(delta[2])) / 2
    clearance = oracle.clearance(middle)
    if clearance > reach:
        return True
    return clearance > 1e-3 and proven_free(oracle, a, middle, arm) and proven_free(oracle, middle, b, arm)


@pytest.mark.slow
def test_narrow_is_feasible() -> None:
    world = World.load(shipped_worlds()["narrow"])
    assert world.robot is not None
    oracle = Oracle(world)
    for query in world.queries:
        way = [query.start, *WAYS[query.name], query.goal]
        for a, b in pairwise(way):
            assert proven_free(oracle, a, b, world.robot.circumradius), (query.name, a, b)


# --- infeasible --------------------------------------------------------------------------------------------------


def test_enclosed_is_infeasible_even_for_the_inscribed_disc() -> None:
    world = World.load(shipped_worlds()["enclosed"])
    assert world.robot is not None
    assert isinstance(world.robot.footprint, Rectangle)
    r = world.robot.footprint.width / 2 - 1e-6
    # shapely's round buffers are polygons inside the true ones, so the free space here is too large, if anything.
    grown = [region(each).buffer(radius(each) + r) for each in world.obstacles]
    free = shapely.box(*world.bounds).buffer(-r).difference(shapely.union_all(grown))
    rooms = shapely.get_parts(free)
    for query in world.queries:
        start, goal = (np.flatnonzero(shapely.contains(rooms, shapely.Point(q[:2]))) for q in (query.start, query.goal))
        assert len(start) == len(goal) == 1
        assert start != goal, query.name
