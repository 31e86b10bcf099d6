"""The shipped worlds: sound, and each query as feasible as its name says.

Nothing here uses trailmark's own collision checks: regions are built with shapely from the fields of the shapes.
"""

from __future__ import annotations

import numpy as np
import pytest
import shapely
import shapely.affinity

from trailmark import Disc, LandmarkPlanner, Polygon, Rectangle, World
from trailmark.world.library import shipped_worlds

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


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in NAMES if name != "enclosed"])
def test_queries_are_feasible(name: str) -> None:
    world = World.load(shipped_worlds()[name])
    planner, oracle = LandmarkPlanner(world, seed=0), Oracle(world)
    for query in world.queries:
        path = planner.plan(query.start, query.goal, time_limit=20.0, max_iterations=1).path
        assert path is not None, query.name
        for q in path.at(np.linspace(0.0, 1.0, 200)):
            assert oracle.clearance(q) > -1e-6, query.name


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
