"""Pose graphs as g2o files (Kümmerle et al. 2011, "g2o: a general framework for graph optimization")."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from trailmark.estimation.graph.pose_graph import Relation
from trailmark.formats.files import write_atomically
from trailmark.se2 import FloatArray

__all__ = ["write_g2o"]


def write_g2o(path: str | Path, poses: FloatArray, relations: Sequence[Relation]) -> None:
    """Write poses and the relations between them: lines VERTEX_SE2 and EDGE_SE2.

    Args:
        path: the file.
        poses: shape (n, 3).
        relations: between them; an edge has the inverse of a relation's covariance.

    Raises:
        OutputError: the path cannot be written.
    """
    lines = [f"VERTEX_SE2 {i} {x!r} {y!r} {theta!r}" for i, (x, y, theta) in enumerate(poses.tolist())]
    for relation in relations:
        information = np.linalg.inv(relation.covariance)[np.triu_indices(3)]
        numbers = " ".join(repr(v) for v in [*relation.pose.tolist(), *information.tolist()])
        lines.append(f"EDGE_SE2 {relation.a} {relation.b} {numbers}")
    write_atomically(Path(path), "\n".join(lines) + "\n")
