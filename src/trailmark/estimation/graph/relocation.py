"""Where in a whole map a scan may have been taken: for a robot that is lost."""

from __future__ import annotations

import math

import numpy as np

from trailmark.estimation.graph.graph_settings import LOOP_SCORE, GraphSettings
from trailmark.estimation.graph.submaps import MIN_POINTS, KeyScans
from trailmark.estimation.logs.records import Scan
from trailmark.estimation.scans.clouds import surface_cloud
from trailmark.estimation.scans.correlation import Window, search
from trailmark.estimation.scans.matching import refine
from trailmark.se2 import FloatArray

__all__ = ["places_like"]

SEARCHED = 200
"""End points, at most, that are looked for in the whole map."""

HEADINGS = 8
"""Parts of a full turn in which it is looked for one by one."""

FAR = 1e6
"""Metres: all of a map."""


def places_like(scan: Scan, keys: KeyScans, settings: GraphSettings) -> FloatArray:
    """Return where a scan may have been taken, shape (k, 3): the best place for each heading.

    Args:
        scan: of the lost robot.
        keys: the map.
        settings: how scans are matched.
    """
    cloud = surface_cloud(scan, settings.max_range)
    if len(cloud.points) < MIN_POINTS or not len(keys):
        return np.empty((0, 3))
    area = keys.area(np.arange(len(keys)), keys.poses[0], FAR, FAR)
    low, high = area.points.min(axis=0), area.points.max(axis=0)
    points = cloud.points[:: -(-len(cloud.points) // SEARCHED)]
    window = Window(0.5 * float((high - low).max()), math.pi / HEADINGS)
    found = list[FloatArray]()
    for heading in 2.0 * math.pi * np.arange(HEADINGS) / HEADINGS:
        guess = np.append(0.5 * (low + high), heading)
        match = search(area, points, guess, window, coarseness=2, min_score=0.5 * LOOP_SCORE)
        if match is not None:
            found.append(refine(area, cloud, match.pose).pose)
    return np.array(found).reshape(-1, 3)
