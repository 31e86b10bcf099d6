"""One-way zones in compiled code: whether a motion travels through them in an allowed direction, everywhere.

A straight motion or a car's arc is cut where it crosses an outline and where its direction of travel begins or ends to
be allowed; each part between two cuts lies either inside or outside of a zone and has an allowed direction either
everywhere or nowhere, which its middle tells. Of one inside it is proven that all of it is near to the outline, by
edges that both of its ends are near to, its halves taken one by one where there is none. Nothing is sampled.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from math import atan2, fabs, hypot, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.collision import StateChecker
from trailmark.curves.words import PIECES, drive
from trailmark.heading import wrapped
from trailmark.jit import array_callee, callee, njit
from trailmark.motion.density import sort_in_place
from trailmark.se2 import FloatArray
from trailmark.touching import TOUCHING_TOLERANCE
from trailmark.zones import OneWayZone, Zone

__all__ = ["DEPTH", "OneWays", "curve_allowed", "one_ways", "straight_allowed", "straight_valid"]

DEPTH = 0.9 * TOUCHING_TOLERANCE
"""Metres by which a motion may reach into a zone in any direction: as far as the robot may overlap obstacles, a tenth
of which is left for rounding."""

ANGLE = 1e-9
"""Radians by which a direction may lie beyond the tolerance: a tolerance of 0 leaves no room for rounding."""

IN_PLACE = 1e-9
"""Metres: what is shorter has no direction of travel, the robot turns in place."""

HALVINGS = 40
"""Of a part of a motion, at most: then it is no longer than rounding, and not proven to be near the outline."""

NEAR = 1e-6
"""Metres from a motion at which a corner of an outline cuts it too: rounding may hide that it crosses an edge there."""


class OneWays(NamedTuple):
    """One-way zones, as compiled code takes them.

    Attributes:
        edges: (m, 4), x1, y1, x2, y2 of the edges of all outlines and holes, zone by zone.
        first: (k + 1,), where the edges of each zone begin.
        boxes: (k, 4), xmin, ymin, xmax, ymax of each zone.
        headings: (k,), radians in (-pi, pi].
        tolerances: (k,), radians.
    """

    edges: FloatArray
    first: NDArray[np.int64]
    boxes: FloatArray
    headings: FloatArray
    tolerances: FloatArray


def one_ways(zones: Iterable[Zone]) -> OneWays:
    """Return the one-way zones among some zones; there may be none."""
    found = [zone for zone in zones if isinstance(zone, OneWayZone)]
    edges = [np.vstack([np.hstack([r, np.roll(r, -1, axis=0)]) for r in zone.region.rings()]) for zone in found]
    edges = [rows[(rows[:, :2] != rows[:, 2:]).any(axis=1)] for rows in edges]  # a corner may be there twice
    return OneWays(
        np.concatenate([np.empty((0, 4)), *edges]),
        np.cumsum([0, *map(len, edges)], dtype=np.int64),
        np.array([zone.region.bounding_box() for zone in found]).reshape(-1, 4),
        np.array([zone.heading for zone in found], dtype=np.float64),
        np.array([zone.tolerance for zone in found], dtype=np.float64),
    )


@njit(numbers=True)
def straight_allowed(zones: OneWays, a: FloatArray, b: FloatArray) -> bool:
    """Return whether the straight motion from a to b, each of shape (3,), travels as all zones allow."""
    if len(zones.headings) == 0:
        return True
    dx, dy = b[0] - a[0], b[1] - a[1]
    return _piece_allowed(zones, a[0], a[1], atan2(dy, dx), 0.0, hypot(dx, dy), 1.0)


def straight_valid(checker: StateChecker) -> Callable[[FloatArray, FloatArray], NDArray[np.bool_]]:
    """Return what tells which straight motions between states, each of shape (n, 3), are certified and allowed.

    A car's path is joined by them once it is a file of states, whatever its curves are.
    """
    zones = one_ways(checker.world.zones)

    def valid(a: FloatArray, b: FloatArray) -> NDArray[np.bool_]:
        found = np.array(checker.motions_valid(a, b))
        if len(zones.headings):
            for i in np.flatnonzero(found):
                found[i] = straight_allowed(zones, a[i], b[i])
        return found

    return valid


@njit(numbers=True)
def curve_allowed(zones: OneWays, a: FloatArray, word: FloatArray, radius: float) -> bool:
    """Return whether a car's curve travels as all zones allow, its pieces in reverse included.

    Args:
        zones: the one-way zones.
        a: where the curve begins, shape (3,).
        word: its pieces, shape (2, 5) (:mod:`trailmark.curves.words`).
        radius: turning radius, metres.
    """
    if len(zones.headings) == 0:
        return True
    x, y, theta = a[0], a[1], a[2]
    for k in range(PIECES):
        length, side = word[0, k] * radius, word[1, k]
        if length != 0.0:
            # In reverse, the robot travels where its back points, and turns the other way for each metre.
            ahead = theta if length > 0.0 else theta + pi
            turning = side if length > 0.0 else -side
            if not _piece_allowed(zones, x, y, wrapped(ahead), turning, fabs(length), radius):
                return False
            x, y, theta = drive(x, y, theta, side, length, radius)
    return True


@array_callee
def _piece_allowed(zones: OneWays, x: float, y: float, ahead: float, side: float, length: float, radius: float) -> bool:
    """Return whether a straight piece or an arc travels as all zones allow.

    Args:
        zones: the one-way zones.
        x: where it begins, metres.
        y: likewise.
        ahead: direction of travel where it begins, radians in (-pi, pi].
        side: 1 for an arc to the left, -1 to the right, 0 straight.
        length: metres, 0 or more.
        radius: of the arc, metres.
    """
    if length <= IN_PLACE:
        return True
    end_x, end_y, _ = drive(x, y, ahead, side, length, radius)
    # No point of an arc is farther from both ends than half of its length from the nearer one.
    room = 0.5 * length * fabs(side)
    low_x, high_x = min(x, end_x) - room, max(x, end_x) + room
    low_y, high_y = min(y, end_y) - room, max(y, end_y) + room
    for k in range(len(zones.headings)):
        tolerance = zones.tolerances[k] + ANGLE
        off = wrapped(ahead - zones.headings[k])
        if side == 0.0 and fabs(off) <= tolerance:
            continue
        box = zones.boxes[k]
        if low_x >= box[2] or high_x <= box[0] or low_y >= box[3] or high_y <= box[1]:
            continue
        edges = zones.edges[zones.first[k] : zones.first[k + 1]]
        cuts, count = np.empty(3 * len(edges) + 12), 1
        cuts[0] = 0.0
        if side == 0.0:
            count = _cut_line(edges, x, y, end_x, end_y, length, cuts, count)
        else:
            count = _cut_arc(edges, x, y, ahead, side, length, radius, cuts, count)
            for bound in (-tolerance, tolerance):
                place = (side * (bound - off)) % (2.0 * pi) * radius
                if place < length:
                    cuts[count] = place
                    count += 1
        cuts[count] = length
        sort_in_place(cuts, count + 1)
        for i in range(count):
            middle = 0.5 * (cuts[i] + cuts[i + 1])
            wrong = cuts[i + 1] - cuts[i] > IN_PLACE and fabs(wrapped(off + side * middle / radius)) > tolerance
            if wrong and not _near_outline(edges, x, y, ahead, side, cuts[i], cuts[i + 1], radius):
                return False
    return True


@array_callee
def _near_outline(
    edges: FloatArray, x: float, y: float, ahead: float, side: float, begin: float, end: float, radius: float
) -> bool:
    """Return whether a part of a piece, ``begin`` to ``end`` metres along it, is outside of a zone or near its outline.

    Other arguments are those of :func:`_piece_allowed`.
    """
    px, py, _ = drive(x, y, ahead, side, 0.5 * (begin + end), radius)
    if not _inside(edges, px, py):
        return True
    parts = np.empty((HALVINGS + 1, 2))
    parts[0, 0], parts[0, 1] = begin, end
    count = 1
    while count > 0:
        count -= 1
        low, high = parts[count]
        ax, ay, _ = drive(x, y, ahead, side, low, radius)
        bx, by, _ = drive(x, y, ahead, side, high, radius)
        # The distance from an edge is convex along a line; an arc is no farther than this from its chord.
        bulge = fabs(side) * (high - low) ** 2 / (8.0 * radius)
        near = False
        for edge in edges:
            if max(_distance(edge, ax, ay), _distance(edge, bx, by)) + bulge <= DEPTH:
                near = True
                break
        if near:
            continue
        middle = 0.5 * (low + high)
        mx, my, _ = drive(x, y, ahead, side, middle, radius)
        deep = True
        for edge in edges:
            deep = deep and _distance(edge, mx, my) > DEPTH
        if deep or count + 2 > len(parts):
            return False
        parts[count, 0], parts[count, 1] = low, middle
        parts[count + 1, 0], parts[count + 1, 1] = middle, high
        count += 2
    return True


@callee
def _cut_line(
    edges: FloatArray, x: float, y: float, end_x: float, end_y: float, length: float, cuts: FloatArray, count: int
) -> int:
    """Write where (metres) a segment meets edges, or passes near their corners, to ``cuts``; return the new count."""
    c, s = (end_x - x) / length, (end_y - y) / length
    for x1, y1, x2, y2 in edges:
        along1, off1 = c * (x1 - x) + s * (y1 - y), c * (y1 - y) - s * (x1 - x)
        along2, off2 = c * (x2 - x) + s * (y2 - y), c * (y2 - y) - s * (x2 - x)
        if fabs(off1) <= NEAR and 0.0 < along1 < length:
            cuts[count] = along1
            count += 1
        if (off1 < 0.0) != (off2 < 0.0):
            place = along1 + (along2 - along1) * (off1 / (off1 - off2))
            if 0.0 < place < length:
                cuts[count] = place
                count += 1
    return count


@callee
def _cut_arc(
    edges: FloatArray,
    x: float,
    y: float,
    ahead: float,
    side: float,
    length: float,
    radius: float,
    cuts: FloatArray,
    count: int,
) -> int:
    """Write where (metres) an arc meets edges, or passes near their corners, to ``cuts``; return the new count."""
    center_x, center_y, _ = drive(x, y, ahead + side * 0.5 * pi, 0.0, radius, radius)
    begin = atan2(y - center_y, x - center_x)
    for x1, y1, x2, y2 in edges:
        px, py, ex, ey = x1 - center_x, y1 - center_y, x2 - x1, y2 - y1
        near = fabs(hypot(px, py) - radius) <= NEAR
        size = hypot(ex, ey)
        nearest = -(px * ex + py * ey) / size  # metres along the edge
        inside = radius * radius - ((px * ey - py * ex) / size) ** 2
        half = sqrt(inside) if inside > 0.0 else 0.0
        for which in range(3):
            place = 0.0 if which == 0 else nearest + (which - 1.5) * 2.0 * half
            # Where it touches the edge, or all but does, it is cut too: no part's middle may lie on the outline.
            if near if which == 0 else (inside >= -2.0 * NEAR * radius and -NEAR <= place <= size + NEAR):
                angle = atan2(py + place * ey / size, px + place * ex / size)
                along = (side * (angle - begin)) % (2.0 * pi) * radius
                if along < length:
                    cuts[count] = along
                    count += 1
    return count


@callee
def _distance(edge: FloatArray, x: float, y: float) -> float:
    """Return the distance (metres) of a point from an edge, x1, y1, x2, y2."""
    ex, ey, px, py = edge[2] - edge[0], edge[3] - edge[1], x - edge[0], y - edge[1]
    t = min(1.0, max(0.0, (px * ex + py * ey) / (ex * ex + ey * ey)))
    return hypot(px - t * ex, py - t * ey)


@callee
def _inside(edges: FloatArray, x: float, y: float) -> bool:
    """Return whether a point is inside of a zone."""
    inside = False
    for x1, y1, x2, y2 in edges:
        if (y1 > y) != (y2 > y) and ((x2 - x1) * (y - y1) - (y2 - y1) * (x - x1) > 0.0) == (y2 > y1):
            inside = not inside
    return inside
