"""Messages of ROS 2 to what trailmark plans with, and back."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from nav_msgs.msg import OccupancyGrid, Path
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from trailmark import Disc, Polygon, Rectangle, Robot, se2
from trailmark.errors import ConfigurationError, WorldError
from trailmark.ros.planning import Answer, GridMap
from trailmark.ros.planning import Pose as Configuration
from trailmark.shapes import Shape

LEAST, MOST = 1e-6, 1e7
"""Metres: the smallest cell of a map, and the farthest."""

UNIT = 0.01
"""By which a quaternion's norm may be off 1, as nav2 allows."""


def configuration(pose: Pose) -> Configuration:
    """Return a pose's x, y and heading."""
    q = pose.orientation
    norm = math.hypot(q.x, q.y, q.z, q.w)
    if not all(map(math.isfinite, (pose.position.x, pose.position.y))) or not abs(norm - 1.0) <= UNIT:
        got = f"({pose.position.x:g}, {pose.position.y:g}) with ({q.x:g}, {q.y:g}, {q.z:g}, {q.w:g})"
        raise ConfigurationError(f"pose: expected finite numbers and a quaternion of norm 1, got {got}")
    yaw = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
    return pose.position.x, pose.position.y, yaw


def grid_map(message: OccupancyGrid, threshold: int, allow_unknown: bool) -> GridMap:
    """Return a map or costmap (-1 unknown, 0 to 100), whose cells from the threshold on are occupied."""
    info = message.info
    if not info.width * info.height == len(message.data) > 0:
        got = f"{len(message.data)} of {info.width} x {info.height}"
        raise WorldError(f"map: expected at least one cell and as many as its size says, got {got}")
    x, y, _ = origin = configuration(info.origin)
    reach = max(abs(x), abs(y)) + info.resolution * (info.width + info.height)
    if not (info.resolution >= LEAST and reach <= MOST):
        got = f"{info.resolution:g} and {reach:g}"
        raise WorldError(f"map: expected cells of at least {LEAST:g} m and coordinates up to {MOST:g} m, got {got}")
    cells = np.frombuffer(message.data, np.int8).reshape(info.height, info.width)
    stamp = message.header.stamp.sec, message.header.stamp.nanosec
    occupied = (cells >= threshold) | ((cells < 0) & (not allow_unknown))
    return GridMap(occupied, info.resolution, origin, message.header.frame_id, stamp)


def patched(message: OccupancyGrid, update: Any) -> None:
    """Write a ``map_msgs/OccupancyGridUpdate`` into the grid that it is of."""
    width, height = message.info.width, message.info.height
    new, old = ((at.header.stamp.sec, at.header.stamp.nanosec) for at in (update, message))
    if new < old or update.header.frame_id not in ("", message.header.frame_id):  # topics may overtake each other
        got = f"{new[0]}.{new[1]:09d} in {update.header.frame_id!r}"
        raise WorldError(f"map update: expected {message.header.frame_id!r}, no older than the map, got {got}")
    inside = 0 <= update.x <= width - update.width and 0 <= update.y <= height - update.height
    if not inside or len(update.data) != update.width * update.height:
        got = f"{len(update.data)} cells, {update.width} x {update.height} at ({update.x}, {update.y})"
        raise WorldError(f"map update: expected cells within {width} x {height}, got {got}")
    cells = np.frombuffer(message.data, np.int8).reshape(height, width)  # an array of Python's own, which is written to
    cells[update.y : update.y + update.height, update.x : update.x + update.width] = np.frombuffer(
        update.data, np.int8
    ).reshape(update.height, update.width)
    message.header.stamp = update.header.stamp


