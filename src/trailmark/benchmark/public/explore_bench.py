"""Explore-Bench's maps: what its robot has to drive through, from where it begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from trailmark.benchmark.public.base import Found, PublicSuite, files_below
from trailmark.benchmark.public.nav2_pairs import Places, is_map
from trailmark.formats import load_world
from trailmark.world import Query, Robot, World

__all__ = ["ExploreBench"]

GOALS = 10
"""A map."""

START = (8.0, 8.0, 1.57)
"""Of the single robot in its launch files; metres, radians."""

BURGER = ((-0.105, -0.105), (0.041, -0.105), (0.041, 0.105), (-0.105, 0.105))
"""Footprint of the TurtleBot3 Burger in ``turtlebot3_navigation``, metres."""


class ExploreBench(PublicSuite):
    """Ten random goals on every map; the set itself is for exploration and has none."""

    name = "explore-bench"
    contents = "loop, corridor, corner, room and their combinations: from the published start to 10 random goals each"
    published = "github.com/efc-robot/Explore-Bench, exploration_benchmark/blueprints; Y. Xu et al., ICRA 2022"
    robot = "TurtleBot3 Burger, 0.146 x 0.21 m"
    expected = "Explore-Bench's maps (.yaml files that name an image)"

    def find(self, folder: Path) -> Found:
        """Return ten problems for each map."""
        maps = [file for file in files_below(folder, ".yaml", ".yml") if is_map(file)]
        return Found([(file, i) for file in maps for i in range(GOALS)])

    def world(self, folder: Path, file: Path, numbers: Sequence[int], robot: Robot | None) -> World:
        """Return the map with the start and goals for the robot."""
        robot = robot or Robot.polygon(BURGER)
        made = load_world(file)  # refuses maps that are none
        pairs = Places(file, robot).pairs(max(numbers) + 1, START)
        return replace(made, robot=robot, queries=tuple(Query(f"goal-{i}", *pairs[i]) for i in numbers))
