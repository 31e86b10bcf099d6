"""Laser scans of shapely's shapes: what the tests of scans and maps are measured by."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely

from trailmark.estimation.records import Scan
from trailmark.se2 import FloatArray


def cast(
    regions: Sequence[shapely.Geometry],
    pose: Sequence[float],
    *,
    beams: int = 180,
    field: float = math.pi,
    range_max: float = 20.0,
    sigma_range: float = 0.0,
    sigma_bearing: float = 0.0,
    rng: np.random.Generator | None = None,
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0),
    t: float = 0.0,
) -> Scan:
    """A scan from a pose: the first crossing of each beam with an outline, ``range_max`` where there is none."""
    x, y, theta = pose
    cos, sin = math.cos(theta), math.sin(theta)
    origin = np.array([x + cos * mount[0] - sin * mount[1], y + sin * mount[0] + cos * mount[1]])
    step = field / beams if field > 6.28 else field / (beams - 1)
    angles = -0.5 * field + step * np.arange(beams)
    noise = rng.normal(size=(2, beams)) if rng is not None else np.zeros((2, beams))
    world_angles = theta + mount[2] + angles + sigma_bearing * noise[0]
    ranges = first_crossings(edges(regions) - origin, np.column_stack([np.cos(world_angles), np.sin(world_angles)]))
    ranges = np.where(ranges <= range_max, ranges + sigma_range * noise[1], range_max)
    return Scan(t, ranges, float(angles[0]), step, range_max, mount, (x, y, theta))


def edges(regions: Sequence[shapely.Geometry]) -> FloatArray:
    """The edges of all outlines, shape (n, 2 ends, 2)."""
    lines = shapely.get_parts([shapely.boundary(region) for region in regions])
    points, line = shapely.get_coordinates(lines, return_index=True)
    within = line[:-1] == line[1:]
    return np.stack([points[:-1][within], points[1:][within]], axis=1)


def first_crossings(edges: FloatArray, directions: FloatArray) -> FloatArray:
    """How far from the origin rays with these directions first cross an edge, infinite where they cross none."""
    a, along = edges[:, 0], edges[:, 1] - edges[:, 0]
    dx, dy = directions[:, :1], directions[:, 1:]
    # An edge along a ray counts by its neighbours' ends; rounding lets no ray through between two edges.
    with np.errstate(divide="ignore", invalid="ignore"):
        slant = dx * along[:, 1] - dy * along[:, 0]
        distance = (a[:, 0] * along[:, 1] - a[:, 1] * along[:, 0]) / slant
        place = (a[:, 0] * dy - a[:, 1] * dx) / slant
    met = (slant != 0.0) & (distance >= 0.0) & (place >= -1e-9) & (place <= 1.0 + 1e-9)
    return np.asarray(np.where(met, distance, math.inf).min(axis=1, initial=math.inf))


def room(xmin: float, ymin: float, xmax: float, ymax: float, thickness: float = 0.2) -> shapely.Geometry:
    """Four walls whose inner faces are the given box."""
    inner = shapely.box(xmin, ymin, xmax, ymax)
    return shapely.difference(shapely.buffer(inner, thickness, join_style="mitre"), inner)


def end_points(scan: Scan) -> FloatArray:
    """Where the beams that met something ended, in the world, shape (n, 2)."""
    assert scan.pose is not None
    met = scan.ranges < scan.range_max
    angles = scan.angle_min + scan.angle_increment * np.flatnonzero(met)
    x, y, theta = scan.pose
    cos, sin = math.cos(theta), math.sin(theta)
    direction = angles + theta + scan.mount[2]
    origin = [x + cos * scan.mount[0] - sin * scan.mount[1], y + sin * scan.mount[0] + cos * scan.mount[1]]
    rays = scan.ranges[met][:, None] * np.column_stack([np.cos(direction), np.sin(direction)])
    return np.asarray(origin + rays)
