"""A scan as a cloud of end points with the directions of the surfaces that they lie on."""

from __future__ import annotations

from math import atan2, cos, hypot, sin
from typing import NamedTuple

import numpy as np

from trailmark.estimation.logs.records import Scan
from trailmark.jit import njit
from trailmark.se2 import FloatArray, compose

__all__ = ["GRAZED", "PointCloud", "joined", "point_cloud", "relative", "surface_cloud", "transformed"]

NEIGHBOURS = 5
"""Beams to either side that a surface's direction is found from."""

REACH = 0.25
"""Metres from a point within which these neighbours count, where the beams are that dense."""

SPARSE = 0.4
"""Metres between neighbouring beams from which on a point of no known surface shows no shape of its own."""

GRAZED = 6.0
"""Times the beams' spacing up to which points may lie apart: two beams' steps on a surface met at 20 degrees."""


class PointCloud(NamedTuple):
    """End points of beams, in one frame."""

    points: FloatArray
    """Shape (n, 2), metres."""
    normals: FloatArray
    """Shape (n, 2): unit vectors across the surface, towards the scanner; zero where no straight surface was found."""
    spacing: FloatArray
    """Shape (n,): metres by which neighbouring beams lie apart at each point."""


def point_cloud(scan: Scan, max_range: float) -> PointCloud:
    """Return the end points of a scan that lie within ``max_range`` metres, in the robot's frame."""
    points, normals, spacing = _cloud(
        np.asarray(scan.ranges, dtype=np.float64),
        float(scan.angle_min),
        float(scan.angle_increment),
        min(float(scan.range_max), np.nextafter(max_range, np.inf)),
    )
    return transformed(PointCloud(points, normals, spacing), np.asarray(scan.mount, dtype=np.float64))


def surface_cloud(scan: Scan, max_range: float) -> PointCloud:
    """Return the end points that scans are matched by; see :func:`point_cloud`.

    Without those of which no surface is known where beams lie far apart: the next scan meets other points there.
    """
    cloud = point_cloud(scan, max_range)
    kept = cloud.normals.any(axis=1) | (cloud.spacing <= SPARSE)
    return PointCloud(*(array[kept] for array in cloud))


def transformed(cloud: PointCloud, pose: FloatArray) -> PointCloud:
    """Return a cloud of the frame at ``pose``, shape (3,), in the frame that the pose is given in."""
    c, s = cos(pose[2]), sin(pose[2])
    turn = np.array([[c, s], [-s, c]])
    return PointCloud(cloud.points @ turn + pose[:2], cloud.normals @ turn, cloud.spacing)


def joined(clouds: list[PointCloud], poses: FloatArray) -> PointCloud:
    """Return several clouds, each in the frame at its row of ``poses`` (n, 3), as one in the poses' frame."""
    parts = [transformed(cloud, pose) for cloud, pose in zip(clouds, poses, strict=True)]
    return PointCloud(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def relative(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the pose b in the frame of a, shape (..., 3)."""
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    inverse = np.stack([-c * a[..., 0] - s * a[..., 1], s * a[..., 0] - c * a[..., 1], -a[..., 2]], axis=-1)
    return compose(inverse, b)


@njit
def _cloud(ranges, first, step, limit):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return points, normals (the narrow axis of the neighbours' scatter, if it is narrow enough) and spacing."""
    n = len(ranges)
    places = np.empty((n, 2))
    good = np.zeros(n, dtype=np.bool_)
    count = 0
    for i in range(n):
        r = ranges[i]
        if r > 0.0 and r < limit:  # NaN is neither
            good[i] = True
            places[i, 0], places[i, 1] = r * cos(first + i * step), r * sin(first + i * step)
            count += 1
    points, normals, spacing = np.empty((count, 2)), np.zeros((count, 2)), np.empty(count)
    at = 0
    for i in range(n):
        if not good[i]:
            continue
        x, y = places[i]
        points[at, 0], points[at, 1], spacing[at] = x, y, abs(step) * ranges[i]
        # Far away neighbours lie farther apart.
        reach = max(REACH, GRAZED * spacing[at])
        m, sx, sy, sxx, sxy, syy = 0, 0.0, 0.0, 0.0, 0.0, 0.0
        for j in range(max(0, i - NEIGHBOURS), min(n, i + NEIGHBOURS + 1)):
            if good[j]:
                dx, dy = places[j, 0] - x, places[j, 1] - y
                if hypot(dx, dy) <= reach:
                    m += 1
                    sx += dx
                    sy += dy
                    sxx += dx * dx
                    sxy += dx * dy
                    syy += dy * dy
        if m >= 3:
            sxx, sxy, syy = sxx - sx * sx / m, sxy - sx * sy / m, syy - sy * sy / m
            half = hypot(0.5 * (sxx - syy), sxy)
            wide, narrow = 0.5 * (sxx + syy) + half, 0.5 * (sxx + syy) - half
            if narrow <= 0.1 * wide and narrow <= 0.03**2 * m:
                angle = 0.5 * atan2(2.0 * sxy, sxx - syy)
                nx, ny = -sin(angle), cos(angle)
                side = -1.0 if nx * x + ny * y > 0.0 else 1.0
                normals[at, 0], normals[at, 1] = side * nx, side * ny
        at += 1
    return points, normals, spacing
