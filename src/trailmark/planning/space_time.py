"""Planning among moving obstacles: paths that pass before or behind them, certified in space and time.

A robot of a stated speed is at cost c (:attr:`trailmark.Path.cost`) of its path at time c / speed. What stands is
avoided as ever; of each moving obstacle (:class:`trailmark.moving.Moving`) the path is clear at each time up to the
obstacle's horizon, or until the robot arrives. Nothing is claimed beyond either. Where the path meets an obstacle, the
robot gives way by short straight steps, sought in space and time, and goes on from there along the path among what
stands.

In the frame of an obstacle with velocity v, a robot that goes straight from a, at time s, to b, at time t, goes
straight from a - v·s to b - v·t, and turns as before. So a motion is certified against each obstacle as it is against
one that stands, by conservative advancement (:mod:`trailmark.verify.advance`). Nothing is sampled. Between two moments
nothing gets into or out of an obstacle without crossing its outline: whether one is inside the other is looked at for a
path's first state alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from heapq import heappop, heappush
from math import atan2, cos, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision.footprint import Footprint
from trailmark.moving import Moving
from trailmark.path import Path
from trailmark.planning.query import Incumbent, vertices_of
from trailmark.planning.replanning import Replanner, Rest, as_replan, rest_of
from trailmark.planning.result import ReplanResult
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc
from trailmark.verify.advance import Close, Way, meetings

__all__ = ["MovingObstacles", "SpaceTimeReplanner", "motions_clear", "path_clear", "state_clear"]

TRIES = 3
"""Searches at most: how fast a disc moves depends on how much it turns along the whole path, known once it is found."""

WEIGHT = 1.2
"""Of the cost to go: a path may cost so many times the cheapest, and is found among far fewer nodes."""

CELLS = 2.0
"""Cells per step within which one node stands for all that come there at the same time."""

NEIGHBOURS = 3
"""Bends of the path before and behind its parent's that a node is joined to."""

ROUNDING = 1e-9
"""Metres: what comes closer does not count as clear."""


