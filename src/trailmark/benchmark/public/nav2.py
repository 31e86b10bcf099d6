"""nav2's planner benchmark and any nav2 maps: random ends, as nav2's planner benchmark draws them."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from trailmark.benchmark.errors import SuiteError
from trailmark.benchmark.public.base import Found, PublicSuite, files_below
from trailmark.errors import FormatError
from trailmark.formats.files import read_text
from trailmark.formats.nav2_map import read_grid
from trailmark.formats.yaml_data import parse_yaml
from trailmark.world import Query, Robot, World

__all__ = ["NAV2", "Places", "is_map"]

SEED = 33
"""Of Python's ``random``, as the tool has it."""

MAX_COST, SCALING = 210, 3.0
"""Costs from which on an end is refused, of 0 to 255; nav2's default ``cost_scaling_factor``, per metre."""

BUFFER, SHARE = 100, 20
"""Cells beside the map's sides in which no end lies: 100, and on maps below 2,000 cells a twentieth of their size."""

APART, PART = 3.0, 0.25
"""Metres that two ends are apart at least; on small maps a part of their diagonal."""

CELLS, TRIES = 5_000, 1_000
"""Cells that are drawn for one end, and pairs that are drawn in vain, at most."""

Pose = tuple[float, float, float]

MASKS = ("keepout", "speed", "mask")
"""In the names of maps that are no maps of obstacles: nav2's costmap filters."""


class Places:
    """Where ends may lie on a map.

    An end is drawn from the cells below ``MAX_COST`` of a costmap with nav2's default inflation around a robot of a
    given radius: farther than the radius and ``ln(252 / 210) / 3`` m from what is not free, cell to cell. It is the
    middle of its cell.

    Args:
        file: the map's YAML.
        robot: its radius is that of a disc, else that of the disc around the robot, with which each heading is valid.

    Raises:
        FormatError: no nav2 map.
    """

    def __init__(self, file: Path, robot: Robot) -> None:
        from scipy import ndimage

        data = parse_yaml(read_text(file), file)
        if not isinstance(data, dict):
            raise FormatError(file, "expected a nav2 map's YAML, got no mapping")
        free, fields = read_grid(data, file)
        self._file, self._origin, self._cell = file, fields.origin, fields.resolution
        apart = self._cell * ndimage.distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1]
        self._open = apart > robot.circumradius + math.log(252.0 / MAX_COST) / SCALING
        self._part = ndimage.label(apart > robot.circumradius, np.ones((3, 3)))[0]
        rows, columns = free.shape
        self._buffer = min(BUFFER, rows // SHARE, columns // SHARE)
        self._apart = min(APART, PART * self._cell * math.hypot(rows, columns))

    def pairs(self, count: int) -> list[tuple[Pose, Pose]]:
        """Return start and goal of ``count`` problems.

        Pairs that no free cells join are drawn anew, as the tool draws anew where a planner finds no path.

        Raises:
            SuiteError: the map has no room for them.
        """
        rng = random.Random(SEED)  # noqa: S311  # the published sequence
        found: list[tuple[Pose, Pose]] = []
        for _ in range(count + TRIES if self._open.any() else 0):
            if len(found) == count:
                return found
            first = next(self._cells(rng), None)
            if first is None:
                continue
            begin = self._pose(first, rng)
            last = next((c for c in self._cells(rng) if self._cell * math.dist(first, c) > self._apart), None)
            if last is None:  # amid a small map all is near
                continue
            end = self._pose(last, rng)
            if self._part[first] == self._part[last]:
                found.append((begin, end))
        raise SuiteError(f"{self._file}: expected room for {count} pairs of ends, got {len(found)}")

    def _cells(self, rng: random.Random) -> Iterator[tuple[int, int]]:
        """Yield cells in which an end may lie, of those that are drawn for one."""
        rows, columns = self._open.shape
        for _ in range(CELLS):
            # As in the tool, both ends of the range count.
            cell = rng.randint(self._buffer, rows - self._buffer), rng.randint(self._buffer, columns - self._buffer)
            if cell[0] < rows and cell[1] < columns and self._open[cell]:
                yield cell

    def _pose(self, cell: tuple[int, int], rng: random.Random) -> Pose:
        x0, y0, yaw = self._origin
        x, y = (cell[1] + 0.5) * self._cell, (cell[0] + 0.5) * self._cell
        cos, sin = math.cos(yaw), math.sin(yaw)
        return x0 + cos * x - sin * y, y0 + sin * x + cos * y, rng.uniform(0, 1) * 2.0 * math.pi


def is_map(file: Path) -> bool:
    """Return whether a YAML file is a nav2 map of obstacles, no mask of zones, parameters or anything else."""
    if any(word in file.stem.lower() for word in MASKS):
        return False
    try:
        data = parse_yaml(read_text(file), file)
    except FormatError:  # launch files and parameters with tags of their own
        return False
    return isinstance(data, dict) and "image" in data and "resolution" in data


RADIUS = 0.22
"""Metres: ``robot_radius`` of nav2's default parameters."""

PAIRS = 100
"""Problems of each map."""


def _found(folder: Path) -> Found:
    maps = [file for file in files_below(folder, ".yaml", ".yml") if is_map(file)]
    return Found([(file, i) for file in maps for i in range(PAIRS)])


def _world(_: Path, file: Path, numbers: Sequence[int], given: Robot | None) -> World:
    robot = given or Robot.disc(RADIUS)
    made = World.load(file)  # refuses maps that are none
    pairs = Places(file, robot).pairs(max(numbers) + 1)
    return replace(made, robot=robot, queries=tuple(Query(f"pair-{i}", *pairs[i]) for i in numbers))


NAV2 = PublicSuite(
    name="nav2",
    contents=f"the planner benchmark's 100by100_10, _15, _20, or any nav2 maps: {PAIRS} random pairs each, seed {SEED}",
    published="github.com/ros-navigation/navigation2, tools/planner_benchmarking (metrics.py)",
    robot=f"disc of {RADIUS:g} m, nav2's default robot_radius",
    expected="nav2 maps (.yaml files that name an image)",
    find=_found,
    world=_world,
)
