"""Does a map fit the log that it was made from? Figures on it, and one sentence on each thing that looks wrong."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trailmark.estimation.logs.records import Scan
from trailmark.estimation.maps.map_settings import MappingSettings
from trailmark.estimation.maps.scan_map import beam_ends
from trailmark.se2 import FloatArray
from trailmark.world import World

__all__ = ["duration", "explained_share", "scan_warnings", "top_speed"]

NEAR = 0.15
"""Metres from an obstacle's outline within which a scan's end point counts as explained."""

MIN_EXPLAINED = 0.9
"""Share of the end points that a right map explains: people and glass make up for the rest."""

MAX_SPEED = 10.0
"""Metres a second: no indoor robot is as fast, and few outdoors are."""

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
    if (speed := top_speed(trajectory)) > MAX_SPEED:
        found.append(
            f"speeds of {speed:.3g} m/s and more: expected at most {MAX_SPEED:g}; are the log's times right, and its "
            "odometry without jumps?"
        )
    return found
