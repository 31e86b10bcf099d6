"""Laser scans of shapes, by shapely: what the tests of scans and maps are measured by."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely

from trailmark.estimation.logs.records import Scan
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
    ends = origin + range_max * np.column_stack([np.cos(world_angles), np.sin(world_angles)])
    outlines = shapely.union_all([shapely.boundary(region) for region in regions])
    lines = shapely.linestrings(np.stack([np.broadcast_to(origin, ends.shape), ends], axis=1))
    ranges = shapely.distance(shapely.intersection(lines, outlines), shapely.Point(origin))
    met = np.isfinite(ranges)
    ranges = np.where(met, np.nan_to_num(ranges) + sigma_range * noise[1], range_max)
    return Scan(t, ranges, float(angles[0]), step, range_max, mount, (x, y, theta))


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
