"""Planners by name: trailmark's own, OMPL's in two baselines, native ones, and functions of the user's own."""

from __future__ import annotations

import importlib.util
import os
import re
import sys
from collections.abc import Iterable, Sequence
from dataclasses import fields, replace
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

from trailmark.benchmark.errors import SuiteError
from trailmark.benchmark.planner_name import CERTIFIED, PlannerName
from trailmark.errors import ConfigurationError, expected_name

if TYPE_CHECKING:
    from trailmark.planning import PlannerSettings

__all__ = ["known_planners", "method_settings", "read_planners", "settings_of"]


def known_planners() -> list[str]:
    """Return the names of all planners: trailmark's, OMPL's as they are and certified, native ones where built."""
    from trailmark.ompl_bridge.planners import planner_names
    from trailmark.planning.settings import METHODS

    names = list(METHODS)
    for name in planner_names():
        names += [name, name + CERTIFIED]
    return names + _native()


def read_planners(given: Iterable[str], *, cars: bool = False) -> list[str]:
    """Return the planners that a list names, each once, spelt as they are known.

    Args:
        given: names, in upper or lower case; ``all`` for all that are known; ``module:function`` for one of the user's
            own. Parameters of OMPL's planners and settings of trailmark's may follow: ``RRTConnect:range=2``.
        cars: whether some of the robots are cars, whose curves a lattice does not know.

    Raises:
        SuiteError: a name that is none of them, a parameter that the planner does not have, or no name at all.
    """
    known = [name for name in known_planners() if not (cars and _moves_straight(name))]
    spelt = {name.lower(): name for name in known}
    chosen: dict[str, None] = {}
    for text in given:
        name, parameters = PlannerName.parse(text)
        if text == "all":
            chosen |= dict.fromkeys(known)
        elif name.lower() in spelt:
            named = PlannerName(spelt[name.lower()], parameters)
            _require_parameters(named)
            chosen[str(named)] = None
        elif cars and _moves_straight(name.lower()):
            raise SuiteError(f"planner: expected one that plans for cars, got {name!r}, which moves straight")
        elif name.startswith("native:") and not any(other.startswith("native:") for other in known):
            raise SuiteError(f"planner {name!r} given, but the native program is not built (see benchmarks/native)")
        elif ":" in name and not name.startswith("native:"):
            _require_parameters(PlannerName(name, parameters))
            _require_module(name)
            chosen[name] = None
        else:
            raise SuiteError(f"planner: {_near(name, [*known, 'all'])}")
    if not chosen:
        raise SuiteError(f"no planner given; expected {', '.join([*known, 'all'])}")
    return list(chosen)


def _near(name: str, known: Sequence[str]) -> str:
    """Return what was expected in place of a name: the names near it, else where all are listed."""
    spelt = {other.lower(): other for other in known}
    if near := [spelt[other] for other in get_close_matches(name.lower(), spelt, n=6)]:
        return expected_name(name, near)
    own = [other for other in known if other.islower()]
    return f"{expected_name(name, own)}, or one of OMPL's, such as RRTConnect (see 'trailmark benchmark --help')"


def settings_of(name: str, *, first: bool = False) -> str:
    """Return what the results say about a planner's settings.

    Args:
        name: as :func:`read_planners` returns it.
        first: whether its runs end at their first path.
    """
    if first:
        return f"{settings_of(name)}; ends at its first path"
    named = PlannerName.parse(name)
    if name.startswith("native:"):
        native = importlib.import_module("trailmark.benchmark.native")
        made = ", ".join(f"{what} {version}" for what, version in native.native_versions().items())
        motions = "certified by bisection of clearances" if named.certified else "discrete"
        return f"OMPL in C++, {_given(named)}; states checked by FCL in C++; motions {motions}; {made}"
    if ":" in named.base:
        return "a function of the user's own"
    from trailmark.planning.settings import METHODS

    if named.base in METHODS:
        chosen = ", ".join(f"{setting}={value}" for setting, value in method_settings(named).to_dict().items())
        return f"trailmark's LandmarkPlanner, method {named.base}; motions certified; {chosen}"
    motions = "certified by trailmark" if named.certified else "discrete, at the experiment's resolution"
    return f"OMPL from Python, {_given(named)}; states checked by trailmark; motions {motions}"


def _given(name: PlannerName) -> str:
    """Return what the results say about the parameters of one of OMPL's planners."""
    given = ", ".join(f"{parameter}={value}" for parameter, value in name.parameters.items())
    return f"{given}, else default settings" if given else "default settings"


def method_settings(name: PlannerName) -> PlannerSettings:
    """Return the settings of one of trailmark's methods, with those that its name gives.

    Raises:
        SuiteError: a setting that there is not, or a value out of range.
    """
    from trailmark.planning.settings import METHODS

    settings = METHODS[name.base]
    known = [field.name for field in fields(settings) if field.name not in ("placement", "without")]
    given: dict[str, Any] = {}
    for setting, text in name.parameters.items():
        if setting not in known:
            raise SuiteError(f"planner {name.base}: setting: {expected_name(setting, known)}")
        try:
            given[setting] = int(text) if text.lstrip("+-").isdigit() else float(text)
        except ValueError:
            raise SuiteError(f"planner {name.base}: {setting}: expected a number, got {text!r}") from None
    try:
        return replace(settings, **given) if given else settings
    except ConfigurationError as error:
        raise SuiteError(f"planner {name.base}: {error}") from None


def _require_parameters(name: PlannerName) -> None:
    """Raise SuiteError unless the planner has the parameters that its name gives, with such values."""
    from trailmark.planning.settings import METHODS

    if not name.parameters:
        return
    if name.base.startswith("native:"):
        native = importlib.import_module("trailmark.benchmark.native")
        known = native.native_parameters(name.base)
        for parameter, text in name.parameters.items():
            if parameter not in known:
                raise SuiteError(f"planner {name.base}: parameter: {expected_name(parameter, known)}")
            if not re.fullmatch(r"true|false|\d+(\.\d*)?(e[-+]?\d+)?", text):
                raise SuiteError(f"planner {name.base}: {parameter}: expected a number, true or false, got {text!r}")
        return
    if ":" in name.base:
        raise SuiteError(f"planner {str(name)!r}: expected no parameters, for {name.base!r} takes none")
    if name.base in METHODS:
        method_settings(name)
        return
    from trailmark.ompl_bridge.errors import PlannerNameError
    from trailmark.ompl_bridge.planners import set_parameters

    try:
        set_parameters(name.algorithm, name.parameters)
    except PlannerNameError as error:
        raise SuiteError(str(error)) from None


def _moves_straight(name: str) -> bool:
    """Return whether a planner knows no motions but straight ones."""
    return name == "lattice"


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
