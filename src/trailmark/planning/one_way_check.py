"""OneWayCheck: the part of the final check that looks at the direction of travel in one-way zones, by shapely alone.

It shares no code with :mod:`trailmark.motion.one_way`. Zones are eroded by what counts as touching, which a valid path
may; arcs are chords, no farther from them than a tenth of that.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import shapely

from trailmark import se2
from trailmark.collision.footprint import TOUCHING_TOLERANCE
from trailmark.se2 import FloatArray
from trailmark.zones import OneWayZone, Zone

__all__ = ["OneWayCheck"]

SLACK = 1e-6
"""Radians by which a direction may lie beyond the tolerance."""

IN_PLACE = 1e-9
"""Metres: what is shorter has no direction of travel."""


class OneWayCheck:
    """Finds where a path travels through one-way zones in a wrong direction.

    Args:
        zones: of the world.
    """

    def __init__(self, zones: Iterable[Zone]) -> None:
        self._zones = []
        for i, zone in enumerate(zones):
            if isinstance(zone, OneWayZone):
                region = shapely.buffer(zone.region.shapely(), -TOUCHING_TOLERANCE, join_style="mitre")
                shapely.prepare(region)
                self._zones.append((i, zone, region))

    def fault(self, starts: FloatArray, moves: FloatArray, curvature: FloatArray) -> str | None:
        """Return where a path goes the wrong way; None if it does not.

        Args:
            starts: of its motions, shape (n, 3).
            moves: (n, 3): changes of x, y and heading; of an arc the metres driven, 0 and the change of heading.
            curvature: (n,), 1/metres, signed; 0 of straight motions.
        """
        if not self._zones:
            return None
        arcs = curvature != 0.0
        lines = [np.stack([starts[:, :2], starts[:, :2] + moves[:, :2]], axis=1)[~arcs]]
        ahead = [np.tile(np.arctan2(moves[~arcs, 1], moves[~arcs, 0])[:, None], (1, 2))]
        motion = [np.flatnonzero(~arcs)]
        for arc in np.flatnonzero(arcs):
            chords, directions = _chords(starts[arc], moves[arc, 0], curvature[arc])
            lines.append(chords)
            ahead.append(directions)
            motion.append(np.full(len(chords), arc))
        segments, directions, motions = np.concatenate(lines), np.concatenate(ahead), np.concatenate(motion)
        travels = np.hypot(*(segments[:, 1] - segments[:, 0]).T) > IN_PLACE
        for i, zone, region in self._zones:
            off = np.abs(se2.wrap(directions - zone.heading)).min(axis=1)
            wrong = np.flatnonzero(travels & (off > zone.tolerance + SLACK))
            hit = shapely.intersects(region, shapely.linestrings(segments[wrong])) if len(wrong) else np.empty(0, bool)
            if hit.any():
                first = wrong[int(np.argmax(hit))]
                begin = starts[motions[first]].tolist()
                return f"motion {motions[first]} from {begin} goes {off[first]:.6f} rad off one-way zone {i}'s heading"
        return None


def _chords(start: FloatArray, length: float, curvature: float) -> tuple[FloatArray, FloatArray]:
    """Return an arc's chords, shape (m, 2, 2), and the directions of travel at their ends, shape (m, 2).

    Args:
        start: shape (3,).
        length: metres driven, negative backwards.
        curvature: 1/metres, positive to the left of the robot's front.
    """
    radius = 1.0 / curvature
    turn = length * curvature
    # The middle of a chord over an angle a is |radius| · (1 - cos(a/2)), about |radius| · a²/8, off the arc.
    count = int(np.ceil(abs(turn) / np.sqrt(0.8 * TOUCHING_TOLERANCE / abs(radius)))) + 1
    heading = start[2] + np.linspace(0.0, turn, count + 1)
    x = start[0] + radius * (np.sin(heading) - np.sin(start[2]))
    y = start[1] + radius * (np.cos(start[2]) - np.cos(heading))
    points = np.column_stack([x, y])
    ahead = heading + (np.pi if length < 0.0 else 0.0)
    return np.stack([points[:-1], points[1:]], axis=1), np.column_stack([ahead[:-1], ahead[1:]])
