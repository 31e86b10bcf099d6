"""A second look at a proof by cells of SE(2): is the robot really nowhere free in the cells that shut it in?

Where a proof is wrong, a way leads through one of those cells. So each is looked at by shapely alone, which shares
nothing with what found it: if what the robot covers at every configuration of the cell meets an obstacle, no place
there is free. What is not settled so is divided, and with it the centres grow dense just where a way might be.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.affinity import rotate

from trailmark.se2 import FloatArray
from trailmark.world import Robot, World

__all__ = ["free_somewhere"]

HALVINGS = 7
"""Times that a cell's edges are halved: to a hundredth, some millimetres of a cell as large as a robot."""

MOST = 200_000
"""Cells that are looked at: a second or two, if it comes to that."""

BATCH = 2_000
"""Cells that are looked at together."""

HEADINGS = 17
"""Headings of a box at which the robot, eroded by how far it moves from one to the next, is intersected with itself."""

CHILDREN = np.array(list(product((-0.5, 0.5), repeat=3)))


def free_somewhere(
    world: World,
    robot: Robot,
    middle: FloatArray,
    extent: FloatArray,
    pivot: FloatArray,
) -> bool:
    """Return whether a configuration in one of the boxes is found at which the robot meets nothing.

    Args:
        world: obstacles, bounds, boundary.
        robot: footprint.
        middle: of each box: place of the pivot (metres) and heading (radians), shape (n, 3).
        extent: half the box's edges, those along x and y alike, shape (n, 3).
        pivot: in the robot's frame, shape (2,).
    """
    space = _Space(world, robot.clearance)
    outline = np.asarray(robot.outline.rings()[0]) - pivot
    left = MOST
    # Boxes of one size are looked at together: the robot's middle is the same in all.
    sizes, kind = np.unique(extent, axis=0, return_inverse=True)
    kind = kind.ravel()
    for _ in range(HALVINGS + 1):
        unsettled = []
        for n, size in enumerate(sizes):
            core = _core(outline, size)
            boxes = np.flatnonzero(kind == n)
            for first in range(0, len(boxes), BATCH):
                of = boxes[first : first + BATCH]
                left -= len(of)
                if left < 0:
                    return False
                # Where what the robot covers throughout meets something, so does the robot at the centre.
                for ring in core:
                    of = of[~space.meets(_placed(ring, middle[of]))]
                if not space.meets(_placed(outline, middle[of])).all():
                    return True
                unsettled.append(of)
        open_ = np.concatenate(unsettled) if unsettled else np.empty(0, np.int64)
        if len(open_) == 0:
            return False
        middle = (middle[open_][:, None] + CHILDREN * sizes[kind[open_]][:, None]).reshape(-1, 3)
        sizes, kind = 0.5 * sizes, np.repeat(kind[open_], len(CHILDREN))
    return False


class _Space:
    """What the robot must not come nearer to than its clearance, metres."""

    def __init__(self, world: World, clearance: float) -> None:
        self._clearance = clearance
        # Discs as polygons about them, by 1 mm at most: what is said to be free is.
        self._tree = shapely.STRtree([shape.polygon().shapely() for shape in world.obstacles])
        self._rooms = [shapely.box(*world.bounds)]
        if world.boundary is not None:
            self._rooms.append(world.boundary.shapely())
        shapely.prepare(self._rooms)

    def meets(self, pieces: Any) -> NDArray[np.bool_]:
        """Return which of n pieces of the robot, an array of shapely's polygons, meet an obstacle or leave a room."""
        found = np.zeros(len(pieces), np.bool_)
        if self._clearance > 0.0:
            near = self._tree.query(pieces, predicate="dwithin", distance=self._clearance)
        else:
            near = self._tree.query(pieces, predicate="intersects")
        found[near[0]] = True
        for room in self._rooms:
            found |= ~shapely.covers(room, pieces)
            if self._clearance > 0.0:
                found |= shapely.distance(room.exterior, pieces) < self._clearance
        return found


def _placed(ring: FloatArray, q: FloatArray) -> Any:
    """Return an array of n polygons: a ring about the pivot at configurations (n, 3)."""
    c, s = np.cos(q[:, 2]), np.sin(q[:, 2])
    turn = np.stack([np.stack([c, s], axis=-1), np.stack([-s, c], axis=-1)], axis=-2)
    return shapely.polygons(ring @ turn + q[:, None, :2])


def _core(outline: FloatArray, extent: FloatArray) -> list[FloatArray]:
    """Return rings around what the robot covers at every configuration in a box, in its frame at the box's centre."""
    turn = min(float(extent[2]), np.pi)
    # No heading of the box is farther than half a step from one of these.
    headings, half = np.linspace(-turn, turn, HEADINGS), turn / (HEADINGS - 1)
    moves = np.sqrt(2.0) * extent[0] + 2.0 * float(np.hypot(*outline.T).max()) * np.sin(0.5 * half) + 1e-9
    robot = shapely.Polygon(outline)
    inside = shapely.buffer(robot, -1.03 * moves, join_style="mitre")
    # Buffers are not exact: measured anew.
    if inside.is_empty or inside.distance(robot.exterior) < moves or not robot.covers(inside):
        return []
    throughout = shapely.intersection_all([rotate(inside, a, origin=(0.0, 0.0), use_radians=True) for a in headings])
    # A part's outline is all that can meet first.
    parts = shapely.get_parts(throughout)
    return [shapely.get_coordinates(part.exterior) for part in parts if part.area > 0.0]
