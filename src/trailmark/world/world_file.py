"""What files say of worlds: the world file's content, schema version 1, and which format a file is of.

A file's format is recognised by its content, never by its name. Only the modules that a file needs are imported.
"""

from __future__ import annotations

import re
from itertools import repeat
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trailmark.errors import ConfigurationError, FormatError, ShapeError, WorldError
from trailmark.formats.files import read_bytes, require_not_an_input, text_of, write_atomically
from trailmark.formats.grid import CellObstacles, cells_of, packed_cells, unpacked_cells
from trailmark.formats.robot_yaml import robot_fields
from trailmark.formats.world_yaml import yaml_text
from trailmark.formats.yaml_data import parse_yaml
from trailmark.shapes import Disc, Polygon, Rectangle, Shape
from trailmark.world.estimates import ObstacleEstimate, RiskBound
from trailmark.world.goals import Goal, Query
from trailmark.world.moving import Moving
from trailmark.world.robot import Robot
from trailmark.world.zones import CostZone, KeepOutZone, OneWayZone, SpeedZone, Zone

if TYPE_CHECKING:
    from trailmark.formats import schema

__all__ = [
    "obstacles_from_data",
    "query_from_data",
    "read_world",
    "robot_data",
    "save_world",
    "world_data",
    "world_fields",
    "world_text",
]

FORMATS = (
    "expected trailmark YAML (key 'trailmark'), nav2 map YAML (key 'image'), MovingAI map "
    "(first line 'type octile'), OMPL.app cfg (section [problem]), PNG grid with a start"
)


def read_world(path: Path, unknown: bool | None = None) -> dict[str, Any]:
    """Return what a file says of a world, as arguments of :class:`trailmark.World`.

    Args:
        path: trailmark YAML (schema version 1), nav2 map YAML, MovingAI ``.map`` (its ``.scen`` beside it gives
            the queries), OMPL.app ``.cfg``, or a PNG grid in which a block marks the start of an exploration.
        unknown: whether unknown cells of a nav2 map, told apart from the others, are obstacles.

    Raises:
        WorldError: ``unknown`` is given for another format.
        FormatError: the file is missing, unreadable, too large (see :mod:`trailmark.formats.files` and
            :mod:`trailmark.formats.grid` for the limits), of no known format, or breaks its format's rules.
    """
    fields = _read(read_bytes(path), path, unknown)
    if unknown is not None and "unknown" not in fields:
        raise WorldError(f"unknown: expected a nav2 map, whose cells may be unknown, got {path}")
    if isinstance(fields.get("robot"), dict):
        fields["robot"] = Robot(**fields["robot"])
    fields["queries"] = tuple(q if isinstance(q, Query) else Query(*q) for q in fields.get("queries", ()))
    return fields


def save_world(world: Any, path: Path) -> None:
    """Write a :class:`trailmark.World` as trailmark YAML (schema version 1), whole or not at all.

    Loading the file gives an equal world: every number is written with all its digits.

    Raises:
        OutputError: the path cannot be written, or is a file in another format that the world was read from.
    """
    require_not_an_input(path, (source for source in world.sources if not _is_world_file(source)))
    write_atomically(path, world_text(world))


def _is_world_file(path: Path) -> bool:
    """Return whether a file is a trailmark world file, as far as its keys tell."""
    try:
        with path.open("rb") as file:
            return re.search(rb"^trailmark[ \t]*:[ \t]*1[ \t]*(?:#.*)?\r?$", file.read(2**16), re.MULTILINE) is not None
    except (OSError, ValueError):
        return False


def _read(data: bytes, path: Path, unknown: bool | None) -> dict[str, Any]:
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        from trailmark.formats.png_grid import read_png_grid

        return read_png_grid(path)

    text = text_of(data, path, FORMATS)
    if re.match(r"\s*type[ \t]", text):
        from trailmark.formats.movingai import read_movingai

        return read_movingai(text, path)
    if re.match(r"(?:[ \t]*(?:[#;].*)?\r?\n)*[ \t]*\[[\w. -]+\][ \t]*(?:[#;].*)?\r?(?:\n|$)", text):
        from trailmark.formats.omplapp import read_cfg

        return read_cfg(text, path)

    fields = parse_yaml(text, path)
    if not isinstance(fields, dict):
        raise FormatError(path, f"no world: neither a YAML mapping nor another known format; {FORMATS}")
    if "trailmark" in fields:
        return world_fields(fields, path)
    if "image" in fields:
        from trailmark.formats.nav2_map import read_nav2_map

        return read_nav2_map(fields, path, unknown)
    hint = "add the line 'trailmark: 1'; " if "bounds" in fields else ""
    raise FormatError(path, f"no world: the YAML mapping has neither 'trailmark' nor 'image'; {hint}{FORMATS}")


