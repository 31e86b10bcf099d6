"""BARN: 300 fields of cylinders for the Jackal, as the BARN challenge drives them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from trailmark.benchmark.public.base import Found, PublicSuite, files_below
from trailmark.formats.gazebo import read_gazebo_shapes
from trailmark.world import Query, Robot, World

__all__ = ["Barn"]

LENGTH, WIDTH = 0.508, 0.43
"""Of the Jackal, metres."""

START = (-2.0, 3.0, 1.57)
GOAL = (-2.0, 13.0, 1.57)
"""The challenge's ``run.py``: INIT_POSITION, and GOAL_POSITION 10 m ahead of it."""

MARGIN = 1.0
"""Metres of free space around obstacles and ends: the goal lies beyond the field."""


class Barn(PublicSuite):
    """Every ``.world`` file."""

    name = "barn"
    contents = "300 fields of cylinders of 0.075 m radius in Gazebo worlds, from open to dense; one query each"
    published = "github.com/Daffan/the-barn-challenge, jackal_helper/worlds/BARN; D. Perille et al., SSRR 2020"
    robot = f"the Jackal, {LENGTH:g} x {WIDTH:g} m"
    expected = "BARN's .world files"

    def find(self, folder: Path) -> Found:
        """Return a problem for each ``.world``."""
        return Found([(file, 0) for file in files_below(folder, ".world")])

    def world(self, folder: Path, file: Path, numbers: Sequence[int], robot: Robot | None) -> World:
        """Return the field, with room around it."""
        shapes = read_gazebo_shapes(file)
        boxes = np.array([*(shape.bounding_box() for shape in shapes), (*START[:2], *GOAL[:2])])
        low, high = boxes[:, :2].min(axis=0) - MARGIN, boxes[:, 2:].max(axis=0) + MARGIN
        return World(
            name=f"barn-{file.stem}",
            bounds=(float(low[0]), float(low[1]), float(high[0]), float(high[1])),
            obstacles=shapes,
            robot=robot or Robot.rectangle(LENGTH, WIDTH),
            queries=(Query("ahead", START, GOAL),),
            sources=(file.absolute(),),
        )
