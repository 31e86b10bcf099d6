"""Verification: what leaves the planner, paths and bounds, is checked in the form in which it is returned."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter

import numpy as np

from trailmark.collision import StateChecker
from trailmark.curves import CurvePath
from trailmark.motion import Motion
from trailmark.motion.one_way import straight_valid
from trailmark.path import Path
from trailmark.planning.proofs.claims import contradicted
from trailmark.planning.query import Incumbent, OnProgress, report_error, vertices_of
from trailmark.planning.result import PlanProgress, PlanResult, Status
from trailmark.roadmap import Roadmap
from trailmark.se2 import FloatArray
from trailmark.verify import RIM, Verifier

__all__ = ["Verification"]

WITHIN = 1e-3
"""Metres by which the least clearance along a path may be less than the one reported."""


class Verification:
    """Checks what is about to be returned, and makes the results."""

    def __init__(self, checker: StateChecker, motion: Motion, seed: int) -> None:
        self.checker, self.motion, self.seed = checker, motion, seed
        self.world, self.robot = checker.world, checker.robot
        self.verifier = Verifier(self.world, self.robot, RIM)

    def certified(self, path: Path, ends: FloatArray) -> bool:
        """Return whether a path from one end to the other, (2, 3), passes the final check; report it if not."""
        fault = self.verifier.fault(path, *ends)
        if fault is not None:
            self._report(f"a path that was found is not free: {fault}", path, ends)
        return fault is None

    def progress(self, on_progress: OnProgress, ends: FloatArray) -> OnProgress:
        """Return a callback that hands on paths between the ends (2, 3) only once they passed the final check."""
        passed: Path | None = None

        def hand_on(progress: PlanProgress) -> None:
            nonlocal passed
            path = progress.path
            if path is not None and path != passed:
                if self.verifier.fault(path, *ends) is None:
                    passed = path
                else:
                    # At the end it is reported, unless a better path has taken its place.
                    progress = replace(progress, path=None, cost=None)
            if progress.path is not None:
                progress = replace(progress, path=self.followed_by_lines(progress.path))
            on_progress(progress)

        return hand_on

    def result(
        self, incumbent: Incumbent, status: Status, path: Path | None, roadmap: Roadmap, build: float = 0.0
    ) -> PlanResult:
        """Return the result of a query."""
        cost, error = self.cost(path, incumbent)
        return PlanResult(
            status=status,
            path=None if path is None else self.followed_by_lines(path),
            seed=self.seed,
            lower_bound=None if status == "infeasible" else self._lower_bound(incumbent, path, cost, error),
            charged=cost,
            cost_error=error,
            objective=self.motion.objective,
            first_cost=incumbent.first_cost,
            min_clearance=None if path is None else self.least_clearance(path),
            landmarks=len(roadmap),
            edges=int(np.count_nonzero(roadmap.status)),
            nearest=None if path is not None else self._nearest(incumbent),
            history=tuple(incumbent.history),
            clearance=self.robot.clearance,
            time={
                "load": 0.0,
                "build": build,
                "first_solution": incumbent.history[0][0] if incumbent.history else None,
                "total": perf_counter() - incumbent.begin,
            },
            world=self.world,
            robot=self.robot,
            start=tuple(incumbent.start.tolist()),
            target=tuple(incumbent.goal.tolist()),
        )

    def followed_by_lines(self, path: Path, leaves: bool = False) -> Path:
        """Return a path that passed the check, a car's with states that straight motions join: programs do so.

        Where it ``leaves`` obstacles, its first states are not valid: motions from and to such states stay as they are.
        """
        if not isinstance(path, CurvePath):
            return path
        lines = straight_valid(self.checker)
        if not leaves:
            return path.refined(lines)
        valid = self.checker.states_free
        return path.refined(lambda a, b: ~valid(a) | ~valid(b) | lines(a, b))

    def least_clearance(self, path: Path) -> float:
        """Return the least clearance (metres) along a path; the true one is at most 1 mm less."""
        return self.verifier.clearance(self.verifier.motions(path), WITHIN)[0]

    def cost(self, path: Path | None, incumbent: Incumbent) -> tuple[float | None, float]:
        """Return a path's cost under the objective, as it is reported, and a bound on its error."""
        if path is None:
            return None, 0.0
        if self.motion.objective is None:
            return path.cost, 0.0
        cost, error = self.motion.cost_within(vertices_of(self.motion, path))
        return self.motion.whole_cost(cost, incumbent.start, incumbent.goal), error

    def _nearest(self, incumbent: Incumbent) -> Path | None:
        """Return the path that ends nearest to the goal, if one was found and it passes the final check."""
        if incumbent.nearest is None:
            return None
        path = self.motion.path(incumbent.nearest)
        certified = self.certified(path, np.array([incumbent.start, path.states[-1]]))
        return self.followed_by_lines(path) if certified else None

    def _lower_bound(self, incumbent: Incumbent, path: Path | None, cost: float | None, error: float) -> float:
        """Return the bound that was proven; one above the path's cost is reported as an error instead."""
        if path is None or cost is None or not contradicted(incumbent.lower_bound, cost + error):
            # Where the two meet, the cost may be a little below the bound by its error.
            return incumbent.lower_bound if cost is None else min(incumbent.lower_bound, cost)
        ends = np.array([incumbent.start, incumbent.goal])
        problem = f"a lower bound of {incumbent.lower_bound:g} m is above the cost of a path, {cost:g} m"
        self._report(problem, path, ends)
        return self.motion.least_cost(*ends)

    def _report(self, problem: str, path: Path, ends: FloatArray) -> None:
        states = path.knots if isinstance(path, CurvePath) else path.states
        report_error(problem, self.world, self.robot, *ends, seed=self.seed, states=states.tolist())
