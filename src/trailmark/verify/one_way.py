"""Where a path travels through one-way zones in a wrong direction, by shapely alone."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import shapely

from trailmark import se2
from trailmark.se2 import FloatArray
from trailmark.touching import TOUCHING_TOLERANCE
from trailmark.verify.motions import Motions, merged
from trailmark.zones import OneWayZone, Zone

__all__ = ["OneWayCheck", "WrongWay"]

SLACK, IN_PLACE = 1e-6, 1e-9
"""Radians by which a direction may be beyond the tolerance, and metres: what is shorter is a turn in place."""

SAGITTA = 0.1 * TOUCHING_TOLERANCE
"""Metres that an arc may be off the chords that stand for it."""


class WrongWay(NamedTuple):
    """An interval on which a path goes the wrong way.

    Attributes:
        zone: its index among the world's zones.
        begin: place on the motions' scale.
        end: likewise.
        off: radians between the directions of travel and the zone's heading, at least.
    """

    zone: int
    begin: float
    end: float
    off: float


class OneWayCheck:
    """Finds where paths travel through one-way zones in a wrong direction.

    Zones are eroded by what counts as touching, which a valid path may.

    Args:
        zones: of the world.
    """

    def __init__(self, zones: Iterable[Zone]) -> None:
        self.zones = {i: zone for i, zone in enumerate(zones) if isinstance(zone, OneWayZone)}
        self._inside = {
            i: shapely.buffer(zone.region.shapely(), -TOUCHING_TOLERANCE, join_style="mitre")
            for i, zone in self.zones.items()
        }
        shapely.prepare(list(self._inside.values()))

    def wrong_ways(self, motions: Motions) -> list[WrongWay]:
        """Return the intervals, zone by zone; of an arc's chord any part may go in the direction that suits best."""
        if not self.zones:
            return []
        states, of, directions = motions.chords(SAGITTA)
        chord = np.arange(len(of)) - np.searchsorted(of, of)
        count = np.bincount(of)[of]
        lines = np.stack([states[:-1, :2], states[1:, :2]], axis=1)
        lengths = np.hypot(*(lines[:, 1] - lines[:, 0]).T)
        found = []
        for i, zone in self.zones.items():
            off = np.abs(se2.wrap(directions - zone.heading)).min(axis=1)
            wrong = np.flatnonzero((lengths > IN_PLACE) & (off > zone.tolerance + SLACK))
            wrong = wrong[shapely.intersects(self._inside[i], shapely.linestrings(lines[wrong]))]
            rows, least = list[FloatArray](), np.inf
            for k in wrong.tolist():
                for part in shapely.get_parts(shapely.intersection(self._inside[i], shapely.LineString(lines[k]))):
                    if part.length > 0.0:
                        along = np.hypot(*(shapely.get_coordinates(part) - lines[k, 0]).T) / lengths[k]
                        shares = (chord[k] + np.minimum([along.min(), along.max()], 1.0)) / count[k]
                        rows.append(motions.place(of[k], shares))
                        least = min(least, float(off[k]))
            found += [WrongWay(i, begin, end, least) for begin, end in merged(np.array(rows))]
        return found

    def depths(self, zone: int, states: FloatArray) -> FloatArray:
        """Return how far (metres) the reference point is from a zone's outline, at configurations (n, 3): (n,)."""
        outline = self.zones[zone].region.shapely().boundary
        return np.asarray(shapely.distance(outline, shapely.points(states[:, :2])))
