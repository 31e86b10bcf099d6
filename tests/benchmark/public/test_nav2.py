"""nav2's pairs, against its tool's own loop over a costmap made cell by cell."""

from __future__ import annotations

import math
import random
from pathlib import Path

import numpy as np
import pytest

from trailmark.benchmark.errors import SuiteError
from trailmark.benchmark.public.catalogue import PUBLIC
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


def costs(blocked: np.ndarray) -> np.ndarray:
    """nav2_costmap_2d's InflationLayer::computeCost, for every cell from every blocked one."""
    found = np.zeros(blocked.shape, dtype=np.uint8)
    rows, columns = np.indices(blocked.shape)
    nearest = np.full(blocked.shape, np.inf)
    for row, column in np.argwhere(blocked):
        nearest = np.minimum(nearest, 0.05 * np.hypot(rows - row, columns - column))
    found[nearest <= 0.7] = (252 * np.exp(-3.0 * (nearest[nearest <= 0.7] - RADIUS))).clip(0, 252).astype(np.uint8)
    found[nearest <= RADIUS] = 253
    found[blocked] = 254
    return found


@pytest.mark.slow
def test_pairs_are_those_of_the_tool(tmp_path: Path) -> None:
    blocked = room()
    costmap = costs(blocked)
    found = Places(write_map(tmp_path, blocked), Robot.disc(RADIUS)).pairs(20)
    # metrics.py: getRandomStart and getRandomGoal, on a map whose sides are a tenth of theirs.
    rng = random.Random(33)  # noqa: S311  # the published sequence
    side = 200 // 20
    pairs: list[tuple[tuple[float, ...], tuple[float, ...]]] = []
    while len(pairs) < 20:
        while True:
            row, col = rng.randint(side, 200 - side), rng.randint(side, 240 - side)
            if costmap[row, col] < 210:
                start = (col, row, rng.uniform(0, 1) * 2 * math.pi)
                break
        while True:
            row, col = rng.randint(side, 200 - side), rng.randint(side, 240 - side)
            apart = math.hypot(col * 0.05 - start[0] * 0.05, row * 0.05 - start[1] * 0.05)
            if costmap[row, col] < 210 and apart > 3.0:
                goal = (col, row, rng.uniform(0, 1) * 2 * math.pi)
                break
        pairs.append((start, goal))
    wanted = [[(1.0 + 0.05 * (c + 0.5), -2.0 + 0.05 * (r + 0.5), yaw) for c, r, yaw in pair] for pair in pairs]
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-12)


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
