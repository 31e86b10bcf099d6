"""The Victoria Park file as GTSAM publishes it: pose increments, and trees in the frame of the pose.

Lines, in the order of the drive (numbers are shared by poses and trees):

- ``ODOMETRY i j dx dy dtheta c11 c12 c13 c22 c23 c33``: from pose i to pose j, in i's frame, with the covariance's
  upper triangle;
- ``LANDMARK i j x y c11 c12 c22``: tree j seen from pose i, in i's frame.

A sighting's covariance that is the same in all directions, c, was not measured for x and y: GTSAM's own reader
(``load2D``) takes c for the variance of its range, and c/10, without the metres, for that of its bearing; so does this.

The file states no times: t is the number of the pose. Source: Guivant & Nebot 2001, Optimization of the simultaneous
localization and map-building algorithm, IEEE Trans. Robotics and Automation 17(3).
"""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path

import numpy as np

from trailmark.estimation.readers.source import BadRecords, name_of, numbers, read_lines
from trailmark.estimation.records import Detection, Increment, Log, Record
from trailmark.se2 import FloatArray

__all__ = ["KEYWORDS", "read_victoria"]

# The lines' first words and the columns after them.
KEYWORDS = {"ODOMETRY": "i j dx dy dtheta c11 c12 c13 c22 c23 c33", "LANDMARK": "i j x y c11 c12 c22"}


def read_victoria(path: Path, bad: BadRecords) -> Log:
    """Return increments and detections with their covariances; t is the pose's number, j a detection's identity.

    Detections are ``range-bearing`` where their covariance is the same in all directions, else ``cartesian``.

    A line must belong to the pose that the drive has reached: a line about an earlier pose is out of order, and one
    about a later pose shows that the motion to it is missing. With ``skip_bad`` the first is left out, and the second
    is taken as it stands, without the missing motion.

    Args:
        path: the file, gzipped or not.
        bad: what becomes of bad lines: unknown words, wrong columns, values that are not finite, numbers that are not
            whole, covariances that are not positive, lines out of order.
    """
    records: list[Record] = []
    pose: int | None = None
    for number, line in enumerate(read_lines(path, bad), start=1):
        fields = line.split()
        if not fields or fields[0].startswith("#"):
            continue
        row, problem = _row(fields)
        if row is None:
            bad.report(path, problem, number)
            continue
        i, j = int(row[0]), int(row[1])
        pose = i if pose is None else pose
        if i != pose and (i < pose or not bad.skip):
            what = "a pose left behind: the line is out of order" if i < pose else "the motion to it is missing"
            bad.report(path, f"expected pose {pose}, got pose {i}, {what}", number)
            continue
        if fields[0] == "LANDMARK":
            records.append(_detection(float(i), j, *row[2:]))
        elif j <= i:
            bad.report(path, f"motion from pose {i}: expected to a later pose, got pose {j}", number)
            continue
        else:
            records.append(Increment(float(j), row[2], row[3], row[4], _covariance(*row[5:])))
        pose = j if fields[0] == "ODOMETRY" else i
    return Log(name_of(path), tuple(records), np.empty((0, 3)))


def _row(fields: list[str]) -> tuple[list[float] | None, str]:
    """Return a line's numbers, or what is wrong with it."""
    word = fields[0]
    if word not in KEYWORDS:
        return None, f"expected a line with {', '.join(KEYWORDS)}, got {' '.join(fields)[:60]!r}"
    columns, row = KEYWORDS[word].split(), numbers(fields[1:])
    if len(fields) != len(columns) + 1:
        return None, f"{word}: expected {len(columns)} columns {', '.join(columns)}, got {len(fields) - 1}"
    if row is None or not (row[0].is_integer() and row[1].is_integer()):
        return None, f"expected {word}, two whole and then finite numbers, got {' '.join(fields)[:60]!r}"
    split = len(columns) - (6 if word == "ODOMETRY" else 3)
    if _covariance(*row[split:]) is None:
        return None, f"covariance: expected the upper triangle of a positive definite matrix, got {row[split:]}"
    return row, ""


def _detection(t: float, identity: int, x: float, y: float, c11: float, c12: float, c22: float) -> Detection:
    if c11 == c22 and c12 == 0.0:
        polar = np.array([math.hypot(x, y), math.atan2(y, x)])
        return Detection(t, polar, "range-bearing", identity, _covariance(c11, 0.0, c11 / 10.0))
    return Detection(t, np.array([x, y]), "cartesian", identity, _covariance(c11, c12, c22))


@lru_cache(maxsize=1024)  # most lines of a log state the same one
def _covariance(*upper: float) -> FloatArray | None:
    """Return the symmetric matrix whose upper triangle, row by row, this is; None if it is not positive definite."""
    size = 3 if len(upper) == 6 else 2
    matrix = np.empty((size, size))
    rows, columns = np.triu_indices(size)
    matrix[rows, columns] = matrix[columns, rows] = upper
    matrix.flags.writeable = False
    return matrix if np.linalg.eigvalsh(matrix)[0] > 0.0 else None
