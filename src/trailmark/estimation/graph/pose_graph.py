"""Poses and relations between them, optimised by gtsam."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.filter.consistency import chi_square_quantile
from trailmark.se2 import FloatArray

__all__ = ["Relation", "optimise", "pose_covariances", "relative_covariances"]

BoolArray = NDArray[np.bool_]


class Relation(NamedTuple):
    """Where one pose lies in the frame of another, as it was measured."""

    a: int
    b: int
    pose: FloatArray
    """Of b in a's frame, shape (3,)."""
    covariance: FloatArray
    """Of x, y, theta in the frame of b, shape (3, 3)."""
    certain: bool = True
    """Whether it is taken as right: consecutive scans; a loop closure may be wrong as a whole."""


def optimise(relations: Sequence[Relation], poses: FloatArray, gate: float = 0.999) -> tuple[FloatArray, BoolArray]:
    """Return the poses that fit the relations best, the first one as given, and which relations count.

    Relations that are not certain may turn out to be wrong: graduated non-convexity (Yang et al. 2020, "Graduated
    non-convexity for robust spatial perception", truncated least squares) drops those whose residual is beyond
    the ``gate`` quantile of chi-square.

    Args:
        relations: that join all poses.
        poses: to begin with, shape (n, 3).
        gate: probability with which a right relation counts.

    Returns:
        The poses, shape (n, 3), and a bool for each relation.
    """
    import gtsam

    graph, values = _graph(relations, poses)
    params = gtsam.LevenbergMarquardtParams()
    best = gtsam.LevenbergMarquardtOptimizer(graph, values, params).optimize()
    counts = np.ones(len(relations), dtype=bool)
    loose = [i for i, relation in enumerate(relations) if not relation.certain]
    errors = np.array([graph.at(i).error(best) for i in loose])
    limit = 0.5 * float(chi_square_quantile(gate, 3))
    if (errors > limit).any():
        gnc = gtsam.GncLMParams(params)
        gnc.setLossType(gtsam.GncLossType.TLS)
        certain = [i for i, relation in enumerate(relations) if relation.certain]
        gnc.setKnownInliers([*certain, len(relations)])
        optimizer = gtsam.GncLMOptimizer(graph, values, gnc)
        optimizer.setInlierCostThresholds(limit)
        best = optimizer.optimize()
        counts = np.asarray(optimizer.getWeights())[: len(relations)] > 0.5
    return _poses_of(best, len(poses)), counts


def pose_covariances(relations: Sequence[Relation], poses: FloatArray) -> FloatArray:
    """Return the covariance of each pose in the frame of the first one, shape (n, 3, 3), at an optimum.

    Returns:
        Of x, y and theta, in the world's axes.
    """
    return _covariances(*_graph(relations, poses), _turns(poses))


def relative_covariances(relations: Sequence[Relation], poses: FloatArray) -> FloatArray:
    """Return the covariance of each pose relative to the places of all, shape (n, 3, 3), at an optimum.

    A graph's frame is that of its first pose, so that an error of the first heading turns everything. Within the map
    nothing is wrong by that: Baarda's S-transformation (:mod:`trailmark.estimation.graph.estimate`) takes it out, here
    without the joint covariance of all poses, which is large.

    Returns:
        Of x, y and theta, in the world's axes.
    """
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import splu

    n = len(poses)
    graph, values = _graph(relations, poses)
    turn = _turns(poses)
    own = _covariances(graph, values, turn)
    # What a shift and a turn of the frame do to each pose, and the ones that align the places best.
    frame = np.zeros((n, 3, 3))
    frame[:, 0, 0] = frame[:, 1, 1] = frame[:, 2, 2] = 1.0
    away = poses[:, :2] - poses[:, :2].mean(axis=0)
    frame[:, 0, 2], frame[:, 1, 2] = -away[:, 1], away[:, 0]
    align = np.zeros((n, 3, 3))
    align[:, :, :2] = np.linalg.pinv(frame[:, :2].reshape(-1, 3)).reshape(3, n, 2).transpose(1, 0, 2)
    rows, columns, entries = graph.linearize(values).sparseJacobian_()
    inside = columns <= 3 * n
    jacobian = csc_array((entries[inside], (rows[inside].astype(int) - 1, columns[inside].astype(int) - 1)))
    local = (align @ turn).transpose(0, 2, 1).reshape(3 * n, 3)
    shared = turn @ splu((jacobian.T @ jacobian).tocsc()).solve(local).reshape(n, 3, 3)
    total = np.einsum("nij,njk->ik", align, shared)
    crossed = shared @ frame.transpose(0, 2, 1)
    return np.asarray(own - crossed - crossed.transpose(0, 2, 1) + frame @ total @ frame.transpose(0, 2, 1))


def _turns(poses: FloatArray) -> FloatArray:
    """Return the matrices that turn x, y, theta of each pose's own frame into the world's, shape (n, 3, 3)."""
    turn = np.zeros((len(poses), 3, 3))
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1], turn[:, 2, 2] = c, -s, s, c, 1.0
    return turn


def _covariances(graph: Any, values: Any, turn: FloatArray) -> FloatArray:
    """Return the poses' covariances in the frame of the first one, in the world's axes."""
    import gtsam

    # Not by gtsam.Marginals: its Cholesky factors fail where headings are known to 1e-4 and far places to metres.
    tree = graph.linearize(values).eliminateMultifrontal(function=gtsam.EliminateQR)
    own = np.array([tree.marginalCovariance(i) for i in range(len(turn))])
    return np.asarray(turn @ own @ turn.transpose(0, 2, 1))


def _graph(relations: Sequence[Relation], poses: FloatArray) -> tuple[Any, Any]:
    """Return factors, one for each relation and last the first pose's, and values."""
    import gtsam

    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for i, pose in enumerate(poses):
        values.insert(i, gtsam.Pose2(*pose))
    for relation in relations:
        # Not of the covariance as it is: gtsam leaves out what lies beside its diagonal where it is under 1e-9.
        upper = np.linalg.cholesky(np.linalg.inv(relation.covariance)).T
        noise = gtsam.noiseModel.Gaussian.SqrtInformation(upper, False)
        graph.add(gtsam.BetweenFactorPose2(relation.a, relation.b, gtsam.Pose2(*relation.pose), noise))
    graph.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(*poses[0]), gtsam.noiseModel.Isotropic.Sigma(3, 1e-6)))
    return graph, values


def _poses_of(values: Any, n: int) -> FloatArray:
    return np.array([(p.x(), p.y(), p.theta()) for p in (values.atPose2(i) for i in range(n))])
