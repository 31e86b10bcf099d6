"""A roadmap for whatever query may come: landmarks spread over all free space, as many as the world asks for.

More landmarks in tight places, with headings along them, were tried: at the same number of nodes they solve no more
queries, and paths are no shorter.
"""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from trailmark import se2
from trailmark.errors import ConfigurationError
from trailmark.landmarks import Relaxation, free_samples, k_means_landmarks
from trailmark.landmarks.sampling import farthest_samples
from trailmark.planning.settings import PlannerSettings
from trailmark.roadmap import Roadmap
from trailmark.roadmap.snapshot import RoadmapSnapshot

__all__ = ["Grown", "Growth", "grow_general", "spread_landmarks"]

SMALLEST, FIRST = 16, 1_024
"""Landmarks of the first part, and when random queries are asked first: each part doubles them."""

DRAWN, FARTHEST = 2, 0.25
"""Where there are landmarks already: times as many samples are drawn, and which share of them, the farthest, is
clustered. The same number of landmarks then leaves gaps a quarter smaller and answers up to 10 % more queries
(benchmarks.nodes)."""

NEXT = 2.5
"""Times as long as a part of landmarks the next one may take, twice as large."""


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


class Growth(NamedTuple):
    """A roadmap that was grown.

    Attributes:
        rounds: what the probes said after each round.
        graph: the roadmap, ready for queries.
        whole: whether it is as dense as the world asks for; else the time was up before.
    """

    rounds: list[Grown]
    graph: RoadmapSnapshot
    whole: bool


def _forever() -> float:
    return np.inf


def grow_general(
    roadmap: Roadmap,
    relaxation: Relaxation,
    rng: np.random.Generator,
    settings: PlannerSettings,
    *,
    seconds_left: Callable[[], float] = _forever,
    report: Callable[[], object] | None = None,
) -> Growth:
    """Add landmarks until random queries find their paths, and no much shorter ones when landmarks are doubled.

    Args:
        roadmap: what is there already is kept.
        relaxation: the relaxed problem's grid.
        rng: source of randomness.
        settings: numbers that a person may change.
        seconds_left: asked before each part of the landmarks, which begins only if it is expected to come to its end.
        report: called after each part.

    Raises:
        ConfigurationError: no free place for the robot.
    """
    checker = roadmap.checker
    rounds = list[Grown]()
    probes, before = np.empty((0, 2, 3)), np.empty(0)
    placed, part = 0, SMALLEST
    while True:
        begin = perf_counter()
        _spread(roadmap, part, rng, settings)
        placed, part = placed + part, placed + part
        graph = RoadmapSnapshot(roadmap)
        if report is not None:
            report()
        if placed == FIRST:
            ends = free_samples(checker, 2 * settings.probes, random_state=rng)
            probes = ends[: len(ends) // 2 * 2].reshape(-1, 2, 3)
            probes = probes[_joined(relaxation, probes, seconds_left)]
            before = np.full(len(probes), np.inf)
        if placed >= FIRST:
            costs = _costs(graph, probes, seconds_left)
            if seconds_left() <= 0.0:
                return Growth(rounds, graph, whole=False)
            solved = np.isfinite(costs)
            mean = float(costs[solved].mean()) if solved.any() else np.inf
            rounds.append(Grown(len(probes), int(solved.sum()), mean))
            if len(rounds) > 1:
                common = solved & np.isfinite(before)
                shorter = 1.0 - costs[common].sum() / max(before[common].sum(), 1e-9) if common.any() else 0.0
                settled = bool(solved.all()) or rounds[-1].solved == rounds[-2].solved
                if settled and shorter < settings.least_probe_gain:
                    return Growth(rounds, graph, whole=True)
            if 2 * len(roadmap) > 1.1 * settings.max_spread_landmarks:
                return Growth(rounds, graph, whole=True)
            before = costs
        if NEXT * (perf_counter() - begin) > seconds_left():
            return Growth(rounds, graph, whole=False)


def spread_landmarks(
    roadmap: Roadmap,
    count: int,
    rng: np.random.Generator,
    settings: PlannerSettings,
    *,
    seconds_left: Callable[[], float] = _forever,
    report: Callable[[], object] | None = None,
) -> int:
    """Add landmarks spread evenly over all free space: K-means centres of a Halton sequence's valid samples.

    They are placed in parts, each as large as all before and clustered from the samples that lie farthest from those
    (:func:`~trailmark.landmarks.sampling.farthest_samples`). Fewer than asked for come back where some centres share
    their nearest sample.

    Args:
        roadmap: to add them to.
        count: how many.
        rng: source of randomness.
        settings: numbers that a person may change.
        seconds_left: asked before each part, which begins only if it is expected to come to its end.
        report: called after each part.

    Returns:
        How many of ``count`` were dealt with; fewer if the time was up.

    Raises:
        ConfigurationError: no free place for the robot.
    """
    placed, part = 0, SMALLEST
    while placed < count:
        begin = perf_counter()
        part = min(part, count - placed)
        _spread(roadmap, part, rng, settings)
        placed += part
        if report is not None:
            report()
        took, part = (perf_counter() - begin) / part, placed
        if placed < count and 0.5 * NEXT * took * min(part, count - placed) > seconds_left():
            break
    return placed


def _spread(roadmap: Roadmap, count: int, rng: np.random.Generator, settings: PlannerSettings) -> None:
    checker, radius = roadmap.checker, roadmap.motion.radius
    wanted = settings.samples_per_landmark * count
    drawn = DRAWN * wanted if len(roadmap) else wanted
    samples = free_samples(checker, drawn, method="halton", random_state=rng)
    if len(samples) == 0:
        raise ConfigurationError(f"world {checker.world.name!r}: no free place for the robot was found")
    if len(roadmap):
        kept = max(count, int(FARTHEST * len(samples)))
        samples = farthest_samples(samples, roadmap.configurations, kept, radius=radius)
    # Landmarks come in the samples' order, and what is near in space is looked at together from here on.
    samples = samples[cKDTree(se2.embed(samples, radius)).indices]
    roadmap.add(k_means_landmarks(samples, count, radius=radius, steps=settings.spread_steps, random_state=rng))


def _joined(relaxation: Relaxation, pairs: se2.FloatArray, seconds_left: Callable[[], float]) -> np.ndarray:
    """Return which of the pairs, shape (n, 2, 3), the relaxed problem may join, shape (n,), as far as there is time."""
    cells = relaxation.cells(relaxation.disc_centers(pairs))
    part = np.full(len(pairs), -1)
    joined = np.zeros(len(pairs), dtype=np.bool_)
    for i in range(len(pairs)):
        if part[i] < 0 and seconds_left() > 0.0:
            reached = relaxation.component(pairs[i, 0])
            part[(part < 0) & reached[cells[:, 0]]] = i
            # Pairs of this part are decided at once: hardly any world has more than a few.
            of_part = part == i
            joined[of_part] = reached[cells[of_part, 1]]
            part[i] = i
    return joined


def _costs(graph: RoadmapSnapshot, pairs: se2.FloatArray, seconds_left: Callable[[], float]) -> se2.FloatArray:
    """Return the cost of each pair's path, shape (n,), metres; infinite where there is none, or no time is left."""
    costs = np.full(len(pairs), np.inf)
    for i, (start, goal) in enumerate(pairs):
        if seconds_left() <= 0.0:
            break
        states = graph.find_path(start, goal)
        if states is not None:
            costs[i] = graph.motion.cost_of(states)
    return costs
