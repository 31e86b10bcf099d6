"""Planners by name: trailmark's own, OMPL's in two baselines, native ones, and functions of the user's own."""

from __future__ import annotations

import importlib
import importlib.util
import os
import re
import sys
from collections.abc import Iterable
from dataclasses import fields, replace
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, NamedTuple

from trailmark.benchmark.errors import SuiteError
from trailmark.errors import ConfigurationError, expected_name

if TYPE_CHECKING:
    from trailmark.planning import PlannerSettings
    from trailmark.world import Robot

__all__ = [
    "OWN_SPACING",
    "PlannerName",
    "known_planners",
    "load_function",
    "method_settings",
    "native_peer",
    "read_planners",
    "settings_of",
    "spacing_of",
]

CERTIFIED = "+certified"
"""Ends the name of one of OMPL's planners that plans with certified motions."""

NATIVE = "native:"
"""Begins the name of one of OMPL's planners in C++."""


class PlannerName(NamedTuple):
    """A planner and the parameters that it is given, as in ``RRTConnect+certified:range=2,intermediate_states=true``.

    Attributes:
        base: such as ``landmark``, ``PRM+certified``, ``native:PRM`` or ``module:function``.
        parameters: values as they were given, by name.
    """

    base: str
    parameters: dict[str, str]

    @classmethod
    def parse(cls, text: str) -> PlannerName:
        """Return what a name says.

        Raises:
            SuiteError: parameters that are not ``name=value,name=value``.
        """
        base, colon, last = text.rpartition(":")
        if not colon or "=" not in last:
            return cls(text, {})
        parameters: dict[str, str] = {}
        for word in last.split(","):
            name, equals, value = (part.strip() for part in word.partition("="))
            if not (name and equals and value) or name in parameters:
                raise SuiteError(f"planner {text!r}: expected PLANNER:name=value,name=value, each once, got {word!r}")
            parameters[name] = value
        return cls(base, parameters)

    @property
    def native(self) -> bool:
        """Whether it is one of OMPL's in C++."""
        return self.base.startswith(NATIVE)

    @property
    def own(self) -> bool:
        """Whether it is a function of the user's."""
        return ":" in self.base and not self.native

    @property
    def algorithm(self) -> str:
        """The name of OMPL's planner, certified or not."""
        return self.base.removesuffix(CERTIFIED)

    @property
    def certified(self) -> bool:
        """Whether OMPL's planner gets certified motions."""
        return self.base.endswith(CERTIFIED)

    def __str__(self) -> str:
        given = ",".join(f"{name}={value}" for name, value in self.parameters.items())
        return f"{self.base}:{given}" if given else self.base


SPACING, NATIVE_SPACING = 0.1, 0.05
"""Shares of the robot's inscribed radius that the states lie apart which OMPL's discrete validation checks.

From Python the referee refused 1 of 168 paths found so, 36 of 252 at five times it; of native planners, whose checks
cost less, 1 of 269, and 68 of 392 at ten times it.
"""

OWN_SPACING = f"{100.0 * SPACING:g} % of the robot's inscribed radius, native planners {100.0 * NATIVE_SPACING:g} %"
"""What the results say where each planner has its own."""


def spacing_of(planner: str, robot: Robot) -> float:
    """Return the spacing (metres) at which refusals of a planner are rare."""
    return (NATIVE_SPACING if planner.startswith(NATIVE) else SPACING) * robot.keeping(0.0).inscribed_disc.radius


def known_planners() -> list[str]:
    """Return the names of all planners: trailmark's, OMPL's as they are and certified, native ones where built."""
    from trailmark.ompl_bridge.planners import planner_names
    from trailmark.planning.settings import METHODS

    peer = native_peer()
    ompls = [name + motions for name in planner_names() for motions in ("", CERTIFIED)]
    return [*METHODS, *ompls, *(peer.native_planners() if peer is not None else ())]


def native_peer() -> Any:
    """Return the module that runs OMPL's C++ planners, which is in the project's folder; None elsewhere."""
    _look_here_too()
    try:
        return importlib.import_module("benchmarks.native.peer")
    except ImportError:
        return None


