"""Why there is no path: which end, what it overlaps, where the robot is shut in, and what ended the search."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from trailmark import Goal, KeepOutZone, LandmarkPlanner, Path, PlanResult, Rectangle, Robot, World

START, BEHIND = (1.0, 1.0, 0.0), (9.0, 1.0, 0.0)
RECTANGLE = Robot.rectangle(0.6, 0.4)
ROBOTS = {
    "disc": Robot.disc(0.3),
    "rectangle": RECTANGLE,
    "differential": RECTANGLE.differential(),
    "car": RECTANGLE.steered(0.5),
    "L": Robot.polygon(np.array([(-0.2, -0.2), (0.6, -0.2), (0.6, 0.0), (0.0, 0.0), (0.0, 0.6), (-0.2, 0.6)])),
    "ahead": Robot.polygon(np.array([(0.1, -0.2), (0.7, -0.2), (0.7, 0.2), (0.1, 0.2)])),
}
SQUARE = [(4.0, 2.0), (8.0, 2.0), (8.0, 6.0), (4.0, 6.0)]
ZONE = World("zone", (0.0, 0.0, 12.0, 8.0), (), zones=(KeepOutZone(SQUARE),))  # type: ignore[arg-type]  # vertices
BLOCK = World("block", (0.0, 0.0, 12.0, 8.0), (Rectangle((6.0, 4.0), 4.0, 4.0),))
SPLIT = World("split", (0.0, 0.0, 12.0, 8.0), (Rectangle((5.5, 4.0), 1.0, 8.0),))


def planned(world: World, robot: Robot, goal: Any, start: Any = START, clearance: float | None = None) -> PlanResult:
    """Return what a round of landmarks comes to, with time to spare: what is said depends on no clock."""
    return LandmarkPlanner(world, robot, seed=0, clearance=clearance).plan(start, goal, 60.0, max_iterations=1)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize(
    ("world", "goal", "fault"),
    [
        (SPLIT, Goal((5.5, 1.0)), r"overlaps obstacle 0 \(rectangle\) by"),
        (SPLIT, Goal((15.5, 1.0)), "reaches .* over the right bound"),
        (ZONE, Goal((6.0, 4.0, 0.0), position_tolerance=0.5), "overlaps keep-out zone 0 by"),
        (BLOCK, Goal(region=[(5, 3), (7, 3), (7, 5), (5, 5)]), r"overlaps obstacle 0 \(rectangle\) by"),
        (BLOCK, Goal((6.0, 4.0, 0.0), position_tolerance=0.2, heading_tolerance=1.0), "overlaps obstacle 0"),
    ],
)
def test_a_goal_that_is_free_nowhere_is_proven_so_and_says_what_is_there(
    robot: str, world: World, goal: Goal, fault: str
) -> None:
    result = planned(world, ROBOTS[robot], goal)
    assert result.status == "infeasible"
    assert re.search(f"the goal is free nowhere.*{fault}", result.reason)
    assert result.to_dict("w")["reason"] == result.reason
    depth = re.search(r"(\S+) m\b", result.reason)
    assert depth
    assert 0.1 < float(depth[1]) < 4.0


def test_a_sliver_of_a_goal_that_is_free_is_no_proof() -> None:
    world = World("sliver", (0.0, 0.0, 12.0, 8.0), (Rectangle((6.0, 4.0), 4.0, 4.0),))
    # The disc is free beside the block by 0.1 mm, on the goal's right edge alone.
    goal = Goal(region=[(5, 3), (8.2501, 3), (8.2501, 5), (5, 5)])
    result = planned(world, Robot.disc(0.25), goal)
    assert result.status != "infeasible"
    assert result.path is None or goal.contains(result.path.states[-1])


def test_many_queries_and_replanning_say_why() -> None:
    planner = LandmarkPlanner(SPLIT, RECTANGLE, seed=0)
    free, shut = planner.plan_many([START, START], [(3.0, 6.0, 1.0), BEHIND], 0.5)
    assert (free.status, free.reason) == ("solved", "")
    assert (shut.status, shut.reason[:22]) == ("infeasible", "shut in at the start: ")
    stopped = planner.plan_many([START], [BEHIND], 0.5, stop=lambda: True)[0]
    assert (stopped.status, "before this one's turn" in stopped.reason) == ("timeout", True)
    old = Path(np.array([START, BEHIND]))
    for goal in (BEHIND, Goal((9.0, 1.0)), Goal((5.5, 1.0))):
        replanned = planner.replan(START, goal, old, 0.5)
        assert replanned.status == "infeasible"
        assert ("free nowhere" if goal == Goal((5.5, 1.0)) else "shut in at the start") in replanned.reason
