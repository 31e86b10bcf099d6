"""The one FCL scene: obstacles and robot as FCL collision objects. The only module that imports fcl.

Polygons on both sides are flat triangle meshes at z = 0 that fill their regions: with them FCL's collide and
distance agree with shapely, containment included. Distances between primitives and meshes are wrong, and surface
meshes miss a robot that lies completely inside an obstacle. Discs are spheres, whose distances to flat meshes and to
one another are exact.
"""

from __future__ import annotations

import math
from threading import Lock
from typing import Any

import fcl
import numpy as np
import shapely

from trailmark.collision.footprint import TOUCHING_TOLERANCE, overlap_core
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc, Polygon, triangulate
from trailmark.world import Robot, World

__all__ = ["FclScene"]


class FclScene:
    """A world and a robot as FCL objects. Threads that share it take turns, since each query moves the robot.

    Args:
        world: obstacles, boundary and bounds.
        robot: its footprint; eroded by at most TOUCHING_TOLERANCE for :meth:`collides`, since touching is allowed.
    """

    def __init__(self, world: World, robot: Robot) -> None:
        self._turns = Lock()
        self._bounds = world.bounds
        self._outline = robot.outline.vertices if not isinstance(robot.footprint, Disc) else None
        self._radius = robot.footprint.radius if isinstance(robot.footprint, Disc) else 0.0
        self._robot = fcl.CollisionObject(_robot_geometry(robot, eroding=False))
        self._robot_eroded = fcl.CollisionObject(_robot_geometry(robot, eroding=True))
        self._obstacles = _obstacle_objects(world)
        self._manager = fcl.DynamicAABBTreeCollisionManager()
        self._manager.registerObjects(self._obstacles)
        self._manager.setup()

    def collides(self, q: FloatArray) -> bool:
        """Return whether the robot at q = (x, y, theta), shape (3,), overlaps an obstacle or leaves the bounds."""
        if self._beyond_bounds(q) > TOUCHING_TOLERANCE:
            return True
        if not self._obstacles:
            return False
        with self._turns:
            self._robot_eroded.setTransform(_transform(q))
            if len(self._obstacles) == 1:
                request, result = fcl.CollisionRequest(), fcl.CollisionResult()
                return bool(fcl.collide(self._robot_eroded, self._obstacles[0], request, result) > 0)
            data = fcl.CollisionData()
            self._manager.collide(self._robot_eroded, data, fcl.defaultCollisionCallback)
            return bool(data.result.is_collision)

    def clearance(self, q: FloatArray) -> float:
        """Return the distance (metres) of the robot at q to all that blocks it; 0 on overlap or outside."""
        with self._turns:
            self._robot.setTransform(_transform(q))
            return self._distance(-self._beyond_bounds(q))

    def _distance(self, clearance: float) -> float:
        """Return the distance (metres) of the robot at its present place to the obstacles, or ``clearance`` if less."""
        for obstacle in self._obstacles:
            # One call per object: distances through a manager do not show overlap reliably. Nor does the distance of
            # a sphere and a mesh, an undefined value when they overlap: so collisions are checked first.
            if fcl.collide(self._robot, obstacle, fcl.CollisionRequest(), fcl.CollisionResult()) > 0:
                return 0.0
            result = fcl.DistanceResult()
            distance = fcl.distance(self._robot, obstacle, fcl.DistanceRequest(), result)
            clearance = min(clearance, distance)
            if clearance <= 0.0:
                return 0.0
        return max(0.0, float(clearance))

    def _beyond_bounds(self, q: FloatArray) -> float:
        """Return how far (metres) the robot reaches over the bounds; negative where it stays inside."""
        xmin, ymin, xmax, ymax = self._bounds
        x, y = float(q[0]), float(q[1])
        if self._outline is None:
            r = self._radius
            return max(xmin - x + r, x + r - xmax, ymin - y + r, y + r - ymax)
        cos, sin = math.cos(q[2]), math.sin(q[2])
        xs = x + self._outline @ (cos, -sin)
        ys = y + self._outline @ (sin, cos)
        return float(max(xmin - xs.min(), xs.max() - xmax, ymin - ys.min(), ys.max() - ymax))


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


def _obstacle_objects(world: World) -> list[Any]:
    """Return one mesh for all polygons and for what lies outside the boundary, and one sphere for each disc."""
    polygons = [shape.polygon() for shape in world.obstacles if not isinstance(shape, Disc)]
    polygons += _outside_boundary(world)
    objects = [fcl.CollisionObject(_mesh(polygons))] if polygons else []
    for shape in world.obstacles:
        if isinstance(shape, Disc):
            center = np.array([*shape.center, 0.0])
            objects.append(fcl.CollisionObject(fcl.Sphere(shape.radius), fcl.Transform(np.eye(3), center)))
    return objects


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
