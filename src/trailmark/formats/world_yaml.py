"""trailmark's own world file, schema version 1: YAML that people write and read; and robots in YAML files."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import repeat
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trailmark.arguments import brief, real
from trailmark.errors import ConfigurationError, FormatError, OutputError, ShapeError, WorldError
from trailmark.formats.files import read_text
from trailmark.formats.schema import ObstacleList, QueryEntry, RobotFile, WorldFile, validate
from trailmark.formats.yaml_data import parse_yaml
from trailmark.goals import Goal
from trailmark.moving import Moving
from trailmark.robot import Robot
from trailmark.shapes import Disc, Polygon, Rectangle, Shape
from trailmark.world import ObstacleEstimate, Query, RiskBound, World
from trailmark.zones import CostZone, KeepOutZone, OneWayZone, SpeedZone, Zone

if TYPE_CHECKING:
    from trailmark.formats import schema

__all__ = [
    "HEADER",
    "obstacles_from_data",
    "query_from_data",
    "read_robot",
    "robot_data",
    "robot_from_entry",
    "world_data",
    "world_from_data",
    "world_text",
]

HEADER = "# A trailmark world. Metres and radians; y up, theta counter-clockwise; configurations are [x, y, theta].\n"
_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*(?: [A-Za-z0-9_.-]+)*")
_LISTS = frozenset(("obstacles", "zones", "queries"))  # one line for each entry
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
    from trailmark.formats.grid import unpacked_cells

    version = data["trailmark"]
    if isinstance(version, bool | float) or version != 1:
        raise FormatError(path, f"trailmark: expected 1 (the schema version), got {version!r}")
    file = validate(WorldFile, data, path)
    robot = None if file.robot is None else _build(path, "robot", robot_from_entry, file.robot)
    boundary = None if file.boundary is None else _build(path, "boundary", Polygon, file.boundary)
    entries = file.obstacles or ()
    if file.grid is not None and file.obstacles:
        raise FormatError(path, "expected obstacles or a grid, got both")
    grid = None if file.grid is None else _build(path, "grid", unpacked_cells, file.grid)
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
        obstacles=tuple(obstacles) if grid is None else grid.as_tuple(),
        robot=robot,
        boundary=boundary,
        queries=tuple(queries),
        estimates=tuple(estimates),
        risk=None if file.risk is None else _build(path, "risk", _risk, file.risk),
        ids=tuple(entry.id for entry in entries),
        not_certified=file.not_certified,
        zones=tuple(_build(path, f"zones[{i}]", _zone, entry) for i, entry in enumerate(file.zones or ())),
        sources=(path.absolute(),),
    )


def world_text(world: World, grid: bool = False) -> str:
    """Return the world as the text of a world file; reading it gives an equal world.

    Args:
        world: to be written.
        grid: whether the obstacles of a grid map are written as its cells; as polygons otherwise.

    Raises:
        OutputError: a name that UTF-8 cannot hold.
    """
    from trailmark.formats.grid import cells_of, packed_cells

    cells = None if not grid or world.ids or world.estimates or world.moving else cells_of(world)
    data = world_data(world if cells is None else replace(world, obstacles=()))
    if cells is not None:
        data["grid"] = packed_cells(cells)
    lines = list[str]()
    for key, value in data.items():
        if key in _LISTS:
            lines += [f"{key}:", *(f"  - {_flow(entry)}" for entry in value)]
        else:
            lines.append(f"{key}: {_flow(value)}")
    return HEADER + "\n".join(lines) + "\n"


def world_data(world: World) -> dict[str, Any]:
    """Return the world as a world file's content: mappings, lists, texts and numbers, which JSON holds too."""
    data: dict[str, Any] = {"trailmark": 1, "name": world.name, "bounds": list(map(float, world.bounds))}
    if world.robot is not None:
        data["robot"] = robot_data(world.robot)
    if world.boundary is not None:
        data["boundary"] = world.boundary.vertices.tolist()
    if world.risk is not None:
        data["risk"] = _risk_data(world.risk)
    if world.not_certified is not None:
        data["not_certified"] = world.not_certified
    if world.obstacles:
        columns = (column or repeat(None) for column in (world.ids, world.estimates, world.moving))
        data["obstacles"] = [_obstacle_data(*row) for row in zip(world.obstacles, *columns, strict=False)]
    if world.zones:
        data["zones"] = [_zone_data(zone) for zone in world.zones]
    if world.queries:
        data["queries"] = [
            {"name": query.name, "start": list(query.start), "goal": _goals_data(query)} for query in world.queries
        ]
    return data


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


