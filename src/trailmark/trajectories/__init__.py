"""Trajectories: smoothed paths, and the fastest way to drive a path within a robot's limits."""

from trailmark.trajectories.pieces import Pieces
from trailmark.trajectories.smooth import SmoothPath
from trailmark.trajectories.trajectory import Limits, Trajectory, timed

__all__ = ["Limits", "Pieces", "SmoothPath", "Trajectory", "timed"]
