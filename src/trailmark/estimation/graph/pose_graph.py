"""Scans as nodes, local maps made of some of them, and the poses that their relations come to, by gtsam."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.filter.consistency import chi_square_quantile
from trailmark.estimation.scans.clouds import PointCloud, joined
from trailmark.estimation.scans.clouds import relative as relative_pose
from trailmark.estimation.scans.local_map import LocalMap, levels_for, local_map
from trailmark.se2 import FloatArray

__all__ = ["MIN_POINTS", "KeyScans", "Relation", "in_frame", "optimise", "pose_covariances", "relative_covariances"]

BoolArray = NDArray[np.bool_]


IntArray = NDArray[np.intp]

MIN_POINTS = 10
"""End points that a scan needs to be matched: fewer do not show a shape."""

THIN = 0.1
"""Metres: a cloud of several scans has one point for each square of this side."""

REVISITED = 0.003, 0.001
"""Metres and radians by which the maps of two visits to a place disagree, each with the errors of its own scans, which
all matches between the two have in common."""

MAX_POINTS = 300
"""Points of such a cloud, at most: more make a search slower, and hardly surer."""


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
    nothing is wrong by that: Baarda's S-transformation (:mod:`trailmark.estimation.graph.smoother`) takes it out, here
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


class KeyScans:
    """Scans with their poses, in the order of time, and the relations between them.

    Attributes:
        clouds: of each, in the robot's frame.
        poses: shape (n, 3).
        travel: shape (n,), metres driven before each.
        steps: shape (n, 3, 3), covariance of each pose beside the one before, in the world's axes.
        relations: between them.

    Args:
        gap: metres between neighbouring end points of a surface from which on local maps have the line between them.
    """

    def __init__(self, gap: float) -> None:
        self._gap = gap
        self.clouds: list[PointCloud] = []
        self.poses = np.empty((0, 3))
        self.travel = np.empty(0)
        self.steps = np.empty((0, 3, 3))
        self.relations: list[Relation] = []

    def __len__(self) -> int:
        return len(self.clouds)

    def add(self, cloud: PointCloud, pose: FloatArray, step: FloatArray, gap: float = 0.0) -> None:
        """Add a scan after the others, ``gap`` metres further on than its place says.

        Args:
            cloud: in the robot's frame.
            pose: shape (3,).
            step: covariance of that beside the last scan's, shape (3, 3), in the world's axes.
            gap: metres.
        """
        way = 0.0 if not self.clouds else self.travel[-1] + float(np.hypot(*(pose - self.poses[-1])[:2])) + gap
        self.clouds.append(cloud)
        self.poses, self.travel = np.vstack([self.poses, pose]), np.append(self.travel, way)
        self.steps = np.concatenate([self.steps, step[None]])

    def chain(self, middle: int, length: float, count: int, *, before: bool = False) -> IntArray:
        """Return the scans around one: at most ``count`` of them, at most half of ``length`` metres driven from it.

        With ``before``, the scans up to that one, at most ``length`` metres before it.
        """
        reach = length if before else 0.5 * length
        first = int(np.searchsorted(self.travel, self.travel[middle] - reach))
        last = middle + 1 if before else int(np.searchsorted(self.travel, self.travel[middle] + reach, side="right"))
        half = count - 1 if before else count // 2
        return np.arange(max(first, middle - half), min(last, middle + half + 1))

    def area(self, chosen: IntArray, centre: FloatArray, reach: float, window: float) -> LocalMap:
        """Return the local map that some scans make, within ``reach`` metres of a place along each axis.

        It has the resolutions that a search over ``window`` metres to either side needs.
        """
        cloud = joined([self.clouds[i] for i in chosen], self.poses[chosen])
        x, y = float(centre[0]), float(centre[1])
        return local_map(cloud, (x - reach, y - reach, x + reach, y + reach), levels_for(window), self._gap)

    def spread(self, chain: IntArray, middle: int) -> FloatArray:
        """Return the mean covariance of a chain's scans beside one of them, shape (3, 3), in the world's axes.

        Along a corridor, where odometry alone holds each scan by the one before, the map that they make is no surer.
        """
        first, last = int(chain[0]), int(chain[-1])
        step = np.arange(first + 1, last + 1)
        beyond = np.where(step > middle, last - step + 1, step - first)  # scans that lie on its other side
        return np.asarray(np.einsum("n,nij->ij", beyond / len(chain), self.steps[step]))

    def query(self, chosen: IntArray, frame: int) -> PointCloud:
        """Return what some scans show, in the frame of one of them, thinned."""
        cloud = joined([self.clouds[i] for i in chosen], relative_pose(self.poses[frame], self.poses[chosen]))
        place = np.floor(cloud.points / THIN).astype(np.int64)
        _, one = np.unique(place[:, 0] * 2**31 + place[:, 1], return_index=True)
        one = one[:: -(-len(one) // MAX_POINTS)]
        return PointCloud(*(array[one] for array in cloud))

    def related(self, a: int, b: int, pose: FloatArray, covariance: FloatArray, *, certain: bool) -> Relation:
        """Return the relation that the pose of b, found in the world where a lies as it does now, stands for.

        Args:
            a: the scan that others are held by.
            b: the one that was matched.
            pose: of b, shape (3,).
            covariance: of that pose, in the world's axes, shape (3, 3).
            certain: see :class:`Relation`.
        """
        if not certain:
            covariance = covariance + np.diag([REVISITED[0] ** 2, REVISITED[0] ** 2, REVISITED[1] ** 2])
        return Relation(a, b, relative_pose(self.poses[a], pose), in_frame(covariance, pose[2]), certain)


def in_frame(covariance: FloatArray, heading: float) -> FloatArray:
    """Return a covariance of x, y, theta in the world's axes, shape (3, 3), in those of a frame with that heading."""
    c, s = np.cos(heading), np.sin(heading)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(turn @ covariance @ turn.T)