def world_fields(data: dict[str, Any], path: Path) -> dict[str, Any]:
    """Return what a world file says, as arguments of :class:`trailmark.World`.

    Args:
        data: the file's plain data.
        path: the file, for messages; its stem names the world if the file does not.

    Raises:
        FormatError: a field is missing, unknown, of a wrong type or out of range, or a shape bounds no region; the
            message names the field, its value and what is allowed.
    """
    from trailmark.formats.schema import WorldFile, validate

    version = data["trailmark"]
    if isinstance(version, bool | float) or version != 1:
        raise FormatError(path, f"trailmark: expected 1 (the schema version), got {version!r}")
    file = validate(WorldFile, data, path)
    robot = None if file.robot is None else _build(path, "robot", _robot, file.robot)
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
    return {
        "name": path.stem if file.name is None else file.name,
        "bounds": tuple(file.bounds),
        "obstacles": tuple(obstacles) if grid is None else grid.as_tuple(),
        "robot": robot,
        "boundary": boundary,
        "queries": tuple(queries),
        "estimates": tuple(estimates),
        "risk": None if file.risk is None else _build(path, "risk", _risk, file.risk),
        "ids": tuple(entry.id for entry in entries),
        "not_certified": file.not_certified,
        "zones": tuple(_build(path, f"zones[{i}]", _zone, entry) for i, entry in enumerate(file.zones or ())),
        "sources": (path.absolute(),),
    }


def world_text(world: Any, grid: bool = False) -> str:
    """Return a :class:`trailmark.World` as the text of a world file; reading it gives an equal world.

    Args:
        world: to be written.
        grid: whether the obstacles of a grid map are written as its cells; as polygons otherwise.

    Raises:
        OutputError: a name that UTF-8 cannot hold.
    """
    plain = not grid or world.ids or world.estimates or world.moving
    return yaml_text(world_data(world, None if plain else cells_of(world.obstacles)))


def world_data(world: Any, cells: CellObstacles | None = None) -> dict[str, Any]:
    """Return a :class:`trailmark.World` as a world file's content: mappings, lists, texts and numbers, as in JSON.

    The obstacles are written as ``cells``, where these are given.
    """
    data: dict[str, Any] = {"trailmark": 1, "name": world.name, "bounds": list(map(float, world.bounds))}
    if world.robot is not None:
        data["robot"] = robot_data(world.robot)
    if world.boundary is not None:
        data["boundary"] = world.boundary.vertices.tolist()
    if world.risk is not None:
        data["risk"] = _risk_data(world.risk)
    if world.not_certified is not None:
        data["not_certified"] = world.not_certified
    if cells is None and world.obstacles:
        columns = (column or repeat(None) for column in (world.ids, world.estimates, world.moving))
        data["obstacles"] = [_obstacle_data(*row) for row in zip(world.obstacles, *columns, strict=False)]
    if world.zones:
        data["zones"] = [_zone_data(zone) for zone in world.zones]
    if world.queries:
        data["queries"] = [
            {"name": query.name, "start": list(query.start), "goal": _goals_data(query)} for query in world.queries
        ]
    if cells is not None:
        data["grid"] = packed_cells(cells)
    return data


def _build(path: Path, where: str, make: Any, entry: Any) -> Any:
    try:
        return make(entry)
    except (ShapeError, ConfigurationError, WorldError) as error:
        raise FormatError(path, f"{where}: {error}") from None


def _robot(entry: schema.DiscRobot | schema.RectangleRobot | schema.PolygonRobot) -> Robot:
    return Robot(**robot_fields(entry))


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
    from trailmark.formats.schema import ObstacleList, validate

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
    from trailmark.formats.schema import QueryEntry, validate

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
