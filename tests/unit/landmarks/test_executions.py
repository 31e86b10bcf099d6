"""Executions in a world, repaired centres, their spread, and how many a sensor's range needs. Shapely judges."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from scipy.spatial.distance import cdist
from sklearn.cluster import KMeans
from tests.helpers.oracles import Oracle
from tests.helpers.worlds import ROBOTS, random_states, random_world
from threadpoolctl import threadpool_limits

from trailmark import ConfigurationError, Disc, Polygon, Rectangle, Robot, StateChecker, World
from trailmark.landmarks import repair_centres
from trailmark.landmarks.executions import Execution, execute_paper, landmarks_for_area, landmarks_for_range
from trailmark.world.library import shipped_worlds

FloatArray = NDArray[np.float64]

YARD = (58.0, 34.0, 68.0, 42.0)  # inside the walls of environment 2


@pytest.fixture(scope="module")
def checker() -> StateChecker:
    return StateChecker(World.load(shipped_worlds()["environment2"]))


@pytest.fixture(scope="module")
def plain(checker: StateChecker) -> Execution:
    return execute_paper(checker, 1000, 14, random_state=0, start=start(checker))


def start(checker: StateChecker) -> FloatArray:
    return np.array(checker.world.queries[0].start)


@pytest.mark.slow
def test_the_source_method_in_environment_2(checker: StateChecker, plain: Execution) -> None:
    found, points = plain, shapely.points(plain.samples)
    solid = shapely.union_all([shape.polygon(1e-3).shapely() for shape in checker.world.obstacles])
    # The boxes hold the obstacles, but for the noise of the readings and what no pose saw of their outlines.
    assert found.forbidden[shapely.contains(shapely.buffer(solid, -0.3), points)].all()
    assert np.array_equal(found.enclosed, found.enclosed & shapely.contains(shapely.box(*YARD), points))
    deep_inside = shapely.contains(shapely.box(*YARD).buffer(-0.2), points)
    assert found.forbidden[deep_inside].all()
    assert found.enclosed.sum() >= deep_inside.sum() > 0
    for shape, box in zip(checker.world.obstacles, found.boxes, strict=True):
        assert np.abs(np.array(box) - shape.bounding_box()).max() < 1.3
    # K-means knows no obstacles: some centres lie in them; what stands in for the centres does not.
    assert found.in_obstacle.any()
    assert (found.in_obstacle <= found.invalid).all()
    assert found.repaired.shape == (14, 3)
    assert checker.valid(found.repaired).all()
    same = np.hypot(*(found.repaired[:, :2] - found.centres).T) == 0.0
    assert np.array_equal(same, ~found.invalid)
    assert found.seconds > 0.0


WORLD = World(
    "room",
    (0.0, 0.0, 20.0, 12.0),
    (
        Disc((5.0, 5.0), 2.0),
        Rectangle((12.0, 3.0), 4.0, 1.0, 0.4),
        Polygon(np.array([[14, 6], [18, 6], [18, 11], [17, 11], [17, 7], [14, 7]])),
        Rectangle((10.0, 9.0), 6.0, 0.5),
        Rectangle((10.0, 10.2), 6.0, 0.5),  # a gap of 0.7 m between the two, which only some headings fit
    ),
    boundary=Polygon(np.array([[0, 0], [20, 0], [20, 12], [4, 12], [0, 8]])),
)
assert WORLD.boundary is not None
FREE = WORLD.boundary.shapely().difference(shapely.union_all([s.polygon(1e-5).shapely() for s in WORLD.obstacles]))
LOOSE, TIGHT = FREE.buffer(1e-3), FREE.buffer(-1e-4)
shapely.prepare([LOOSE, TIGHT])
STANDING = [Robot.disc(0.4), Robot.rectangle(1.6, 0.6), Robot.polygon([[-0.3, -0.2], [1.2, -0.2], [1.2, 0.3]])]


def body(robot: Robot, q: FloatArray) -> shapely.Geometry:
    if isinstance(robot.footprint, Disc):
        return shapely.Point(q[:2]).buffer(robot.footprint.radius, quad_segs=64)
    placed = shapely.affinity.rotate(robot.outline.shapely(), q[2], (0, 0), use_radians=True)
    return shapely.affinity.translate(placed, q[0], q[1])


def fits(robot: Robot, place: FloatArray) -> bool:
    """Is there a heading, of those that are tried, at which the robot fits with room to spare?"""
    headings = [0.0] if isinstance(robot.footprint, Disc) else np.linspace(-math.pi, math.pi, 72, endpoint=False)
    return any(TIGHT.contains(body(robot, np.array([*place, heading]))) for heading in headings)


@pytest.mark.slow
@pytest.mark.parametrize("robot", STANDING, ids=Robot.describe)
def test_repaired_centres_are_valid_and_the_nearest(robot: Robot) -> None:
    centres, samples = (np.random.default_rng(i).uniform((0, 0), (20, 12), (n, 2)) for i, n in enumerate((40, 200)))
    found = repair_centres(StateChecker(WORLD, robot), centres, samples)
    assert all(LOOSE.contains(body(robot, q)) for q in found.configurations)
    points = shapely.points(centres)
    sure = shapely.distance(points, FREE.boundary) > 1e-4
    assert np.array_equal(found.in_obstacle[sure], ~shapely.contains(FREE, points)[sure])
    assert 3 < found.in_obstacle.sum() < 30
    for q, centre, invalid in zip(found.configurations, centres, found.invalid, strict=True):
        if not invalid:
            assert np.array_equal(q[:2], centre)
            continue
        assert not fits(robot, centre)
        assert np.hypot(*(samples - q[:2]).T).min() == 0.0
        nearer = samples[np.hypot(*(samples - centre).T) < np.hypot(*(q[:2] - centre)) - 1e-9]
        assert not any(fits(robot, place) for place in nearer)


OPEN = StateChecker(World("open", (-0.5, -0.5, 40.5, 40.5)), Robot.disc(0.5))


@pytest.mark.parametrize("probability", [0.01, 0.3, 0.85, 0.9, 0.95, 0.99, 0.9999])
def test_a_hexagon_has_that_share_within_range(probability: float) -> None:
    area, reach = 1e6, 3.0
    side = math.sqrt(area / landmarks_for_area(area, reach, probability) / (1.5 * math.sqrt(3.0)))
    angles = np.arange(6) * (math.pi / 3.0)
    cell = shapely.Polygon(side * np.column_stack([np.cos(angles), np.sin(angles)]))
    covered = cell.intersection(shapely.Point(0, 0).buffer(reach, quad_segs=2000)).area / cell.area
    # One landmark less would not do, and k is large: the share is met to a rounding.
    assert covered == pytest.approx(probability, abs=1e-4)


def share_in_range(places: FloatArray, k: int, reach: float, seed: int) -> float:
    """The share of the places within range of scikit-learn's centres of 1,000 others."""
    mixed = np.random.default_rng(seed).permutation(places)
    with threadpool_limits(1):  # more threads than free cores would wait for one another
        centres = KMeans(k, init="random", n_init=1, random_state=seed).fit(mixed[:1000]).cluster_centers_
    return float((cdist(mixed[1000:], centres).min(axis=1) <= reach).mean())


