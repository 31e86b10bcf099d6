"""Bench-MR's mazes: the units of both versions, the published ends, the robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from trailmark.benchmark.errors import SuiteError
from trailmark.benchmark.public import PUBLIC
from trailmark.world import Robot, World

CAR = "m 0,0 0,94 54,0 0,-94 z"
"""As first drawn: 22 to the metre, its length along y."""


def write(folder: Path, name: str, *lines: str) -> None:
    paths = "".join(f'<path d="{line}"/>' for line in lines)
    (folder / f"{name}.svg").write_text(f'<svg xmlns="http://www.w3.org/2000/svg">{paths}</svg>')


def maze(folder: Path, unit: float, x: float, y: float) -> World:
    """Two blocks about the published ends of parking3, whose drawing begins at (153.3, 111.7) of its first units."""
    far = 153.30823 / 22.0, 111.71665 / 22.0
    square = [f"m {unit * (far[0] + x)},{unit * (far[1] + y)} {unit},0 0,{unit} {-unit},0 z"]
    square += [f"m {unit * (x - 12)},{unit * (y - 12)} {unit},0 0,{unit} {-unit},0 z"]
    square += [f"m {unit * (x + 28)},{unit * (y + 17)} {unit},0 0,{unit} {-unit},0 z"]
    write(folder, "parking3", *square)
    suite = PUBLIC["bench-mr"]
    (world,) = suite.worlds(folder, suite.find(folder), 3, None)
    return world


@pytest.mark.parametrize(("unit", "x", "y"), [(22.0, 0.0, 0.0), (1.0, 200.0, -40.0)], ids=["units", "metres"])
def test_published_ends_in_both_versions(unit: float, x: float, y: float, tmp_path: Path) -> None:
    write(tmp_path, "car", CAR)
    world = maze(tmp_path, unit, x, y)
    suite = PUBLIC["bench-mr"]
    (all_ten,) = suite.worlds(tmp_path, suite.find(tmp_path), None, None)
    # benchmarks/parking3.json: from (15.45, -2.27) to (3.82, 0.34); a drawing's y points down.
    start, goal = all_ten.queries[0].start, all_ten.queries[0].goal
    assert np.array(start) == pytest.approx((15.45 + x, -2.27 - y, 0.0), abs=1e-3)
    assert np.array(goal) == pytest.approx((3.82 + x, 0.34 - y, 0.0), abs=1e-3)
    assert len(all_ten.queries) == 10
    assert [query.name for query in world.queries] == ["pair-1", "pair-5", "pair-8"]
    assert len(world.obstacles) == 3
    assert world.obstacles[0].area == pytest.approx(1.0)


@pytest.mark.slow
def test_the_robot_is_the_drawn_one_with_its_length_ahead(tmp_path: Path) -> None:
    write(tmp_path, "car", CAR)
    world = maze(tmp_path, 22.0, 0.0, 0.0)
    assert world.robot is not None
    low, high = world.robot.outline.vertices.min(axis=0), world.robot.outline.vertices.max(axis=0)
    assert high - low == pytest.approx((94 / 22, 54 / 22))
    assert low == pytest.approx(-high)
    assert world.robot.turning_radius == 4.0


def test_without_a_robot(tmp_path: Path) -> None:
    with pytest.raises(SuiteError, match=r"expected car\.svg beside Bench-MR's mazes, got none"):
        maze(tmp_path, 22.0, 0.0, 0.0)
    suite = PUBLIC["bench-mr"]
    (world,) = suite.worlds(tmp_path, suite.find(tmp_path), 1, Robot.disc(0.5))
    assert world.robot == Robot.disc(0.5)