class SpaceTimeReplanner:
    """Answers one query for which there was a path, among obstacles that move.

    Args:
        replanner: of the query, in the model of what stands.
        moving: the obstacles, and the robot.
        speed: metres of cost per second.
    """

    def __init__(self, replanner: Replanner, moving: MovingObstacles, speed: float) -> None:
        self.replanner, self.moving, self.speed = replanner, moving, speed
        self.model, self.motion = replanner.model, replanner.motion
        self.turning = self.motion.whole_cost(0.0, replanner.start, replanner.goal)

    def answer(self, path: Path) -> ReplanResult:
        """Return the path to follow from here on instead of ``path``, or the rest of it."""
        replanner = self.replanner
        kept = self._kept(rest_of(self.motion, path, replanner.start, self.model.passed))
        if kept is not None and self._is_near(kept, self.motion.least_cost(replanner.start, replanner.goal)):
            return kept
        if not state_clear(self.moving, replanner.start):
            return self._failed("the robot meets a moving obstacle where it is")
        # Among what stands there may be a better path than one that gave way to what moves.
        among = replanner.answer(path, look=True)
        if among.path is None:
            return among
        # Beside a path that is free, only the way straight back to the route is looked at.
        found = self._searched(
            vertices_of(self.motion, among.path), self.model.settings.space_time_nodes if kept is None else 1
        )
        if kept is None:
            return found
        if found.path is None or self._is_near(kept, found.cost or 0.0):
            return kept
        return replace(found, reason=f"another path costs {found.cost:.4g} m instead of {kept.cost:.4g} m")

    def ends_are_swept(self) -> bool:
        """Return whether an obstacle comes to where the robot is, or to the goal, before its horizon."""
        ends = np.array([self.replanner.start, self.replanner.goal])
        return not motions_clear(self.moving, ends, np.zeros(2), ends, np.full(2, self.moving.until.max())).all()

    def _is_near(self, kept: ReplanResult, cost: float) -> bool:
        """Return whether a path costs too little more than another one (metres) to be replaced by it."""
        return (kept.cost or 0.0) <= (1.0 + self.replanner.options.min_gain) * cost

    def _kept(self, rest: Rest) -> ReplanResult | None:
        """Return the rest of the path, if it is free and stays clear of the moving obstacles."""
        replanner = self.replanner
        if not (np.array_equal(rest.vertices[-1], replanner.ends[1]) and rest.free.all()):
            return None
        return replanner.kept(rest) if self._clear(rest.vertices) else None

    def _clear(self, vertices: FloatArray) -> bool:
        """Return whether the path over vertices (n, 3), as it is returned, stays clear of the moving obstacles."""
        replanner = self.replanner
        # Where a disc does not turn, its headings, left out of the vertices, change nothing.
        states = self.motion.whole_states(vertices, replanner.start, replanner.goal) if self.turning else vertices
        return path_clear(self.moving, states, self.speed) < 0

    def _searched(self, route: FloatArray, max_nodes: int) -> ReplanResult:
        """Return a path that stays clear of the moving obstacles, or as ``nearest`` the steps that do so longest.

        Args:
            route: to the goal among what stands, states that motions join, shape (m, 3), m >= 2.
            max_nodes: of the search.
        """
        to_go = np.append(np.cumsum(self.motion.costs(route[:-1], route[1:])[::-1])[::-1], 0.0)
        length, steps = max(float(to_go[0]), 1e-9), None
        for _ in range(TRIES):
            speed = self.speed * length / (length + self.turning)
            found, states = self._give_way(route, to_go, speed, max_nodes)
            if not found:
                steps = states
                break
            result = self.replanner.result(states) if self._clear(states) else None
            if result is not None:
                return as_replan(result, "the path meets a moving obstacle, another one passes it in time")
            length = max(self.motion.cost_of(states), 1e-9)
        return self._failed("no path was found that stays clear of the moving obstacles", steps)

    def _give_way(self, route: FloatArray, to_go: FloatArray, speed: float, max_nodes: int) -> tuple[bool, FloatArray]:
        """Return whether a way to the goal was found, and its states, shape (n, 3).

        From the start the robot takes steps of equal length and duration in any of a number of directions, turning in
        none. From each place it is tried whether it can go on along the route to the end without meeting an obstacle.
        Without success the states are those of the steps that stay clear for the longest time as far as anything is
        foreseen, nearest to the goal among them.

        Args:
            route: as of :meth:`_searched`; its first state is left aside.
            to_go: (m,) cost from each of its states to the goal, metres.
            speed: metres of cost per second.
            max_nodes: nodes expanded at most.
        """
        motion, moving, settings, last = self.motion, self.moving, self.model.settings, len(route) - 1
        step = settings.space_time_step * (moving.reach + moving.size)
        seconds, horizon, nodes = step / speed, float(moving.until.max()), [_Node(self.replanner.ends[0], -1, 0, last)]
        waiting, seen, best, best_rank = [(0.0, 0)], set(), 0, -np.inf
        while waiting and max_nodes > 0 and self.replanner.seconds_left() > 0.0:
            max_nodes -= 1
            _, k = heappop(waiting)
            here, _, layer, bend = nodes[k]
            time = layer * seconds
            # The last of the route's states that a motion leads to, about the one that was near before.
            low, high = (max(1, bend - NEIGHBOURS), min(last, bend + NEIGHBOURS)) if k else (1, last)
            bends = route[low : high + 1]
            free = np.flatnonzero(motion.motions_between_valid(np.tile(here, (len(bends), 1)), bends))
            if len(free):
                bend = low + int(free[-1])
                rest = np.vstack([here, route[bend:]])
                if _first_meeting(moving, rest, time + np.cumsum(motion.costs(rest[:-1], rest[1:])) / speed, time) < 0:
                    return True, np.vstack([_steps(nodes, k), rest[1:]])
            target = route[bend]
            rank = min(time, horizon) - 1e-6 * (float(motion.costs(here, target)[0]) + to_go[bend])
            if rank > best_rank:
                best, best_rank = k, rank
            count = settings.space_time_directions
            angles = atan2(target[1] - here[1], target[0] - here[0]) + 2.0 * np.pi / count * np.arange(count)
            children = here + step * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(count)])
            keys = [(layer + 1, *cell) for cell in np.floor(children[:, :2] * (CELLS / step)).tolist()]
            children = children[[key not in seen for key in keys]]
            keys = [key for key in keys if key not in seen]
            a = np.tile(here, (len(children), 1))
            times = np.full(len(children), time)
            ok = motions_clear(moving, a, times, children, times + seconds) & motion.checker.states_free(children)
            ok[ok] = motion.motions_between_valid(a[ok], children[ok])
            left = motion.costs(children, target) + to_go[bend]
            for i in np.flatnonzero(ok).tolist():
                if keys[i] not in seen:
                    seen.add(keys[i])
                    heappush(waiting, (step * (layer + 1) + WEIGHT * float(left[i]), len(nodes)))
                    nodes.append(_Node(children[i], k, layer + 1, bend))
        return False, _steps(nodes, best)

    def _failed(self, reason: str, states: FloatArray | None = None) -> ReplanResult:
        """Return that there is no path, and the steps (n, 3) that stay clear the longest, if there are any."""
        replanner, model = self.replanner, self.model
        incumbent = Incumbent(self.motion, replanner.start, replanner.goal, replanner.begin)
        if states is not None and len(states) > 1:
            incumbent.nearest = states.copy()
            incumbent.nearest[:, 2] = replanner.start[2]
        result = model.verification.result(incumbent, "timeout", None, model.shared.roadmap)
        return replace(as_replan(result, ""), reason=reason)


