"""trailmark's own world file, schema version 1: YAML that people write and read."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from itertools import repeat
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trailmark.errors import ConfigurationError, FormatError, OutputError, ShapeError, WorldError
from trailmark.goals import Goal
from trailmark.moving import Moving
from trailmark.shapes import Disc, Polygon, Rectangle, Shape
from trailmark.world import ObstacleEstimate, Query, RiskBound, Robot, World
from trailmark.zones import CostZone, KeepOutZone, OneWayZone, SpeedZone, Zone

if TYPE_CHECKING:
    from trailmark.formats import schema

__all__ = ["robot_from_entry", "world_from_data", "world_text"]

_HEADER = "# A trailmark world. Metres and radians; y up, theta counter-clockwise; configurations are [x, y, theta].\n"
_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*(?: [A-Za-z0-9_.-]+)*")
# Words that YAML readers of any version take for something other than text.
_RESERVED = frozenset(("null", "true", "false", "yes", "no", "on", "off", "y", "n"))


def world_from_data(data: dict[str, Any], path: Path) -> World:
    """Return the world that a world file describes.

    Args:
        data: the file's plain data.
        path: the file, for messages; its stem names the world if the file does not.

    Raises:
        FormatError: a field is missing, unknown, of a wrong type or out of range, or a shape bounds no region; the
            message names the field, its value and what is allowed.
    """
    from trailmark.formats.schema import WorldFile
    from trailmark.formats.validation import validate

    version = data["trailmark"]
    if isinstance(version, bool | float) or version != 1:
        raise FormatError(path, f"trailmark: expected 1 (the schema version), got {version!r}")
    file = validate(WorldFile, data, path)
    robot = None if file.robot is None else _build(path, "robot", robot_from_entry, file.robot)
    boundary = None if file.boundary is None else _build(path, "boundary", Polygon, file.boundary)
    entries = file.obstacles or ()
    obstacles = [_build(path, f"obstacles[{i}]", _any_obstacle, entry) for i, entry in enumerate(entries)]
    estimates = [
        None if entry.estimate is None else _build(path, f"obstacles[{i}].estimate", _estimate, entry.estimate)
        for i, entry in enumerate(entries)
    ]
    queries = [_build(path, f"queries[{i}]", _query, entry) for i, entry in enumerate(file.queries or ())]
    xmin, ymin, xmax, ymax = file.bounds
    return World(
        name=path.stem if file.name is None else file.name,
        bounds=(xmin, ymin, xmax, ymax),
        obstacles=tuple(obstacles),
        robot=robot,
        boundary=boundary,
        queries=tuple(queries),
        estimates=tuple(estimates),
        risk=None if file.risk is None else _build(path, "risk", _risk, file.risk),
        ids=tuple(entry.id for entry in entries),
        zones=tuple(_build(path, f"zones[{i}]", _zone, entry) for i, entry in enumerate(file.zones or ())),
        sources=(path.absolute(),),
    )


def world_text(world: World) -> str:
    """Return the world as the text of a world file; reading it gives an equal world.

    Raises:
        OutputError: a name that UTF-8 cannot hold.
    """
    lines = [
        "trailmark: 1",
        f"name: {_text(world.name)}",
        f"bounds: {_numbers(world.bounds)}",
    ]
    if world.robot is not None:
        lines.append(f"robot: {_robot_text(world.robot)}")
    if world.boundary is not None:
        lines.append(f"boundary: {_points(world.boundary.vertices.tolist())}")
    if world.risk is not None:
        lines.append(f"risk: {_risk_text(world.risk)}")
    if world.obstacles:
        lines.append("obstacles:")
        columns = (column or repeat(None) for column in (world.ids, world.estimates, world.moving))
        lines += [f"  - {_obstacle_text(*row)}" for row in zip(world.obstacles, *columns, strict=False)]
    if world.zones:
        lines += ["zones:", *(f"  - {_zone_text(zone)}" for zone in world.zones)]
    if world.queries:
        lines.append("queries:")
        lines += [
            f"  - {{name: {_text(query.name)}, start: {_numbers(query.start)}, goal: {_goals_text(query)}}}"
            for query in world.queries
        ]
    return _HEADER + "\n".join(lines) + "\n"


def _build(path: Path, where: str, make: Any, entry: Any) -> Any:
    try:
        return make(entry)
    except (ShapeError, ConfigurationError, WorldError) as error:
        raise FormatError(path, f"{where}: {error}") from None


def robot_from_entry(entry: schema.DiscRobot | schema.RectangleRobot | schema.PolygonRobot) -> Robot:
    """Return the robot that a world file's ``robot`` describes."""
    if entry.shape == "disc":
        robot = Robot.disc(entry.radius)
    elif entry.shape == "rectangle":
        robot = Robot.rectangle(entry.length, entry.width)
    else:
        robot = Robot.polygon(entry.vertices)
    # What is not given is as the rest says.
    given: Any = {"turning_radius": entry.turning_radius, "reverse": entry.reverse, "drive": entry.drive}
    return replace(robot, **given)


