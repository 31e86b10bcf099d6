"""g2o files of a drive: poses joined by odometry, and landmarks seen from them.

Lines that are read: ``VERTEX_SE2 id x y theta``; ``EDGE_SE2 a b dx dy dtheta`` and the upper triangle of the
information matrix, six numbers; ``EDGE_SE2_XY a b x y`` with three: landmark b in the frame of pose a. Lines with
``VERTEX_XY`` and ``FIX`` are left out.

The poses are taken in the order of their numbers, one second apart, since the format has no times. Edges between
consecutive poses become increments; others, loop closures, are no records, and a note has their number. A pose that no
edge joins to the one before it is taken from the vertices.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from trailmark.estimation.readers.source import BadRecords, name_of, numbers, read_lines
from trailmark.estimation.records import Detection, Increment, Log, Pose, Record
from trailmark.se2 import FloatArray

__all__ = ["KEYWORDS", "read_g2o"]

KEYWORDS = ("VERTEX_SE2", "EDGE_SE2", "EDGE_SE2_XY")  # The first words of the lines that are read.
_COUNTS = {"VERTEX_SE2": 4, "EDGE_SE2": 11, "EDGE_SE2_XY": 7}
_OTHERS = ("VERTEX_XY", "FIX")


def read_g2o(path: Path, bad: BadRecords) -> Log:
    """Return the drive's increments and detections, which state identities and covariances.

    Args:
        path: the file, gzipped or not.
        bad: what becomes of bad lines: unknown words, wrong columns, values that are not finite, matrices that are no
            information.
    """
    poses: dict[int, tuple[float, ...]] = {}
    edges: dict[tuple[int, int], tuple[FloatArray, FloatArray]] = {}
    seen: dict[int, list[Detection]] = {}
    closures = 0
    for number, text in enumerate(read_lines(path, bad), start=1):
        word, *fields = text.split() or ["#"]
        if word.startswith("#") or word in _OTHERS:
            continue
        row = numbers(fields)
        if word not in _COUNTS or row is None or len(row) != _COUNTS[word]:
            rule = (
                f"{word} and {_COUNTS[word]} finite numbers"
                if word in _COUNTS
                else f"a line with {', '.join(KEYWORDS)}"
            )
            bad.report(path, f"expected {rule}, got {text.strip()[:60]!r}", number)
        elif word == "VERTEX_SE2":
            poses[int(row[0])] = tuple(row[1:])
        else:
            size = 3 if word == "EDGE_SE2" else 2
            covariance = _covariance(row[2 + size :], size)
            if covariance is None:
                bad.report(
                    path, f"{word}: expected a positive definite information matrix, got {row[2 + size :]}", number
                )
            elif word == "EDGE_SE2":
                edges[int(row[0]), int(row[1])] = np.array(row[2:5]), covariance
            else:
                z = np.array(row[2:4])
                seen.setdefault(int(row[0]), []).append(Detection(0.0, z, "cartesian", int(row[1]), covariance))
    order = sorted({*poses, *(end for edge in edges for end in edge), *seen})
    records: list[Record] = []
    for i, k in enumerate(order):
        t = float(i)
        if i == 0:
            records.append(Pose(t, *poses.get(k, (0.0, 0.0, 0.0))))  # type: ignore[arg-type]  # three numbers
        elif (order[i - 1], k) in edges:
            step, covariance = edges.pop((order[i - 1], k))
            records.append(Increment(t, float(step[0]), float(step[1]), float(step[2]), covariance))
        elif k in poses and order[i - 1] in poses:
            records.append(Increment.between(t, poses[order[i - 1]], poses[k]))  # type: ignore[arg-type]  # three numbers
        records += [detection._replace(t=t) for detection in seen.get(k, [])]
    closures = len(edges)
    notes = (f"{closures} edges between poses that do not follow one another left out",) if closures else ()
    return Log(name_of(path), tuple(records), np.empty((0, 3)), notes=notes)


def _covariance(upper: list[float], size: int) -> FloatArray | None:
    """Return the inverse of a symmetric matrix from its upper triangle; None if it is not positive definite."""
    matrix = np.zeros((size, size))
    matrix[np.triu_indices(size)] = upper
    matrix = matrix + np.triu(matrix, 1).T
    if not np.linalg.eigvalsh(matrix).min() > 0.0:
        return None
    return np.asarray(np.linalg.inv(matrix))
