"""CarAttempt: how one query of a car-like robot is answered, round by round."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision.curve_motions import CurveChecker
from trailmark.curves import CurvePath
from trailmark.landmarks.informed import Band
from trailmark.planning.attempt import (
    SWEEPS,
    Attempt,
)
from trailmark.planning.curve_shortening import shorten_curves, without_needless_knots
from trailmark.planning.drives import drives_from
from trailmark.roadmap import Roadmap
from trailmark.roadmap.curve_roadmap import CurveRoadmap
from trailmark.roadmap.roadmap import UNBOUNDED

__all__ = ["CarAttempt"]

LONGEST_DRIVE = 0.1
"""Turning radii: drives of the first round; those of later ones are half as long each time."""

DRIVES, KEPT = 6000, 80
"""Configurations that drives from one part of the roadmap reach at first, and landmarks among them."""


SECONDS_A_CURVE = 2e-5
"""What a node or a curve of the roadmap that a search looks at may take."""

SECONDS_A_DRIVE = 1e-4
"""What a configuration reached by a drive may take, with some to spare."""


class CarAttempt(Attempt):
    """One query of a car-like robot under way: its ends, its best path so far, its clock.

    Curves take the place of straight motions; and where landmarks alone do not join the ends, drives from both of them
    do (:mod:`trailmark.planning.drives`). Paths are told by their knots. Arguments are those of
    :class:`trailmark.planning.attempt.Attempt`, with a roadmap of curves.
    """

    roadmap: CurveRoadmap
    sought: CurveRoadmap

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.steering = self.roadmap.steering
        # A round car has a heading too.
        self.turning = True
        self.motions = CurveChecker(self.checker, self.steering)

    def _least_cost(self) -> float:
        """Return the length of the shortest curve without obstacles, metres."""
        return float(self.roadmap.steering.lengths(self.start, self.goal))

    def _straight(self, ends: se2.FloatArray) -> bool:
        """Return whether the shortest curve leads from start to goal."""
        return bool(self.motions.motions_between_valid(ends[:1], ends[1:])[0])

    def _scout(self, ends: se2.FloatArray) -> None:
        """A lattice's motions are not a car's."""

    def _guides(self, band: Band, rounds: int) -> se2.FloatArray:  # the same in every round
        return band.guides(self.rng)[0]

    def _join(self, band: Band, nodes: NDArray[np.int64], rounds: int) -> None:
        self._drive(band, nodes, LONGEST_DRIVE * self.steering.radius * 0.5**rounds, DRIVES << min(rounds, 6))

    @property
    def _turning_radius(self) -> float:
        """How far (metres) a radian of heading counts among landmarks: as far as the car drives to turn by it."""
        return self.steering.radius

    def _drive(self, band: Band, nodes: NDArray[np.int64], step: float, most: int) -> None:
        """Drive on from what the start leads to, and towards what leads to the goal, and search again."""
        self._report("driving")
        band.widen(np.inf)
        for into in (False, True):
            most = int(min(most, max(0.0, self._time_left()) / SECONDS_A_DRIVE))
            reached = np.flatnonzero(self.sought.reached(int(nodes[int(into)]), against=into))
            found = drives_from(
                self.motions,
                band.relaxation,
                band.from_start if into else band.to_goal,
                self.sought.configurations[reached],
                into=into,
                step=step,
                most=most,
                landmarks=KEPT,
                rng=self.rng,
            )
            parents = np.concatenate([reached, len(self.sought) + np.arange(len(found.parents))])[found.parents]
            self.sought.add_tree(found.configurations, parents, into=into)
            self._search(self.sought, band, nodes)
            if self.best is not None or self._time_left() <= 0.0:
                return

    def _search(
        self, roadmap: Roadmap, band: Band | None, nodes: NDArray[np.int64], banned: NDArray[np.bool_] | None = None
    ) -> None:
        """Offer a roadmap's shortest path, shortened."""
        to_go = roadmap.distances_to(int(nodes[1]))
        if band is not None and self.best is None:
            # The relaxed way guides to a first path soon; it may overestimate.
            to_go = np.maximum(to_go, band.costs_to_goal(roadmap.configurations))
        limit = np.inf if banned is not None else self.best_cost
        budget = int(min(UNBOUNDED, max(0.0, self._time_left()) / SECONDS_A_CURVE))
        found = roadmap.shortest_path(
            int(nodes[0]), int(nodes[1]), to_go=to_go, banned=banned, limit=limit, budget=budget
        )
        self._take(roadmap.configurations[found.nodes])

    def _approach(self, nodes: NDArray[np.int64]) -> se2.FloatArray:
        """Return the knots of the shortest path from the start to the node, of those reached, nearest to the goal."""
        start, goal, sought = int(nodes[0]), int(nodes[1]), self.sought
        q = sought.configurations
        reached = np.flatnonzero(sought.reached(start))
        last = int(reached[np.argmin(se2.distance(q[reached], q[goal]))])
        return np.asarray(q[sought.shortest_path(start, last).nodes])

    def _shortened(self, states: se2.FloatArray, sweeps: int = SWEEPS, *, splitting: bool = False) -> se2.FloatArray:
        """Return a path made shorter; no knots are added, which would cost a curve more than they gain."""
        return shorten_curves(self.motions, states, self.rng, sweeps=sweeps, stop=self._no_sweep())

    def _without_needless(self, states: se2.FloatArray) -> se2.FloatArray:
        """Return a path without the knots that it does without."""
        return without_needless_knots(self.motions, states)

    def _cost(self, states: se2.FloatArray) -> float:
        return float(np.sum(self.steering.lengths(states[:-1], states[1:])))

    def _path(self, states: se2.FloatArray) -> CurvePath:
        return CurvePath(states, self.steering)
