"""Does a map fit the log that it was made from? Figures on it, and one sentence on each thing that looks wrong."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trailmark.estimation.filter.consistency import chi_square_quantile
from trailmark.estimation.logs.records import Detection, Increment, Odometry, Record, Scan
from trailmark.estimation.maps.map_settings import MappingSettings
from trailmark.estimation.maps.scan_map import beam_ends
from trailmark.estimation.slam.slam_result import SlamResult
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc
from trailmark.world import ObstacleEstimate, World

__all__ = ["detection_warnings", "duration", "explained_share", "log_warnings", "scan_warnings", "top_speed"]

NEAR = 0.15
"""Metres from an obstacle's outline within which a scan's end point counts as explained."""

MIN_EXPLAINED = 0.9
"""Share of the end points that a right map explains: people and glass make up for the rest."""

MAX_SPEED = 10.0
"""Metres a second: no indoor robot is as fast, and few outdoors are."""

MIN_RATIO = 0.7
"""NIS to its expectation: what is nearer to 1 changes a covariance by less than a fifth of its deviation."""

MIN_UPDATES = 30
"""Updates before which the NIS says little."""

MAX_LEFT_OUT = 0.05
"""Share of the readings that may fit no feature."""

SAME = 0.99
"""Probability that two estimates of one thing pass as one."""

MAX_POINTS = 20_000
"""End points, at most, that are looked at."""

DAY = 86_400.0
"""Seconds: a longer gap between two records is a clock that was set."""


def explained_share(world: World, scans: Sequence[Scan], poses: FloatArray, s: MappingSettings) -> float:
    """Return the share of the scans' end points that lie within NEAR of an obstacle's outline; NaN without any."""
    import shapely

    beams = sum(len(scan.ranges) for scan in scans)
    step = beams // MAX_POINTS + 1
    found = [beam_ends(scan, pose, s) for scan, pose in zip(scans[::step], poses[::step], strict=True)]
    points = np.concatenate([ends[met] for _, ends, met in found])
    if len(points) == 0 or not world.obstacles:
        return float("nan") if len(points) == 0 else 0.0
    outlines = [shapely.get_coordinates(part, return_index=True) for part in _rings(world)]
    sides = np.concatenate([np.stack([xy[:-1], xy[1:]], axis=1)[of[:-1] == of[1:]] for xy, of in outlines])
    near, _ = shapely.STRtree(shapely.linestrings(sides)).query(shapely.points(points), "dwithin", distance=NEAR)
    return float(len(np.unique(near)) / len(points))


def _rings(world: World) -> list[object]:
    """Return the outlines and holes of each obstacle, as arrays of rings."""
    import shapely

    regions = shapely.get_parts(np.array([shape.polygon(1e-2).shapely() for shape in world.obstacles]))
    return [shapely.get_rings(regions)]


def top_speed(trajectory: FloatArray) -> float:
    """Return the speed (m/s) that a hundredth of a trajectory, rows t, x, y, theta, is faster than; 0 if it is short.

    Over ten poses each, since single times arrive late.
    """
    if len(trajectory) < 12:
        return 0.0
    travel = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(trajectory[:, 1:3], axis=0).T))])
    time, way = trajectory[10:, 0] - trajectory[:-10, 0], travel[10:] - travel[:-10]
    return float(np.quantile(way[time > 0.0] / time[time > 0.0], 0.99)) if (time > 0.0).any() else 0.0


def duration(times: FloatArray) -> float | None:
    """Return the seconds from the first to the last of times, shape (n,), without jumps of the clock by a day or more.

    None where the times are rounded so far that most are equal: they do not tell.
    """
    if len(times) > 10 and 10 * len(np.unique(times)) < len(times):
        return None
    gaps = np.diff(times)
    return float(gaps[gaps < DAY].sum())


def log_warnings(records: Sequence[Record], detected: bool) -> list[str]:
    """Return what looks wrong with the log itself: clocks that differ, scans that met nothing.

    Args:
        records: of the log, in the order of time.
        detected: whether obstacles come from its detections, else from its scans.
    """
    what = "detections" if detected else "scans"
    read = [record for record in records if isinstance(record, Detection if detected else Scan)]
    moves = [record for record in records if isinstance(record, Odometry | Increment)]
    found = []
    # Velocities hold on after the last of them.
    if moves and read:
        end = np.inf if isinstance(moves[-1], Odometry) else moves[-1].t
        if read[-1].t < moves[0].t or end < read[0].t:
            found.append(
                f"the times of odometry ({moves[0].t:.3f} to {moves[-1].t:.3f} s) and of {what} ({read[0].t:.3f} to "
                f"{read[-1].t:.3f} s) do not overlap: are they of different clocks?"
            )
    scans = [record for record in read if isinstance(record, Scan)]
    blind = sum(not ((scan.ranges > 0.0) & (scan.ranges < scan.range_max)).any() for scan in scans)
    if 2 * blind > len(scans):
        found.append(f"{blind:,} of {len(scans):,} scans met nothing: they place neither the robot nor an obstacle")
    return found


def scan_warnings(explained: float, trajectory: FloatArray, poses: str) -> list[str]:
    """Return what looks wrong with a map of scans, and what to try.

    Args:
        explained: of :func:`explained_share`.
        trajectory: rows t, x, y, theta.
        poses: what they are by.
    """
    found = []
    if explained < MIN_EXPLAINED:
        advice = {
            "match": "look at it with --plot; --scan-range 20 leaves out far readings",
            "log": "are the log's poses corrected ones? --poses match finds them from odometry and scans",
        }.get(poses, "--poses match finds the poses from odometry and scans")
        found.append(
            f"the map explains {explained:.0%} of the scans' end points, a right one {MIN_EXPLAINED:.0%} or more: "
            f"{advice}"
        )
    return [*found, *_speed_warnings(trajectory)]


def detection_warnings(
    result: SlamResult, estimates: Sequence[ObstacleEstimate], fitted: bool, poses: str
) -> list[str]:
    """Return what looks wrong with a map of detections, and what to try.

    Args:
        result: features and readings; of its NIS that of the filter.
        estimates: of its features, with covariances relative to the map.
        fitted: whether noise was estimated from the log after the filter, so that its NIS says nothing of the map.
        poses: what they are by.
    """
    found, counts, nis = [], result.counts, result.nis()
    judged = not fitted and nis.size >= MIN_UPDATES
    if judged and not (nis.inside or MIN_RATIO < nis.mean / nis.expected < 1.0 / MIN_RATIO):
        kind = "larger" if nis.mean > nis.expected else "smaller"
        found.append(
            f"the readings' errors are {kind} than the noise that is stated (NIS {nis.mean:.3g}, expected "
            f"{nis.expected:.3g}): --fit-noise on estimates it; --sensor-noise and --odometry-noise state it"
        )
    left_out = counts.outliers + counts.ambiguous
    if left_out > MAX_LEFT_OUT * max(1, counts.detections):
        found.append(
            f"{left_out / counts.detections:.0%} of the readings fit no feature: misread identities, things that "
            "moved, or wrong noise (--fit-noise on)"
        )
    if (doubled := _doubled(estimates)) > 0:
        found.append(
            f"{doubled} of {len(estimates)} features may be others seen twice, so that the map shows more than there "
            "is: look at it with --plot; --confirm 20 keeps those with more readings"
        )
    return [*found, *(_speed_warnings(result.trajectory) if poses == "slam" else [])]


def _doubled(estimates: Sequence[ObstacleEstimate]) -> int:
    """Return how many features lie so near to another one that, by their covariances, they may be the same."""
    points = np.array([estimate.mean.center for estimate in estimates if isinstance(estimate.mean, Disc)])
    if len(points) < 2:
        return 0
    blocks = np.array([estimate.covariance[:2, :2] for estimate in estimates])
    i, j = np.triu_indices(len(points), 1)
    gap, spread = points[j] - points[i], blocks[i] + blocks[j] + 1e-12 * np.eye(2)
    d2 = np.einsum("ni,nij,nj->n", gap, np.linalg.inv(spread), gap)
    return len(np.unique(j[d2 <= chi_square_quantile(SAME, 2)]))


def _speed_warnings(trajectory: FloatArray) -> list[str]:
    found = list[str]()
    if (speed := top_speed(trajectory)) > MAX_SPEED:
        found.append(
            f"speeds of {speed:.3g} m/s and more: expected at most {MAX_SPEED:g}; are the log's times right, and its "
            "odometry without jumps?"
        )
    return found
