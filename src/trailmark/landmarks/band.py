"""Band: samples where a short path is likely, in the cells on short paths of the relaxed problem."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.landmarks.relaxation import CostMap, Relaxation
from trailmark.landmarks.retraction import retract_all
from trailmark.se2 import FloatArray

__all__ = ["Band"]

FORWARD, BACKWARD, BETWEEN = 0.3, 0.1, 0.3
"""Shares of the headings drawn along the relaxed path, opposite to it, and between the headings of the ends; the rest
are uniform."""

SPREAD = 0.3
"""Largest standard deviation (radians) of the headings that are not uniform."""

LOOKAHEAD = 4
"""Cells along the relaxed path over which its direction is measured."""

FIRST_WIDENING, LATER_WIDENING = 0.15, 0.8
"""Width of the band whose cells are found at first, and when a wider one is needed; after that, all cells."""

TRIES = 24
"""Configurations tried in each cell of the relaxed shortest path for a guide."""


class Band:
    """The cells on paths from start to goal whose cost is at most (1 + ε) times the lowest.

    Args:
        checker: decides what is valid.
        relaxation: its grid.
        start: configuration, shape (3,).
        goal: configuration, shape (3,).

    Attributes:
        shortest: cost (metres) of the relaxed shortest path; infinite if there is none, which proves that the
            robot cannot get from start to goal.
    """

    def __init__(self, checker: StateChecker, relaxation: Relaxation, start: FloatArray, goal: FloatArray) -> None:
        self.checker = checker
        self.relaxation = relaxation
        self.start, self.goal = start, goal
        self._compute(FIRST_WIDENING)

    def refine(self) -> bool:
        """Solve the relaxed problem again, on cells half as large; return False if the grid is the finest."""
        finer = self.relaxation.finer()
        if finer is None:
            return False
        self.relaxation = finer
        self._compute(FIRST_WIDENING)
        return True

    def _compute(self, widening: float) -> None:
        """Find the cells of all bands up to a width."""
        relaxation = self.relaxation
        to_goal = relaxation.costs_from(self.goal, target=self.start, widening=widening)
        self.to_goal: CostMap = to_goal
        self.shortest = float(relaxation.cost_at(to_goal, self.start))
        if not np.isfinite(self.shortest):
            return
        self.from_start = from_start = relaxation.costs_from(self.start)
        total = from_start.cost.ravel() + to_goal.cost.ravel()
        self._cells = np.flatnonzero(np.isfinite(total) & (total <= to_goal.limit))
        self._total = total[self._cells]
        self._share = from_start.cost.ravel()[self._cells] / np.maximum(self._total, 1e-9)
        # A tighter place needs more landmarks, and K-means leaves out tight places first.
        spare = np.maximum(relaxation.clearance(self._cells) - relaxation.radius, 0.0)
        self._weight = 1.0 / (spare + 0.25 * self.checker.footprint.circumradius)
        self._directions = self._path_directions(self._cells)

    def _path_directions(self, cells: NDArray[np.int64]) -> FloatArray:
        """Return the heading (radians) of the relaxed path to the goal in each cell, shape (n,)."""
        later = self.relaxation.follow(self.to_goal, cells, LOOKAHEAD)
        step = self.relaxation.cell_centers(later) - self.relaxation.cell_centers(cells)
        return np.asarray(np.where(later == cells, self.goal[2], np.arctan2(step[:, 1], step[:, 0])))

    def widen(self, widening: float) -> None:
        """Find the cells of the band of width ε = ``widening`` if they are not known yet."""
        if (1.0 + widening) * self.shortest > self.to_goal.limit:
            self._compute(LATER_WIDENING if widening <= LATER_WIDENING else np.inf)

    def costs_to_goal(self, q: FloatArray) -> FloatArray:
        """Return an estimate (metres) of the cost from configurations (n, 3) to the goal, shape (n,).

        It guides the search and proves nothing: cells that are tight for the disc cost more than their length.
        """
        return self._estimate(self.to_goal, q, self.goal)

    def costs_to_start(self, q: FloatArray) -> FloatArray:
        """Return an estimate (metres) of the cost from the start to configurations (n, 3), shape (n,)."""
        return self._estimate(self.from_start, q, self.start)

    def _estimate(self, costs: CostMap, q: FloatArray, end: FloatArray) -> FloatArray:
        relaxed = self.relaxation.cost_at(costs, q)
        # Eight directions overestimate lengths by up to 8.3 %, and cells by up to a diagonal at either end.
        estimate = np.where(np.isfinite(relaxed), relaxed / 1.0824 - 3.0 * self.relaxation.size, 0.0)
        return np.asarray(np.maximum(estimate, np.hypot(*(q[:, :2] - end[:2]).T)))

    def guides(self, rng: np.random.Generator) -> tuple[FloatArray, bool]:
        """Return valid configurations along the relaxed shortest path, shape (n, 3), and whether they form a path.

        They are about as far apart as their clearance, each the one with the largest clearance among several tries in
        its cell; where two of them are not joined by a certified motion, all valid tries between them are returned too.
        """
        path = self.relaxation.shortest_path(self.to_goal, self.start)
        cell = np.repeat(np.arange(len(path)), TRIES)
        q = self._place(path[cell], self._path_directions(path)[cell], cell / max(1, len(path) - 1), rng)
        reach = self.checker.footprint.circumradius
        # Only half of the tries: the field's clearances may be wrong by its slack.
        tight = self.relaxation.clearance(path)[cell] < 1.5 * reach
        tight[::2] = False
        q[tight] = retract_all(self.checker, q[tight], 0.75 * self.relaxation.size)
        clearance = np.where(self.checker.valid(q), self.checker.clearance(q, cap=2.0 * reach), -1.0)
        best = np.arange(len(path)) * TRIES + clearance.reshape(-1, TRIES).argmax(axis=1)
        chain: list[int] = []
        for i in best[clearance[best] >= 0.0].tolist():
            if not chain or np.hypot(*(q[i, :2] - q[chain[-1], :2])) >= min(clearance[i], clearance[chain[-1]]):
                chain.append(i)
        if not chain:
            return np.empty((0, 3)), False
        joined = self.checker.motions_between_valid(q[chain[:-1]], q[chain[1:]])
        gap = np.zeros(len(path), dtype=np.bool_)
        for a, b in zip(cell[chain[:-1]][~joined], cell[chain[1:]][~joined], strict=True):
            gap[max(0, a - 1) : b + 2] = True
        return np.vstack([q[chain], q[gap[cell] & (clearance >= 0.0)]]), bool(joined.all())

    def samples(self, n: int, widening: float, rng: np.random.Generator) -> FloatArray:
        """Return up to n valid configurations from the band, shape (m, 3).

        Args:
            n: how many are wanted.
            widening: ε; infinity includes every cell that the disc can reach.
            rng: source of randomness.
        """
        self.widen(widening)
        chosen = np.flatnonzero(self._total <= (1.0 + widening) * self.shortest + 2.0 * self.relaxation.size)
        cumulative = np.cumsum(self._weight[chosen])
        found, have = [np.empty((0, 3))], 0
        for _ in range(8):
            draws = max(64, 2 * (n - have))
            picked = chosen[np.searchsorted(cumulative, rng.random(draws) * cumulative[-1], side="right")]
            q = self._place(self._cells[picked], self._directions[picked], self._share[picked], rng)
            q = q[self.checker.valid(q)]
            found.append(q)
            have += len(q)
            if have >= n:
                break
        return np.concatenate(found)[:n]

    def samples_near(self, q: FloatArray, reach: float, n: int, rng: np.random.Generator) -> FloatArray:
        """Return valid configurations, shape (m, 3), m <= 2 n, near q, shape (3,).

        Half of the tries put the disc within ``reach`` metres of q's, in cells of the band and with the band's
        headings; half move q itself, at all scales below ``reach``, since in a passage hardly wider than the robot only
        small moves succeed.
        """
        turning = self.checker.footprint.sweep_radius
        scale = reach * 2.0 ** -rng.uniform(0.0, 5.0, (n, 1)) / (1.0, 1.0, turning or np.inf)
        moved = q + rng.standard_normal((n, 3)) * scale
        moved[:, 2] = se2.wrap(moved[:, 2])
        around = self.relaxation.disc_centers(q) + rng.uniform(-reach, reach, (n, 2))
        cells = self.relaxation.cells(around)
        from_start, to_goal = self.from_start.cost.ravel()[cells], self.to_goal.cost.ravel()[cells]
        known = np.isfinite(from_start + to_goal)
        cells, share = cells[known], from_start[known] / np.maximum(from_start[known] + to_goal[known], 1e-9)
        found = np.vstack([self._place(cells, self._path_directions(cells), share, rng), moved])
        found[::2] = retract_all(self.checker, found[::2], 0.375 * reach)
        return np.asarray(found[self.checker.valid(found)])

    def nearest_to_goal(self, q: FloatArray) -> int:
        """Return which of the configurations (n, 3) is nearest to the goal along relaxed paths."""
        return int(np.argmin(self.relaxation.cost_at(self.to_goal, q)))

    def nearest_to_start(self, q: FloatArray) -> int:
        """Return which of the configurations (n, 3) is nearest to the start along relaxed paths."""
        return int(np.argmin(self.relaxation.cost_at(self.from_start, q)))

    def _place(
        self,
        cells: NDArray[np.int64],
        directions: FloatArray,
        share: FloatArray,
        rng: np.random.Generator,
    ) -> FloatArray:
        """Return one configuration per cell: a random point of it, a heading of one of four kinds."""
        relaxation, n = self.relaxation, len(cells)
        centers = relaxation.cell_centers(cells)
        centers += (rng.random(centers.shape) - 0.5) * relaxation.size
        if not self.checker.robot.heading_matters:
            return relaxation.references(centers, np.zeros(n))
        headings = rng.uniform(-np.pi, np.pi, n)
        # Deviations at all scales up to SPREAD: tight passages allow only small ones.
        kind, noise = rng.random(n), SPREAD * rng.standard_normal(n) * 2.0 ** -rng.uniform(0.0, 4.0, n)
        between = se2.interpolate(self.start, self.goal, share)[:, 2] + noise
        headings = np.where(kind < FORWARD + BACKWARD + BETWEEN, between, headings)
        headings = np.where(kind < FORWARD + BACKWARD, directions + np.pi + noise, headings)
        headings = np.where(kind < FORWARD, directions + noise, headings)
        return relaxation.references(centers, np.asarray(se2.wrap(headings)))
