"""FinalCheck: a path is certified once more, in the form in which it is returned, before it is called free.

It shares no code with what found the path: no clearance field, no grid of obstacles, no kernel of
:mod:`trailmark.collision`, and curves are driven by a formula of their own. Obstacles are their edges in an R-tree; a
motion is certified by conservative advancement, the interval halved until every edge is farther away than any point of
the robot moves. Without an edge ever met, what lies outside of what at the first state does so all along.

The footprint is eroded by :data:`RIM`: a valid path may overlap an obstacle by 1e-7 m where it touches, and rounding is
another here. No deeper overlap is missed, but of tips: an erosion draws a corner of angle 2a back by RIM / sin(a).

It shares no code with :mod:`trailmark.motion.one_way`. Zones are eroded by what counts as touching, which a valid path
may; arcs are chords, no farther from them than a tenth of that.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import shapely

from trailmark import se2
from trailmark.collision.footprint import TOUCHING_TOLERANCE
from trailmark.curves import CurvePath
from trailmark.formats.grid import cells_of
from trailmark.path import Path
from trailmark.planning.conservative_advancement import advance
from trailmark.planning.edge_index import CellIndex, EdgeIndex, closed
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc, Polygon
from trailmark.world import Robot, World
from trailmark.zones import OneWayZone, Zone

__all__ = ["RIM", "FinalCheck", "OneWayCheck"]

RIM = 1e-6
"""Metres of overlap that are not looked at."""

PIECE, MAX_PIECES = 4.0, 64
"""Circumradii that a piece of a motion is long for which nearby edges are looked up, and pieces of a motion at most."""

MISSED = 1e-5
"""Metres, and radians, that a curve may end off its knot, for radii and coordinates up to 1e5 m."""


OFF_HEADING = 1e-8
"""Metres, and metres for each metre, by which a drive ahead may lead aside, for rounding."""


class FinalCheck:
    """Certifies finished paths of one robot in one world.

    Args:
        world: obstacles, bounds, boundary.
        robot: footprint.
    """

    def __init__(self, world: World, robot: Robot) -> None:
        self.world, self.robot = world, robot
        shape = robot.footprint
        self._radius, self._parts, self._body = robot.clearance, [], np.zeros((1, 4))
        if isinstance(shape, Disc):
            self._radius += max(shape.radius - RIM, 0.5 * shape.radius)
        else:
            self._parts = _eroded(robot.outline)
            self._body = np.concatenate([closed(ring) for part in self._parts for ring in _coordinates(part)])
        cells = cells_of(world)
        self._index: EdgeIndex | CellIndex = EdgeIndex(world) if cells is None else CellIndex(world, cells)
        self._one_way = OneWayCheck(world.zones)

    def fault(self, path: Path, start: FloatArray, goal: FloatArray) -> str | None:
        """Return what is wrong with a path, or None if it leads from start to goal and is certified.

        Args:
            path: as it is to be returned.
            start: configuration, shape (3,).
            goal: configuration, shape (3,).
        """
        for name, q, state in (("start", start, path.states[0]), ("goal", goal, path.states[-1])):
            if not np.array_equal(q, state):
                return f"the path's {name} is {state.tolist()}, expected {np.asarray(q).tolist()}"
        if isinstance(path, CurvePath):
            starts, moves, curvature, off = _driven(path)
            if off > MISSED:
                return f"a curve ends {off:g} m or radians off its knot"
        else:
            starts, moves = path.states[:-1].copy(), se2.difference(path.states[:-1], path.states[1:])
            curvature = np.zeros(len(starts))
        if (problem := self._fault_at(path.states[0])) is not None:
            return problem
        if self.robot.drive == "differential" and (problem := _undriven(starts, moves, self.robot.reverse)) is not None:
            return problem
        failed, where = self._certified(starts, moves, curvature)
        if failed >= 0:
            return f"motion {failed} from {starts[failed].tolist()} meets an obstacle at {where:.6f} of its way"
        return self._one_way.fault(starts, moves, curvature)

    def _certified(self, starts: FloatArray, moves: FloatArray, curvature: FloatArray) -> tuple[int, float]:
        """Return the first motion that is not certified and at which share of it; -1 if all are.

        Args:
            starts: (n, 3).
            moves: (n, 3): changes of x, y and heading; of an arc the metres driven, 0 and the change of heading.
            curvature: (n,), 1/metres, signed; 0 of straight motions.
        """
        reach = self.robot.circumradius
        arcs = curvature != 0.0
        ends = starts[:, :2] + np.where(arcs[:, None], 0.0, moves[:, :2])
        room = (reach + np.where(arcs, np.abs(moves[:, 0]), 0.0))[:, None]
        # Long motions in pieces: the box of a slanting one holds many obstacles that it does not come near.
        length = np.hypot(*(ends - starts[:, :2]).T)
        count = np.ceil(np.clip(length / (PIECE * reach), 1.0, MAX_PIECES)).astype(np.int64)
        of = np.repeat(np.arange(len(starts)), count)
        share = (np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)) / count[of]
        begin = starts[of, :2] + share[:, None] * (ends - starts[:, :2])[of]
        end = begin + ((ends - starts[:, :2]) / count[:, None])[of]
        low, high = np.minimum(begin, end) - room[of], np.maximum(begin, end) + room[of]
        first, item, runs, edges = self._index.near(low, high, of, len(starts))
        return advance(
            self._body,
            self._radius,
            np.ascontiguousarray(starts),
            np.ascontiguousarray(moves),
            curvature,
            first,
            item,
            runs,
            edges,
        )

    def _fault_at(self, q: FloatArray) -> str | None:
        """Return what is wrong with a state: overlap, one inside the other included."""
        xmin, ymin, xmax, ymax = self.world.bounds
        body = shapely.MultiPolygon([_placed(part, q) for part in self._parts]) if self._parts else shapely.Point(q[:2])
        low, high = np.array(body.bounds[:2]) - self._radius, np.array(body.bounds[2:]) + self._radius
        if min(low[0] - xmin, low[1] - ymin, xmax - high[0], ymax - high[1]) < 0.0:
            return f"state {q.tolist()} reaches over the bounds"
        radius = self._radius
        if self.world.boundary is not None:
            inside = self.world.boundary.shapely()
            if not shapely.covers(inside, body) or shapely.distance(inside.exterior, body) < radius:
                return f"state {q.tolist()} reaches over the boundary"
        for shape in self._index.shapes_near(low, high):
            if isinstance(shape, Disc):
                overlap = shapely.distance(shapely.Point(shape.center), body) < radius + shape.radius - RIM
            elif radius > 0.0:
                overlap = shapely.distance(shape.polygon().shapely(), body) < radius
            else:
                overlap = shapely.intersects(shape.polygon().shapely(), body)
            if overlap:
                known = self.world.obstacles
                name = known.index(shape) if isinstance(known, tuple) else f"cells in {shape.bounding_box()}"
                return f"state {q.tolist()} overlaps obstacle {name}"
        return None


def _eroded(outline: Polygon) -> list[shapely.Polygon]:
    """Return the parts of a footprint less its rim; all of it if it is so thin that nothing would be left."""
    region = outline.shapely()
    parts = shapely.get_parts(shapely.buffer(region, -RIM, join_style="round", quad_segs=2))
    return [part for part in parts if not part.is_empty] or [region]


def _coordinates(part: shapely.Polygon) -> list[FloatArray]:
    """Return the rings of a polygon, not closed, each of shape (n, 2)."""
    return [shapely.get_coordinates(ring)[:-1] for ring in (part.exterior, *part.interiors)]


def _placed(part: shapely.Polygon, q: FloatArray) -> shapely.Polygon:
    rings = [se2.transform(q, ring) for ring in _coordinates(part)]
    return shapely.Polygon(rings[0], rings[1:])


def _undriven(starts: FloatArray, moves: FloatArray, reverse: bool) -> str | None:
    """Return what motions (starts and changes, each (n, 3)) a differential drive cannot make; None if it can all."""
    length = np.hypot(moves[:, 0], moves[:, 1])
    ahead = np.cos(starts[:, 2]) * moves[:, 0] + np.sin(starts[:, 2]) * moves[:, 1]
    aside = np.abs(np.cos(starts[:, 2]) * moves[:, 1] - np.sin(starts[:, 2]) * moves[:, 0])
    turns_only = length == 0.0
    drives_only = (moves[:, 2] == 0.0) & (aside <= OFF_HEADING * (1.0 + length)) & (reverse | (ahead >= 0.0))
    wrong = np.flatnonzero(~(turns_only | drives_only))
    return f"motion {wrong[0]} is neither a turn in place nor a drive ahead" if len(wrong) else None


def _driven(path: CurvePath) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Return where the pieces of curves begin, their moves and curvature, and how far one ends off its knot at most."""
    curves, knots = path.curves, path.knots
    used = curves.signed_lengths != 0.0
    turns = np.where(used, curves.sides * curves.signed_lengths, 0.0) / path.steering.radius
    starts = np.empty((*curves.signed_lengths.shape, 3))
    q = np.array(knots[:-1])
    for k in range(curves.signed_lengths.shape[1]):
        starts[:, k] = q
        q = _moved(q, curves.signed_lengths[:, k] * used[:, k], turns[:, k])
    off = np.abs(se2.difference(q, knots[1:])).max(initial=0.0)
    # What Path.at and resample make of it must be the same: at the middle of each curve, and where its pieces end.
    ends = np.cumsum(np.abs(curves.signed_lengths), axis=1)
    places = np.hstack([ends[:, :-1], 0.5 * ends[:, -1:]])
    seen = path.steering.states(knots[:-1], knots[1:], places)
    off = max(off, float(np.abs(se2.difference(seen[:, :-1], starts[:, 1:])).max(initial=0.0)))
    moves = np.stack([curves.signed_lengths, np.zeros_like(turns), turns], axis=-1)
    straight = used & (curves.sides == 0)
    c, s = np.cos(starts[..., 2]), np.sin(starts[..., 2])
    moves[straight] = np.stack([curves.signed_lengths * c, curves.signed_lengths * s, turns], axis=-1)[straight]
    curvature = np.where(used, curves.sides / path.steering.radius, 0.0)
    return starts[used], moves[used], curvature[used], float(off)


def _moved(q: FloatArray, length: FloatArray, turn: FloatArray) -> FloatArray:
    """Return where arcs of some metres and radians, shape (n,), lead from configurations (n, 3); turn 0: straight."""
    arc = turn != 0.0
    radius = np.divide(length, turn, out=np.zeros_like(length), where=arc)
    heading = q[:, 2] + turn
    x = np.where(arc, radius * (np.sin(heading) - np.sin(q[:, 2])), length * np.cos(q[:, 2]))
    y = np.where(arc, radius * (np.cos(q[:, 2]) - np.cos(heading)), length * np.sin(q[:, 2]))
    return np.column_stack([q[:, 0] + x, q[:, 1] + y, heading])


# --- OneWayCheck: the part of the final check that looks at the direction of travel in one-way zones, by shapely
# alone.

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