def read_planners(given: Iterable[str], *, cars: bool = False) -> list[str]:
    """Return the planners that a list names, each once, spelt as they are known.

    Args:
        given: names, in upper or lower case; ``all`` for all that are known; ``module:function`` for one of the user's
            own. Parameters of OMPL's planners and settings of trailmark's may follow: ``RRTConnect:range=2``.
        cars: whether some of the robots are cars, whose curves a lattice does not know.

    Raises:
        SuiteError: a name that is none of them, a parameter that the planner does not have, or no name at all.
    """
    spelt = {name.lower(): name for name in known_planners() if not (cars and name == "lattice")}
    known = list(spelt.values())
    chosen: dict[str, None] = {}
    for text in given:
        name = PlannerName.parse(text)
        if text == "all":
            chosen |= dict.fromkeys(known)
            continue
        if name.base.lower() in spelt:
            name = name._replace(base=spelt[name.base.lower()])
        elif name.own:
            _require_module(name.base)
        elif cars and name.base.lower() == "lattice":
            raise SuiteError(f"planner: expected one that plans for cars, got {name.base!r}, which moves straight")
        elif name.native and not any(other.startswith(NATIVE) for other in known):
            raise SuiteError(
                f"planner {name.base!r} given, but the native program is not built (see benchmarks/native)"
            )
        else:
            near = [spelt.get(other, other) for other in get_close_matches(name.base.lower(), [*spelt, "all"], n=6)]
            short = [other for other in [*known, "all"] if other.islower()]
            more = "" if near else ", or one of OMPL's, such as RRTConnect (see 'trailmark benchmark --help')"
            raise SuiteError(f"planner: {expected_name(name.base, near or short)}{more}")
        _require_parameters(name)
        chosen[str(name)] = None
    if not chosen:
        raise SuiteError(f"no planner given; expected {', '.join([*known, 'all'])}")
    return list(chosen)


def settings_of(name: str) -> str:
    """Return what the results say about the settings of a planner, named as :func:`read_planners` returns it."""
    from trailmark.planning.settings import METHODS

    named = PlannerName.parse(name)
    given = ", ".join([*(f"{key}={value}" for key, value in named.parameters.items()), ""])
    given = f"{given}else default settings" if given else "default settings"
    if named.native:
        made = ", ".join(f"{what} {version}" for what, version in native_peer().native_versions().items())
        motions = "certified by bisection of clearances" if named.certified else "discrete"
        return f"OMPL in C++, {given}; states checked by FCL in C++; motions {motions}; {made}"
    if named.own:
        return "a function of the user's own"
    if named.base in METHODS:
        chosen = ", ".join(f"{setting}={value}" for setting, value in method_settings(named).to_dict().items())
        return f"trailmark's LandmarkPlanner, method {named.base}; motions certified; {chosen}"
    motions = "certified by trailmark" if named.certified else "discrete, at the experiment's resolution"
    return f"OMPL from Python, {given}; states checked by trailmark; motions {motions}"


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
    from trailmark.ompl_bridge.errors import PlannerNameError
    from trailmark.ompl_bridge.planners import set_parameters
    from trailmark.planning.settings import METHODS

    if not name.parameters:
        return
    if name.native:
        known = native_peer().native_parameters(name.base)
        for parameter, text in name.parameters.items():
            if parameter not in known:
                raise SuiteError(f"planner {name.base}: parameter: {expected_name(parameter, known)}")
            if not re.fullmatch(r"true|false|\d+(\.\d*)?(e[-+]?\d+)?", text):
                raise SuiteError(f"planner {name.base}: {parameter}: expected a number, true or false, got {text!r}")
    elif name.own:
        raise SuiteError(f"planner {str(name)!r}: expected no parameters, for {name.base!r} takes none")
    elif name.base in METHODS:
        method_settings(name)
    else:
        try:
            set_parameters(name.algorithm, name.parameters)
        except PlannerNameError as error:
            raise SuiteError(str(error)) from None


def load_function(name: str) -> Any:
    """Return the function that ``module:function`` names."""
    _look_here_too()
    module, _, function = name.partition(":")
    return getattr(importlib.import_module(module), function)


def _require_module(name: str) -> None:
    module = name.partition(":")[0]
    _look_here_too()
    try:
        found = importlib.util.find_spec(module)
    except (ImportError, ValueError):
        found = None
    if found is None:
        raise SuiteError(f"planner {name!r} given, but there is no module {module!r}; expected module:function")


def _look_here_too() -> None:
    """Import from the working directory too, as worker processes do; last, so that no file takes a library's place."""
    if os.getcwd() not in sys.path:  # noqa: PTH109  # sys.path holds strings
        sys.path.append(os.getcwd())  # noqa: PTH109  # as above
