from __future__ import annotations

import numpy as np
import pytest
import shapely

from trailmark import Disc, LandmarkPlanner, Rectangle, Robot, World
from trailmark.live.reach_data import reach_data

START, GOAL = np.array([1.0, 1.0, 0.0]), np.array([9.0, 1.0, 0.0])


def rooms(gap: float) -> World:
    """Return a room of 4 m and one of 5 m, with a gap in the wall of 1 m between them, in the middle."""
    side = 0.5 * (6.0 - gap)
    walls = tuple(Rectangle((4.5, y), 1.0, side) for y in (0.5 * side, 6.0 - 0.5 * side) if side > 0.0)
    return World("rooms", (0.0, 0.0, 10.0, 6.0), walls)


def region(rings: list[list[list[float]]]) -> shapely.Polygon:
    return shapely.Polygon(rings[0], rings[1:])


def test_a_disc_is_shut_in_and_the_narrowest_place_is_told() -> None:
    found = reach_data(LandmarkPlanner(rooms(0.6), Robot.disc(0.4)), START, GOAL, infeasible=True)
    assert (found["proof"], found["end"]) == ("disc", "start")
    # The disc's centre keeps its radius from all walls of the room of 4 x 6 m.
    assert region(found["rings"]).area == pytest.approx(3.2 * 5.2, rel=0.01)
    x, y, radius = found["gap"]
    assert 4.0 <= x <= 5.0
    assert y == pytest.approx(3.0, abs=0.01)
    assert radius == pytest.approx(0.3, abs=0.001)
    assert "robot holds one of 0.80 m" in found["text"]


def test_the_narrowest_place_is_that_of_the_widest_way() -> None:
    # Two doors, of 0.5 m and of 0.7 m, and beyond a third of 0.6 m that every way takes.
    walls = [Rectangle((4.0, y), 0.2, h) for y, h in ((0.5, 1.0), (2.75, 2.5), (5.35, 1.3))]
    walls += [Rectangle((7.0, y), 0.2, h) for y, h in ((1.2, 2.4), (4.5, 3.0))]
    world = World("doors", (0.0, 0.0, 10.0, 6.0), tuple(walls))
    found = reach_data(LandmarkPlanner(world, Robot.disc(0.4)), START, GOAL, infeasible=True)
    assert found["gap"] == pytest.approx([7.0, 2.7, 0.3], abs=0.11)
    assert found["gap"][2] == pytest.approx(0.3, abs=0.001)
    # Without time there is none.
    assert reach_data(LandmarkPlanner(world, Robot.disc(0.4)), START, GOAL, stop=lambda: True)["gap"] is None


def test_a_wall_without_a_gap_has_no_narrowest_place() -> None:
    found = reach_data(LandmarkPlanner(rooms(0.0), Robot.disc(0.4)), GOAL, START, infeasible=True)
    assert (found["proof"], found["end"], found["gap"]) == ("disc", "goal", None)
    assert "close every way to the start" in found["text"]


def test_the_end_shut_in_may_be_a_pocket_with_a_hole() -> None:
    ring = shapely.Point(7.0, 3.0).buffer(2.5).difference(shapely.Point(7.0, 3.0).buffer(2.2))
    bars = tuple(
        Rectangle((7.0 + 2.4 * np.cos(a), 3.0 + 2.4 * np.sin(a)), 0.2, 0.8, float(a))
        for a in np.linspace(-np.pi, np.pi, 24, endpoint=False)
    )
    world = World("pocket", (0.0, 0.0, 10.0, 6.0), (*bars, Disc((7.0, 3.0), 0.5)))
    found = reach_data(LandmarkPlanner(world, Robot.disc(0.2)), START, np.array([8.0, 3.0, 0.0]), infeasible=True)
    assert found["end"] == "goal"
    reached = region(found["rings"])
    assert len(reached.interiors) == 1
    assert not reached.intersects(ring)


@pytest.mark.slow
def test_headings_prove_what_a_disc_does_not() -> None:
    # A turn at a right angle: the disc inside the long robot passes, the robot does not.
    walls = (Rectangle((3.0, 3.5), 6.0, 5.0), Rectangle((8.5, 3.0), 3.0, 6.0))
    world = World("corner", (0.0, 0.0, 10.0, 6.0), walls)
    planner = LandmarkPlanner(world, Robot.rectangle(3.0, 0.5))
    start, goal = np.array([2.0, 0.5, 0.0]), np.array([6.5, 4.0, 0.5 * np.pi])
    found = reach_data(planner, start, goal, infeasible=True, seconds=60.0)
    assert found["proof"] == "headings"
    boxes = np.array(found["boxes"]).reshape(-1, 5)
    assert (boxes[:, 4] > 0.0).all()
    assert (boxes[:, 4] <= 1.0).all()
    q = {"start": start, "goal": goal}[found["end"]]
    assert ((boxes[:, :2] <= q[:2]) & (q[:2] <= boxes[:, 2:4])).all(axis=1).any()
    # Nobody who has stopped is told of a proof.
    assert reach_data(planner, start, goal, infeasible=True, stop=lambda: True)["proof"] is None


def test_where_there_is_a_way_the_disc_gets_all_over() -> None:
    found = reach_data(LandmarkPlanner(rooms(1.0), Robot.disc(0.4)), START, GOAL)
    assert found["proof"] is None
    assert region(found["rings"]).covers(shapely.Point(GOAL[:2]))