def obstacles_from_data(entries: list[Any], where: str) -> list[tuple[str | None, Shape | Moving]]:
    """Return the ids and obstacles that entries of a world file's ``obstacles`` describe.

    Raises:
        FormatError: one of them is none, or has an estimate; the message begins with ``where``.
    """
    path = Path(where)
    found = validate(ObstacleList, {"obstacles": entries}, path).obstacles
    for i, entry in enumerate(found):
        if entry.estimate is not None:
            raise FormatError(path, f"obstacles[{i}].estimate: expected none in an edit, got one")
    return [(entry.id, _build(path, f"obstacles[{i}]", _any_obstacle, entry)) for i, entry in enumerate(found)]


def query_from_data(data: dict[str, Any], where: str) -> Query:
    """Return the query that an entry of a world file's ``queries`` describes; its goal may also be a point [x, y].

    Raises:
        FormatError: it describes none; the message begins with ``where``.
    """
    goal = data.get("goal")
    if isinstance(goal, list) and len(goal) == 2 and not isinstance(goal[0], dict):
        data = {**data, "goal": {"pose": goal}}
    return _build(Path(where), "query", _query, validate(QueryEntry, data, Path(where)))  # type: ignore[no-any-return]


def _any_obstacle(entry: schema.DiscObstacle | schema.RectangleObstacle | schema.PolygonObstacle) -> Shape | Moving:
    shape = _obstacle(entry)
    if entry.motion is None:
        return shape
    vx, vy = entry.motion.velocity
    return Moving(shape, (vx, vy), entry.motion.until)


def _estimate(entry: schema.EstimateEntry) -> ObstacleEstimate:
    return ObstacleEstimate(_obstacle(entry.mean), entry.covariance, entry.share, entry.frame)  # type: ignore[arg-type]  # it makes arrays


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


def _shape_data(shape: Shape, placed: bool) -> dict[str, Any]:
    if isinstance(shape, Polygon):
        return {"shape": "polygon", **_rings(shape)}
    center = {"center": list(shape.center)} if placed else {}
    if isinstance(shape, Disc):
        return {"shape": "disc", **center, "radius": shape.radius}
    heading = {"heading": shape.heading} if shape.heading else {}
    return {"shape": "rectangle", **center, "length": shape.length, "width": shape.width, **heading}


def robot_data(robot: Robot) -> dict[str, Any]:
    """Return the robot as a world file's ``robot``."""
    data = _shape_data(robot.footprint, placed=False)
    if robot.drive == "differential":
        data |= {"drive": "differential"} | ({"reverse": True} if robot.reverse else {})
    elif robot.turning_radius is not None:
        data |= {"turning_radius": robot.turning_radius} | ({} if robot.reverse else {"reverse": False})
    return data


def _obstacle_data(
    shape: Shape, name: str | None, estimate: ObstacleEstimate | None, moving: Moving | None
) -> dict[str, Any]:
    data = _shape_data(shape if moving is None else moving.shape, placed=True)
    if name is not None:
        data["id"] = name
    if estimate is not None:
        mean = _shape_data(estimate.mean, placed=True)
        said = {"share": estimate.share, "frame": estimate.frame}
        said = {name: value for name, value in said.items() if value is not None}
        data["estimate"] = {"mean": mean, "covariance": estimate.covariance.tolist(), **said}
    if moving is not None:
        data["motion"] = {"velocity": list(moving.velocity), "until": moving.until}
    return data


