"""Paths of straight motions and of curves, how they are smoothed, and the fastest way to drive them within limits."""

from trailmark.trajectories.curve_path import CurvePath, path_of
from trailmark.trajectories.path import Path
from trailmark.trajectories.pieces import Pieces
from trailmark.trajectories.smooth import SmoothPath
from trailmark.trajectories.trajectory import Limits, Trajectory, timed

__all__ = ["CurvePath", "Limits", "Path", "Pieces", "SmoothPath", "Trajectory", "path_of", "timed"]
