"""Headings of a disc robot's path, which its roadmap leaves out."""

from __future__ import annotations

import numpy as np

from trailmark import se2

__all__ = ["turned_evenly"]


def turned_evenly(states: se2.FloatArray, start: se2.FloatArray, goal: se2.FloatArray) -> se2.FloatArray:
    """Return a path with the headings of its ends, turning evenly along it, which costs the least; shape (n, 3).

    Args:
        states: shape (n, 3), n >= 2; their headings do not matter.
        start: shape (3,).
        goal: shape (3,).
    """
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(states[:, :2], axis=0).T))])
    share = along / along[-1] if along[-1] > 0.0 else np.linspace(0.0, 1.0, len(states))
    turned = np.array(states)
    turned[:, 2] = se2.interpolate(start, goal, share)[:, 2]
    turned[0], turned[-1] = start, goal
    return turned
