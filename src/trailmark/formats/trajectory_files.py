"""Trajectory files: rows of time, configuration and velocity as CSV, or nav2's message."""

from __future__ import annotations

from pathlib import Path as FilePath

import numpy as np
from numpy.typing import ArrayLike

from trailmark.errors import ConfigurationError
from trailmark.formats import files, nav2_messages

__all__ = ["HEADER", "TRAJECTORY_SUFFIXES", "write_trajectory"]

TRAJECTORY_SUFFIXES = (".csv", ".yaml", ".yml", ".nav2.json")

HEADER = "t [s],x [m],y [m],theta [rad],vx [m/s],vy [m/s],omega [rad/s]"


def write_trajectory(path: FilePath, t: ArrayLike, q: ArrayLike, dq: ArrayLike, frame: str = "map") -> None:
    """Write a trajectory, whole or not at all; every number is written with all its digits.

    ``.csv`` has the columns of :data:`HEADER`, velocities in the world's frame; ``.yaml`` and ``.nav2.json`` are
    ``nav_msgs/msg/Trajectory``, with velocities in the robot's.

    Args:
        path: where to; its suffix tells the format.
        t: seconds, shape (n,).
        q: configurations then, shape (n, 3); metres, radians in (-pi, pi].
        dq: their derivatives by time, shape (n, 3).
        frame: name of the coordinate frame, for messages.

    Raises:
        ConfigurationError: arrays of other shapes.
        OutputError: another suffix, or a file that cannot be written.
    """
    files.check_writable(path, TRAJECTORY_SUFFIXES)
    times, states, rates = (np.asarray(values, dtype=np.float64) for values in (t, q, dq))
    if not times.ndim == 1 or not states.shape == rates.shape == (len(times), 3):
        raise ConfigurationError(
            f"trajectory: expected shapes (n,), (n, 3) and (n, 3), got {times.shape}, {states.shape}, {rates.shape}"
        )
    if path.suffix.lower() == ".csv":
        rows = np.column_stack([times, states, rates]).tolist()
        text = "\n".join([HEADER, *(",".join(map(repr, row)) for row in rows)]) + "\n"
    else:
        message = nav2_messages.trajectory_message(times, states, rates, frame)
        as_json = path.suffix.lower() == ".json"
        text = nav2_messages.message_text(message, "nav_msgs/msg/Trajectory", as_json=as_json)
    files.write_atomically(path, text)
