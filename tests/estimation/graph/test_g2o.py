"""g2o files: a graph that is written is the one that gtsam reads."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gtsam
import numpy as np

from trailmark.estimation.graph.g2o import write_g2o
from trailmark.estimation.graph.pose_graph import Relation


def test_gtsam_reads_what_was_written(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    poses = rng.uniform(-3.0, 3.0, (5, 3))
    root = rng.normal(size=(3, 3))
    covariance = root @ root.T + np.eye(3)
    relations = [Relation(i, i + 1, rng.uniform(-1.0, 1.0, 3), covariance * (i + 1)) for i in range(4)]
    write_g2o(tmp_path / "a.g2o", poses, relations)
    graph, values = gtsam.readG2o(str(tmp_path / "a.g2o"), False)
    read = [values.atPose2(i) for i in range(5)]
    assert np.allclose([(p.x(), p.y(), p.theta()) for p in read], poses)
    assert graph.size() == 4
    for i, relation in enumerate(relations):
        factor: Any = graph.at(i)
        assert list(factor.keys()) == [relation.a, relation.b]
        measured = factor.measured()
        assert np.allclose([measured.x(), measured.y(), measured.theta()], relation.pose)
        assert np.allclose(factor.noiseModel().covariance(), relation.covariance)
