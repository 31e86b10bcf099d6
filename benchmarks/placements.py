"""Ways to place n valid nodes in free space, to be compared at equal n (benchmarks/nodes.py)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.landmarks import draw, free_samples, k_means_landmarks
from trailmark.landmarks.band import Band
from trailmark.landmarks.paper import algorithm_1
from trailmark.planning import LandmarkPlanner

__all__ = ["CENTRES", "HALTON", "INFORMED", "LATTICE", "OURS", "PLACEMENTS", "UNIFORM", "informed"]

OURS, UNIFORM, HALTON, LATTICE, CENTRES, INFORMED = (
    "trailmark's landmarks",
    "uniform samples",
    "Halton points",
    "triangular lattice",
    "K-means centres",
    "informed by the query",
)
"""Names of the placements, as tables and plots show them."""

SAMPLES_PER_CENTRE = 10
"""Samples that K-means clusters for each centre."""

HEADINGS = 16
"""Random headings tried at a position that is given."""

BANDS = (0.05, 0.3, 1.5)
"""Widths of the bands that a third of a query's nodes each are drawn from."""

Place = Callable[[StateChecker, int, np.random.Generator], se2.FloatArray]


def uniform(checker: StateChecker, n: int, rng: np.random.Generator) -> se2.FloatArray:
    """Return independent uniform valid configurations."""
    return free_samples(checker, n, random_state=rng)


def halton(checker: StateChecker, n: int, rng: np.random.Generator) -> se2.FloatArray:
    """Return the first n valid points of one scrambled Halton sequence."""
    seed, drawn = int(rng.integers(2**31)), 4 * n
    while True:
        q = draw(checker.world.bounds, drawn, method="halton", random_state=seed)
        if not turns(checker):
            q[:, 2] = 0.0
        q = q[checker.valid(q)]
        if len(q) >= n or drawn > 400 * n:
            return np.asarray(q[:n])
        drawn *= 2


def lattice(checker: StateChecker, n: int, rng: np.random.Generator) -> se2.FloatArray:
    """Return the widest triangular lattice, anyhow placed, with n valid nodes at random valid headings."""
    xmin, ymin, xmax, ymax = checker.world.bounds
    middle, half = np.array([0.5 * (xmin + xmax), 0.5 * (ymin + ymax)]), 0.5 * checker.world.extent
    angle, shift = rng.uniform(0.0, np.pi / 3.0), rng.random(2)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    low, high = 0.0, 2.0 * half / np.sqrt(n)
    found = np.empty((0, 3))
    for _ in range(14):
        spacing = 0.5 * (low + high)
        m = int(half / (spacing * np.sqrt(0.75))) + 2
        i, j = np.meshgrid(np.arange(-2 * m, 2 * m + 1), np.arange(-m, m + 1))
        points = np.column_stack([(i + 0.5 * (j % 2) + shift[0]).ravel(), ((j + shift[1]) * np.sqrt(0.75)).ravel()])
        points = middle + spacing * points @ turn
        q, valid = with_headings(checker, points[in_bounds(checker, points)], rng)
        if valid.sum() >= n:
            low, found = spacing, q[valid]
        else:
            high = spacing
    return found[rng.choice(len(found), min(n, len(found)), replace=False)]


def centres(checker: StateChecker, n: int, rng: np.random.Generator) -> se2.FloatArray:
    """Return K-means centres of uniform valid positions (Algorithm 1, Forgy) at random valid headings.

    A centre that is valid at none of the headings tried is replaced by the sample nearest to it.
    """
    samples = free_samples(checker, SAMPLES_PER_CENTRE * n, random_state=rng)
    found = algorithm_1(samples[:, :2], n, "forgy", rng).centres
    q, valid = with_headings(checker, found, rng)
    q[~valid] = samples[cKDTree(samples[:, :2]).query(found[~valid])[1]]
    return np.unique(q, axis=0)


def ours(checker: StateChecker, n: int, rng: np.random.Generator) -> se2.FloatArray:
    """Return the landmarks that LandmarkPlanner.build places without knowing any query."""
    planner = LandmarkPlanner(checker.world, seed=int(rng.integers(2**31)), checker=checker, warm=False)
    return planner.build(n).configurations


PLACEMENTS: dict[str, Place] = {UNIFORM: uniform, HALTON: halton, LATTICE: lattice, CENTRES: centres, OURS: ours}
"""Placements that know nothing of the queries, by name."""


def informed(checker: StateChecker, band: Band, n: int, rng: np.random.Generator) -> se2.FloatArray:
    """Return n landmarks for one query: guides, and K-means landmarks from ever wider bands, a third from each."""
    guides = band.guides(rng)[0]
    nodes = guides[np.unique(np.linspace(0, len(guides) - 1, min(len(guides), n // 3)).astype(int))]
    for i, widening in enumerate(BANDS, 1):
        k = i * n // len(BANDS) - len(nodes)
        if k > 0 and len(samples := band.samples(5 * k, widening, rng)):
            radius = checker.footprint.sweep_radius
            nodes = np.vstack([nodes, k_means_landmarks(samples, k, radius=radius, steps=3, random_state=rng)])
    return np.asarray(nodes)


def turns(checker: StateChecker) -> bool:
    """Return whether headings count: not for a disc."""
    return checker.footprint.sweep_radius > 0.0


def in_bounds(checker: StateChecker, points: se2.FloatArray) -> NDArray[np.bool_]:
    """Return which points (n, 2) lie within the world's bounds."""
    xmin, ymin, xmax, ymax = checker.world.bounds
    return np.asarray(((points >= (xmin, ymin)) & (points <= (xmax, ymax))).all(axis=1))


def with_headings(
    checker: StateChecker, points: se2.FloatArray, rng: np.random.Generator
) -> tuple[se2.FloatArray, NDArray[np.bool_]]:
    """Return configurations (n, 3) at the points with random headings, and which of them are valid."""
    q = np.column_stack([points, np.zeros(len(points))])
    valid = np.zeros(len(q), dtype=np.bool_)
    for _ in range(HEADINGS if turns(checker) else 1):
        rest = np.flatnonzero(~valid)
        if turns(checker):
            q[rest, 2] = rng.uniform(-np.pi, np.pi, len(rest))
        valid[rest] = checker.valid(q[rest])
    return q, valid
