"""A batch smoother on the very factors that a filter used, built with gtsam.

Odometry between two instants with readings becomes one factor: the steps are put together as the filter puts them
together (f, F, W and Q of its motion model), starting at the origin. Velocities leave the sideways motion certain,
which no factor can be; :data:`FLOOR` is added. Readings that the filter left out are left out, the rest has the noise
that the log's records state.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import gtsam
import numpy as np
from numpy.typing import NDArray

from trailmark.estimation import SlamResult, Unicycle
from trailmark.estimation.logs.records import Detection, Odometry, Record

__all__ = ["Smoothed", "smooth"]

FloatArray = NDArray[np.float64]

FLOOR = 1e-4
"""Metres and radians: standard deviation added to each odometry factor."""


class Smoothed(NamedTuple):
    """The batch optimum."""

    landmarks: dict[int, FloatArray]
    """By identity, shape (2,)."""
    trajectory: FloatArray
    """Rows t, x, y, shape (n, 3)."""
    error: float
    """Half the sum of the squared, whitened residuals."""


def smooth(records: Sequence[Record], motion: Unicycle, result: SlamResult) -> Smoothed:
    """Return the batch optimum of a log with known identities, from the filter's result on.

    Args:
        records: velocities and detections whose covariances are stated.
        motion: the filter's.
        result: the filter's.
    """
    used = {(a.t, a.identity) for a in result.assignments if a.feature is not None}
    names = {f.identity: f.mean for f in result.features if f.identity is not None}
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for identity, place in names.items():
        values.insert(gtsam.symbol("l", identity), place)
    huber = gtsam.noiseModel.mEstimator.Huber.Create(1.345)
    x, P, t, held = np.zeros(3), np.zeros((3, 3)), -np.inf, None  # noqa: N806 # the filter's own symbol
    times: list[float] = []

    def advance(to: float) -> None:
        nonlocal x, P, t
        if held is not None and to > t:
            u = np.array([held.v, held.omega, to - t])
            x, F, W = motion.step(x, u)  # noqa: N806 # the filter's own symbols
            P = F @ P @ F.T + W @ motion.Q(u) @ W.T  # noqa: N806 # the filter's own symbol
        t = to

    for record in records:
        advance(record.t)
        if isinstance(record, Odometry):
            held = record
        elif isinstance(record, Detection) and record.identity is not None and (record.t, record.identity) in used:
            if not times or times[-1] != record.t:
                key = len(times)
                values.insert(key, gtsam.Pose2(*_pose_at(result, record.t)))
                if times:
                    noise = gtsam.noiseModel.Gaussian.Covariance(_at_end(x, P) + FLOOR**2 * np.eye(3))
                    graph.add(gtsam.BetweenFactorPose2(key - 1, key, gtsam.Pose2(*x), noise))
                else:
                    graph.add(gtsam.PriorFactorPose2(0, values.atPose2(0), _diagonal(np.full(3, 1e-6))))
                times.append(record.t)
                x, P = np.zeros(3), np.zeros((3, 3))  # noqa: N806 # the filter's own symbol
            assert record.covariance is not None
            sigma = np.sqrt(np.diag(record.covariance))
            graph.add(
                gtsam.BearingRangeFactor2D(
                    len(times) - 1,
                    gtsam.symbol("l", record.identity),
                    gtsam.Rot2(float(record.z[1])),
                    float(record.z[0]),
                    gtsam.noiseModel.Robust.Create(huber, _diagonal(sigma[::-1])),
                )
            )
    best = gtsam.LevenbergMarquardtOptimizer(graph, values, gtsam.LevenbergMarquardtParams()).optimize()
    poses = [best.atPose2(i) for i in range(len(times))]
    return Smoothed(
        {i: np.asarray(best.atPoint2(gtsam.symbol("l", i))) for i in names},
        np.array([(t, pose.x(), pose.y()) for t, pose in zip(times, poses, strict=True)]),
        float(graph.error(best)),
    )


def _diagonal(sigmas: FloatArray) -> Any:
    return gtsam.noiseModel.Diagonal.Sigmas(np.ascontiguousarray(sigmas))


def _at_end(x: FloatArray, P: FloatArray) -> FloatArray:  # noqa: N803 # the filter's own symbol
    """Return a step's covariance in the frame that it ends in, as gtsam has it, from that in the one it begins in."""
    cos, sin = np.cos(x[2]), np.sin(x[2])
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(turn @ P @ turn.T)


def _pose_at(result: SlamResult, t: float) -> FloatArray:
    """Return the filter's pose at a time that it has one for."""
    return np.asarray(result.trajectory[np.searchsorted(result.trajectory[:, 0], t), 1:4])
