"""Relations between all scans that saw the same place: each is matched against the maps of other visits.

Loop closures hold the graph together; these make the walls that several visits saw one wall.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.graph.graph_settings import LOCAL_SCANS, LOOP_SCORE, GraphSettings
from trailmark.estimation.graph.pose_graph import Relation
from trailmark.estimation.graph.submaps import MIN_POINTS, KeyScans
from trailmark.estimation.scans.clouds import relative
from trailmark.estimation.scans.correlation import match_covariance
from trailmark.estimation.scans.matching import refine

__all__ = ["revisit_relations"]

IntArray = NDArray[np.intp]

MAX_VISITS = 4
"""Earlier and later visits, at most, that one scan is matched against: the nearest ones."""

MAX_SHIFT = 0.3, np.radians(5.0)
"""Metres and radians: what is matched farther from where the optimised graph has it than this is something else."""


def revisit_relations(keys: KeyScans, settings: GraphSettings) -> list[Relation]:
    """Return where each scan lies in the maps of the other visits to its place, from the poses that it has now."""
    s, found = settings, list[Relation]()
    stretches = np.floor(keys.travel / (0.5 * s.local_length)).astype(np.intp)
    visitors = _visitors(keys, stretches, s)
    for stretch in np.unique(stretches):
        if len(visitors[stretch]) == 0:
            continue
        own = np.flatnonzero(stretches == stretch)
        middle = int(own[len(own) // 2])
        # One map for all scans that see this stretch.
        chain = keys.chain(middle, 1.5 * s.local_length, LOCAL_SCANS)
        area = keys.area(chain, keys.poses[middle], s.max_range + s.loop_distance, 0.0)
        for k in visitors[stretch]:
            cloud = keys.clouds[k]
            match = refine(area, cloud, keys.poses[k])
            shift = relative(keys.poses[k], match.pose)
            if match.score < LOOP_SCORE or np.hypot(*shift[:2]) > MAX_SHIFT[0] or abs(shift[2]) > MAX_SHIFT[1]:
                continue
            covariance, _ = match_covariance(area, cloud.points, match.pose, scatter=s.scatter)
            place = int(own[np.hypot(*(keys.poses[own, :2] - match.pose[:2]).T).argmin()])
            covariance = covariance + keys.spread(chain, place)
            found.append(keys.related(place, k, match.pose, covariance, certain=False))
    return found


def _visitors(keys: KeyScans, stretches: IntArray, s: GraphSettings) -> list[list[int]]:
    """Return for each stretch the scans of other visits that see it: each scan is in the lists of the nearest ones."""
    visitors: list[list[int]] = [[] for _ in range(stretches[-1] + 1)]
    for k, cloud in enumerate(keys.clouds):
        if len(cloud.points) < MIN_POINTS:
            continue
        apart = np.hypot(*(keys.poses[:, :2] - keys.poses[k, :2]).T)
        near = np.flatnonzero(
            (apart <= 0.5 * s.loop_distance) & (np.abs(keys.travel - keys.travel[k]) > s.local_length)
        )
        nearest = near[np.argsort(apart[near], kind="stable")]
        _, first = np.unique(stretches[nearest], return_index=True)
        for at in np.sort(first)[:MAX_VISITS]:
            visitors[stretches[nearest[at]]].append(k)
    return visitors
