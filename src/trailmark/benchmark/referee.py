"""Referee: checks returned paths by shapely and dense sampling, which no planner uses to find them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from trailmark.curves import Steering
from trailmark.shapes import Disc
from trailmark.world import Robot, World, with_keep_outs
from trailmark.world.zones import OneWayZone

__all__ = ["Referee"]

FloatArray = NDArray[np.float64]

TOUCHING = 1e-6
"""Metres that the robot may overlap an obstacle or a bound: touching is allowed, and rounding is not a collision."""

STATES_PER_RADIUS = 20.0
"""States that are checked while a point of the robot moves by its inscribed radius."""

CHUNK = 2048
"""States that are checked together."""

MAX_STATES = 2_000_000
"""Longest path, in steps, that is judged: longer ones are refused."""


class Referee:
    """Judges paths in one world for one robot.

    Args:
        world: obstacles, bounds and boundary, zones to keep out of and one-way zones.
        robot: footprint, and the clearance that it keeps.
    """

    def __init__(self, world: World, robot: Robot) -> None:
        footprint = robot.footprint
        self._world = world = with_keep_outs(world)
        # About the reference point of a disc, about the outline of others.
        self._radius = robot.clearance + (footprint.radius - TOUCHING if isinstance(footprint, Disc) else 0.0)
        self._outline = None if isinstance(footprint, Disc) else _shrunk(robot)
        self._reach = 0.0 if self._outline is None else float(np.hypot(*self._outline.T).max())
        self._steering = Steering.of(robot)
        self._turns_in_place, self._reverse = robot.drive == "differential", robot.reverse
        self.step = robot.keeping(0.0).inscribed_disc.radius / STATES_PER_RADIUS
        discs = [shape for shape in world.obstacles if isinstance(shape, Disc)]
        solid = [shape.polygon().shapely() for shape in world.obstacles if not isinstance(shape, Disc)]
        self._solid = shapely.STRtree(solid)
        self._centers = shapely.points([disc.center for disc in discs]) if discs else []
        self._discs = shapely.STRtree([shapely.box(*disc.bounding_box()) for disc in discs])
        self._radii = np.array([disc.radius for disc in discs])
        self._boundary = None if world.boundary is None else world.boundary.shapely().buffer(TOUCHING)
        if self._boundary is not None:
            shapely.prepare(self._boundary)
        one_way = [zone for zone in world.zones if isinstance(zone, OneWayZone)]
        self._one_way = [
            (zone, shapely.buffer(zone.region.shapely(), -TOUCHING, join_style="mitre")) for zone in one_way
        ]

    def fault(self, path: ArrayLike, start: ArrayLike, goal: ArrayLike) -> str | None:
        """Return what is wrong with a path, in one line; None if it is correct.

        Args:
            path: states (x, y, theta), shape (n, 3), joined by straight motions with the heading along the shorter arc,
                or by the shortest curves of a robot that is a car. A differential drive either turns in place or drives
                along its heading from each to the next.
            start: shape (3,).
            goal: shape (3,).
        """
        states = np.asarray(path, dtype=np.float64)
        if states.ndim != 2 or states.shape[1] != 3 or len(states) == 0:
            return f"path: expected shape (n, 3), got {states.shape}"
        if not np.isfinite(states).all():
            return "path holds a value that is not a finite number"
        for name, end, wanted in (("start", states[0], start), ("goal", states[-1], goal)):
            apart = np.asarray(wanted, dtype=np.float64) - end
            if math.hypot(apart[0], apart[1]) > TOUCHING or abs(_wrapped(apart[2])) > TOUCHING:
                return f"path's end ({_row(end)}) is not the {name} ({_row(wanted)})"
        steps = sum(math.ceil(self._bound(a, b) / self.step) for a, b in pairwise(states))
        if steps > MAX_STATES:
            return f"path: expected at most {MAX_STATES:,} steps of {self.step:g} m, got {steps:,}"
        for a, b in pairwise(states):
            between = f"from ({_row(a)}) to ({_row(b)})"
            if self._steering is not None:
                if not self._can_be_driven(np.vstack([a, self._between(a, b)]), b, self._steering):
                    return f"no curve of the car ({self._steering}) leads {between}"
            elif self._turns_in_place and not self._drives_ahead(a, b):
                return f"the robot neither turns in place nor drives along its heading {between}"
            if self._goes_the_wrong_way(a, b):
                return f"the robot goes the wrong way through a one-way zone {between}"
        for block in self._blocks(states):
            for judge in (self._outside, self._hit):
                wrong = judge(block)
                if wrong.any():
                    what = "is out of bounds" if judge == self._outside else "meets an obstacle"
                    return f"robot at ({_row(block[int(np.argmax(wrong))])}) {what}"
        return None

    def _bound(self, a: FloatArray, b: FloatArray) -> float:
        """Return how far a motion moves any point of the robot at most (metres)."""
        if self._steering is not None:
            return float(self._steering.lengths(a, b)) * (1.0 + self._reach / self._steering.radius)
        return float(math.hypot(b[0] - a[0], b[1] - a[1]) + self._reach * abs(_wrapped(b[2] - a[2])))

    def _between(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Return the states along the motion from a to b, without a, no point moving more than a step to the next."""
        n = max(1, math.ceil(self._bound(a, b) / self.step))
        at = np.arange(1, n + 1) / n
        if self._steering is not None:
            return self._steering.states(a, b, at * self._steering.lengths(a, b))
        along = b - a
        along[2] = _wrapped(along[2])
        return np.asarray(a + at[:, None] * along)

    def _can_be_driven(self, states: FloatArray, goal: FloatArray, steering: Steering) -> bool:
        """Return whether a car can drive along dense states to the goal.

        The code that computes the curves is the planners' too, so it is not trusted: from state to state the car must
        move along its mean heading, turn by no more than its turning radius allows, and reverse only if it can.
        """
        step = self.step / (1.0 + self._reach / steering.radius)
        dx, dy, turned = np.diff(states[:, 0]), np.diff(states[:, 1]), _wrapped(np.diff(states[:, 2]))
        heading = states[:-1, 2] + 0.5 * turned
        ahead, beside = np.cos(heading) * dx + np.sin(heading) * dy, np.cos(heading) * dy - np.sin(heading) * dx
        missed = math.hypot(*(goal - states[-1])[:2]) + abs(_wrapped(goal[2] - states[-1, 2]))
        return bool(
            missed <= TOUCHING
            and (np.abs(turned) <= step / steering.radius + TOUCHING).all()
            and (np.abs(beside) <= step**2 / steering.radius + TOUCHING).all()
            and (steering.reverse or (ahead >= -TOUCHING).all())
        )

    def _drives_ahead(self, a: FloatArray, b: FloatArray) -> bool:
        """Return whether a differential drive turns in place from a to b, or drives along its heading."""
        (dx, dy), turned = (b - a)[:2], abs(_wrapped(b[2] - a[2]))
        if math.hypot(dx, dy) <= TOUCHING:
            return True
        ahead, beside = math.cos(a[2]) * dx + math.sin(a[2]) * dy, math.cos(a[2]) * dy - math.sin(a[2]) * dx
        return bool(turned <= TOUCHING and abs(beside) <= TOUCHING and (self._reverse or ahead >= -TOUCHING))

    def _goes_the_wrong_way(self, a: FloatArray, b: FloatArray) -> bool:
        """Return whether the reference point travels from a to b through a one-way zone as that does not allow."""
        if not self._one_way:
            return False
        places = np.vstack([a, b if self._steering is None else self._between(a, b)])[:, :2]
        moves = np.diff(places, axis=0)
        apart = np.hypot(*moves.T)
        # Where a car turns its direction between two places, the chord has that of the longer part, or none.
        travels = apart > max(TOUCHING, 0.1 * float(apart.max()))
        turned = 0.0 if self._steering is None else float(apart.max()) / self._steering.radius
        lines, heading = shapely.linestrings(np.stack([places[:-1], places[1:]], axis=1)), np.arctan2(*moves.T[::-1])
        for zone, region in self._one_way:
            off = np.abs(_wrapped(heading - zone.heading))
            if (travels & (off > zone.tolerance + turned + TOUCHING) & shapely.intersects(region, lines)).any():
                return True
        return False

    def _blocks(self, states: FloatArray) -> Iterator[FloatArray]:
        """Yield the states along the path, no point of the robot moving more than a step from one to the next."""
        pending, count = [states[:1]], 1
        for a, b in pairwise(states):
            pending.append(self._between(a, b))
            count += len(pending[-1])
            if count >= CHUNK:
                yield from np.array_split(np.concatenate(pending), math.ceil(count / CHUNK))
                pending, count = [], 0
        if pending:
            yield np.concatenate(pending)

    def _corners(self, states: FloatArray, outline: FloatArray) -> FloatArray:
        """Return the robot's outline at each state, shape (m, n, 2)."""
        cos, sin = np.cos(states[:, 2:]), np.sin(states[:, 2:])
        x, y = outline.T
        return np.stack([states[:, :1] + cos * x - sin * y, states[:, 1:2] + sin * x + cos * y], axis=-1)

    def _outside(self, states: FloatArray) -> NDArray[np.bool_]:
        low, high = np.array(self._world.bounds[:2]) - TOUCHING, np.array(self._world.bounds[2:]) + TOUCHING
        reach = self._radius
        places = states[:, None, :2] if self._outline is None else self._corners(states, self._outline)
        outside = (places.min(axis=1) - reach < low).any(axis=1) | (places.max(axis=1) + reach > high).any(axis=1)
        if self._boundary is not None:
            robots = shapely.points(places[:, 0]) if self._outline is None else shapely.polygons(places)
            outside |= ~shapely.covers(self._boundary, robots)
            if reach > 0.0:
                outside |= shapely.distance(self._boundary.exterior, robots) < reach
        return np.asarray(outside)

    def _hit(self, states: FloatArray) -> NDArray[np.bool_]:
        hit = np.zeros(len(states), dtype=np.bool_)
        at = states[:, :2] if self._outline is None else self._corners(states, self._outline)
        robots = shapely.points(at) if self._outline is None else shapely.polygons(at)
        hit[self._solid.query(robots, predicate="dwithin", distance=self._radius)[0]] = True
        if len(self._radii):
            which, disc = self._discs.query(robots, predicate="dwithin", distance=self._radius)
            apart = shapely.distance(robots[which], self._centers[disc])
            hit[which[apart < self._radius + self._radii[disc]]] = True
        return hit


def _shrunk(robot: Robot) -> FloatArray:
    """Return the footprint's outline, shape (n, 2), smaller by what counts as touching."""
    region = robot.outline.shapely().buffer(-TOUCHING, join_style="mitre")
    parts = [part for part in shapely.get_parts(region) if part.area > 0.0]
    largest = max(parts, key=lambda part: part.area) if parts else robot.outline.shapely()
    return np.asarray(shapely.get_coordinates(largest.exterior)[:-1])


def _wrapped(angle: Any) -> Any:
    """Return an angle, or an array of angles (radians), wrapped to (-pi, pi]."""
    return math.pi - (math.pi - angle) % (2.0 * math.pi)


def _row(state: Any) -> str:
    return ", ".join(f"{float(v):.6g}" for v in state)