def _obstacle(entry: schema.DiscShape | schema.RectangleShape | schema.PolygonShape) -> Shape:
    if entry.shape == "disc":
        return Disc((entry.center[0], entry.center[1]), entry.radius)
    if entry.shape == "rectangle":
        return Rectangle((entry.center[0], entry.center[1]), entry.length, entry.width, entry.heading)
    return Polygon(entry.vertices, entry.holes)  # type: ignore[arg-type]  # it turns lists into arrays itself


def _any_obstacle(entry: schema.DiscObstacle | schema.RectangleObstacle | schema.PolygonObstacle) -> Shape | Moving:
    shape = _obstacle(entry)
    if entry.motion is None:
        return shape
    vx, vy = entry.motion.velocity
    return Moving(shape, (vx, vy), entry.motion.until)


def _estimate(entry: schema.EstimateEntry) -> ObstacleEstimate:
    return ObstacleEstimate(_obstacle(entry.mean), entry.covariance, entry.share)  # type: ignore[arg-type]  # it makes arrays


def _risk(entry: schema.RiskEntry) -> RiskBound:
    return RiskBound(entry.confidence, entry.pose_covariance, entry.reach)  # type: ignore[arg-type]  # it makes arrays


def _query(entry: schema.QueryEntry) -> Query:
    x0, y0, t0 = entry.start
    if not isinstance(entry.goal, list):
        return Query(entry.name, (x0, y0, t0), (_goal(entry.goal),))
    poses = [goal for goal in entry.goal if isinstance(goal, float)]
    goals = [_goal(goal) for goal in entry.goal if not isinstance(goal, float)]
    return Query(entry.name, (x0, y0, t0), (poses[0], poses[1], poses[2]) if poses else tuple(goals))


def _goal(entry: schema.GoalEntry) -> Goal:
    return Goal(**entry.model_dump())


def _zone(entry: schema.ZoneEntry) -> Zone:
    region = Polygon(entry.vertices, entry.holes)  # type: ignore[arg-type]  # it turns lists into arrays itself
    if entry.kind == "cost":
        return CostZone(region, entry.factor)
    if entry.kind == "one-way":
        return OneWayZone(region, entry.heading, entry.tolerance)
    return SpeedZone(region, entry.limit) if entry.kind == "speed" else KeepOutZone(region)


def _shape(shape: Shape, placed: bool) -> str:
    if isinstance(shape, Polygon):
        return f"{{shape: polygon, {_rings(shape)}}}"
    center = f"center: {_numbers(shape.center)}, " if placed else ""
    if isinstance(shape, Disc):
        return f"{{shape: disc, {center}radius: {_number(shape.radius)}}}"
    size = f"length: {_number(shape.length)}, width: {_number(shape.width)}"
    heading = f", heading: {_number(shape.heading)}" if shape.heading else ""
    return f"{{shape: rectangle, {center}{size}{heading}}}"


