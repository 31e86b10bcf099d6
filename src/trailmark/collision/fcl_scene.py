"""The one FCL scene: obstacles and robot as FCL collision objects. The only module that imports fcl.

Polygons on both sides are flat triangle meshes at z = 0 that fill their regions: with them FCL's collide and
distance agree with shapely, containment included. Distances between primitives and meshes are wrong, and surface
meshes miss a robot that lies completely inside an obstacle. Discs are spheres, whose distances to flat meshes and to
one another are exact.
"""

from __future__ import annotations

import math
from typing import Any

import fcl
import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark.jit import njit
from trailmark.lock import Lock
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc, Polygon, Shape, triangulate
from trailmark.touching import TOUCHING_TOLERANCE, overlap_core
from trailmark.world import Robot, World

__all__ = ["FclScene"]

Box = tuple[float, float, float, float]


class FclScene:
    """A world and a robot as FCL objects, each obstacle's made when the robot first comes near it.

    Threads that share it take turns, since each query moves the robot.

    Args:
        world: obstacles, boundary and bounds.
        robot: its footprint and the clearance that it keeps. Without one, :meth:`collides` erodes the footprint by at
            most TOUCHING_TOLERANCE, since touching is allowed.
    """

    def __init__(self, world: World, robot: Robot) -> None:
        self._turns = Lock()
        self._bounds = world.bounds
        disc = robot.footprint if isinstance(robot.footprint, Disc) else None
        self._radius, self._kept = 0.0 if disc is None else disc.radius, robot.clearance
        # A copy: shapes are read-only, which numba would take for another type and compile anew for.
        self._outline = np.array(robot.outline.vertices) if disc is None else np.zeros((1, 2))
        self._robot = fcl.CollisionObject(_robot_geometry(robot, eroding=False))
        # Eroded, it would come nearer by up to the tolerance to what it is to keep away from by less than that.
        self._robot_eroded = fcl.CollisionObject(_robot_geometry(robot, eroding=robot.clearance == 0.0))
        self._shapes: list[Shape] = [*_outside_boundary(world), *world.obstacles]
        self._objects: list[Any] = [None] * len(self._shapes)
        boxes = [shape.bounding_box() for shape in self._shapes]
        self._boxes = np.array(boxes).reshape(-1, 4).T.copy()

    def collides(self, q: FloatArray) -> bool:
        """Return whether the robot at q = (x, y, theta), shape (3,), overlaps an obstacle or leaves the bounds.

        So it does if it is nearer to one of them than the clearance that it keeps.
        """
        box = _placed_box(self._outline, self._radius + self._kept, float(q[0]), float(q[1]), float(q[2]))
        if self._beyond_bounds(box) > TOUCHING_TOLERANCE:
            return True
        near, apart = _meeting(self._boxes, *box)
        near = near[np.argsort(apart)]
        if len(near) == 0:
            return False
        with self._turns:
            self._robot_eroded.setTransform(_transform(q))
            self._robot.setTransform(_transform(q))
            return any(self._too_near(place) for place in near.tolist())

    def _too_near(self, place: int) -> bool:
        """Return whether the robot, as it stands, overlaps an obstacle or does not keep its clearance from it."""
        if _overlap(self._robot_eroded, self._object(place)):
            return True
        needed = self._kept - TOUCHING_TOLERANCE
        return needed > 0.0 and self._distance(place) < needed

    def _distance(self, place: int) -> float:
        """Return the distance (metres) of the robot, as it stands, to an obstacle; 0 if they overlap."""
        obstacle = self._object(place)
        # The distance of a sphere and a mesh is an undefined value when they overlap: so collisions are checked first.
        if _overlap(self._robot, obstacle):
            return 0.0
        return float(fcl.distance(self._robot, obstacle, fcl.DistanceRequest(), fcl.DistanceResult()))

    def _object(self, place: int) -> Any:
        """Return an obstacle's collision object, made when it is first needed."""
        found = self._objects[place]
        if found is None:
            found = self._objects[place] = _obstacle_object(self._shapes[place])
        return found

    def _beyond_bounds(self, box: Box) -> float:
        """Return how far (metres) a box reaches over the bounds; negative where it stays inside."""
        xmin, ymin, xmax, ymax = self._bounds
        return max(xmin - box[0], box[2] - xmax, ymin - box[1], box[3] - ymax)


