"""Trajectory: a path with the fastest time law along it, by forward and backward passes on the squared speed.

Along a path q(s) the velocity is q'·ds/dt and the acceleration q'·u + q''·x, with x = (ds/dt)² and u = d²s/dt². Where u
is constant, x is linear in s. Each piece of the path is cut into intervals with one u each; on straight pieces these
are exact, since accelerating, holding a speed and braking is the fastest. On others their number is a setting. The
limits hold everywhere, not just where intervals meet: on a parabola the acceleration is linear in s within an interval,
so its norm is largest at the ends; elsewhere bounds over the interval are used. The backward pass finds the largest x
from which the rest of the path can be driven, the forward pass accelerates below it as hard as it may; as the intervals
get finer, that is the fastest law (Pham and Pham, "A New Approach to Time-Optimal Path Parameterization Based on
Reachability Analysis", IEEE T-RO 34(3), 2018, DOI 10.1109/TRO.2018.2819195).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from math import inf, sqrt
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from trailmark import se2
from trailmark.arguments import number, number_array, one_of, whole
from trailmark.curves import CurvePath
from trailmark.errors import ConfigurationError
from trailmark.path import Path
from trailmark.se2 import FloatArray
from trailmark.trajectories.pieces import Pieces, joined, pieces_of
from trailmark.trajectories.smooth import SmoothPath
from trailmark.zones import SpeedZone

__all__ = ["Limits", "TimeLaw", "Trajectory", "fastest", "timed"]

ZONE_EDGE = 1e-3
"""Metres before the edge of a speed zone, at most, from where its limit holds."""

ROUNDING = 1e-12
"""Relative: what exceeds a limit by no more does not."""

APART = 1e-9
"""Metres along a path between two rows, at least."""

SHORTEST = 1e-12
"""Shares of an interval below which it is not worth a part of its own."""

SEARCH_STEPS = 50
"""Of golden sections, each of which leaves 0.62 of an interval."""


@dataclass(frozen=True)
class Limits:
    """What a robot can do.

    Attributes:
        max_speed: of the reference point, m/s.
        max_acceleration: of the reference point in every direction, m/s²: the norm of its acceleration along the path
            and across it.
        max_turn_rate: rad/s.
        max_turn_acceleration: rad/s²; None: the turn rate may change at once.
        intervals: on each curved piece, at least; more come nearer to the fastest law, in more time.

    Raises:
        ConfigurationError: limits that are not finite numbers above 0, or fewer than 4 intervals.
    """

    max_speed: float
    max_acceleration: float
    max_turn_rate: float
    max_turn_acceleration: float | None = None
    intervals: int = 48

    def __post_init__(self) -> None:
        units = {"max_speed": "m/s", "max_acceleration": "m/s²", "max_turn_rate": "rad/s"}
        if self.max_turn_acceleration is not None:
            units["max_turn_acceleration"] = "rad/s²"
        for name, unit in units.items():
            label = f"timed: {name}"
            object.__setattr__(self, name, number(getattr(self, name), label, above=0.0, unit=unit))
        object.__setattr__(self, "intervals", whole(self.intervals, "timed: intervals", 4, 10_000))


class TimeLaw(NamedTuple):
    """n intervals of time, in each of which ds/dt changes at a constant rate.

    Attributes:
        piece: (n,), of the path.
        begin: (n,), s where the interval begins.
        length: (n,), of the interval, in s.
        x: (n, 2), (ds/dt)² at its beginning and end.
    """

    piece: NDArray[np.intp]
    begin: FloatArray
    length: FloatArray
    x: FloatArray

    @property
    def seconds(self) -> FloatArray:
        """Duration of each interval, shape (n,)."""
        return np.asarray(2.0 * self.length / np.sqrt(self.x).sum(axis=1))


@dataclass(frozen=True, eq=False)
class Trajectory:
    """When a robot is where along a path.

    The configurations are those of the path, and no others. Within each of ``law``'s intervals the path's parameter is
    a quadratic function of time, which :meth:`at` and :meth:`velocity` evaluate.

    Attributes:
        path: that is driven.
        limits: that hold everywhere.
        pieces: of the path.
        law: the time law; without intervals for a path of length 0.
        t: (n,), seconds from 0, where intervals meet.
        q: (n, 3), configurations then: metres, radians in (-pi, pi].
        dq: (n, 3), their derivatives by time, m/s and rad/s; just after t where a turn rate changes at once.
    """

    path: Path
    limits: Limits
    pieces: Pieces = field(repr=False)
    law: TimeLaw = field(repr=False)

    def __repr__(self) -> str:
        return f"Trajectory({len(self.t)} rows, {self.duration:.4g} s, along {self.path!r})"

    @cached_property
    def t(self) -> FloatArray:
        """Seconds from 0, shape (n,)."""
        return np.concatenate([[0.0], np.cumsum(self.law.seconds)])

    @property
    def q(self) -> FloatArray:
        """Configurations at ``t``, shape (n, 3)."""
        return self.at(self.t)

    @property
    def dq(self) -> FloatArray:
        """Velocities at ``t``, shape (n, 3): m/s, m/s, rad/s."""
        return self.velocity(self.t)

    @property
    def duration(self) -> float:
        """Seconds from start to end."""
        return float(self.t[-1])

    def at(self, t: ArrayLike) -> FloatArray:
        """Return the configurations at times (seconds, shape (m,) or a scalar; limited to the duration).

        Returns:
            Shape (m, 3), or (3,) for a scalar; headings in (-pi, pi].
        """
        times = self._times(t)
        if len(self.law.piece) == 0:
            return np.broadcast_to(self.path.states[0], (*times.shape, 3)).copy()
        interval, s, _ = self._places(times.ravel())
        found = self.pieces.states(self.law.piece[interval], s)
        found[:, 2] = se2.wrap(found[:, 2])
        # The path's own ends, without rounding.
        found[times.ravel() <= 0.0], found[times.ravel() >= self.t[-1]] = self.path.states[0], self.path.states[-1]
        return found.reshape(*times.shape, 3)

    def velocity(self, t: ArrayLike) -> FloatArray:
        """Return dx/dt, dy/dt (m/s) and dtheta/dt (rad/s) at times as :meth:`at` takes them, in the same shape."""
        times = self._times(t)
        if len(self.law.piece) == 0:
            return np.zeros((*times.shape, 3))
        interval, s, rate = self._places(times.ravel())
        first, _ = self.pieces.derivatives(self.law.piece[interval], s)
        found = rate[:, None] * first
        found[times.ravel() >= self.t[-1]] = 0.0
        return np.asarray(found.reshape(*times.shape, 3))

    def _times(self, t: ArrayLike) -> FloatArray:
        times = number_array(t, "trajectory: time")
        if np.isnan(times).any():
            raise ConfigurationError("trajectory: time: expected seconds, got NaN")
        return np.clip(times, 0.0, self.t[-1])

    def _places(self, times: FloatArray) -> tuple[Any, FloatArray, FloatArray]:
        """Return the interval at each time, s, and ds/dt."""
        interval = np.clip(np.searchsorted(self.t, times, side="right") - 1, 0, len(self.t) - 2)
        after = times - self.t[interval]
        seconds = self.t[interval + 1] - self.t[interval]
        begin, end = np.sqrt(self.law.x[interval]).T
        share = np.clip(after / np.where(seconds > 0.0, seconds, 1.0), 0.0, 1.0)
        rate = begin + share * (end - begin)
        mean = np.where(begin + end > 0.0, begin + end, 1.0)
        part = share * (begin + rate) / mean
        return interval, self.law.begin[interval] + self.law.length[interval] * np.clip(part, 0.0, 1.0), rate


def timed(path: Path, limits: Limits, zones: Iterable[Any] = ()) -> Trajectory:
    """Return the fastest trajectory along a path, from rest to rest.

    The robot stops where the path's direction jumps, and, with a limit on the turn acceleration, where its turn rate
    does; jumps of less than 1e-6 of the speed are taken for rounding. A car stops where it changes direction.

    Args:
        path: of straight motions, a car's curves, or smoothed.
        limits: of the robot.
        zones: of the world (``world.zones``); the speed limits among them hold for the reference point.
    """
    one_of(path, Path, "timed: path:")
    pieces = path.pieces if isinstance(path, SmoothPath) else pieces_of(path)
    if len(pieces.length) == 0:
        return Trajectory(
            path, limits, pieces, TimeLaw(np.zeros(0, np.intp), np.zeros(0), np.zeros(0), np.zeros((0, 2)))
        )
    moving = joined(pieces, isinstance(path, SmoothPath) or limits.max_turn_acceleration is not None)
    # As many rows as the path's, or rows at its states, so that the straight motions between them are as good.
    rows = path.rows if isinstance(path, SmoothPath) else None
    places = path.places if isinstance(path, CurvePath) else None
    return Trajectory(path, limits, pieces, fastest(pieces, moving, limits, zones, rows, places))


# --- The time law.


def fastest(
    pieces: Pieces,
    moving: NDArray[np.bool_],
    limits: Limits,
    zones: Iterable[Any] = (),
    rows: NDArray[np.intp] | None = None,
    places: FloatArray | None = None,
) -> TimeLaw:
    """Return the fastest time law along pieces, from rest to rest.

    Args:
        pieces: of the path, n >= 1.
        moving: (n - 1,), whether the robot may pass a joint without a stop.
        limits: of the robot.
        zones: of the world; speed limits of :class:`~trailmark.zones.SpeedZone` hold where the reference point is in
            the zone, and for the last millimetre before it.
        rows: (n,), the least number of intervals on each curved piece; those of the limits if that is more.
        places: where intervals on curved pieces are to meet, metres along a car's path, rising; None for nowhere.
    """
    curved = (pieces.second != 0.0).any(axis=1) | ((pieces.direction != 0) & (pieces.first[:, 2] != 0.0))
    wanted = np.full(len(curved), limits.intervals) if rows is None else np.maximum(rows, limits.intervals)
    count = np.where(curved, wanted, 1)
    piece = np.repeat(np.arange(len(count)), count)
    # Shortest at the ends, where a robot comes to a stop or starts: it may do so on a small share of a long piece.
    place = np.arange(len(piece)) - np.repeat(np.cumsum(count) - count, count)
    begin, end = (0.5 * pieces.length[piece] * (1.0 - np.cos(np.pi * k / count[piece])) for k in (place, place + 1))
    if places is not None:
        piece, begin, end = _divided(pieces.length, piece, begin, places, curved)
    step = end - begin
    speed = np.full(len(piece), limits.max_speed)
    for zone in zones:
        if isinstance(zone, SpeedZone) and zone.limit < limits.max_speed:
            piece, begin, step, speed = _cut(pieces, piece, begin, step, speed, zone)
    v0, v1 = (pieces.derivatives(piece, begin + part * step)[0] for part in (0.0, 1.0))
    caps = _speed_caps(v0, v1, speed, limits.max_turn_rate)
    constraints = _constraints(pieces, piece, begin, step, limits)
    stop = np.zeros(len(piece) + 1, np.bool_)
    joint = np.flatnonzero(np.diff(piece)) + 1
    stop[joint] = ~moving
    stop[[0, -1]] = True
    nodes = np.minimum(np.append(caps[:, 0], inf), np.append(inf, caps[:, 1]))
    nodes[stop] = 0.0
    law = TimeLaw(piece, begin, step, _passes(constraints, nodes))
    return _exact_on_straights(law, constraints, caps[:, 0], ~curved[piece])


def _divided(
    lengths: FloatArray, piece: NDArray[np.intp], begin: FloatArray, places: FloatArray, curved: NDArray[np.bool_]
) -> tuple[NDArray[np.intp], FloatArray, FloatArray]:
    """Return pieces, beginnings and ends of intervals, which meet at places (metres along the path) on curves too."""
    ends = np.cumsum(lengths)
    at = np.minimum(np.searchsorted(ends, places, side="right"), len(ends) - 1)
    s = places - (ends - lengths)[at]
    known = (ends - lengths)[piece] + begin
    before = np.maximum(np.searchsorted(known, places, side="right") - 1, 0)
    gap = np.minimum(np.abs(places - known[before]), np.abs(np.append(known, ends[-1])[before + 1] - places))
    new = curved[at] & (gap > APART) & (np.diff(places, prepend=-inf) > APART)
    piece, begin = np.insert(piece, before[new] + 1, at[new]), np.insert(begin, before[new] + 1, s[new])
    last = np.diff(piece, append=-1) != 0
    return piece, begin, np.where(last, lengths[piece], np.roll(begin, -1))


def _cut(
    pieces: Pieces, piece: NDArray[np.intp], begin: FloatArray, step: FloatArray, speed: FloatArray, zone: SpeedZone
) -> tuple[NDArray[np.intp], FloatArray, FloatArray, FloatArray]:
    """Return the intervals, halved until each lies outside of a zone or is limited by it."""
    region = zone.region.shapely()
    shapely.prepare(region)
    outline = region.boundary
    while True:
        middle = shapely.points(pieces.states(piece, begin + 0.5 * step)[:, :2])
        ends = (np.hypot(*pieces.derivatives(piece, begin + part * step)[0][:, :2].T) for part in (0.0, 1.0))
        # Speed is convex along a piece, so that it is largest at an end.
        reach = 0.5 * step * np.maximum(*ends)
        open_ = (reach > 0.5 * ZONE_EDGE) & (shapely.distance(outline, middle) <= reach)
        if not open_.any():
            inside = shapely.distance(region, middle) <= reach
            return piece, begin, step, np.where(inside, np.minimum(speed, zone.limit), speed)
        times = np.where(open_, 2, 1)
        first = np.cumsum(times) - times
        piece, begin, speed = np.repeat(piece, times), np.repeat(begin, times), np.repeat(speed, times)
        step = np.repeat(step / times, times)
        begin[first[open_] + 1] += step[first[open_]]


def _speed_caps(v0: FloatArray, v1: FloatArray, speed: FloatArray, turn_rate: float) -> FloatArray:
    """Return the largest x, shape (n, 2), at both ends of intervals, of which speed and turn rate allow all between.

    Where x is linear and g = |q'|² convex from g0 to g1, x·g is at most 1 + (g0/g1 + g1/g0 - 2)/4 times what it is at
    the ends, if that is the same.
    """
    caps = np.full((len(v0), 2), inf)
    for g0, g1, most in (
        (np.hypot(*v0[:, :2].T) ** 2, np.hypot(*v1[:, :2].T) ** 2, speed**2),
        (v0[:, 2] ** 2, v1[:, 2] ** 2, np.full(len(v0), turn_rate**2)),
    ):
        with np.errstate(divide="ignore", invalid="ignore"):
            even = most / np.maximum(g0, g1)
            share = most / (1.0 + 0.25 * (g0 / g1 + g1 / g0 - 2.0))
            each = np.stack([share / g0, share / g1], axis=1)
        # Both hold for the whole interval: one bound for both ends, and one for each. The one that lets pass more.
        better = np.isfinite(each).all(axis=1) & (each.sum(axis=1) > 2.0 * even)
        caps = np.minimum(caps, np.where(better[:, None], each, even[:, None]))
    return caps


def _constraints(
    pieces: Pieces, piece: NDArray[np.intp], begin: FloatArray, step: FloatArray, limits: Limits
) -> FloatArray:
    """Return pp, pq, qq and pp·qq - pq², shape (n, k, 4), of constraints pp·x0² + 2·pq·x0·x1 + qq·x1² <= 1.

    Each says that a vector A·u + B·x, with u = (x1 - x0)/(2h) and x at one end, is no longer than a limit. In terms of
    x0 and x1 it is P·x0 + Q·x1, and the determinant is the square of the cross product of P and Q.
    """
    found = []
    driven = (pieces.direction[piece] != 0)[:, None]
    ends = [pieces.derivatives(piece, begin + part * step) for part in (0.0, 1.0)]
    bend = np.abs(np.stack([first[:, 2] for first, _ in ends])).max(axis=0)
    along, across = np.array([[1.0, 0.0]]), np.column_stack([np.zeros(len(step)), bend])
    half = 0.5 / step[:, None]
    for at_end, (first, second) in enumerate(ends):
        # On driven pieces in the robot's own frame, with the largest curvature of the interval.
        vectors = [
            (np.where(driven, along, first[:, :2]), np.where(driven, across, second[:, :2]), limits.max_acceleration)
        ]
        if limits.max_turn_acceleration is not None:
            vectors.append((first[:, 2:], second[:, 2:], limits.max_turn_acceleration))
        for a, b, limit in vectors:
            p = ((0.0 if at_end else b) - a * half) / limit
            q = ((b if at_end else 0.0) + a * half) / limit
            # Without the digits that A would cancel: P x Q is B x A/(2h), whichever end it is.
            cross = (b[:, 0] * a[:, -1] - b[:, -1] * a[:, 0]) * half[:, 0] / limit**2
            found.append(np.stack([(p * p).sum(axis=1), (p * q).sum(axis=1), (q * q).sum(axis=1), cross**2], axis=1))
    return np.stack(found, axis=1)


def _largest(constraints: list[list[float]], x: float, known: int) -> float:
    """Return the largest x1 that constraints allow for x0 = x (``known`` 0), or x0 for x1 = x (2); -inf if none."""
    largest = inf
    for row in constraints:
        unknown = row[2 - known]
        if unknown > 0.0:
            inside = unknown - row[3] * x * x
            if inside < -ROUNDING * unknown:
                return -inf
            largest = min(largest, (sqrt(max(inside, 0.0)) - row[1] * x) / unknown)
        elif row[known] * x * x > 1.0 + ROUNDING:
            return -inf
    return largest


def _peaks(constraints: FloatArray, top: FloatArray) -> FloatArray:
    """Return for each interval the x1, 0 to top (n,), for which x0 may be largest: it is a concave function of it."""
    low, high, share = np.zeros(len(top)), top, 0.5 * (sqrt(5.0) - 1.0)

    def largest(x: FloatArray) -> FloatArray:
        pp, pq, qq, cross = np.moveaxis(constraints, 2, 0)
        x = x[:, None]
        inside = np.where(pp > 0.0, pp - cross * x * x, 1.0 - qq * x * x)
        with np.errstate(divide="ignore", invalid="ignore"):
            root, middle = np.sqrt(inside) / pp, -pq * x / pp
        upper = np.where(inside < 0.0, -inf, np.where(pp > 0.0, middle + root, inf)).min(axis=1)
        lower = np.where((inside >= 0.0) & (pp > 0.0), middle - root, -inf).max(axis=1)
        return np.asarray(np.where(lower <= upper * (1.0 + ROUNDING), upper, -inf))

    for _ in range(SEARCH_STEPS):
        a, b = high - share * (high - low), low + share * (high - low)
        left = largest(a) >= largest(b)
        low, high = np.where(left, low, a), np.where(left, b, high)
    return low


def _passes(constraints: FloatArray, caps: FloatArray) -> FloatArray:
    """Return x, shape (n, 2), at both ends of the intervals: at each node the largest that is possible.

    Args:
        constraints: of the intervals, shape (n, k, 4).
        caps: largest x at the nodes, shape (n + 1,).
    """
    n = len(constraints)
    peaks = _peaks(constraints, caps[1:]).tolist()
    rows, x = constraints.tolist(), caps.tolist()
    for i in range(n - 1, -1, -1):
        # What is past the peak is no better than the peak.
        x[i] = min(x[i], max(_largest(rows[i], min(x[i + 1], peaks[i]), 2), 0.0))
    for i in range(n):
        x[i + 1] = min(x[i + 1], max(_largest(rows[i], x[i], 0), 0.0))
    return np.column_stack([x[:-1], x[1:]])


def _exact_on_straights(law: TimeLaw, constraints: FloatArray, cap: FloatArray, straight: NDArray[np.bool_]) -> TimeLaw:
    """Return a law whose straight intervals accelerate, hold a speed and brake, as hard and as fast as they may."""
    n = len(law.piece)
    # A straight's constraint is |x1 - x0| <= 1/sqrt(qq).
    with np.errstate(divide="ignore"):
        change = 1.0 / np.sqrt(constraints[:, :, 2].max(axis=1))
    top = np.minimum(cap, 0.5 * (law.x.sum(axis=1) + change))
    part = np.empty((n, 3))
    part[:, 0], part[:, 2] = ((top - law.x[:, k]) / change for k in (0, 1))
    part[:, 1] = 1.0 - part[:, 0] - part[:, 2]
    part[~straight] = 1.0, 0.0, 0.0
    part[part < SHORTEST] = 0.0
    part /= part.sum(axis=1, keepdims=True)
    x = np.stack(
        [np.column_stack([law.x[:, 0], top]), np.column_stack([top, top]), np.column_stack([top, law.x[:, 1]])], 1
    )
    x[~straight, 0] = law.x[~straight]
    begin = law.begin[:, None] + law.length[:, None] * (np.cumsum(part, axis=1) - part)
    used = part > 0.0
    rows = np.repeat(law.piece[:, None], 3, axis=1)[used]
    return TimeLaw(rows, begin[used], (law.length[:, None] * part)[used], x[used])
