"""nav2's pairs: drawn where there is room, and joined by free cells."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from trailmark.benchmark.errors import SuiteError
from trailmark.benchmark.public import PUBLIC
from trailmark.benchmark.public.nav2 import START, Places, is_map
from trailmark.world import Robot

RADIUS = 0.22


def write_map(folder: Path, blocked: np.ndarray, name: str = "room") -> Path:
    """Write cells of 5 cm, row 0 with the smallest y, as a nav2 map."""
    rows, columns = blocked.shape
    pixels = np.where(blocked[::-1], 0, 254).astype(np.uint8)
    (folder / f"{name}.pgm").write_bytes(f"P5\n{columns} {rows}\n255\n".encode() + pixels.tobytes())
    file = folder / f"{name}.yaml"
    file.write_text(f"image: {name}.pgm\nresolution: 0.05\norigin: [1.0, -2.0, 0.0]\n")
    return file


def room() -> np.ndarray:
    blocked = np.zeros((200, 240), dtype=bool)
    blocked[60:140, 100:104] = True
    blocked[20:24, 180:200] = True
    return blocked


def test_pairs_that_nothing_joins_are_drawn_anew(tmp_path: Path) -> None:
    blocked = room()
    blocked[:, 120:124] = True
    for start, goal in Places(write_map(tmp_path, blocked), Robot.disc(RADIUS)).pairs(10):
        assert (start[0] < 7.0) == (goal[0] < 7.0)


def test_a_map_without_room_is_told_in_one_line(tmp_path: Path) -> None:
    file = write_map(tmp_path, np.ones((60, 60), dtype=bool))
    with pytest.raises(SuiteError, match="expected room for 2 pairs of ends, got 0"):
        Places(file, Robot.disc(RADIUS)).pairs(2)


def test_masks_and_parameters_are_no_maps(tmp_path: Path) -> None:
    assert is_map(write_map(tmp_path, room()))
    assert not is_map(write_map(tmp_path, room(), "depot_keepout"))
    (tmp_path / "params.yaml").write_text("planner_server: {}\n")
    assert not is_map(tmp_path / "params.yaml")
    (tmp_path / "launch.yaml").write_text("a: !tag b\n")
    assert not is_map(tmp_path / "launch.yaml")


def test_a_larger_robot_keeps_farther_away(tmp_path: Path) -> None:
    file = write_map(tmp_path, room())
    suite, robot = PUBLIC["nav2"], Robot.rectangle(1.0, 0.6)
    world = suite.world(tmp_path, file, range(100), robot)
    assert world.robot == robot
    assert [query.name for query in world.queries[:2]] == ["pair-0", "pair-1"]


def test_explore_bench_begins_at_its_own_start(tmp_path: Path) -> None:
    blocked = np.zeros((300, 300), dtype=bool)
    world = PUBLIC["explore-bench"].world(tmp_path, write_map(tmp_path, blocked), [0, 3], None)
    assert [query.start for query in world.queries] == [START, START]
    assert [query.name for query in world.queries] == ["goal-0", "goal-3"]