class _Node(NamedTuple):
    """A place (3,) at a time: the node before or -1, how many steps led there, and a state of the route near by."""

    q: FloatArray
    parent: int
    layer: int
    bend: int


def _steps(nodes: list[_Node], k: int) -> FloatArray:
    """Return the places on the way to a node, shape (n, 3)."""
    found = []
    while k >= 0:
        found.append(nodes[k].q)
        k = nodes[k].parent
    return np.array(found[::-1])


# --- Moving obstacles, and whether a robot that moves too stays clear of them.


class MovingObstacles(NamedTuple):
    """Moving obstacles and the robot that is to stay clear of them. Metres and seconds.

    Attributes:
        edges: (e, 5) where the obstacles are at time 0: both ends of an edge, and by how much it is thickened. A disc
            is an edge of length 0.
        first: (k + 1,) where the edges of each obstacle begin.
        circles: (k, 3) x, y, radius of a circle that holds the obstacle at time 0; a disc itself.
        velocities: (k, 2).
        until: (k,) up to when each is foreseen; nothing is claimed for later times.
        body: (b, 4) the robot's edges in its own frame; one of length 0 for a disc.
        radius: by which they are thickened: the clearance that the robot keeps, and the radius of a disc.
        reach: largest distance of a point of the robot from its reference point.
        size: half of the shortest side of the obstacles' bounding boxes, the smallest disc's radius.
    """

    edges: FloatArray
    first: NDArray[np.int64]
    circles: FloatArray
    velocities: FloatArray
    until: FloatArray
    body: FloatArray
    radius: float
    reach: float
    size: float

    @classmethod
    def of(cls, obstacles: Sequence[Moving], robot: Footprint) -> MovingObstacles:
        """Return obstacles, at least one, and a robot as arrays."""
        edges: list[tuple[float, ...]] = []
        circles, first, size = [], [0], np.inf
        for shape in (obstacle.shape for obstacle in obstacles):
            if isinstance(shape, Disc):
                circles.append((*shape.center, shape.radius))
                edges.append((*shape.center, *shape.center, shape.radius))
                size = min(size, shape.radius)
            else:
                rings = shape.polygon().rings()
                low, high = rings[0].min(axis=0), rings[0].max(axis=0)
                center = 0.5 * (low + high)
                circles.append((*center, float(np.hypot(*(rings[0] - center).T).max())))
                edges += [(*edge, 0.0) for ring in rings for edge in _closed(ring)]
                size = min(size, 0.5 * float((high - low).min()))
            first.append(len(edges))
        return cls(
            np.array(edges),
            np.array(first),
            np.array(circles),
            np.array([obstacle.velocity for obstacle in obstacles]),
            np.array([obstacle.until for obstacle in obstacles]),
            np.zeros((1, 4)) if robot.is_disc else _closed(robot.outline),
            robot.dilation,
            robot.circumradius,
            size,
        )


