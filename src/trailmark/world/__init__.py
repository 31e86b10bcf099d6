"""What there is to plan in and for: worlds, robots, goals, zones, objectives, changes of worlds, noisy obstacles."""

from trailmark.world.changes import Change, Changes
from trailmark.world.estimates import ObstacleEstimate, RiskBound
from trailmark.world.goals import Goal, Query, ReachedGoal
from trailmark.world.library import find_world, shipped_worlds
from trailmark.world.moving import Moving
from trailmark.world.objective import Objective
from trailmark.world.robot import Robot
from trailmark.world.world import BOUNDS_LIMIT, KEEP_OUT, World, keep_outs, with_keep_outs
from trailmark.world.zones import CostZone, KeepOutZone, OneWayZone, SpeedZone

__all__ = [
    "BOUNDS_LIMIT",
    "KEEP_OUT",
    "Change",
    "Changes",
    "CostZone",
    "Goal",
    "KeepOutZone",
    "Moving",
    "Objective",
    "ObstacleEstimate",
    "OneWayZone",
    "Query",
    "ReachedGoal",
    "RiskBound",
    "Robot",
    "SpeedZone",
    "World",
    "find_world",
    "keep_outs",
    "shipped_worlds",
    "with_keep_outs",
]