CASES = {
    "open, small share": (OPEN, 3.5, 0.5),
    "office": (StateChecker(World.load(shipped_worlds()["office"])), 3.0, 0.95),
    "random": (StateChecker(random_world(2, 250, discs=0.4, boundary=True), ROBOTS["rectangle"]), 14.0, 0.99),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_the_share_in_range_is_as_promised(name: str) -> None:
    checker, reach, probability = CASES[name]
    k = landmarks_for_range(checker, reach, probability, random_state=1)
    rng, oracle, places = np.random.default_rng(2), Oracle(checker.world, checker.robot), np.empty((0, 2))
    while len(places) < 3000:
        q = random_states(checker.world, 2500, rng)
        places = np.vstack([places, q[~oracle.collides(q)][:, :2]])
    shares = np.array([share_in_range(places, k, reach, seed) for seed in range(4)])
    error = max(shares.std(ddof=1) / 2.0, math.sqrt(probability * (1.0 - probability) / len(places)))
    assert shares.mean() >= probability - 3.0 * error
    # Nor is it far too many, although these centres may lie in obstacles: two thirds would not do.
    assert share_in_range(places, 2 * k // 3, reach, 0) < probability


@pytest.mark.parametrize(
    "call",
    [
        *(lambda reach=reach: landmarks_for_area(1.0, reach) for reach in (0.0, -1.0, math.nan, math.inf, 1e-200)),
        *(lambda reach=reach: landmarks_for_range(OPEN, reach) for reach in (0.0, math.nan, 0.01)),
        *(lambda p=p: landmarks_for_range(OPEN, 1.0, p) for p in (0.0, 1.0, 0.99999, math.nan)),
        lambda: landmarks_for_area(1.0, 1.0, 1.0),
        lambda: landmarks_for_area(0, 1.0),
    ],
)
def test_bad_ranges_are_told_in_one_line(call: Callable[[], object]) -> None:
    with pytest.raises(ConfigurationError, match=r"^[^\n]*expected [^\n]*got [^\n]*$"):
        call()
