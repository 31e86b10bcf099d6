"""Executions in a world: what is forbidden, enclosed, repaired, and that the seed decides it all."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from scipy.spatial.distance import cdist

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError
from trailmark.landmarks.executions import Execution, execute_paper, execute_se2
from trailmark.library import shipped_worlds
from trailmark.shapes import Rectangle
from trailmark.world import Robot, World

YARD = (58.0, 34.0, 68.0, 42.0)  # inside the walls of environment 2
FULL = World("full", (0.0, 0.0, 5.0, 5.0), (Rectangle((2.5, 2.5), 6.0, 6.0),), Robot.disc(0.2))


@pytest.fixture(scope="module")
def checker() -> StateChecker:
    return StateChecker(World.load(shipped_worlds()["environment2"]))


@pytest.fixture(scope="module")
def room() -> StateChecker:
    """A small world, where sensing takes no time."""
    walls = (Rectangle((3.0, 2.0), 1.0, 2.0), Rectangle((6.0, 4.0), 2.0, 1.0))
    return StateChecker(World("room", (0.0, 0.0, 8.0, 6.0), walls, Robot.disc(0.3)))


@pytest.fixture(scope="module")
def plain(checker: StateChecker) -> Execution:
    return execute_paper(checker, 1000, 14, random_state=0, start=start(checker))


def start(checker: StateChecker) -> se2.FloatArray:
    return np.array(checker.world.queries[0].start)


def test_environment_2_is_half_c_obstacle(checker: StateChecker) -> None:
    rng = np.random.default_rng(0)
    q = rng.uniform((0.0, 0.0, -np.pi), (100.0, 80.0, np.pi), (20_000, 3))
    assert checker.world.bounds == (0.0, 0.0, 100.0, 80.0)
    assert 0.48 < 1.0 - checker.valid(q).mean() < 0.52


@pytest.mark.slow
def test_grown_boxes_leave_out_the_points_of_the_c_obstacle(checker: StateChecker, plain: Execution) -> None:
    grown = execute_paper(checker, 1000, 14, random_state=0, start=start(checker), grown=True)
    radius = checker.robot.inscribed_disc.radius
    assert np.allclose(grown.boxes - plain.boxes, [-radius, -radius, radius, radius])
    # By shapely: what is not forbidden lies in no grown box; a disc robot can stand at almost all of it, but for what
    # readings missed of the outlines, and the bounds.
    valid = grown.samples[~grown.forbidden]
    boxes = shapely.union_all(shapely.box(*grown.boxes.T))
    assert not shapely.contains(boxes, shapely.points(valid)).any()
    inner = (valid > radius).all(axis=1) & (valid < np.array([100.0, 80.0]) - radius).all(axis=1)
    stands = np.asarray(checker.valid(np.column_stack([valid[inner], np.zeros(inner.sum())])))
    assert stands.mean() > 0.99
    assert grown.forbidden.sum() > 1.3 * plain.forbidden.sum()


@pytest.mark.slow
def test_the_source_method_in_environment_2(checker: StateChecker, plain: Execution) -> None:
    found = plain
    points = shapely.points(found.samples)
    solid = shapely.union_all([shape.polygon(1e-3).shapely() for shape in checker.world.obstacles])
    # The boxes hold the obstacles, but for the noise of the readings and what no pose saw of their outlines.
    deep = shapely.contains(shapely.buffer(solid, -0.3), points)
    assert found.forbidden[deep].all()
    assert np.array_equal(found.enclosed, found.enclosed & shapely.contains(shapely.box(*YARD), points))
    deep_inside = shapely.contains(shapely.box(*YARD).buffer(-0.2), points)
    assert np.array_equal(found.forbidden[deep_inside], np.ones(deep_inside.sum(), dtype=bool))
    assert found.enclosed.sum() >= deep_inside.sum() > 0
    assert len(found.boxes) == len(checker.world.obstacles)
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


def test_trailmarks_own_in_environment_2(checker: StateChecker) -> None:
    found = execute_se2(checker, 1000, 14, random_state=0, start=start(checker))
    assert np.array_equal(found.forbidden & ~found.enclosed, ~checker.valid(found.samples))
    inside = shapely.contains(shapely.box(*YARD), shapely.points(found.samples[:, :2]))
    assert np.array_equal(found.enclosed, inside & checker.valid(found.samples))
    assert found.enclosed.any()
    kept = found.samples[~found.forbidden]
    assert checker.valid(found.centres).all()
    assert not found.invalid.any()
    gaps = cdist(kept[:, :2], found.centres[:, :2])  # a disc: headings count for nothing
    assert np.array_equal(found.labels, np.argmin(gaps, axis=1))
    assert found.inertia == pytest.approx(float((gaps.min(axis=1) ** 2).sum()))


@pytest.mark.slow
def test_a_start_in_an_obstacle_tells_nothing(checker: StateChecker) -> None:
    blocked = np.array([42.0, 43.0, 0.0])
    assert not checker.valid(blocked)
    # The yard does not reach the edge of the region, so it is enclosed even so; for trailmark's own it is a place.
    assert execute_paper(checker, 1000, 14, random_state=0, start=blocked).enclosed.any()
    assert not execute_se2(checker, 1000, 14, random_state=0, start=blocked).enclosed.any()


def test_no_room() -> None:
    full = StateChecker(FULL)
    with pytest.raises(ConfigurationError, match="world 'full': empty free space: no place for the robot was found"):
        execute_paper(full, 100, 3, random_state=0)
    with pytest.raises(ConfigurationError, match="k: empty free space: 0 of 100 samples drawn are valid"):
        execute_se2(full, 100, 3, random_state=0)


@pytest.mark.slow
def test_counts_out_of_range(room: StateChecker) -> None:
    for method in (execute_paper, execute_se2):
        with pytest.raises(ConfigurationError, match="n: expected 1 or more, got 0"):
            method(room, 0, 3, random_state=0)
        with pytest.raises(ConfigurationError, match=r"k: expected 1 to \d+, got 101: \d+ of 100"):
            method(room, 100, 101, random_state=0)