def marker_shapes(marker: Marker, frame: str) -> list[Shape]:
    """Return the obstacles that a marker shows: a line strip's or list of triangles' polygons, a cylinder, a box."""
    if marker.header.frame_id not in ("", frame):
        raise ConfigurationError(f"obstacles: expected frame {frame!r}, got {marker.header.frame_id!r}")
    x, y, yaw = configuration(marker.pose)
    points = se2.transform((x, y, yaw), np.array([(p.x, p.y) for p in marker.points]).reshape(-1, 2))
    if marker.type == Marker.LINE_STRIP:
        closed = len(points) > 1 and np.array_equal(points[0], points[-1])
        return [Polygon(points[:-1] if closed else points)]
    if marker.type == Marker.TRIANGLE_LIST:
        return [Polygon(triangle) for triangle in points[: len(points) // 3 * 3].reshape(-1, 3, 2)]
    if marker.type == Marker.CYLINDER:
        return [Disc((x, y), 0.5 * max(marker.scale.x, marker.scale.y))]
    if marker.type == Marker.CUBE:
        return [Rectangle((x, y), marker.scale.x, marker.scale.y, yaw)]
    raise ConfigurationError(
        f"obstacles: expected a LINE_STRIP, TRIANGLE_LIST, CYLINDER or CUBE, got type {marker.type}"
    )


def path_message(states: se2.FloatArray, robot: Robot, header: Header) -> Path:
    """Return configurations, shape (n, 3), as a path."""
    headings = states[:, 2].copy()
    if len(states) and isinstance(robot.footprint, Disc) and robot.drive == "omnidirectional":
        # A disc may have any heading: who follows the path wants that of travel, and the goal's at its end.
        headings[:-1] = np.arctan2(*np.diff(states[:, 1::-1], axis=0).T)
    rows = zip(states[:, :2].tolist(), headings.tolist(), strict=True)
    return Path(header=header, poses=[PoseStamped(header=header, pose=_pose(x, y, theta)) for (x, y), theta in rows])


def diagnostics(name: str, answer: Answer, header: Header) -> DiagnosticArray:
    """Return what came of a query, as the tools of ROS show it."""
    solved = answer.code == "NONE"
    facts = {
        "code": answer.code,
        "cost": f"{answer.cost:.6g}" if solved else "",
        "lower bound": "" if answer.lower_bound is None else f"{answer.lower_bound:.6g}",
        "seconds": f"{answer.seconds:.6g}",
        "map stamp": "{}.{:09d}".format(*answer.stamp),
        "path stamp": f"{header.stamp.sec}.{header.stamp.nanosec:09d}",
    }
    level = DiagnosticStatus.OK if solved else DiagnosticStatus.WARN
    status = DiagnosticStatus(level=level, name=f"{name}: plan", message=answer.message or "solved")
    status.values = [KeyValue(key=key, value=value) for key, value in facts.items()]
    return DiagnosticArray(header=header, status=[status])


def _pose(x: float, y: float, theta: float) -> Pose:
    rotation = Quaternion(z=math.sin(0.5 * theta), w=math.cos(0.5 * theta))
    return Pose(position=Point(x=x, y=y), orientation=rotation)


def roadmap_markers(graph: Any, header: Header) -> tuple[MarkerArray, MarkerArray]:
    """Return the roadmap's certified edges as lines, and its landmarks as points."""
    places = {node: _point(*data["configuration"][:2]) for node, data in graph.nodes(data=True)}
    edges = _marker(header, Marker.LINE_LIST, 0.01, (0.4, 0.5, 0.6, 0.5))
    edges.points = [places[node] for *edge, free in graph.edges(data="certified") if free for node in edge]
    landmarks = _marker(header, Marker.POINTS, 0.06, (0.1, 0.4, 0.8, 1.0))
    landmarks.points = list(places.values())
    return MarkerArray(markers=[edges]), MarkerArray(markers=[landmarks])


def swept_footprint(robot: Robot, states: se2.FloatArray, header: Header) -> MarkerArray:
    """Return the footprint's outline at each configuration, shape (n, 3), as one list of lines."""
    outline = robot.footprint.polygon(0.05).vertices
    marker = _marker(header, Marker.LINE_LIST, 0.01, (0.9, 0.5, 0.1, 0.8))
    for corners in se2.transform(states, outline):
        points = [_point(*corner) for corner in corners.tolist()]
        marker.points += [p for pair in zip(points, [*points[1:], points[0]], strict=True) for p in pair]
    return MarkerArray(markers=[marker])


def _point(x: float, y: float) -> Point:
    return Point(x=float(x), y=float(y))


def _marker(header: Header, kind: int, width: float, colour: Sequence[float]) -> Marker:
    marker = Marker(header=header, type=kind, action=Marker.ADD)
    marker.pose.orientation.w = 1.0
    marker.scale.x = marker.scale.y = width
    marker.color.r, marker.color.g, marker.color.b, marker.color.a = colour
    return marker


def states_of(poses: Iterable[PoseStamped]) -> se2.FloatArray:
    """Return the configurations of a path's poses, shape (n, 3)."""
    return np.array([configuration(stamped.pose) for stamped in poses]).reshape(-1, 3)
