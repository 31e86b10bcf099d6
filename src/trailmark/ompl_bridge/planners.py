"""OMPL's planners and their parameters by name, with whatever the installed OMPL binds."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

from ompl import base as ob
from ompl import geometric as og

from trailmark.errors import expected_name
from trailmark.ompl_bridge.errors import PlannerNameError

__all__ = ["parameters_of", "planner_named", "planner_names", "set_parameters"]

OTHER_NAMES = {
    "AdmissibleCostToCome": "use_admissible_heuristic",
    "BatchSize": "ordering_batch_size",
    "CacheCC": "cache_cc",
    "ConsiderApproximateSolutions": "find_approximate_solutions",
    "DelayCC": "delay_collision_checking",
    "DelayRewiringUntilInitialSolution": "delay_rewiring_to_first_solution",
    "DropSamplesOnPrune": "drop_unconnected_samples_on_prune",
    "ExtendedFMT": "extended_fmt",
    "FailedExpansionCellScoreFactor": "failed_expansion_score_factor",
    "JustInTimeSampling": "use_just_in_time_sampling",
    "KNearest": "use_k_nearest",
    "NumSamplingAttempts": "number_sampling_attempts",
    "PruneThresholdFraction": "prune_threshold_as_fractional_cost_change",
    "Pruning": "use_graph_pruning",
    "StopOnSolnImprovement": "stop_on_each_solution_improvement",
    "StrictQueueOrdering": "use_strict_queue_ordering",
}
"""Setters whose parameter has another name in OMPL's ``declareParam`` than theirs in small letters."""

_SIGNATURE = re.compile(r"\(self, \w+: (float|int|bool)")


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


def parameters_of(planner: str) -> dict[str, tuple[str, type]]:
    """Return the parameters that the installed OMPL lets a planner be given, by name: setter and kind of value."""
    found = {}
    kind = getattr(og, planner)
    for name in dir(kind):
        signature = _SIGNATURE.search(getattr(kind, name).__doc__ or "") if name.startswith("set") else None
        if signature is not None:
            called = (
                OTHER_NAMES.get(name[3:]) or re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=K)(?=Nearest)", "_", name[3:]).lower()
            )
            found[called] = name, {"float": float, "int": int, "bool": bool}[signature.group(1)]
    return dict(sorted(found.items()))


def set_parameters(planner: str, given: Mapping[str, str]) -> Callable[[Any], None]:
    """Return a function that gives a planner these parameters.

    Args:
        planner: its class, by name.
        given: values as texts, by parameter; numbers, and ``true`` or ``false``.

    Raises:
        PlannerNameError: a name or a value that is not one of the planner's.
    """
    known = parameters_of(planner)
    calls = []
    for name, text in given.items():
        if name not in known:
            raise PlannerNameError(f"planner {planner}: parameter: {expected_name(name, known)}")
        setter, kind = known[name]
        calls.append((setter, _value(text, kind, f"planner {planner}: {name}")))

    def give(made: Any) -> None:
        for setter, value in calls:
            getattr(made, setter)(value)

    return give


def _value(text: str, kind: type, name: str) -> Any:
    if kind is bool:
        words = {"true": True, "1": True, "false": False, "0": False}
        if text.lower() not in words:
            raise PlannerNameError(f"{name}: expected true or false, got {text!r}")
        return words[text.lower()]
    expected = "a whole number, 0 or more" if kind is int else "a finite number, 0 or more"
    try:
        value = kind(text)
    except ValueError:
        value = -1
    if not 0 <= value < 2**31:
        raise PlannerNameError(f"{name}: expected {expected}, got {text!r}")
    return value
