"""Paths of straight motions and of curves, how they are smoothed, and the fastest way to drive them within limits.

What is compiled is loaded when its names are first used: a path by itself is light.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from trailmark.trajectories.path import Path

if TYPE_CHECKING:
    from trailmark.trajectories.curve_path import CurvePath as CurvePath
    from trailmark.trajectories.curve_path import path_of as path_of
    from trailmark.trajectories.pieces import Pieces as Pieces
    from trailmark.trajectories.smooth import SmoothPath as SmoothPath
    from trailmark.trajectories.trajectory import Limits as Limits
    from trailmark.trajectories.trajectory import Trajectory as Trajectory
    from trailmark.trajectories.trajectory import timed as timed

_NAMES = {
    "curve_path": "CurvePath path_of",
    "pieces": "Pieces",
    "smooth": "SmoothPath",
    "trajectory": "Limits Trajectory timed",
}
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = ["Path", *_HOME]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'trailmark.trajectories' has no attribute {name!r}")
    value = getattr(import_module(f"trailmark.trajectories.{_HOME[name]}"), name)
    globals()[name] = value
    return value
