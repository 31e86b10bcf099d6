"""A roadmap for whatever query may come: landmarks spread over all free space, as many as the world asks for.

More landmarks in tight places, with headings along them, were tried: at the same number of nodes they solve no more
queries, and paths are no shorter.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trailmark import se2
from trailmark.errors import ConfigurationError
from trailmark.landmarks import Relaxation, free_samples, k_means_landmarks
from trailmark.nearest import near_to_near
from trailmark.roadmap import Roadmap
from trailmark.roadmap.query import QueryGraph

__all__ = ["SAMPLES_PER_LANDMARK", "Grown", "grow_general", "spread_landmarks"]

SPREAD_STEPS = 5
"""Steps of K-means: samples are then on the mean at most a thousandth farther from their centres than where it ends."""

SAMPLES_PER_LANDMARK = 5
"""Of the samples that are clustered; one in so many is left as a landmark."""

FIRST, MOST = 1_000, 16_000
"""Landmarks of the first round, and after the last: each round doubles them."""

PROBES = 200
"""Queries that tell whether more landmarks are worth their time."""

WORTHWHILE = 0.02
"""Share by which a round must shorten the probes' paths for another one to follow."""


class Grown(NamedTuple):
    """How good a roadmap is, by queries drawn at random.

    Attributes:
        probes: queries that the relaxed problem does not rule out.
        solved: those of them that the roadmap answers.
        cost: mean cost of the answers, metres.
    """

    probes: int
    solved: int
    cost: float


def grow_general(roadmap: Roadmap, relaxation: Relaxation, rng: np.random.Generator) -> list[Grown]:
    """Add landmarks until random queries find their paths, and no much shorter ones when landmarks are doubled.

    Args:
        roadmap: of straight motions; what is there already is kept.
        relaxation: the relaxed problem's grid.
        rng: source of randomness.

    Returns:
        What the probes said after each round.

    Raises:
        ConfigurationError: no free place for the robot.
    """
    checker = roadmap.checker
    ends = free_samples(checker, 2 * PROBES, random_state=rng)
    probes = ends[: len(ends) // 2 * 2].reshape(-1, 2, 3)
    probes = probes[_joined(relaxation, probes)]
    rounds: list[Grown] = []
    count, before = FIRST, np.full(len(probes), np.inf)
    while True:
        spread_landmarks(roadmap, checker.footprint.sweep_radius, count, rng)
        costs = _costs(QueryGraph(roadmap), probes)
        solved = np.isfinite(costs)
        rounds.append(Grown(len(probes), int(solved.sum()), float(costs[solved].mean()) if solved.any() else np.inf))
        if len(rounds) > 1:
            common = solved & np.isfinite(before)
            shorter = 1.0 - costs[common].sum() / max(before[common].sum(), 1e-9) if common.any() else 0.0
            settled = bool(solved.all()) or rounds[-1].solved == rounds[-2].solved
            if settled and shorter < WORTHWHILE:
                return rounds
        if len(roadmap) + len(roadmap) > 1.1 * MOST:
            return rounds
        before, count = costs, len(roadmap)


def spread_landmarks(roadmap: Roadmap, radius: float, count: int, rng: np.random.Generator) -> None:
    """Add landmarks spread evenly over all free space: K-means centres of a Halton sequence's valid samples.

    Args:
        roadmap: to add them to.
        radius: R of the embedding, metres.
        count: how many.
        rng: source of randomness.

    Raises:
        ConfigurationError: no free place for the robot.
    """
    checker = roadmap.checker
    samples = free_samples(checker, SAMPLES_PER_LANDMARK * count, method="halton", random_state=rng)
    if len(samples) == 0:
        raise ConfigurationError(f"world {checker.world.name!r}: no free place for the robot was found")
    # Landmarks come in the samples' order, and what is near in space is looked at together from here on.
    samples = samples[near_to_near(se2.embed(samples, radius))]
    roadmap.add(k_means_landmarks(samples, count, radius=radius, steps=SPREAD_STEPS, random_state=rng))


def _joined(relaxation: Relaxation, pairs: se2.FloatArray) -> np.ndarray:
    """Return which of the pairs, shape (n, 2, 3), the relaxed problem may join, shape (n,)."""
    cells = relaxation.cells(relaxation.disc_centers(pairs))
    part = np.full(len(pairs), -1)
    joined = np.zeros(len(pairs), dtype=np.bool_)
    for i in range(len(pairs)):
        if part[i] < 0:
            reached = relaxation.component(pairs[i, 0])
            part[(part < 0) & reached[cells[:, 0]]] = i
            # Pairs of this part are told at once: hardly any world has more than a few.
            of_part = part == i
            joined[of_part] = reached[cells[of_part, 1]]
            part[i] = i
    return joined


def _costs(graph: QueryGraph, pairs: se2.FloatArray) -> se2.FloatArray:
    """Return the cost of each pair's path, shape (n,), metres; infinite where there is none."""
    costs = np.full(len(pairs), np.inf)
    for i, (start, goal) in enumerate(pairs):
        states = graph.way(start, goal)
        if states is not None:
            costs[i] = graph.cost(states)
    return costs
