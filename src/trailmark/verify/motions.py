"""Motions: what a path is made of, lines and arcs, with places along it; and where it goes a one-way zone's wrong way.

Zones are looked at by shapely alone.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from trailmark import se2
from trailmark.curves import CurvePath
from trailmark.path import Path
from trailmark.se2 import FloatArray
from trailmark.touching import TOUCHING_TOLERANCE
from trailmark.verify.advance import Close, Way
from trailmark.zones import OneWayZone, Zone

__all__ = ["Motions", "OneWayCheck", "WrongWay", "merged"]

MIN_RADIUS = 5e-7
"""Metres: smallest R, so that places along a turn in place are apart for a disc too, of which no point moves."""

ABUTTING = 1e-6
"""Metres: intervals that are nearer to one another are one."""

SLACK, IN_PLACE = 1e-6, 1e-9
"""Radians by which a direction may be beyond the tolerance, and metres: what is shorter is a turn in place."""

SAGITTA = 0.1 * TOUCHING_TOLERANCE
"""Metres that an arc may be off the chords that stand for it in a one-way zone."""


class Motions:
    """Straight motions and arcs one after another, with a scale: metres that no point of the robot outruns.

    Along it a motion is as long as its way and R·|Δθ| together, R the robot's largest distance from its reference
    point.

    Args:
        way: of n >= 1 motions.
        radius: R in metres; at least :data:`MIN_RADIUS` is used.
        off: metres, and radians, by which a curve ends off its knot at most.

    Attributes:
        lengths: metres that the reference point goes in each, shape (n,).
        near: the edges that a verifier found near them, and up to which distance, metres.
    """

    def __init__(self, way: Way, radius: float, off: float = 0.0) -> None:
        self.way, self.radius, self.off = Way(*map(np.ascontiguousarray, way)), radius, off
        self.near: tuple[float, Close] | None = None
        _, moves, curvature = way
        self.arcs = curvature != 0.0
        self.lengths = np.where(self.arcs, np.abs(moves[:, 0]), np.hypot(moves[:, 0], moves[:, 1]))
        self._along = np.concatenate([[0.0], np.cumsum(self.lengths)])
        spans = self.lengths + max(radius, MIN_RADIUS) * np.abs(moves[:, 2])
        self._ends = np.concatenate([[0.0], np.cumsum(spans)])

    @classmethod
    def of(cls, path: Path, radius: float) -> Motions:
        """Return a path's motions; at a single state there is one that moves nothing."""
        if isinstance(path, CurvePath) and len(path.knots) > 1:
            way, off = _driven(path)
            if len(way.starts):
                return cls(way, radius, off)
        states = path.states if len(path.states) > 1 else np.repeat(path.states, 2, axis=0)
        # A copy: read-only arrays would be another type to the kernels, and compiled for anew.
        starts = states[:-1].copy()
        return cls(Way(starts, se2.difference(starts, states[1:]), np.zeros(len(starts))), radius)

    @property
    def total(self) -> float:
        """Metres of all motions on the scale."""
        return float(self._ends[-1])

    def place(self, motion: ArrayLike, share: ArrayLike) -> FloatArray:
        """Return places on the scale of shares of motions."""
        i = np.asarray(motion, dtype=np.intp)
        return np.asarray(self._ends[i] + np.asarray(share) * (self._ends[i + 1] - self._ends[i]))

    def motion(self, places: ArrayLike) -> tuple[NDArray[np.intp], FloatArray]:
        """Return the motions that places lie on, and the shares of them, each of the places' shape."""
        where = np.asarray(places, dtype=np.float64)
        i = np.clip(np.searchsorted(self._ends, where, side="right") - 1, 0, len(self._ends) - 2)
        span = self._ends[i + 1] - self._ends[i]
        return i, np.clip((where - self._ends[i]) / np.where(span > 0.0, span, 1.0), 0.0, 1.0)

    def length(self, place: float) -> float:
        """Return metres along the xy curve."""
        i, share = self.motion(place)
        return float(self._along[i] + share * self.lengths[i])

    def poses(self, places: ArrayLike) -> FloatArray:
        """Return the configurations at places (n,), shape (n, 3)."""
        i, share = self.motion(np.atleast_1d(places))
        q = self.way.starts[i] + share[:, None] * self.way.moves[i]
        arcs = self.arcs[i]
        length, turn = share * self.way.moves[i, 0], share * self.way.moves[i, 2]
        q[arcs] = _moved(self.way.starts[i[arcs]], length[arcs], turn[arcs])
        q[:, 2] = se2.wrap(q[:, 2])
        return q

    def interval(self, motions: tuple[float, float]) -> tuple[float, float]:
        """Return the places of two numbers of motions, as :attr:`Collision.motions` has them."""
        first = np.clip(np.floor(motions), 0, len(self.way.starts) - 1)
        begin, end = self.place(first, np.asarray(motions) - first)
        return float(begin), float(end)

    def part(self, begin: float, end: float) -> Motions:
        """Return the motions between two places."""
        (first, last), (since, until) = self.motion([begin, end])
        starts, moves = self.way.starts[first : last + 1].copy(), self.way.moves[first : last + 1].copy()
        starts[0] = self.poses(begin)[0]
        moves[-1] *= until
        moves[0] *= (until - since) / until if first == last and until > 0.0 else 1.0 - since
        return Motions(Way(starts, moves, self.way.curvature[first : last + 1]), self.radius)

    def states(self, begin: float, end: float) -> FloatArray:
        """Return the states between two places, both included, at which motions meet: shape (n, 3), n >= 2."""
        (first, last), _ = self.motion([begin, end])
        a, b = self.poses([begin, end])
        return np.concatenate([a[None], self.way.starts[first + 1 : last + 1], b[None]])

    def box(self) -> tuple[FloatArray, FloatArray]:
        """Return the lower left and the upper right corner, shapes (2,), of a box that holds the reference point."""
        ends = self.way.starts[:, :2] + np.where(self.arcs[:, None], 0.0, self.way.moves[:, :2])
        room = np.where(self.arcs, self.lengths, 0.0)[:, None]
        both = np.concatenate([self.way.starts[:, :2], ends])
        room = np.concatenate([room, room])
        return (both - room).min(axis=0), (both + room).max(axis=0)

    def chords(self, off: float) -> tuple[FloatArray, NDArray[np.intp], FloatArray]:
        """Return straight motions that arcs are no farther from than ``off`` metres.

        Returns:
            Their states, shape (m + 1, 3); which motion each is a chord of, (m,); and the directions of travel
            (radians) where it begins and where it ends, (m, 2).
        """
        # The middle of a chord over an angle a is r·(1 - cos(a/2)), about r·a²/8, off an arc of radius r.
        angle = np.sqrt(8.0 * off * np.abs(self.way.curvature))
        count = np.ceil(np.abs(self.way.moves[:, 2]) / np.where(self.arcs, angle, np.inf)).astype(np.intp) + 1
        count[~self.arcs] = 1
        of = np.repeat(np.arange(len(count)), count)
        share = (np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)) / count[of]
        states = np.vstack([self.poses(self.place(of, share)), self.poses(self.total)])
        states[:-1][share == 0.0] = self.way.starts
        states[:, 2] = se2.wrap(states[:, 2])
        heading = (
            self.way.starts[of, 2] + share * self.way.moves[of, 2] + np.where(self.way.moves[of, 0] < 0.0, np.pi, 0.0)
        )
        arc = np.column_stack([heading, heading + self.way.moves[of, 2] / count[of]])
        straight = np.arctan2(self.way.moves[of, 1], self.way.moves[of, 0])[:, None]
        return states, of, np.where(self.arcs[of, None], arc, straight)


