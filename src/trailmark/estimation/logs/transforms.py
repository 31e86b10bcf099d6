"""Rigid transforms between named frames, as ROS publishes them."""

from __future__ import annotations

import numpy as np

from trailmark.se2 import FloatArray

__all__ = ["Transforms", "matrix"]


class Transforms:
    """A forest of frames, each with its place in its parent; the first place given for a frame stays."""

    def __init__(self) -> None:
        self._places: dict[str, tuple[str, FloatArray]] = {}

    def add(self, parent: str, child: str, place: FloatArray) -> None:
        """Add a frame's place in its parent, shape (4, 4); slashes before the names are dropped, as tf2 drops them."""
        self._places.setdefault(child.lstrip("/"), (parent.lstrip("/"), place))

    def between(self, base: str, frame: str) -> FloatArray | None:
        """Return the frame's place in the base, shape (4, 4), or None if nothing known joins them."""
        above_base, above_frame = self._ancestors(base.lstrip("/")), self._ancestors(frame.lstrip("/"))
        for name, place in above_frame.items():
            if name in above_base:
                return np.asarray(np.linalg.inv(above_base[name]) @ place)
        return None

    def _ancestors(self, frame: str) -> dict[str, FloatArray]:
        """Return the frame and all above it, nearest first, with the frame's place in each."""
        found = {frame: np.eye(4)}
        name = frame
        while name in self._places:
            parent, place = self._places[name]
            if parent in found:  # frames that are each other's parents: no tree, nothing more to learn
                break
            found[parent] = place @ found[name]
            name = parent
        return found


def matrix(translation: tuple[float, float, float], quaternion: tuple[float, float, float, float]) -> FloatArray:
    """Return a rigid transform, shape (4, 4), from a shift (metres) and a quaternion x, y, z, w of any length but 0."""
    x, y, z, w = np.array(quaternion) / (np.linalg.norm(quaternion) or 1.0)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), translation[0]],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), translation[1]],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), translation[2]],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )
