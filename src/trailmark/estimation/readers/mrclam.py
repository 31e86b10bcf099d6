"""UTIAS MRCLAM folders: odometry, range and bearing of barcodes, and the ground truth of one robot.

The files are tables set off by blanks, with comments (``#``):

- ``RobotN_Odometry.dat``: t (s), v (m/s), omega (rad/s);
- ``RobotN_Measurement.dat``: t (s), barcode, range (m), bearing (rad);
- ``Barcodes.dat``: subject, barcode; subjects 1–5 are the robots, 6–20 the landmarks;
- ``RobotN_Groundtruth.dat`` (optional): t (s), x (m), y (m), theta (rad);
- ``Landmark_Groundtruth.dat`` (optional): subject, x (m), y (m), and two standard deviations (m).

Source: Leung et al. 2011, The UTIAS multi-robot cooperative localization and mapping dataset, Int. J. Robotics
Research 30(8). Its measurements hold a few barcodes that no subject wears (misread ones): they are bad records.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from trailmark.errors import FormatError
from trailmark.estimation.readers.source import BadRecords, in_order, read_table
from trailmark.estimation.records import Detection, Log, Odometry, Pose, Record, is_often
from trailmark.se2 import FloatArray

__all__ = ["read_mrclam", "robot_of", "robots"]

ROBOTS = range(1, 6)  # Subjects that are robots: they move, so that sightings of them are no landmarks.
SUBJECTS = range(1, 1000)  # What may wear a barcode; the published sets use 1 to 20.
_FILE = re.compile(r"Robot(\d+)_(?:Odometry|Measurement|Groundtruth)\.dat")


def robot_of(path: Path) -> int | None:
    """Return the robot whose file this is by its name, such as 3 for ``Robot3_Odometry.dat``; None for others."""
    match = _FILE.fullmatch(path.name)
    return int(match[1]) if match else None


def robots(folder: Path) -> list[int]:
    """Return the numbers of the robots whose odometry lies in the folder."""
    files = folder.glob("Robot*_Odometry.dat")
    return sorted({number for number in map(robot_of, files) if number is not None})


def read_mrclam(folder: Path, bad: BadRecords, robot: int | None = None) -> Log:
    """Return the log of one robot, merged by time; at equal times odometry, detections, truth.

    A detection's identity is the subject (6–20). Sightings of other robots are left out, with a note that counts
    them. Truth poses keep the times of the motion capture, which begins before the odometry and may end before it.

    Args:
        folder: with the files above.
        bad: what becomes of bad rows: wrong columns, values that are not finite, times that go back, barcodes that
            no subject wears, negative ranges.
        robot: its number; may be left out where the folder holds one robot.
    """
    number = _chosen(folder, robot)
    odometry_file = folder / f"Robot{number}_Odometry.dat"
    odometry = in_order(odometry_file, read_table(odometry_file, ("t", "v", "omega"), bad), bad)
    _require_fine_clock(odometry_file, odometry.values)
    detections, notes = _detections(folder, number, bad)
    truth, landmarks = np.empty((0, 4)), np.empty((0, 3))
    truth_file, landmark_file = folder / f"Robot{number}_Groundtruth.dat", folder / "Landmark_Groundtruth.dat"
    if truth_file.exists():
        truth = in_order(truth_file, read_table(truth_file, ("t", "x", "y", "theta"), bad), bad).values
    if landmark_file.exists():
        columns = ("subject", "x", "y", "x standard deviation", "y standard deviation")
        landmarks = read_table(landmark_file, columns, bad).values[:, :3]
    parts: list[Record] = [
        *map(Odometry._make, odometry.values.tolist()),
        *detections,
        *(Pose(t, x, y, theta, truth=True) for t, x, y, theta in truth.tolist()),
    ]
    order = np.argsort([record.t for record in parts], kind="stable")
    return Log(f"{folder.resolve().name}-robot{number}", tuple(parts[i] for i in order), landmarks, notes=notes)


def _require_fine_clock(path: Path, rows: FloatArray) -> None:
    """Raise if stamps repeat with other velocities, but for a few that a recorder wrote twice."""
    repeated = (np.diff(rows[:, 0]) == 0.0) & (np.diff(rows[:, 1:], axis=0) != 0.0).any(axis=1)
    if is_often(int(np.count_nonzero(repeated)), len(rows)):
        t = float(rows[1:][repeated][0, 0])
        problem = "the order of odometry and measurements cannot be told"
        raise FormatError(path, f"time: expected a stamp for each velocity, got {t!r} for several: {problem}")


def _chosen(folder: Path, robot: int | None) -> int:
    there = robots(folder)
    listed = ", ".join(map(str, there)) or "none"
    if robot is None:
        if len(there) == 1:
            return there[0]
        raise FormatError(
            folder, f"a folder of robots {listed}: say which, as {folder.name}:{there[0] if there else 1}"
        )
    if robot not in there:
        raise FormatError(folder, f"robot: expected {listed} (with a file RobotN_Odometry.dat), got {robot}")
    return robot


def _detections(folder: Path, robot: int, bad: BadRecords) -> tuple[list[Detection], tuple[str, ...]]:
    """Return the detections of landmarks, and a note on those of other robots."""
    barcodes = read_table(folder / "Barcodes.dat", ("subject", "barcode"), bad)
    subject_of: dict[float, int] = {}
    for line, (worn_by, barcode) in zip(barcodes.lines.tolist(), barcodes.values.tolist(), strict=True):
        if worn_by in SUBJECTS:
            subject_of[barcode] = int(worn_by)
        else:
            bad.report(folder / "Barcodes.dat", f"subject: expected 1 to {SUBJECTS[-1]}, got {worn_by:g}", line)
    path = folder / f"Robot{robot}_Measurement.dat"
    table = in_order(path, read_table(path, ("t", "barcode", "range", "bearing"), bad), bad)
    detections, others = [], 0
    for line, (t, barcode, distance, bearing) in zip(table.lines.tolist(), table.values.tolist(), strict=True):
        subject = subject_of.get(barcode)
        if subject is None:
            known = ", ".join(f"{code:g}" for code in sorted(subject_of))
            bad.report(path, f"barcode: expected one of Barcodes.dat: {known}, got {barcode:g}", line)
        elif distance < 0.0:
            bad.report(path, f"range: expected 0 or more, got {distance:g}", line)
        elif subject in ROBOTS:
            others += 1
        else:
            detections.append(Detection(t, np.array((distance, bearing)), identity=subject))
    return detections, (f"{others} sightings of other robots left out",) if others else ()
