"""OMPL.app's problems in the plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from trailmark.benchmark.public.base import Found, PublicSuite, files_below
from trailmark.errors import FormatError
from trailmark.formats import load_world
from trailmark.formats.files import read_text
from trailmark.world import Robot, World

__all__ = ["OmplApp"]


class OmplApp(PublicSuite):
    """Every ``.cfg`` in the plane whose robot moves in every direction."""

    name = "omplapp"
    contents = "Maze, BugTrap, RandomPolygons and others: a robot's mesh amid a world's mesh, one query each"
    published = "github.com/ompl/omplapp, resources/2D"
    robot = "each problem's own"
    expected = ".cfg files of problems in the plane, with their meshes beside them"

    def find(self, folder: Path) -> Found:
        """Return a problem for each ``.cfg`` that is one in the plane."""
        problems, left_out = [], []
        for file in files_below(folder, ".cfg"):
            keys = {line.partition("=")[0].strip().lower() for line in read_text(file).splitlines()}
            if "start.theta" not in keys or "start.z" in keys:
                left_out.append(f"{file}: a problem in space")
            elif "control" in keys:
                left_out.append(f"{file}: a problem for planners with controls")
            else:
                problems.append((file, 0))
        return Found(problems, left_out)

    def world(self, folder: Path, file: Path, numbers: Sequence[int], robot: Robot | None) -> World:
        """Return the problem under its file's name, for several share one."""
        made = load_world(file)
        if made.robot is None:
            raise FormatError(file, "expected a robot's mesh, got none")
        return replace(made, name=file.stem, robot=robot or made.robot)