@njit
def _placed_box(outline: FloatArray, radius: float, x: float, y: float, theta: float) -> Box:
    """Return xmin, ymin, xmax, ymax of an outline (v, 2) at a configuration, thickened by ``radius``; metres."""
    c, s = math.cos(theta), math.sin(theta)
    xmin = ymin = math.inf
    xmax = ymax = -math.inf
    for px, py in outline:
        ax, ay = x + c * px - s * py, y + s * px + c * py
        xmin, xmax = min(xmin, ax), max(xmax, ax)
        ymin, ymax = min(ymin, ay), max(ymax, ay)
    return xmin - radius, ymin - radius, xmax + radius, ymax + radius


@njit(nogil=True)
def _meeting(
    boxes: FloatArray, xmin: float, ymin: float, xmax: float, ymax: float
) -> tuple[NDArray[np.int64], FloatArray]:
    """Return which of the boxes, shape (4, n), may meet a box, and how far they are apart, negative where they do."""
    meets = np.empty(boxes.shape[1], np.bool_)
    xmin, ymin, xmax, ymax = (
        xmin - TOUCHING_TOLERANCE,
        ymin - TOUCHING_TOLERANCE,
        xmax + TOUCHING_TOLERANCE,
        ymax + TOUCHING_TOLERANCE,
    )
    for k in range(len(meets)):
        meets[k] = (boxes[0, k] <= xmax) & (boxes[1, k] <= ymax) & (boxes[2, k] >= xmin) & (boxes[3, k] >= ymin)
    found = np.flatnonzero(meets)
    apart = np.empty(len(found))
    for i in range(len(found)):
        left, low, right, high = boxes[:, found[i]]
        apart[i] = max(left - xmax, xmin - right, low - ymax, ymin - high)
    return found, apart


def _overlap(a: Any, b: Any) -> bool:
    return bool(fcl.collide(a, b, fcl.CollisionRequest(), fcl.CollisionResult()) > 0)


def _transform(q: FloatArray) -> Any:
    half = 0.5 * float(q[2])
    return fcl.Transform(np.array([math.cos(half), 0.0, 0.0, math.sin(half)]), np.array([q[0], q[1], 0.0]))


def _robot_geometry(robot: Robot, *, eroding: bool) -> Any:
    if isinstance(robot.footprint, Disc):
        radius = robot.footprint.radius
        # A sphere of radius 0 collides with nothing, not even around its centre.
        return fcl.Sphere(max(radius - TOUCHING_TOLERANCE, 0.5 * radius) if eroding else radius)
    parts = overlap_core(robot.outline.rings()[0]) if eroding else []
    return _mesh([_polygon(part) for part in parts] or [robot.outline])


def _obstacle_object(shape: Shape) -> Any:
    """Return a mesh for a polygon or rectangle, a sphere for a disc."""
    if not isinstance(shape, Disc):
        return fcl.CollisionObject(_mesh([shape.polygon()]))
    return fcl.CollisionObject(fcl.Sphere(shape.radius), fcl.Transform(np.eye(3), np.array([*shape.center, 0.0])))


def _outside_boundary(world: World) -> list[Polygon]:
    """Return the part of a frame around the bounds that lies outside the boundary."""
    if world.boundary is None:
        return []
    xmin, ymin, xmax, ymax = world.bounds
    frame = shapely.box(xmin - 1.0, ymin - 1.0, xmax + 1.0, ymax + 1.0)
    outside = shapely.difference(frame, world.boundary.shapely())
    return [_polygon(part) for part in shapely.get_parts(outside) if part.area > 0.0]


def _polygon(region: shapely.Polygon) -> Polygon:
    holes = tuple(shapely.get_coordinates(ring) for ring in region.interiors)
    return Polygon(shapely.get_coordinates(region.exterior), holes)


def _mesh(polygons: list[Polygon]) -> Any:
    corners = np.concatenate([triangulate(polygon) for polygon in polygons])
    points = np.zeros((3 * len(corners), 3))
    points[:, :2] = corners.reshape(-1, 2)
    model = fcl.BVHModel()
    model.beginModel(len(corners), len(points))
    model.addSubModel(points, np.arange(len(points)).reshape(-1, 3))
    model.endModel()
    return model
