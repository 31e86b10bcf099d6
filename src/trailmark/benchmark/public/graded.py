"""Worlds made in grades of difficulty: more and more obstacles, and passages less and less wider than the robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from trailmark.benchmark.errors import SuiteError
from trailmark.benchmark.public.base import Found, PublicSuite
from trailmark.benchmark.public.made_worlds import corner_ends, passage_world, random_world
from trailmark.world import Query, Robot, World

__all__ = ["Clutter", "Passages"]

SEEDS = 10
"""Worlds of each grade."""

CLUTTER = (25, 50, 100, 200, 350, 500)
"""Obstacles on 100 x 100 m."""

SPARE = (1.0, 0.5, 0.25, 0.1, 0.05, 0.02)
"""Metres by which a passage is wider than the robot."""


class Clutter(PublicSuite):
    """Random polygons from corner to corner; whether there is a path, nobody says."""

    name = "clutter"
    contents = (
        f"random polygons on 100 x 100 m, corner to corner: {', '.join(map(str, CLUTTER))} of them, 10 worlds each"
    )
    published = ""
    robot = "rectangle of 2 x 1 m"
    expected = "nothing"

    def find(self, folder: Path) -> Found:
        """Return ten problems for each grade."""
        return _grades(CLUTTER)

    def world(self, folder: Path, file: Path, numbers: Sequence[int], robot: Robot | None) -> World:
        """Return a world with ends for the robot.

        Raises:
            SuiteError: the robot finds no room near a corner.
        """
        grade, (seed,) = int(file.name), numbers
        made = replace(random_world(1000 * grade + seed, grade), robot=robot or Robot.rectangle(2.0, 1.0))
        ends = corner_ends(made, np.random.default_rng(seed))
        if ends is None:
            raise SuiteError(f"world {made.name!r}: expected room for the robot near two corners, got none")
        return replace(made, queries=(Query("corner", *ends),))


class Passages(PublicSuite):
    """Rooms in a row: there is always a path for the robot that they are made for."""

    name = "passages"
    contents = f"four rooms in a row, slits wider than the robot by {', '.join(map(str, SPARE))} m, 10 worlds each"
    published = ""
    robot = "rectangle of 1.2 x 0.6 m"
    expected = "nothing"

    def find(self, folder: Path) -> Found:
        """Return ten problems for each grade."""
        return _grades(SPARE)

    def world(self, folder: Path, file: Path, numbers: Sequence[int], robot: Robot | None) -> World:
        """Return a world whose slits are all as much wider than the robot."""
        spare, (seed,) = float(file.name), numbers
        made = passage_world(seed, spare=(spare, spare))
        return replace(made, name=f"passages-{spare:g}-{seed}", robot=robot or made.robot)


def _grades(grades: Sequence[float]) -> Found:
    """Return a problem for each world, each under a name of its own: no two are queries of one world."""
    return Found([(Path(str(seed)) / str(grade), seed) for grade in grades for seed in range(SEEDS)])
