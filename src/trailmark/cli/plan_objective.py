"""What a path costs, on the command line: ``--objective``, and the rows of the summary that say so."""

# Tested by tests/cli/test_plan_objective.py.

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from trailmark.cli.options import UsageError, option

if TYPE_CHECKING:
    from trailmark.cli.plan_trajectory import Timing
    from trailmark.objective import Objective

__all__ = ["ObjectiveOption", "objective_rows", "read_objective"]

ObjectiveOption = Annotated[
    str,
    option(
        "--objective",
        "NAME",
        "What a path costs: length, time (see --max-speed, --max-turn-rate), clearance (length, dearer near obstacles), "
        "or weights such as length=1,clearance=3,decay=0.4.",
        default=True,
    ),
]


def read_objective(text: str, timing: Timing) -> Objective:
    """Return the objective that ``--objective`` names; speeds are those of the time law.

    Raises:
        UsageError: another name, or a weight that is no number.
    """
    from trailmark.errors import ConfigurationError
    from trailmark.objective import Objective

    speed, _, turn_rate, _ = timing.limits
    try:
        return Objective.of(text, max_speed=speed, max_turn_rate=turn_rate)
    except ConfigurationError as error:
        raise UsageError(f"--objective {text!r}: {str(error).removeprefix('objective: ')}") from None


def objective_rows(record: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the summary's row about an objective other than length."""
    objective = record.get("objective")
    if objective is None:
        return []
    weights = ", ".join(f"{name} {objective[name]:g}" for name in ("length", "time", "clearance") if objective[name])
    return [("objective", f"{weights}; the cost is known to {record['cost_error']:.2g}")]
