"""Planning: the landmark planner, path shortening, and what a planner returns."""

from trailmark.planning.planner import LandmarkPlanner
from trailmark.planning.result import PlanProgress, PlanResult, ReplanResult, Update
from trailmark.planning.settings import PlannerSettings
from trailmark.planning.shortening import shorten

__all__ = ["LandmarkPlanner", "PlanProgress", "PlanResult", "PlannerSettings", "ReplanResult", "Update", "shorten"]
