"""A cell that counts as blocked holds no valid configuration."""

from __future__ import annotations

import numpy as np
import pytest
from tests.helpers.oracle import Oracle
from tests.helpers.random_worlds import ROBOTS, random_world
from tests.support.trials import few

from trailmark.collision import StateChecker
from trailmark.planning.proofs.cell_kinds import kind_of, room_for_cores
from trailmark.planning.proofs.cells import BLOCKED, COLUMNS
from trailmark.planning.proofs.enclosure import Space

FINEST = 9


@pytest.mark.slow
@pytest.mark.parametrize("name", ["L", "offset", "star", "thin"])
def test_nothing_in_a_blocked_cell_is_valid(name: str) -> None:
    robot = ROBOTS[name]
    world = random_world(5, 25, size=20.0, radii=(0.3, 3.0), discs=0.3, holes=0.2, boundary=True, origin=(-7.0, 3.0))
    space = Space(StateChecker(world, robot))
    division = space.division(FINEST, 0.1)
    rng, placed = np.random.default_rng(0), room_for_cores(division)
    inside = []
    # Of the thin robot a cell takes ten times as long.
    count = few(200, of=4) if name == "thin" else 200
    for level in range(FINEST + 1):
        half, headings = division.half[level], 1 << division.turns[level]
        cells = np.zeros((count, COLUMNS), np.int32)
        cells[:, 0] = level
        cells[:, 1:4] = rng.integers(0, (division.columns << level, division.rows << level, headings), (count, 3))
        blocked = [
            kind_of(cells, cell, division, *space.parts, placed, FINEST) == BLOCKED for cell in range(len(cells))
        ]
        assert any(blocked) or level < 4
        # The corners, where what moves the robot adds up, and any others.
        away = rng.uniform(-1.0, 1.0, (12, 3))
        away[:8] = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T
        halves = np.array([half, half, np.pi / headings])
        low = np.array([division.x0, division.y0, -np.pi])
        centres = low + (2 * cells[blocked, 1:4] + 1) * halves
        inside.append((centres[:, None] + away * halves).reshape(-1, 3))
    poses = np.concatenate(inside)
    # The pivot's place against the reference point's.
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x, y = space.pivot
    q = np.column_stack([poses[:, 0] - c * x + s * y, poses[:, 1] - s * x - c * y, poses[:, 2]])
    assert len(q) > 13 * count
    assert Oracle(world, robot).collides(q).all()
