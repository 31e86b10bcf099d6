"""Bhardwaj's eight families of pictures: gaps, forests, bug traps and mazes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from trailmark.benchmark.public.base import Found, PublicSuite, files_below
from trailmark.errors import FormatError
from trailmark.formats.nav2_map import read_image
from trailmark.world import Query, Robot, World

__all__ = ["Families"]

SIZE = 201
"""Pixels a side; a pixel is one metre."""

RADIUS = 0.4
"""Metres: the pictures are planned on from pixel to pixel, and a pixel holds this robot."""

PIXELS = {"resolution": 1.0, "origin": [0.0, 0.0, 0.0], "occupied_thresh": 0.5, "free_thresh": 0.5}
"""Brighter than half is free, as ``planning_python`` reads them."""

START, GOAL = (0.5, 0.5, 0.0), (SIZE - 0.5, SIZE - 0.5, 0.0)
"""The middles of pixels (0, 0) and (200, 200), the ends in the authors' ``SaIL/examples``."""


class Families(PublicSuite):
    """From the lower left pixel of every picture to the upper right one."""

    name = "families"
    contents = "alternating_gaps, forest, mazes, bug traps and others: 201 x 201 pictures, corner to corner"
    published = "github.com/mohakbhardwaj/motion_planning_datasets; M. Bhardwaj et al., CoRL 2017"
    robot = f"disc of {RADIUS:g} m, a pixel being 1 m"
    expected = "pictures of 201 x 201 pixels (.png)"

    def find(self, folder: Path) -> Found:
        """Return a problem for each picture."""
        return Found([(file, 0) for file in files_below(folder, ".png")])

    def world(self, folder: Path, file: Path, numbers: Sequence[int], robot: Robot | None) -> World:
        """Return the picture's world, named by family, part and number."""
        made = read_image(file, PIXELS)
        if made.bounds[2:] != (SIZE, SIZE):
            raise FormatError(file, f"expected {SIZE} x {SIZE} pixels, got {made.bounds[2]:g} x {made.bounds[3]:g}")
        name = "-".join(file.absolute().parts[-3:-1]) + f"-{file.stem}"
        return replace(made, name=name, robot=robot or Robot.disc(RADIUS), queries=(Query("across", START, GOAL),))
