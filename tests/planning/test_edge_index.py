"""EdgeIndex: after any changes, the same edges are near the same boxes as in an index made anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.helpers.random_worlds import random_world, star_polygon

from trailmark.planning.edge_index import MAX_ADDED, EdgeIndex
from trailmark.shapes import Disc, Polygon, Rectangle, Shape


def near(index: EdgeIndex, low: np.ndarray, high: np.ndarray) -> set[tuple[float, ...]]:
    """Return which edges the index names near which pair of boxes."""
    pairs = np.arange(len(low)) // 2
    first, runs, _, _ = index.near(low, high, pairs, len(low) // 2)
    pair = np.repeat(np.arange(len(first) - 1), np.diff(first))
    runs = np.asarray(runs[first[0] : first[-1]])
    assert len(np.unique(pair * len(index.runs) + runs)) == len(runs)
    # Each run's edges, one after the other.
    count = np.asarray(index.runs)[runs + 1] - np.asarray(index.runs)[runs]
    edge = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count - np.asarray(index.runs)[runs], count)
    return set(map(tuple, np.column_stack([np.repeat(pair, count), index.edges[edge]]).tolist()))


def assert_same(index: EdgeIndex, anew: EdgeIndex, rng: np.random.Generator) -> None:
    low = rng.uniform(-3.0, 21.0, (20, 2))
    high = low + rng.uniform(0.0, 4.0, (20, 2))
    assert near(index, low, high) == near(anew, low, high)
    there = [i for i, shape in enumerate(index.obstacles) if shape]
    boxes = index.boxes.T[there]
    assert sorted(boxes.tolist()) == sorted(anew.boxes.T.tolist())
    # Rounded differently: corners are computed for all at once.
    own = np.array([shape.bounding_box() for shape in index.obstacles if shape], dtype=np.float64).reshape(-1, 4)
    assert np.allclose(own, boxes, rtol=0.0, atol=1e-12)


def random_shape(rng: np.random.Generator) -> Shape:
    center, radius = tuple(rng.uniform(0.0, 20.0, 2).tolist()), float(rng.choice([1e-3, 0.3, 2.0, 15.0]))
    if rng.random() < 0.3:
        return Disc(center, radius)
    if rng.random() < 0.3:
        return Rectangle(center, radius, 2.0 * radius, float(rng.uniform(-3, 3)))
    # More vertices than a run has.
    angles = np.linspace(0.0, 2.0 * np.pi, int(rng.integers(3, 40)), endpoint=False)
    ring = np.array(center) + radius * np.column_stack([np.cos(angles), np.sin(angles)])
    return (
        Polygon(ring, (0.5 * (ring + np.array(center)),)) if rng.random() < 0.3 else star_polygon(rng, center, radius)
    )


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 3, 4])
def test_random_changes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    boundary = seed % 2 == 0
    world = random_world(seed, 10 * seed, size=20.0, radii=(0.3, 3.0), discs=0.3, holes=0.4, boundary=boundary)
    index, shapes = EdgeIndex(world), list(world.obstacles)
    old: list[tuple[EdgeIndex, EdgeIndex]] = []
    for _ in range(3 * MAX_ADDED):
        changes: list[tuple[Shape | None, Shape | None]] = []
        for i in sorted(rng.choice(len(shapes), min(len(shapes), int(rng.integers(3))), replace=False), reverse=True):
            after = random_shape(rng) if rng.random() < 0.6 else None
            changes.append((shapes.pop(i), after))
            shapes += [] if after is None else [after]
        if rng.random() < 0.5:
            shapes.append(shapes[0] if shapes and rng.random() < 0.2 else random_shape(rng))
            changes.append((None, shapes[-1]))
        index = index.edited(changes)
        world = replace(world, obstacles=tuple(shapes))
        # Between what is looked at, changes follow one another.
        if rng.random() > 1.0 / 3.0:
            continue
        anew = EdgeIndex(world)
        assert_same(index, anew, rng)
        old = [(index, anew), *old[:3]]
        assert_same(*old[-1], rng)


def test_all_obstacles_may_go_and_come_back() -> None:
    rng = np.random.default_rng(0)
    world = random_world(1, 30, size=20.0, discs=0.5)
    empty = EdgeIndex(world).edited((shape, None) for shape in world.obstacles)
    assert_same(empty, EdgeIndex(replace(world, obstacles=())), rng)
    assert_same(empty.edited((None, shape) for shape in world.obstacles), EdgeIndex(world), rng)
