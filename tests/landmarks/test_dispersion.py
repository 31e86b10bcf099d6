"""Dispersion against Voronoi diagrams and known answers, coverage against densely sampled motions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from benchmarks.dispersion import coverage, dispersion, free_positions
from benchmarks.oracle import Oracle, motion_states
from benchmarks.random_worlds import ROBOTS, random_states, random_world
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial import KDTree, Voronoi
from scipy.spatial.distance import cdist
from tests.support.trials import few

from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError
from trailmark.shapes import Disc, Rectangle
from trailmark.world import Robot, World

FloatArray = NDArray[np.float64]

SIDE = 10.0
OPEN = StateChecker(World("open", (-0.5, -0.5, SIDE + 0.5, SIDE + 0.5)), Robot.disc(0.5))
"""The disc's centre may be anywhere in the square from 0 to SIDE."""
FREE = free_positions(OPEN, cells=10_000)


def mirrored(nodes: FloatArray) -> FloatArray:
    """The nodes and their images in the sides: the Voronoi cells of the nodes then end at the square's sides."""
    images = [nodes]
    for axis in (0, 1):
        for at in (0.0, SIDE):
            image = nodes.copy()
            image[:, axis] = 2.0 * at - image[:, axis]
            images.append(image)
    return np.vstack(images)


def exact_dispersion(nodes: FloatArray) -> float:
    """The largest empty disc with its centre in the square: at a vertex of the Voronoi cells clipped to it."""
    # Images that lie on nodes are told apart by a hair.
    images = mirrored(np.clip(nodes, 1e-6, SIDE - 1e-6))
    corners = Voronoi(images, qhull_options="QJ Qbb Qc").vertices
    corners = corners[((corners > -1e-4) & (corners < SIDE + 1e-4)).all(axis=1)]
    return float(cdist(corners, nodes).min(axis=1).max())


# --- dispersion


@settings(max_examples=few(20))
@given(st.integers(1, 60), st.integers(0, 2**32 - 1))
def test_bounds_hold_the_voronoi_diagrams_answer(n: int, seed: int) -> None:
    nodes = np.random.default_rng(seed).uniform(0.0, SIDE, (n, 2))
    found = dispersion(nodes, FREE)
    assert found.lower - 1e-3 <= exact_dispersion(nodes) <= found.upper + 1e-3
    # Half a diagonal from the widest gap to the centre of its cell, which may lie just outside: two cells at most.
    assert found.upper - found.lower <= 4.0 * FREE.reach
    assert cdist(found.place[None], nodes).min() == pytest.approx(found.lower)


def test_known_answers() -> None:
    corners = np.array([[0.0, 0.0], [SIDE, 0.0], [0.0, SIDE], [SIDE, SIDE]])
    middle = np.array([[SIDE / 2, SIDE / 2]])
    for nodes, place in ((corners, middle), (middle, corners)):
        found = dispersion(nodes, FREE)
        assert found.lower <= SIDE * math.sqrt(0.5) <= found.upper
        assert cdist(found.place[None], place).min() < 3.0 * FREE.reach
    # A square lattice of spacing s has discs of s/√2 at its cells' centres.
    x, y = np.meshgrid(np.linspace(0.0, SIDE, 11), np.linspace(0.0, SIDE, 11))
    found = dispersion(np.column_stack([x.ravel(), y.ravel(), np.zeros(121)]), FREE)
    assert found.lower <= math.sqrt(0.5) <= found.upper


@pytest.mark.slow
def test_more_cells_tell_more() -> None:
    nodes = np.random.default_rng(3).uniform(0.0, SIDE, (20, 2))
    exact, gaps = exact_dispersion(nodes), []
    for cells in (400, 6_400, 102_400):
        found = dispersion(nodes, free_positions(OPEN, cells=cells))
        assert found.lower - 1e-3 <= exact <= found.upper + 1e-3
        gaps.append(found.upper - found.lower)
    assert gaps[0] > 2.0 * gaps[1] > 4.0 * gaps[2]


def test_the_centre_lies_in_free_space_but_the_disc_may_hold_obstacles() -> None:
    # A wall leaves the left half free and the right one out of bounds for the robot's centre.
    wall = Rectangle((7.75, 5.0), 5.5, 11.0)
    checker = StateChecker(World("half", OPEN.world.bounds, (wall,)), OPEN.robot)
    free = free_positions(checker)
    assert free.area == pytest.approx(4.5 * SIDE, rel=0.02)
    found = dispersion(np.array([[0.0, 0.0, 0.0]]), free)
    assert found.lower <= math.hypot(4.5, 10.0) <= found.upper
    across = dispersion(np.array([[8.0, 5.0]]), free)
    assert across.lower <= math.hypot(8.0, 5.0) <= across.upper


