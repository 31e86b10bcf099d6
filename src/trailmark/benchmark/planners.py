"""Planners by name: trailmark's own, OMPL's in two baselines, native ones, and functions of the user's own."""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Iterable

from trailmark.benchmark.errors import SuiteError
from trailmark.errors import expected_name

__all__ = ["CERTIFIED", "known_planners", "read_planners", "settings_of"]

CERTIFIED = "+certified"
"""Ends the name of one of OMPL's planners that plans with trailmark's certified motion validator."""


def known_planners() -> list[str]:
    """Return the names of all planners: trailmark's, OMPL's as they are and certified, native ones where built."""
    from trailmark.ompl_bridge.planners import planner_names
    from trailmark.planning.methods import METHODS

    names = list(METHODS)
    for name in planner_names():
        names += [name, name + CERTIFIED]
    return names + _native()


def read_planners(given: Iterable[str], *, cars: bool = False) -> list[str]:
    """Return the planners that a list names, each once, spelt as they are known.

    Args:
        given: names, in upper or lower case; ``all`` for all that are known; ``module:function`` for one of the user's
            own.
        cars: whether some of the robots are cars, whose curves neither the native program nor a lattice knows.

    Raises:
        SuiteError: a name that is none of them, or no name at all.
    """
    known = [name for name in known_planners() if not (cars and _moves_straight(name))]
    spelt = {name.lower(): name for name in known}
    chosen: dict[str, None] = {}
    for name in given:
        if name == "all":
            chosen |= dict.fromkeys(known)
        elif name.lower() in spelt:
            chosen[spelt[name.lower()]] = None
        elif cars and _moves_straight(name.lower()):
            raise SuiteError(f"planner: expected one that plans for cars, got {name!r}, which moves straight")
        elif name.startswith("native:") and not any(other.startswith("native:") for other in known):
            raise SuiteError(f"planner {name!r} given, but the native program is not built (see benchmarks/native)")
        elif ":" in name and not name.startswith("native:"):
            _require_module(name)
            chosen[name] = None
        else:
            raise SuiteError(f"planner: {expected_name(name, [*known, 'all'])}")
    if not chosen:
        raise SuiteError(f"no planner given; expected {', '.join([*known, 'all'])}")
    return list(chosen)


def settings_of(name: str, *, first: bool = False) -> str:
    """Return what the results say about a planner's settings.

    Args:
        name: as :func:`read_planners` returns it.
        first: whether its runs end at their first path.
    """
    if first:
        return f"{settings_of(name)}; ends at its first path"
    if name.startswith("native:"):
        native = importlib.import_module("trailmark.benchmark.native")
        made = ", ".join(f"{what} {version}" for what, version in native.native_versions().items())
        return f"OMPL in C++, default settings; states and motions checked by FCL in C++, discretely; {made}"
    if ":" in name:
        return "a function of the user's own"
    from trailmark.planning.methods import METHODS

    if name in METHODS:
        chosen = ", ".join(f"{setting}={value}" for setting, value in METHODS[name].to_dict().items())
        return f"trailmark's LandmarkPlanner, method {name}; motions certified; {chosen}"
    motions = "certified by trailmark" if name.endswith(CERTIFIED) else "discrete, at the experiment's resolution"
    return f"OMPL from Python, default settings; states checked by trailmark; motions {motions}"


def _moves_straight(name: str) -> bool:
    """Return whether a planner knows no motions but straight ones."""
    return name.startswith("native:") or name == "lattice"


def _native() -> list[str]:
    """Return the native program's planners; none where it is not built."""
    if importlib.util.find_spec("trailmark.benchmark.native") is None:
        return []
    native = importlib.import_module("trailmark.benchmark.native")
    return list(native.native_planners())


def _require_module(name: str) -> None:
    module = name.partition(":")[0]
    # As the worker processes will import it.
    if os.getcwd() not in sys.path:  # noqa: PTH109  # sys.path holds strings
        sys.path.append(os.getcwd())  # noqa: PTH109  # as above
    try:
        found = importlib.util.find_spec(module)
    except (ImportError, ValueError):
        found = None
    if found is None:
        raise SuiteError(f"planner {name!r} given, but there is no module {module!r}; expected module:function")
