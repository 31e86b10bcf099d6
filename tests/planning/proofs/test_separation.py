"""What is said to block a disc does: against shapely's distances, densely sampled."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.helpers.random_worlds import random_world
from tests.support.trials import few

from trailmark.planning.proofs.separation import CERTAIN, Separation
from trailmark.shapes import Disc, Rectangle
from trailmark.world import World


def clearance(world: World, points: np.ndarray) -> np.ndarray:
    """Distance of points (n, 2) to outlines, bounds and discs; 0 inside of discs."""
    xmin, ymin, xmax, ymax = world.bounds
    lines = [shapely.box(xmin, ymin, xmax, ymax).exterior]
    lines += [] if world.boundary is None else [world.boundary.shapely().exterior]
    for shape in world.obstacles:
        if not isinstance(shape, Disc):
            lines += list(shapely.get_rings(shape.polygon().shapely()))
    outlines = shapely.union_all(lines)
    shapely.prepare(outlines)
    found = shapely.distance(outlines, shapely.points(points))
    for shape in world.obstacles:
        if isinstance(shape, Disc):
            off = np.hypot(*(points - shape.center).T) - shape.radius
            found = np.minimum(found, np.maximum(0.0, off))
    return np.asarray(found)


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.05, 0.4, 1.5]), st.sampled_from([0.0, 1e6]))
@settings(max_examples=few(15), deadline=None)
def test_nowhere_on_what_blocks_is_the_disc_free(seed: int, radius: float, offset: float) -> None:
    world = random_world(
        seed, 15, size=12.0, radii=(0.3, 2.0), discs=0.4, holes=0.3, boundary=seed % 2 == 0, origin=(offset, offset)
    )
    rng = np.random.default_rng(seed)
    starts = rng.uniform(0.0, 12.0, (150, 2)) + offset
    edges = np.stack([starts, starts + rng.normal(0.0, rng.choice([0.1, 1.0]), (150, 2))], axis=1)
    squares = starts[:, None] + rng.uniform(0.01, 0.5) * np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    separation = Separation(world, radius)
    # On edges of up to 4 m: clearance differs by 1 cm at most from one to the next.
    share = np.linspace(0.0, 1.0, 200)[:, None]
    lines = edges[:, :1] + share * (edges[:, 1:] - edges[:, :1])
    nearest = clearance(world, lines.reshape(-1, 2)).reshape(len(edges), -1).max(axis=1)
    found = separation.edges_block(edges)
    assert (nearest[found] < radius - 0.5 * CERTAIN).all()
    # And most that block are known: sampled densely, so that hardly any place is missed.
    assert found[nearest < 0.98 * radius - 0.02].all()
    u, v = np.meshgrid(share[::13, 0], share[::13, 0])
    inside = squares[:, 0][:, None] + np.stack([u, v], axis=-1).reshape(-1, 2) * (squares[0, 2] - squares[0, 0])
    worst = clearance(world, inside[:40].reshape(-1, 2)).reshape(40, -1).max(axis=1)
    assert (worst[separation.cells_block(squares)[:40]] < radius - 0.5 * CERTAIN).all()


def test_two_obstacles_block_one_edge_together() -> None:
    # Neither does alone; the edge is cut in halves.
    world = World("two", (0.0, 0.0, 10.0, 10.0), (Disc((3.0, 5.0), 0.5), Rectangle((5.0, 5.0), 1.0, 1.0)))
    edge = np.array([[[2.5, 5.0], [5.5, 5.0]]])
    assert Separation(world, 0.6).edges_block(edge).all()
    assert not Separation(world, 0.4).edges_block(edge).any()
    # By a hair less than what certainly overlaps.
    for radius, blocked in ((0.5 + 2.0 * CERTAIN, True), (0.5 + 0.5 * CERTAIN, False)):
        touching = np.array([[[4.6, 4.0], [5.4, 4.0]]])
        assert Separation(world, radius).edges_block(touching).all() == blocked


@pytest.mark.parametrize("radius", [1e-7, 1e-6])
def test_the_smallest_discs_are_blocked_by_nothing(radius: float) -> None:
    world = World("box", (0.0, 0.0, 1.0, 1.0))
    separation = Separation(world, radius)
    assert not separation.edges_block(np.array([[[0.0, 0.0], [1.0, 0.0]]])).any()
    assert not separation.cells_block(np.zeros((1, 4, 2))).any()