@pytest.mark.parametrize("name", ROBOTS)
def test_certain_positions_are_free_and_no_free_one_is_impossible(name: str) -> None:
    world = random_world(7, 40, size=40.0, discs=0.3, holes=0.3)
    checker, oracle = StateChecker(world, ROBOTS[name]), Oracle(world, ROBOTS[name])
    free = free_positions(checker, cells=6_000)
    rng = np.random.default_rng(8)
    some = free.certain[rng.choice(len(free.certain), 60)]
    turned = np.column_stack([np.repeat(some, 16, axis=0), np.tile(np.arange(16) * (math.pi / 8.0), 60)])
    assert (~oracle.collides(turned)).reshape(60, 16).any(axis=1).all()
    q = random_states(world, 1_500, rng, 4.0)
    q = q[~oracle.collides(q)]
    away = np.asarray(KDTree(free.possible).query(q[:, :2], p=math.inf)[0])
    assert away.max() <= free.reach * math.sqrt(0.5) + 1e-9
    if name in ("disc", "rectangle"):
        assert len(free.possible) < 6_000


def test_bad_input() -> None:
    with pytest.raises(ConfigurationError, match="dispersion: expected 1 node or more, got none"):
        dispersion(np.empty((0, 3)), FREE)
    with pytest.raises(ConfigurationError, match="cells: expected 1 to 4194304, got 0"):
        free_positions(OPEN, cells=0)
    with pytest.raises(ConfigurationError, match="headings: expected 1 or more, got 0"):
        free_positions(OPEN, headings=0)
    full = StateChecker(World("full", (0, 0, 4, 4), (Rectangle((2, 2), 4, 4),)), Robot.disc(0.5))
    with pytest.raises(ConfigurationError, match="world 'full': no free place for the robot was found"):
        free_positions(full)


# --- coverage


@pytest.mark.slow
@pytest.mark.parametrize("name", ["disc", "rectangle", "thin"])
def test_coverage_against_every_motion(name: str) -> None:
    world = random_world(9, 90, size=60.0, discs=0.3)
    checker, oracle = StateChecker(world, ROBOTS[name]), Oracle(world, ROBOTS[name])
    q = random_states(world, 500, np.random.default_rng(10))
    q = q[checker.valid(q)]
    nodes, q = q[:12], q[12:72]
    seen = coverage(checker, nodes, q)
    starts, ends = np.repeat(q, len(nodes), axis=0), np.tile(nodes, (len(q), 1))
    if name == "disc":
        starts[:, 2] = ends[:, 2] = 0.0
    free = ~oracle.collides(motion_states(starts, ends, 60).reshape(-1, 3)).reshape(-1, 60).any(axis=1)
    by_sampling = free.reshape(len(q), len(nodes)).any(axis=1)
    # Sampling may miss a collision, certified motions may not.
    assert (by_sampling | ~seen).all()
    assert (by_sampling & ~seen).mean() <= 0.03
    assert 0.2 < seen.mean() < 0.999
    batches = checker.motions_valid(starts, ends).reshape(len(q), len(nodes)).any(axis=1)
    assert (seen == batches).all()


def test_a_far_node_counts_as_much_as_a_near_one() -> None:
    # Nodes behind a wall are nearer than the one that is seen.
    checker = StateChecker(World("wall", (0, 0, 60, 20), (Rectangle((40.0, 12.0), 1.0, 16.0),)), Robot.disc(0.5))
    behind = np.column_stack([np.full(30, 42.0), np.linspace(8.0, 19.0, 30), np.zeros(30)])
    q = np.array([[38.0, 15.0, 0.0]])
    assert not coverage(checker, behind, q)[0]
    assert coverage(checker, np.vstack([behind, [2.0, 15.0, 0.0]]), q)[0]


def test_nothing_sees_no_nodes() -> None:
    checker = StateChecker(World("disc", (0, 0, 9, 9), (Disc((4, 4), 1),)), Robot.disc(0.5))
    q = np.array([[1.0, 1.0, 0.0], [8.0, 8.0, 0.0]])
    assert coverage(checker, np.empty((0, 3)), q).tolist() == [False, False]
    assert coverage(checker, q, np.empty((0, 3))).shape == (0,)
    assert coverage(checker, q[:1], q).tolist() == [True, False]
