"""Worlds in grades: as hard as they say, and the same each time."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest
import shapely

from trailmark.benchmark.errors import SuiteError
from trailmark.benchmark.public import PUBLIC
from trailmark.benchmark.public.graded import CLUTTER, SPARE
from trailmark.world import Robot, World


def worlds(name: str, count: int | None = None, robot: Robot | None = None) -> list[World]:
    suite = PUBLIC[name]
    return list(suite.worlds(Path(), suite.find(Path()), count, robot))


@pytest.mark.slow
def test_clutter_grows_from_grade_to_grade() -> None:
    made = worlds("clutter", 12)
    assert [len(world.obstacles) for world in made] == [grade for grade in CLUTTER for _ in range(2)]
    assert len({world.name for world in made}) == len(made)
    # What is made again is the same.
    suite = PUBLIC["clutter"]
    assert made[:4] == list(itertools.islice(suite.worlds(Path(), suite.find(Path()), 12, None), 4))


def test_passages_are_as_much_wider_than_the_robot_as_they_say() -> None:
    made = worlds("passages", 6)
    assert [world.name.split("-")[1] for world in made] == [f"{spare:g}" for spare in SPARE]
    for world, spare in zip(made, SPARE, strict=True):
        below, above = (shape.polygon().shapely() for shape in world.obstacles[:2])
        # Across the slit, whatever its tilt: the width of the robot and what is spare.
        assert shapely.distance(below, above) == pytest.approx(0.6 + spare)


@pytest.mark.slow
def test_a_robot_without_room_is_told_in_one_line() -> None:
    with pytest.raises(SuiteError, match="expected room for the robot near two corners, got none"):
        worlds("clutter", 1, Robot.disc(40.0))
