"""Scene: what a picture is of, and the words that stand beside it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from trailmark import se2
from trailmark.errors import ConfigurationError
from trailmark.world import Robot, World

if TYPE_CHECKING:
    from trailmark.path import Path
    from trailmark.planning import PlanResult
    from trailmark.roadmap import Roadmap

__all__ = ["Scene", "plan_facts", "scene_of", "world_facts"]


@dataclass(frozen=True)
class Scene:
    """What a picture is of.

    Attributes:
        title: a name.
        facts: a line about it.
        world: None for a robot on its own.
        robot: None if there is none.
        roadmap: None if there is none.
        path: None if there is none.
        start: configuration; None if there is none.
        goal: configuration, or goals; None if there is none.
        queries: whether the world's queries belong to it.
    """

    title: str
    facts: str
    world: World | None = None
    robot: Robot | None = None
    roadmap: Roadmap | None = None
    path: Path | None = None
    start: tuple[float, float, float] | None = None
    goal: Any = None
    queries: bool = False


def scene_of(shown: object, robot: Robot | None = None, roadmap: Roadmap | None = None) -> Scene:
    """Return the picture of a world, a robot, a roadmap or a result.

    Args:
        shown: what is shown.
        robot: in the place of its own.
        roadmap: shown as well.

    Raises:
        ConfigurationError: something else, or a result that does not know its world and robot.
    """
    if isinstance(shown, Robot):
        return Scene("robot", shown.describe(), robot=shown)
    if isinstance(shown, World):
        body = robot or shown.robot
        return Scene(shown.name, world_facts(shown), shown, body, roadmap, queries=True)
    # Later, since these bring in all that plans.
    from trailmark.planning import PlanResult
    from trailmark.roadmap import Roadmap

    if isinstance(shown, Roadmap):
        world, body = shown.checker.world, robot or shown.checker.robot
        facts = f"{len(shown):,} landmarks · {len(shown.edges):,} edges · {body.describe()}"
        return Scene(world.name, facts, world, body, shown)
    if not isinstance(shown, PlanResult) or shown.world is None or shown.robot is None:
        raise ConfigurationError(f"picture: expected a result that knows its world and robot, got {shown!r:.80}")
    body = robot or shown.robot
    facts = plan_facts(shown, body)
    return Scene(shown.world.name, facts, shown.world, body, roadmap, shown.path, shown.start, shown.target)


def world_facts(world: World) -> str:
    """Return size, obstacles, queries and robot of a world in a line."""
    facts = [f"{world.bounds[2] - world.bounds[0]:g} × {world.bounds[3] - world.bounds[1]:g} m"]
    facts.append(f"{len(world.obstacles):,} obstacle{'' if len(world.obstacles) == 1 else 's'}")
    facts.append(f"{len(world.queries):,} quer{'y' if len(world.queries) == 1 else 'ies'}")
    facts.append(world.robot.describe() if world.robot else "no robot")
    return " · ".join(facts)


def plan_facts(result: PlanResult, robot: Robot) -> str:
    """Return what a plan found in a line: cost, length, turning, time and robot."""
    from trailmark.curves import CurvePath

    seconds = f"{result.time.get('total') or math.nan:.3g} s"
    if result.path is not None:
        path = result.path
        facts = f"cost {path.cost:.4g} = {path.length:.4g} m + {se2.ROTATION_WEIGHT:g} × {path.rotation:.3g} rad"
        if result.objective is not None or result.goal is not None:
            # Not the sum of length and turning alone.
            facts = f"cost {result.cost:.4g}, {path.length:.4g} m, {path.rotation:.3g} rad"
        if isinstance(path, CurvePath):
            facts = f"{path.length:.4g} m, {path.cusps} changes of direction"
        return f"{facts} · {seconds} · {robot.describe()}"
    why = "no path exists (proven)" if result.status == "infeasible" else f"no path found in {seconds}"
    return f"{why} · {robot.describe()}"