def merged(intervals: ArrayLike) -> list[tuple[float, float]]:
    """Return intervals, shape (n, 2), in order, those that overlap or abut made one."""
    rows = np.asarray(intervals, dtype=np.float64).reshape(-1, 2)
    if len(rows) == 0:
        return []
    begin, end = rows[np.argsort(rows[:, 0], kind="stable")].T
    end = np.maximum.accumulate(end)
    first = np.flatnonzero(np.append(True, begin[1:] > end[:-1] + ABUTTING))
    return [(float(a), float(b)) for a, b in zip(begin[first], end[np.append(first[1:], len(end)) - 1], strict=True)]


def _driven(path: CurvePath) -> tuple[Way, float]:
    """Return the pieces of curves, and how far one ends off its knot at most."""
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
    return Way(starts[used], moves[used], curvature[used]), float(off)


def _moved(q: FloatArray, length: FloatArray, turn: FloatArray) -> FloatArray:
    """Return where arcs of some metres and radians, shape (n,), lead from configurations (n, 3); turn 0: straight."""
    arc = turn != 0.0
    radius = np.divide(length, turn, out=np.zeros_like(length), where=arc)
    heading = q[:, 2] + turn
    x = np.where(arc, radius * (np.sin(heading) - np.sin(q[:, 2])), length * np.cos(q[:, 2]))
    y = np.where(arc, radius * (np.cos(q[:, 2]) - np.cos(heading)), length * np.sin(q[:, 2]))
    return np.column_stack([q[:, 0] + x, q[:, 1] + y, heading])


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
