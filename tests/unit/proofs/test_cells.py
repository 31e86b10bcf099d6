"""Cells tile their space and know their neighbours; one that counts as blocked holds no valid configuration."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.helpers.oracles import Oracle, free_somewhere
from tests.helpers.trials import few
from tests.helpers.worlds import ROBOTS, random_world

from trailmark import Rectangle, Robot, StateChecker, World
from trailmark.proofs.cells import (
    BLOCKED,
    CHILD,
    COLUMNS,
    LEVEL,
    LEVELS,
    Division,
    I,
    J,
    K,
    kind_of,
    leaf_at,
    neighbours,
    split,
)
from trailmark.proofs.enclosure import Space, core, pivot
from trailmark.proofs.region import MARGIN

DEEPEST, FINEST = 4, 9


def division(turns: list[int]) -> Division:
    return Division(0.0, 0.0, 3, 2, 0.5 ** np.arange(1, LEVELS + 1, dtype=np.float64), np.array(turns, np.int64))


def boxes(cells: NDArray[np.int32], space: Division) -> NDArray[np.int64]:
    """Return each cell's low and high x, y and heading in units of the deepest level's cells, shape (n, 3, 2)."""
    level = cells[:, LEVEL].astype(np.int64)
    edge = np.column_stack([1 << (DEEPEST - level)] * 2 + [1 << (space.turns[DEEPEST] - space.turns[level])])
    low = cells[:, [I, J, K]] * edge
    return np.stack([low, low + edge], axis=-1)


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1))
@settings(max_examples=few(40))
def test_neighbours_are_all_that_share_a_part_of_a_face(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turns = np.concatenate([[0], np.cumsum(rng.integers(0, 2, LEVELS - 1))]).tolist()
    space = division(turns)
    cells = np.zeros((4000, COLUMNS), np.int32)
    used = space.columns * space.rows
    cells[:used, I], cells[:used, J] = np.arange(used) % space.columns, np.arange(used) // space.columns
    cells[:used, CHILD] = -1
    for _ in range(25):
        cell = int(rng.integers(used))
        if cells[cell, CHILD] < 0 and cells[cell, LEVEL] < DEEPEST:
            used = split(cells, space, cell, used)
    leaves = np.flatnonzero(cells[:used, CHILD] < 0)
    box = boxes(cells[leaves], space)
    headings = 1 << int(space.turns[DEEPEST])
    whole = (space.columns << DEEPEST) * (space.rows << DEEPEST) * headings
    assert np.prod(box[..., 1] - box[..., 0], axis=1).sum() == whole
    around = np.empty(1, np.int64)
    for at, leaf in enumerate(leaves):
        count, around = neighbours(cells, space, int(leaf), around)
        expected = set()
        for round_ in (-headings, 0, headings):
            shifted = box + np.array([0, 0, round_])[:, None]
            shared = np.minimum(box[at, :, 1], shifted[..., 1]) - np.maximum(box[at, :, 0], shifted[..., 0])
            touching = ((shared == 0).sum(axis=1) == 1) & ((shared > 0).sum(axis=1) == 2)
            expected |= set(leaves[touching].tolist())
        assert set(around[:count].tolist()) - {leaf} == expected - {leaf}
        i, j, k = (box[at, :, 0]).tolist()
        assert leaf_at(cells, space, DEEPEST, i, j, k) == leaf


@pytest.mark.slow
@pytest.mark.parametrize("name", ["L", "offset", "star", "thin"])
def test_nothing_in_a_blocked_cell_is_valid(name: str) -> None:
    robot = ROBOTS[name]
    world = random_world(5, 25, size=20.0, radii=(0.3, 3.0), discs=0.3, holes=0.2, boundary=True, origin=(-7.0, 3.0))
    space = Space(StateChecker(world, robot))
    by, rng = space.blocking(FINEST, 0.1), np.random.default_rng(0)
    division = by.division
    inside = []
    # Of the thin robot a cell takes ten times as long.
    count = few(200, of=4) if name == "thin" else 200
    for level in range(FINEST + 1):
        half, headings = division.half[level], 1 << division.turns[level]
        cells = np.zeros((count, COLUMNS), np.int32)
        cells[:, 0] = level
        cells[:, 1:4] = rng.integers(0, (division.columns << level, division.rows << level, headings), (count, 3))
        blocked = [kind_of(cells, cell, by) == BLOCKED for cell in range(len(cells))]
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


@pytest.mark.parametrize("name", sorted(set(ROBOTS) - {"disc"}))
@pytest.mark.parametrize("share", [0.02, 0.2, 0.35])
def test_a_core_stays_covered_under_all_shifts_and_turns(name: str, share: float) -> None:
    robot = ROBOTS[name]
    outline = np.asarray(robot.outline.rings()[0]) - pivot(robot)
    shift = share * robot.inscribed_disc.radius
    turn = shift / robot.circumradius
    rings = core(outline, shift, turn)
    assert rings
    rng = np.random.default_rng(0)
    region = shapely.Polygon(outline)
    for ring in rings:
        middle = shapely.Polygon(ring)
        for extreme in [*np.ndindex(3, 8), *[(None, None)] * 20]:
            phi = turn * (rng.uniform(-1.0, 1.0) if extreme[0] is None else extreme[0] - 1.0)
            angle = rng.uniform(0.0, 2.0 * np.pi) if extreme[1] is None else 0.25 * np.pi * extreme[1]
            moved = shapely.affinity.rotate(region, phi, origin=(0.0, 0.0), use_radians=True)
            moved = shapely.affinity.translate(moved, shift * np.cos(angle), shift * np.sin(angle))
            assert shapely.covers(moved, middle)
            assert shapely.distance(moved.exterior, middle) >= MARGIN - 1e-9


def test_the_oracle_finds_a_slot_as_narrow_as_a_hundredth_of_the_box() -> None:
    robot, box = Robot.rectangle(1.0, 0.5), np.array([[0.4, 0.4, 0.4]])
    for spare, told in ((0.02, True), (-0.02, False)):
        half = 0.25 + 0.5 * spare
        walls = tuple(Rectangle((3.013, 3.027 + side * (half + 1.0)), 5.0, 2.0) for side in (-1.0, 1.0))
        world = World("slot", (0.0, 0.0, 6.0, 6.0), walls)
        assert free_somewhere(world, robot, np.array([[3.0, 3.0, 0.1]]), box, np.zeros(2)) == told