def _zone_data(zone: Zone) -> dict[str, Any]:
    fields = dict[str, Any]()
    if isinstance(zone, CostZone):
        fields = {"factor": zone.factor}
    elif isinstance(zone, OneWayZone):
        fields = {"heading": zone.heading, "tolerance": zone.tolerance}
    elif isinstance(zone, SpeedZone):
        fields = {"limit": zone.limit}
    return {"kind": zone.kind, **fields, **_rings(zone.region)}


def _rings(polygon: Polygon) -> dict[str, Any]:
    holes = {"holes": [hole.tolist() for hole in polygon.holes]} if polygon.holes else {}
    return {"vertices": polygon.vertices.tolist(), **holes}


def _risk_data(risk: RiskBound) -> dict[str, Any]:
    data: dict[str, Any] = {"confidence": risk.confidence}
    if risk.pose_covariance is not None:
        data["pose_covariance"] = risk.pose_covariance.tolist()
    return data | ({"reach": risk.reach} if risk.reach else {})


def _goals_data(query: Query) -> Any:
    goals = query.goals
    if len(goals) == 1 and query.goal != goals:
        return list(query.pose())
    data = [goal.to_dict() for goal in goals]
    return data[0] if len(data) == 1 else data


def _flow(value: Any) -> str:
    """Return plain data in YAML's flow style."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key}: {_flow(part)}' for key, part in value.items())}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_flow, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return _text(value)
    return str(value) if isinstance(value, int) else _number(value)


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


_ALLOWED = "expected a robot {shape: ...}, a world with one, or parameters with footprint or robot_radius"


def read_robot(path: Path) -> Robot:
    """Return the robot that a YAML file describes.

    - ``shape: rectangle`` and so on, as under ``robot`` in a world file; or a mapping with the key ``robot``, such as a
      world file.
    - Parameters of nav2 or of ROS 1's move_base: a ``footprint`` (a text or a list) that is not empty, else
      ``robot_radius``, at any depth. Where costmaps differ, the global one's counts, in which nav2 plans.
      ``footprint_padding`` is left out: it is a margin, not the robot.

    Raises:
        FormatError: the file is missing, is not YAML, holds no robot, or several different ones.
    """
    data = parse_yaml(read_text(path, _ALLOWED), path)
    entry = data.get("robot", data) if isinstance(data, dict) else None
    try:
        if isinstance(entry, dict) and "shape" in entry:
            return robot_from_entry(validate(RobotFile, {"robot": entry}, path).robot)
        found = dict(_parameters(data, ""))
    except ShapeError as error:
        raise FormatError(path, f"robot: {error}") from None
    # Nodes' names may have a namespace before them: /robot1/global_costmap.
    chosen = {where: robot for where, robot in found.items() if "global_costmap" in where} or found
    if not chosen:
        raise FormatError(path, f"no robot: {_ALLOWED}")
    (where, robot), *others = chosen.items()
    for other, another in others:
        if another != robot:
            raise FormatError(path, f"expected one robot, got different ones at {where} and {other}")
    return robot


def _parameters(data: Any, where: str) -> Iterator[tuple[str, Robot]]:
    """Yield the robots that mappings hold, each with its place in the file."""
    if not isinstance(data, dict):
        return
    footprint, radius = data.get("footprint"), data.get("robot_radius")
    if isinstance(footprint, str | list) and footprint not in ("", "[]", []):
        yield where or "footprint", _of_footprint(footprint, f"{where}footprint")
    elif radius is not None:
        if not real(radius) > 0.0:
            raise ShapeError(f"{where}robot_radius: expected a number above 0 (metres), got {brief(radius)}")
        yield where or "robot_radius", Robot.disc(real(radius))
    for key, value in data.items():
        yield from _parameters(value, f"{where}{key}.")


def _of_footprint(footprint: str | list[Any], where: str) -> Robot:
    try:
        return Robot.parse(footprint) if isinstance(footprint, str) else Robot.polygon(footprint)
    except ShapeError as error:
        raise ShapeError(f"{where}: {error}") from None
