"""``trailmark plan --confidence``: the cheapest path found among those that meet a true obstacle seldom enough."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from trailmark.cli.options import UsageError
from trailmark.errors import ConfigurationError
from trailmark.estimation import spend_risk

if TYPE_CHECKING:
    from trailmark.planning import LandmarkPlanner, PlanResult
    from trailmark.se2 import FloatArray
    from trailmark.world import Robot, World

__all__ = ["Answer", "plan_at_confidence"]

ROUNDS = 6
"""Plans at most: the growth is known to a sixteenth of what even shares of the risk ask for."""

FIRST_SHARE = 0.4
"""Of the time limit, for the first plan; the others share the rest. They begin where less is in the way."""

STEP = 0.05
"""Radians by which a car turns between two places at which its path is looked at, at most."""


class Answer(NamedTuple):
    """A plan, what it was planned in, and what ``--json`` says of its risk."""

    world: World
    planner: LandmarkPlanner
    result: PlanResult
    risk: dict[str, Any]


def plan_at_confidence(
    world: World,
    robot: Robot,
    confidence: float,
    solve: Callable[[World, float], tuple[LandmarkPlanner, PlanResult]],
    time_limit: float,
    seed: int,
) -> Answer:
    """Return the plan whose path meets a true obstacle with probability 1 − confidence at most.

    Args:
        world: with estimates.
        robot: that drives.
        confidence: above 0 and below 1.
        solve: plans in a world, for so many seconds.
        time_limit: seconds for all plans together.
        seed: of the obstacles' draws.

    Raises:
        ConfigurationError: start or goal is not valid in any of the worlds that were tried.
    """
    if not any(estimate is not None for estimate in world.estimates):
        problem = "given for a world without estimates; expected one made by trailmark map"
        raise UsageError(f"--confidence {confidence:g} {problem}")
    if world.not_certified is not None:
        raise UsageError(f"--confidence {confidence:g} given for a world that is not certified: {world.not_certified}")
    answers: list[tuple[World, LandmarkPlanner, PlanResult]] = []
    problems: list[ConfigurationError] = []
    step, margin = np.inf, 0.0
    if robot.turning_radius is not None:
        step = STEP * robot.turning_radius
        margin = step**2 / (8.0 * robot.turning_radius)

    def plan(grown: World) -> tuple[FloatArray, float] | None:
        seconds = time_limit * (FIRST_SHARE if not answers else (1.0 - FIRST_SHARE) / (ROUNDS - 1))
        try:
            planner, result = solve(grown, seconds)
        except ConfigurationError as problem:
            # An end lies in a grown obstacle, not in what was measured.
            problems.append(problem)
            return None
        answers.append((grown, planner, result))
        if result.path is None:
            return None
        path = result.path if margin == 0.0 else result.path.resample(step)
        return path.states, result.path.cost

    spent = spend_risk(world.with_robot(robot), plan, confidence, rounds=ROUNDS, seed=seed, margin=margin)
    if not answers:
        raise problems[-1]
    risk: dict[str, Any] = {"confidence": confidence, "probability": None, "upper_bound": None, "growth": None}
    chosen = answers[-1]
    if spent.risk is not None:
        chosen = next(answer for answer in answers if answer[0] is spent.world)
        # Past obstacles grown by their full shares of the risk, Boole's inequality alone keeps the promise.
        upper = min(spent.risk.upper_bound, 1.0 - confidence)
        risk |= {"probability": spent.risk.probability, "upper_bound": upper, "growth": spent.scale}
    grown, planner, result = chosen
    seconds = {**result.time, "total": sum(answer[2].time["total"] or 0.0 for answer in answers)}
    result = replace(result, lower_bound=None, time=seconds)
    if spent.risk is None:
        # The last path, if there is one, risks too much. Nor is it proven that none risks little enough.
        risky = f"no path was found that meets a true obstacle with probability {1.0 - confidence:.2g} at most"
        result = replace(
            result,
            status="timeout",
            path=None,
            first_cost=None,
            min_clearance=None,
            history=(),
            reason=result.reason or risky,
        )
    return Answer(grown, planner, result, risk)