def _robot_text(robot: Robot) -> str:
    text = _shape(robot.footprint, placed=False)
    if robot.drive == "differential":
        return f"{text[:-1]}, drive: differential{', reverse: true' if robot.reverse else ''}}}"
    if robot.turning_radius is None:
        return text
    reverse = "" if robot.reverse else ", reverse: false"
    return f"{text[:-1]}, turning_radius: {_number(robot.turning_radius)}{reverse}}}"


def _obstacle_text(shape: Shape, name: str | None, estimate: ObstacleEstimate | None, moving: Moving | None) -> str:
    text = _shape(shape if moving is None else moving.shape, placed=True)
    fields = "" if name is None else f", id: {_text(name)}"
    if estimate is not None:
        share = "" if estimate.share is None else f", share: {_number(estimate.share)}"
        mean, covariance = _shape(estimate.mean, placed=True), _points(estimate.covariance.tolist())
        fields += f", estimate: {{mean: {mean}, covariance: {covariance}{share}}}"
    if moving is not None:
        fields += f", motion: {{velocity: {_numbers(moving.velocity)}, until: {_number(moving.until)}}}"
    return f"{text[:-1]}{fields}}}"


def _zone_text(zone: Zone) -> str:
    if isinstance(zone, CostZone):
        fields = f", factor: {_number(zone.factor)}"
    elif isinstance(zone, OneWayZone):
        fields = f", heading: {_number(zone.heading)}, tolerance: {_number(zone.tolerance)}"
    else:
        fields = f", limit: {_number(zone.limit)}" if isinstance(zone, SpeedZone) else ""
    return f"{{kind: {zone.kind}{fields}, {_rings(zone.region)}}}"


def _rings(polygon: Polygon) -> str:
    holes = f", holes: [{', '.join(_points(hole.tolist()) for hole in polygon.holes)}]" if polygon.holes else ""
    return f"vertices: {_points(polygon.vertices.tolist())}{holes}"


def _risk_text(risk: RiskBound) -> str:
    fields = f"confidence: {_number(risk.confidence)}"
    if risk.pose_covariance is not None:
        fields += f", pose_covariance: {_points(risk.pose_covariance.tolist())}"
    return f"{{{fields}, reach: {_number(risk.reach)}}}" if risk.reach else f"{{{fields}}}"


def _goals_text(query: Query) -> str:
    goals = query.goals
    if len(goals) == 1 and query.goal != goals:
        return _numbers(query.pose())
    text = ", ".join(map(_goal_text, goals))
    return text if len(goals) == 1 else f"[{text}]"


def _goal_text(goal: Goal) -> str:
    fields = []
    for name, value in goal.to_dict().items():
        text = _points(value) if name == "region" else _numbers(value) if name == "pose" else _number(value)
        fields.append(f"{name}: {text}")
    return f"{{{', '.join(fields)}}}"


def _points(points: Iterable[Iterable[float]]) -> str:
    return f"[{', '.join(map(_numbers, points))}]"


def _numbers(values: Iterable[float]) -> str:
    return f"[{', '.join(map(_number, values))}]"


def _number(value: float) -> str:
    digits = repr(float(value))
    mantissa, e, exponent = digits.partition("e")
    # Readers of YAML 1.1 take 1e-05 for a text, but 1.0e-05 for a number.
    return f"{mantissa}.0e{exponent}" if e and "." not in mantissa else digits


def _text(text: str) -> str:
    if _PLAIN.fullmatch(text) and text.lower() not in _RESERVED:
        return text
    import yaml

    try:
        text.encode()
    except UnicodeEncodeError:
        raise OutputError(f"name: expected a text that UTF-8 can hold, got {text!r}") from None
    quoted: str = yaml.safe_dump(text, default_style='"', width=1 << 30, allow_unicode=True)
    return quoted.rstrip("\n")
