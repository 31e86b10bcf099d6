"""An oracle of trajectories: finite differences of dense samples, and of the arrays themselves."""

from __future__ import annotations

import numpy as np

from trailmark import Trajectory, se2

SLACK = 1.0 + 1e-6


def assert_within_limits(trajectory: Trajectory, samples: int = 20_001, jump: float = 1e-9) -> None:
    """Speeds and accelerations exceed no limit, by differences of configurations and of velocities.

    Velocities may jump by ``jump`` of their limits.
    """
    limits = trajectory.limits
    for t in (np.linspace(0.0, trajectory.duration, samples), trajectory.t):
        dt = np.diff(t)
        if len(dt) == 0:
            continue
        q, dq = trajectory.at(t), trajectory.velocity(t)
        moved, change = se2.difference(q[:-1], q[1:]), np.diff(dq, axis=0)
        # Coordinates and velocities are rounded, which short times magnify.
        place = 1e-14 * (1.0 + np.abs(q).max()) / dt
        assert (np.hypot(*moved[:, :2].T) / dt <= limits.max_speed * SLACK + place).all()
        assert (np.abs(moved[:, 2]) / dt <= limits.max_turn_rate * SLACK + place).all()
        assert (np.hypot(*change[:, :2].T) <= limits.max_acceleration * SLACK * dt + jump * limits.max_speed).all()
        if limits.max_turn_acceleration is not None:
            allowed = limits.max_turn_acceleration * SLACK * dt
            assert (np.abs(change[:, 2]) <= allowed + jump * limits.max_turn_rate).all()
