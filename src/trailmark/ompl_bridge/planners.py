"""OMPL's planners by name, with whatever the installed OMPL binds."""

from __future__ import annotations

from typing import Any

from ompl import base as ob
from ompl import geometric as og

from trailmark.errors import expected_name
from trailmark.ompl_bridge.errors import PlannerNameError

__all__ = ["planner_named", "planner_names"]


def planner_names() -> list[str]:
    """Return the names of all geometric planners that the installed OMPL binds, sorted."""
    return sorted(
        name
        for name, kind in vars(og).items()
        if isinstance(kind, type) and issubclass(kind, ob.Planner) and name[0].isupper()
    )


def planner_named(name: str, information: Any) -> Any:
    """Return one of OMPL's planners.

    Args:
        name: such as ``RRTConnect``; upper and lower case do not matter.
        information: the ``SpaceInformation`` to plan with.

    Raises:
        PlannerNameError: the installed OMPL has no planner of that name.
    """
    names = planner_names()
    for known in names:
        if known.lower() == name.lower():
            return getattr(og, known)(information)
    raise PlannerNameError(f"planner: {expected_name(name, names)}")
