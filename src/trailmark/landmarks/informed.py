"""Samples where a short path is likely: in the band of cells through which the relaxed problem's good ways go."""

from __future__ import annotations

import numpy as np

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.landmarks.relaxation import CostMap, Relaxation

__all__ = ["Band"]

# Shares of the headings that are drawn along the way, against it, between the ends' headings; the rest uniform.
ALONG, AGAINST, BETWEEN = 0.3, 0.1, 0.3
SPREAD = 0.2
"""Standard deviation (radians) of the headings that are not uniform."""


class Band:
    """The cells that lie on ways from start to goal at most (1 + ε) times as long as the shortest.

    Args:
        checker: decides what is valid.
        relaxation: its grid.
        start: configuration, shape (3,).
        goal: configuration, shape (3,).

    Attributes:
        shortest: cost (metres) of the relaxed shortest way; infinite if there is none, which proves that the
            robot cannot get from start to goal.
    """

    def __init__(
        self, checker: StateChecker, relaxation: Relaxation, start: se2.FloatArray, goal: se2.FloatArray
    ) -> None:
        self.checker = checker
        self.relaxation = relaxation
        self.start, self.goal = start, goal
        self.to_goal: CostMap = relaxation.costs_from(goal)
        row, column = relaxation.cells(relaxation.disc_centers(start))
        self.shortest = float(self.to_goal.cost[row, column])
        if not np.isfinite(self.shortest):
            return
        from_start = relaxation.costs_from(start)
        total = from_start.cost + self.to_goal.cost
        self._cells = np.flatnonzero(np.isfinite(total))
        self._total = total.ravel()[self._cells]
        self._share = from_start.cost.ravel()[self._cells] / np.maximum(self._total, 1e-9)
        # The tighter a place, the more landmarks it needs: K-means would thin out just these.
        room = np.maximum(relaxation.clearance.ravel()[self._cells] - relaxation.radius, 0.0)
        self._weight = 1.0 / (room + 0.25 * checker.footprint.circumradius)
        toward = self.to_goal.parent.ravel()[self._cells].astype(np.float64)
        self._along = np.where(toward >= 0, toward * (np.pi / 4.0), goal[2])

    def costs_to_goal(self, q: se2.FloatArray) -> se2.FloatArray:
        """Return a lower estimate (metres) of the cost from configurations (n, 3) to the goal, shape (n,)."""
        rows, columns = self.relaxation.cells(self.relaxation.disc_centers(q))
        relaxed = self.to_goal.cost[rows, columns]
        # Eight directions overestimate lengths by up to 8.3 %, cells by up to a diagonal at either end.
        estimate = np.where(np.isfinite(relaxed), relaxed / 1.0824 - 3.0 * self.relaxation.size, 0.0)
        return np.maximum(estimate, np.hypot(*(q[:, :2] - self.goal[:2]).T))

    def guide(self) -> se2.FloatArray:
        """Return the relaxed shortest way as positions, shape (n, 2), from start to goal."""
        return self.relaxation.way(self.to_goal, self.start)

    def samples(self, n: int, widening: float, rng: np.random.Generator) -> se2.FloatArray:
        """Return up to n valid configurations from the band, shape (m, 3).

        Args:
            n: how many are wanted.
            widening: ε; infinite takes in every cell that the disc can reach.
            rng: source of randomness.
        """
        chosen = np.flatnonzero(self._total <= (1.0 + widening) * self.shortest + 2.0 * self.relaxation.size)
        cumulative = np.cumsum(self._weight[chosen])
        found, have = [np.empty((0, 3))], 0
        for _ in range(8):
            draws = max(64, 2 * (n - have))
            picked = chosen[np.searchsorted(cumulative, rng.random(draws) * cumulative[-1], side="right")]
            q = self._place(picked, rng)
            q = q[self.checker.valid(q)]
            found.append(q)
            have += len(q)
            if have >= n:
                break
        return np.concatenate(found)[:n]

    def _place(self, picked: np.ndarray, rng: np.random.Generator) -> se2.FloatArray:
        """Return one configuration per picked cell: a random point of the cell, a heading of one of four kinds."""
        relaxation = self.relaxation
        rows, columns = np.divmod(self._cells[picked], relaxation.columns)
        centers = relaxation.cell_centers(rows, columns)
        centers += (rng.random(centers.shape) - 0.5) * relaxation.size
        headings = rng.uniform(-np.pi, np.pi, len(picked))
        if self.checker.footprint.disc_radius > 0.0:
            return relaxation.references(centers, np.zeros(len(picked)))
        kind, noise = rng.random(len(picked)), SPREAD * rng.standard_normal(len(picked))
        along = self._along[picked] + noise
        between = se2.interpolate(self.start, self.goal, self._share[picked])[:, 2] + noise
        headings = np.where(kind < ALONG + AGAINST + BETWEEN, between, headings)
        headings = np.where(kind < ALONG + AGAINST, along + np.pi, headings)
        headings = np.where(kind < ALONG, along, headings)
        return relaxation.references(centers, np.asarray(se2.wrap(headings)))
