"""With what a robot collides, where, and how deep: the colliding intervals of a path, obstacle by obstacle."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike

from trailmark.audit.depth import Penetration, bounds_depth, deepest
from trailmark.audit.result import Collision
from trailmark.audit.scale import Scale
from trailmark.audit.verdict import colliding_parts
from trailmark.collision import StateChecker
from trailmark.collision.body import Body
from trailmark.collision.field import build_field
from trailmark.collision.obstacles import build_grid
from trailmark.se2 import FloatArray
from trailmark.shapes import Polygon
from trailmark.world import BOUNDS_LIMIT, World

__all__ = ["Attribution", "merged", "merged_intervals"]

ABUTTING = 1e-6
"""Metres: colliding parts that are nearer to one another are one interval."""

CELLS = 48
"""Cells of the grid around one obstacle, along its longer side, at most."""

Depths = Callable[[FloatArray], FloatArray]


def merged(parts: FloatArray, scale: Scale) -> list[tuple[float, float]]:
    """Return rows (motion, from, to) as intervals of the path's scale, in order, those that abut made one."""
    return merged_intervals(np.column_stack([scale.place(parts[:, 0], parts[:, k]) for k in (1, 2)]))


def merged_intervals(intervals: ArrayLike) -> list[tuple[float, float]]:
    """Return intervals, shape (n, 2), in order, those that overlap or abut made one."""
    rows = np.asarray(intervals, dtype=np.float64).reshape(-1, 2)
    if len(rows) == 0:
        return []
    begin, end = rows[np.argsort(rows[:, 0], kind="stable")].T
    end = np.maximum.accumulate(end)
    first = np.flatnonzero(np.append(True, begin[1:] > end[:-1] + ABUTTING))
    return [(float(a), float(b)) for a, b in zip(begin[first], end[np.append(first[1:], len(end)) - 1], strict=True)]


class Attribution:
    """Finds what a robot collides with.

    Args:
        checker: for world and robot.
        core: what of the robot may meet no obstacle.
    """

    def __init__(self, checker: StateChecker, core: Body) -> None:
        self.checker, self._core = checker, core
        self._penetrations: dict[int, Penetration] = {}

    def collisions(self, scale: Scale, spans: list[tuple[float, float]]) -> tuple[Collision, ...]:
        """Return the collisions on intervals of a path on which the robot collides with anything."""
        found = []
        for begin, end in spans:
            states = scale.part(begin, end)
            here = Scale(states, self.checker.footprint.sweep_radius)
            reach = self._core.reach + ABUTTING
            low, high = states[:, :2].min(axis=0) - reach, states[:, :2].max(axis=0) + reach
            rows: list[tuple[float, float, str | int, Depths]] = []
            candidates = list(self._candidates(low, high))
            if len(candidates) > 1:
                for name, world, depths in candidates:
                    rows += [(begin + a, begin + b, name, depths) for a, b in self._intervals(world, here)]
            if not rows:
                # There is but one, or rounding hides all: what is deepest in the middle.
                middle = scale.poses(0.5 * (begin + end))
                name, _, depths = max(candidates, key=lambda candidate: float(candidate[2](middle)[0]))
                rows = [(begin, end, name, depths)]
            for a, b, name, depths in rows:
                motions = tuple(i + share for i, share in (scale.motion(a), scale.motion(b)))
                depth = deepest(depths, scale.poses, a, b)
                found.append(Collision(scale.length(a), scale.length(b), name, depth, (motions[0], motions[1])))
        return tuple(sorted(found, key=lambda c: (c.motions, str(c.obstacle))))

    @cached_property
    def _boxes(self) -> FloatArray:
        return np.array([shape.bounding_box() for shape in self.checker.world.obstacles]).reshape(-1, 4)

    def _candidates(self, low: FloatArray, high: FloatArray) -> Iterator[tuple[str | int, World, Depths]]:
        """Yield what may block the robot in a box: its name, a world of it alone, and its depths."""
        world, robot = self.checker.world, self.checker.robot
        margin = 2.0 * self._core.reach
        around = (*np.maximum(low - margin, -BOUNDS_LIMIT).tolist(), *np.minimum(high + margin, BOUNDS_LIMIT).tolist())
        if (low < world.bounds[:2]).any() or (high > world.bounds[2:]).any():
            yield "bounds", World("", world.bounds), partial(bounds_depth, robot, world.bounds)
        if world.boundary is not None:
            yield "boundary", World("", around, boundary=world.boundary), self._penetration(-1).at
        boxes = self._boxes
        for i in np.flatnonzero((boxes[:, :2] <= high).all(axis=1) & (boxes[:, 2:] >= low).all(axis=1)).tolist():
            name = world.ids[i] if world.ids else None
            yield (i if name is None else name), World("", around, (world.obstacles[i],)), self._penetration(i).at

    def _penetration(self, i: int) -> Penetration:
        """Return the depths in an obstacle, or in what lies outside of the boundary (-1); made once."""
        if i not in self._penetrations:
            world, robot = self.checker.world, self.checker.robot
            if i >= 0:
                shape = world.obstacles[i]
            else:
                assert world.boundary is not None  # noqa: S101 # there is one
                # A frame so wide that the shortest way out of it is back into the boundary.
                ring, wide = world.boundary.vertices, world.extent + 8.0 * self._core.reach
                (x1, y1), (x2, y2) = ring.min(axis=0) - wide, ring.max(axis=0) + wide
                shape = Polygon(np.array([[x1, y1], [x2, y1], [x2, y2], [x1, y2]]), (ring,))
            self._penetrations[i] = Penetration(robot, shape)
        return self._penetrations[i]

    def _intervals(self, world: World, scale: Scale) -> list[tuple[float, float]]:
        """Return the intervals of a path, as places on its scale, on which the robot collides with a small world."""
        side = max(world.bounds[2] - world.bounds[0], world.bounds[3] - world.bounds[1])
        grid = build_grid(world, max(0.2 * self.checker.robot.inscribed_disc.radius, side / CELLS))
        parts = colliding_parts(grid, build_field(grid), self.checker.footprint, self._core, scale.states)
        return merged(parts, scale)
