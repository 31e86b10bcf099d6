"""trailmark: certified motion planning for mobile robots from Python.

The public names and the submodules are loaded when they are first used, so that ``import trailmark`` stays quick.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trailmark.changes import Change as Change
    from trailmark.changes import Changes as Changes
    from trailmark.collision import StateChecker as StateChecker
    from trailmark.curves import CurvePath as CurvePath
    from trailmark.curves import Steering as Steering
    from trailmark.errors import ConfigurationError as ConfigurationError
    from trailmark.errors import FormatError as FormatError
    from trailmark.errors import InternalErrorWarning as InternalErrorWarning
    from trailmark.errors import OutputError as OutputError
    from trailmark.errors import ShapeError as ShapeError
    from trailmark.errors import TrailmarkError as TrailmarkError
    from trailmark.errors import WorldError as WorldError
    from trailmark.goals import Goal as Goal
    from trailmark.goals import ReachedGoal as ReachedGoal
    from trailmark.moving import Moving as Moving
    from trailmark.objective import Objective as Objective
    from trailmark.path import Path as Path
    from trailmark.planning import LandmarkPlanner as LandmarkPlanner
    from trailmark.planning import PlannerSettings as PlannerSettings
    from trailmark.planning import PlanProgress as PlanProgress
    from trailmark.planning import PlanResult as PlanResult
    from trailmark.planning import ReplanResult as ReplanResult
    from trailmark.planning import Update as Update
    from trailmark.roadmap import Roadmap as Roadmap
    from trailmark.shapes import Disc as Disc
    from trailmark.shapes import Polygon as Polygon
    from trailmark.shapes import Rectangle as Rectangle
    from trailmark.trajectories import Trajectory as Trajectory
    from trailmark.verify import PathAudit as PathAudit
    from trailmark.verify import PathAuditor as PathAuditor
    from trailmark.verify import check_path as check_path
    from trailmark.world import Query as Query
    from trailmark.world import Robot as Robot
    from trailmark.world import World as World
    from trailmark.zones import CostZone as CostZone
    from trailmark.zones import KeepOutZone as KeepOutZone
    from trailmark.zones import OneWayZone as OneWayZone
    from trailmark.zones import SpeedZone as SpeedZone

__version__ = "0.1.0"

_NAMES = {
    "changes": "Change Changes",
    "collision": "StateChecker",
    "curves": "CurvePath Steering",
    "errors": "ConfigurationError FormatError InternalErrorWarning OutputError ShapeError TrailmarkError WorldError",
    "goals": "Goal ReachedGoal",
    "moving": "Moving",
    "objective": "Objective",
    "path": "Path",
    "planning": "LandmarkPlanner PlanProgress PlanResult PlannerSettings ReplanResult Update",
    "roadmap": "Roadmap",
    "shapes": "Disc Polygon Rectangle",
    "trajectories": "Trajectory",
    "verify": "PathAudit PathAuditor check_path",
    "world": "Query Robot World",
    "zones": "CostZone KeepOutZone OneWayZone SpeedZone",
}
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = ["__version__", *_HOME]


@cache
def _submodules() -> frozenset[str]:
    from pkgutil import iter_modules

    return frozenset(module.name for module in iter_modules(__path__) if not module.name.startswith("_"))


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = getattr(import_module(f"trailmark.{_HOME[name]}"), name)
    elif name in _submodules():
        value = import_module(f"trailmark.{name}")
    else:
        raise AttributeError(f"module 'trailmark' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*__all__, *_submodules()})
