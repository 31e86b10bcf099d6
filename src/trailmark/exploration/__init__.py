"""Exploration of an unknown world, from landmark to landmark, until it is proven that nothing more can be seen.

The names are loaded when they are first used, as those of :mod:`trailmark.estimation` are.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trailmark.exploration.explorer import Explorer as Explorer
    from trailmark.exploration.result import Evaluation as Evaluation
    from trailmark.exploration.result import ExplorationProgress as ExplorationProgress
    from trailmark.exploration.result import ExplorationResult as ExplorationResult
    from trailmark.exploration.result import ExplorationSettings as ExplorationSettings
    from trailmark.exploration.result import load_exploration as load_exploration
    from trailmark.exploration.result import save_exploration as save_exploration
    from trailmark.exploration.simulated_robot import DriveReport as DriveReport
    from trailmark.exploration.simulated_robot import ExploringRobot as ExploringRobot
    from trailmark.exploration.simulated_robot import SimulatedRobot as SimulatedRobot
    from trailmark.exploration.strategies import STRATEGIES as STRATEGIES
    from trailmark.exploration.strategies import Outlook as Outlook
    from trailmark.exploration.strategies import Strategy as Strategy

_HOME = {
    "load_exploration": "result",
    "save_exploration": "result",
    "ExplorationSettings": "result",
    "Explorer": "explorer",
    "Outlook": "strategies",
    "Strategy": "strategies",
    "Evaluation": "result",
    "ExplorationProgress": "result",
    "ExplorationResult": "result",
    "DriveReport": "simulated_robot",
    "ExploringRobot": "simulated_robot",
    "SimulatedRobot": "simulated_robot",
    "STRATEGIES": "strategies",
}

__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'trailmark.exploration' has no attribute {name!r}")
    return getattr(import_module(f"trailmark.exploration.{_HOME[name]}"), name)
