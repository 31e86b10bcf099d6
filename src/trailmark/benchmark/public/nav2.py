"""nav2's planner benchmark, and any nav2 maps with random ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from trailmark.benchmark.public.base import Found, PublicSuite, files_below
from trailmark.benchmark.public.nav2_pairs import Places, is_map
from trailmark.formats import load_world
from trailmark.world import Query, Robot, World

__all__ = ["Nav2"]

PAIRS = 100
"""A map, as the tool draws them."""

RADIUS = 0.22
"""Metres: ``robot_radius`` of nav2's default parameters."""


class Nav2(PublicSuite):
    """A hundred random pairs on every map."""

    name = "nav2"
    contents = "the planner benchmark's 100by100_10, _15, _20, or any nav2 maps: 100 random pairs each, seed 33"
    published = "github.com/ros-navigation/navigation2, tools/planner_benchmarking (metrics.py)"
    robot = f"disc of {RADIUS:g} m, nav2's default robot_radius"
    expected = "nav2 maps (.yaml files that name an image)"

    def find(self, folder: Path) -> Found:
        """Return a hundred problems for each map that is no mask."""
        maps = [file for file in files_below(folder, ".yaml", ".yml") if is_map(file)]
        return Found([(file, i) for file in maps for i in range(PAIRS)])

    def world(self, folder: Path, file: Path, numbers: Sequence[int], robot: Robot | None) -> World:
        """Return the map with pairs of ends for the robot."""
        robot = robot or Robot.disc(RADIUS)
        made = load_world(file)  # refuses maps that are none
        pairs = Places(file, robot).pairs(max(numbers) + 1)
        return replace(made, robot=robot, queries=tuple(Query(f"pair-{i}", *pairs[i]) for i in numbers))
