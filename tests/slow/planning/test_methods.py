"""Planning methods and stages by name: each plans, with every kind of robot; wrong names are refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from trailmark import ConfigurationError, LandmarkPlanner, PlannerSettings, PlanResult, Rectangle, Robot, World
from trailmark.planning.incumbent import GAP
from trailmark.planning.settings import METHODS, STAGES

WALLS = (Rectangle((4.0, 1.5), 0.5, 3.0), Rectangle((8.0, 4.5), 0.5, 3.0))
WORLD = World("two-walls", (0, 0, 12, 6), WALLS)
START, GOAL = (1.0, 1.0, 0.0), (11.0, 5.0, 0.0)
ROBOTS = {
    "disc": Robot.disc(0.3),
    "rectangle": Robot.rectangle(0.8, 0.4),
    "car": Robot.rectangle(0.8, 0.4).steered(0.6),
    "dubins": Robot.rectangle(0.8, 0.4).steered(0.6, reverse=False),
}


def plan(robot: str, settings: PlannerSettings, rounds: int = 6, gap: float = GAP) -> PlanResult:
    planner = LandmarkPlanner(WORLD, ROBOTS[robot], seed=1, settings=settings)
    return planner.plan(START, GOAL, 60.0, max_iterations=rounds, gap=gap)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("method", [name for name in METHODS if name != "lattice"])
def test_every_method_finds_a_path(method: str, robot: str) -> None:
    # How paths are improved afterwards is a matter of the stages below.
    result = plan(robot, METHODS[method], rounds=4, gap=np.inf)
    # It ends where it should, and goes through both gaps.
    assert np.allclose(result.path.states[[0, -1]], [START, GOAL])
    states = result.path.resample(0.05).states
    assert states[np.argmin(np.abs(states[:, 0] - 4.0)), 1] > 3.0
    assert states[np.argmin(np.abs(states[:, 0] - 8.0)), 1] < 3.0


TAKING_PART = {
    # Discs have a path of their own before any lattice, and cars go without lattices.
    "rectangle": [name for name in STAGES if name not in ("disc-path", "hybrid-astar")],
    "disc": ["disc-path", "lattice", "shortening", "improvement"],
    "car": ["bands", "bridges", "hybrid-astar", "background-proof", "shortening", "improvement"],
}
"""Stages that have a part in planning for a robot."""


@pytest.mark.parametrize(("robot", "stage"), [(robot, name) for robot, names in TAKING_PART.items() for name in names])
def test_the_planner_does_without_any_one_stage(stage: str, robot: str) -> None:
    settings = PlannerSettings(without=(stage,), sweeps=5, first_sweeps=2, patience=1)
    assert plan(robot, settings, rounds=2).status == "solved"


@pytest.mark.parametrize(
    ("wrong", "match"),
    [
        ({"without": ("latice",)}, "without: expected .*lattice.*, got 'latice' .did you mean 'lattice'"),
        ({"without": (3,)}, "without"),
        ({"without": "lattice"}, "without"),
        ({"placement": "kmeans"}, "placement: expected k-means, none, paper, samples, got 'kmeans'"),
        ({"placement": None}, "placement"),
    ],
)
def test_wrong_names_are_refused(wrong: dict[str, Any], match: str) -> None:
    with pytest.raises(ConfigurationError, match=match):
        PlannerSettings(**wrong)
