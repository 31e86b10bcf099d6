"""trailmark's parts for OMPL programs: problem set-up, checker, motion validator, sampler, planner.

The one package of trailmark that imports ompl.
"""

import warnings
from typing import Any

from trailmark.ompl_bridge.checker import MotionValidator, StateValidityChecker
from trailmark.ompl_bridge.errors import (
    BoundsError,
    BridgeError,
    LandmarkError,
    ObjectiveError,
    PlannerNameError,
    SpaceError,
)
from trailmark.ompl_bridge.guard import planning, solve
from trailmark.ompl_bridge.landmark_stream import LandmarkSource
from trailmark.ompl_bridge.objective import PathObjective
from trailmark.ompl_bridge.planner import OmplLandmarkPlanner
from trailmark.ompl_bridge.planners import planner_named, planner_names
from trailmark.ompl_bridge.problem import SE2Problem, simple_setup
from trailmark.ompl_bridge.samplers import LandmarkValidStateSampler, PluggedSampler, plug_landmark_sampler
from trailmark.ompl_bridge.states import configuration, path_to_ompl, planner_data_graph, state, states_of, write_state

__all__ = [
    "BoundsError",
    "BridgeError",
    "LandmarkError",
    "LandmarkSource",
    "LandmarkValidStateSampler",
    "MotionValidator",
    "ObjectiveError",
    "OmplLandmarkPlanner",
    "PathObjective",
    "PlannerNameError",
    "PluggedSampler",
    "SE2Problem",
    "SpaceError",
    "StateValidityChecker",
    "configuration",
    "path_to_ompl",
    "planner_data_graph",
    "planner_named",
    "planner_names",
    "planning",
    "plug_landmark_sampler",
    "simple_setup",
    "solve",
    "state",
    "states_of",
    "write_state",
]


def __getattr__(name: str) -> Any:
    if name == "LandmarkPlanner":  # trailmark.LandmarkPlanner is another
        warnings.warn("expected OmplLandmarkPlanner, got its old name", DeprecationWarning, stacklevel=2)
        return OmplLandmarkPlanner
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
