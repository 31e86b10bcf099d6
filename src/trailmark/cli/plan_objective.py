"""What a path costs, on the command line: ``--objective``, and the rows of the summary that say so."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any

from trailmark.cli.options import UsageError, option, read_number

if TYPE_CHECKING:
    from trailmark.cli.plan_trajectory import Timing
    from trailmark.objective import Objective
    from trailmark.robot import Robot

__all__ = [
    "DirectionChangeCostOption",
    "ObjectiveOption",
    "ReverseCostOption",
    "objective_rows",
    "read_objective",
]

ObjectiveOption = Annotated[
    str | None,
    option(
        "--objective",
        "NAME",
        "What a path costs: length, time (see --max-speed, --max-turn-rate), clearance (length, dearer near "
        "obstacles), or weights such as length=1,clearance=3,decay=0.4. Default: length, and a car's maneuvers.",
    ),
]
ReverseCostOption = Annotated[
    str | None,
    option("--reverse-cost", "FACTOR", "A car's metre in reverse counts so many times; default: 1.5, by length 1."),
]
DirectionChangeCostOption = Annotated[
    str | None,
    option("--direction-change-cost", "METRES", "Of a car's change of direction; default: 3, by length 0."),
]


def read_objective(
    text: str | None, timing: Timing, reverse_cost: str | None, direction_change_cost: str | None
) -> Callable[[Robot], Objective]:
    """Return what makes the objective that ``--objective`` names for a robot; speeds are those of the time law.

    Raises:
        UsageError: another name, or a weight that is no number; for a robot, costs of what it does not do.
    """
    from trailmark.errors import ConfigurationError
    from trailmark.objective import Objective

    speed, _, turn_rate, _ = timing.limits
    given: dict[str, float] = {}
    if reverse_cost is not None:
        given["reverse"] = read_number(reverse_cost, "--reverse-cost", "a factor from 1 to 1e6", low=1.0, high=1e6)
    if direction_change_cost is not None:
        flag = "--direction-change-cost"
        given["direction_change"] = read_number(direction_change_cost, flag, "metres, from 0 to 1e6", low=0.0, high=1e6)

    def objective(robot: Robot | None) -> Objective:
        return Objective.of(text, robot, max_speed=speed, max_turn_rate=turn_rate, **given)

    try:
        objective(None)
    except ConfigurationError as error:
        raise UsageError(f"--objective {text!r}: {str(error).removeprefix('objective: ')}") from None

    def objective_of(robot: Robot) -> Objective:
        if given and (robot.turning_radius is None or not robot.reverse):
            flag = "--reverse-cost" if "reverse" in given else "--direction-change-cost"
            raise UsageError(f"{flag}: expected a car that reverses (--turning-radius), got {robot.describe()}")
        return objective(robot)

    return objective_of


def objective_rows(record: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the summary's row about an objective other than length."""
    objective = record.get("objective")
    if objective is None:
        return []
    weights = [f"{name} {objective[name]:g}" for name in ("length", "time", "clearance") if objective[name]]
    if "direction_changes" in record:
        weights += [f"metres in reverse {objective['reverse']:g} times"] if objective["reverse"] > 1.0 else []
        weights += (
            [f"a change of direction {objective['direction_change']:g} m"] if objective["direction_change"] else []
        )
    error = f"; the cost is known to {record['cost_error']:.2g}" if record["cost_error"] else ""
    return [("objective", ", ".join(weights) + error)]