def _closed(ring: FloatArray) -> FloatArray:
    """Return the edges of a ring (n, 2), shape (n, 4)."""
    return np.hstack([ring, np.roll(ring, -1, axis=0)])


def path_clear(moving: MovingObstacles, states: FloatArray, speed: float) -> int:
    """Return the first motion of a path along which the robot may meet a moving obstacle; -1 if it stays clear.

    Args:
        moving: the obstacles and the robot.
        states: of the path, shape (n, 3), headings in [-pi, pi].
        speed: metres of cost (:attr:`trailmark.Path.cost`) per second.
    """
    if not state_clear(moving, states[0]):
        return 0
    return _first_meeting(moving, states, np.cumsum(se2.distance(states[:-1], states[1:])) / speed)


def _first_meeting(moving: MovingObstacles, states: FloatArray, times: FloatArray, begin: float = 0.0) -> int:
    """Return the first motion of states (n, 3), each at its end at a time (n - 1,), that is not clear; -1 for none."""
    clear = motions_clear(moving, states[:-1], np.append(begin, times)[:-1], states[1:], times)
    return -1 if clear.all() else int(np.argmin(clear))


def motions_clear(
    moving: MovingObstacles, a: FloatArray, begin: FloatArray, b: FloatArray, end: FloatArray
) -> NDArray[np.bool_]:
    """Return on which straight motions from a (n, 3) at times (n,) to b the robot meets no outline, shape (n,)."""
    spans, velocities = end - begin, moving.velocities[:, None]
    # For each obstacle and motion: the part of it that is foreseen, as the obstacle sees it.
    share = np.clip((moving.until[:, None] - begin) / np.where(spans > 0.0, spans, 1.0), 0.0, 1.0)
    starts = a[:, :2] - begin[:, None] * velocities
    delta = se2.difference(a, b)
    moves = share[..., None] * (delta[:, :2] - spans[:, None] * velocities)
    off, square = starts - moving.circles[:, None, :2], (moves**2).sum(axis=-1)
    t = np.clip(-(off * moves).sum(axis=-1) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    near = np.hypot(*np.moveaxis(off + t[..., None] * moves, -1, 0)) < moving.circles[:, 2:] + moving.reach + ROUNDING
    which, motion = np.nonzero(near & (begin < moving.until[:, None]))
    clear = np.ones(len(a), np.bool_)
    if len(which):
        turns = share[which, motion] * delta[motion, 2]
        way = Way(
            np.column_stack([starts[which, motion], a[motion, 2]]),
            np.column_stack([moves[which, motion], turns]),
            np.zeros(len(which)),
        )
        count = np.arange(len(moving.until) + 1)
        close = Close(which, count, count[:-1], moving.first, moving.edges)
        met = meetings(moving.body, moving.radius + ROUNDING, way, close, np.inf, 1 << 62)
        clear[motion[met[:, 0].astype(np.int64)]] = False
    return clear


def state_clear(moving: MovingObstacles, q: FloatArray) -> bool:
    """Return whether the robot overlaps no obstacle in a configuration, shape (3,), at time 0."""
    if not motions_clear(moving, q[None], np.zeros(1), q[None], np.zeros(1)).all():
        return False
    c, s = cos(q[2]), sin(q[2])
    x, y = se2.transform(q, moving.body[:1, :2])[0]
    for edges in np.split(moving.edges, moving.first[1:-1]):
        dx, dy = edges[0, :2] - q[:2]
        if _encloses(edges, x, y) or _encloses(moving.body, c * dx + s * dy, c * dy - s * dx):
            return False
    return True


def _encloses(edges: FloatArray, x: float, y: float) -> bool:
    """Return whether a point lies inside closed rings of edges (even-odd rule)."""
    x1, y1, x2, y2 = edges[(edges[:, 1] > y) != (edges[:, 3] > y), :4].T
    return bool((x < x1 + (y - y1) / (y2 - y1) * (x2 - x1)).sum() % 2)
