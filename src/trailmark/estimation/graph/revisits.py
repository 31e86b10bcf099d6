"""Relations between all scans that saw the same place: each is matched against the maps of other visits.

Loop closures hold the graph together; these make the walls that several visits saw one wall.
"""

# Tested by tests/estimation/graph/test_scan_slam.py.

from __future__ import annotations

import numpy as np

from trailmark.estimation.graph.graph_settings import GraphSettings
from trailmark.estimation.graph.pose_graph import Relation
from trailmark.estimation.graph.submaps import KeyScans
from trailmark.estimation.scans.clouds import relative
from trailmark.estimation.scans.matching import match_covariance, refine

__all__ = ["revisit_relations"]

MAX_VISITS = 4
"""Earlier and later visits, at most, that one scan is matched against: the nearest ones."""

MAX_SHIFT = 0.3, np.radians(5.0)
"""Metres and radians: what is matched farther from where the optimised graph has it than this is something else."""


def revisit_relations(keys: KeyScans, settings: GraphSettings) -> list[Relation]:
    """Return where each scan lies in the maps of the other visits to its place, from the poses that it has now."""
    s, found = settings, list[Relation]()
    for k, cloud in enumerate(keys.clouds):
        if len(cloud.points) == 0:
            continue
        apart = np.hypot(*(keys.poses[:, :2] - keys.poses[k, :2]).T)
        near = np.flatnonzero(
            (apart <= 0.5 * s.loop_distance) & (np.abs(keys.travel - keys.travel[k]) > s.local_length)
        )
        runs = [run for run in np.split(near, np.flatnonzero(np.diff(near) > 1) + 1) if len(run)]
        nearest = sorted((int(run[apart[run].argmin()]) for run in runs), key=lambda i: float(apart[i]))
        for place in nearest[:MAX_VISITS]:
            chain = keys.chain(place, s.local_length, s.local_scans)
            area = keys.area(chain, keys.poses[k], float(np.abs(cloud.points).max()) * 1.5, 0.0)
            match = refine(area, cloud, keys.poses[k])
            shift = relative(keys.poses[k], match.pose)
            if match.score < s.loop_score or np.hypot(*shift[:2]) > MAX_SHIFT[0] or abs(shift[2]) > MAX_SHIFT[1]:
                continue
            covariance, _ = match_covariance(area, cloud.points, match.pose)
            found.append(keys.related(place, k, match.pose, covariance, certain=False))
    return found
