"""World: what there is to plan in.

A world made from noisy readings also says how well each obstacle is known (:class:`ObstacleEstimate`) and for which
risk it was grown (:class:`RiskBound`); :mod:`trailmark.estimation.risk` makes such worlds.
"""

from __future__ import annotations

import math
import warnings
import weakref
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path as FilePath
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from trailmark.arguments import brief, each_of, number, one_of, real
from trailmark.errors import ConfigurationError, FormatError, InputWarning, ShapeError, WorldError, expected_name
from trailmark.formats.grid import grid_fields
from trailmark.shapes import Polygon, Shape, shape_of, shapes_of
from trailmark.shown import Shown
from trailmark.world.changes import Changes, Obstacle, Obstacles, apply, changes_of_edits, difference
from trailmark.world.estimates import ObstacleEstimate, RiskBound
from trailmark.world.goals import Query
from trailmark.world.library import find_world
from trailmark.world.moving import Moving
from trailmark.world.robot import Robot
from trailmark.world.world_file import read_world, save_world
from trailmark.world.zones import CostZone, KeepOutZone, OneWayZone, SpeedZone, Zone

__all__ = [
    "BOUNDS_LIMIT",
    "KEEP_OUT",
    "World",
    "keep_outs",
    "with_keep_outs",
]

BOUNDS_LIMIT = 1e7
"""Metres: farther from the origin, rounding would eat up the touching tolerance of 1e-7 m."""

KEEP_OUT = "keep-out zone"
"""With its index among the world's zones, the name of the obstacle that a keep-out zone is."""

_AROUND_OBSTACLES = ("bounds", "boundary", "zones")


@dataclass(frozen=True)
class World(Shown):
    """A planar world: free space lies inside ``bounds`` and ``boundary`` and outside all obstacles.

    Attributes:
        name: its name in reports.
        bounds: xmin, ymin, xmax, ymax in metres; no part of the robot may leave it.
        obstacles: discs, rectangles and polygons, which may overlap; geometries of shapely become polygons. A grid
            map's are a sequence that makes its polygons on first access. A :class:`Moving` obstacle becomes the region
            that it sweeps.
        robot: the robot to plan for, if the file names one.
        boundary: optional simple polygon, also not left by any part of the robot.
        queries: named planning problems.
        estimates: one for each obstacle, None for an obstacle that is known exactly; empty if all are.
        risk: the confidence for which obstacles with estimates are grown; None if they are not grown.
        ids: one for each obstacle, a unique text or None; empty if no obstacle has one. Messages name an obstacle
            without one by its index.
        moving: one for each obstacle, None for a static one; empty if all are static.
        zones: cost, keep-out, one-way and speed zones (:mod:`trailmark.world.zones`).
        not_certified: why the estimates are unreliable (:func:`trailmark.estimation.map_log`); None if they are not.
        unknown: unknown regions of a map, for pictures; for planning they are obstacles or zones. Worlds compare
            without them, and world files do not keep them.
        notes: sentences about oddities in the files that the world was read from; the shell prints them.
        sources: absolute paths of these files, which no output may overwrite. Worlds compare without them.

    Raises:
        WorldError: empty or infinite bounds, two queries or obstacles of the same name, a boundary with holes, another
            number of estimates, ids or moving obstacles than of obstacles, one that moves and has an estimate, shares
            of the risk that add up to more than 1.
    """

    name: str
    bounds: tuple[float, float, float, float]
    obstacles: tuple[Shape, ...] = ()
    robot: Robot | None = None
    boundary: Polygon | None = None
    queries: tuple[Query, ...] = field(default=())
    estimates: tuple[ObstacleEstimate | None, ...] = field(default=())
    risk: RiskBound | None = None
    ids: tuple[str | None, ...] = field(default=())
    moving: tuple[Moving | None, ...] = field(default=())
    zones: tuple[Zone, ...] = field(default=())
    not_certified: str | None = None
    unknown: tuple[Polygon, ...] = field(default=(), repr=False, compare=False)
    notes: tuple[str, ...] = field(default=(), repr=False, compare=False)
    sources: tuple[FilePath, ...] = field(default=(), repr=False, compare=False)
    _origin: tuple[weakref.ref[World], Changes] | None = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        optional = {"robot": Robot, "boundary": Polygon, "risk": RiskBound, "not_certified": str}
        kinds: dict[str, Any] = {"queries": Query, "zones": (CostZone, KeepOutZone, OneWayZone, SpeedZone)}
        one_of(self.name, str, "world: name:", error=WorldError)
        try:
            bounds = tuple(map(real, self.bounds))
        except TypeError:
            bounds = ()
        if len(bounds) != 4 or not all(abs(v) <= BOUNDS_LIMIT for v in bounds):
            allowed = f"four numbers xmin, ymin, xmax, ymax of at most {BOUNDS_LIMIT:g} m"
            raise WorldError(f"bounds: expected {allowed}, got {brief(self.bounds)}")
        if not (bounds[0] < bounds[2] and bounds[1] < bounds[3]):
            raise WorldError(f"bounds: expected xmin < xmax and ymin < ymax, got {list(bounds)}")
        obstacles, ids, estimates, moving = Obstacles.checked(self.obstacles, self.ids, self.estimates, self.moving)
        self.__dict__.update(bounds=bounds, obstacles=obstacles, ids=ids, estimates=estimates, moving=moving)
        self.__dict__["boundary"] = shape_of(self.boundary, "boundary")
        for name, kind in kinds.items():
            self.__dict__[name] = each_of(getattr(self, name), kind, name, error=WorldError)
        for name, kind in optional.items():
            hint = " (Robot.parse)" if name == "robot" else ""
            one_of(getattr(self, name), (kind, type(None)), f"world: {name}:", hint=hint, error=WorldError)
        if self.boundary is not None and self.boundary.holes:
            raise WorldError("boundary: expected a polygon without holes, got one with holes (make them obstacles)")
        names = [query.name for query in self.queries]
        twice = sorted({name for name in names if names.count(name) > 1}) if len(set(names)) < len(names) else []
        if twice:
            raise WorldError(f"queries: expected each name once, got {twice[0]!r} more than once")
        self._check_shares()

    def __getstate__(self) -> dict[str, Any]:
        # The world that it was made from may go at any time, and is nothing to another process.
        return {**self.__dict__, "_origin": None}

    def __repr__(self) -> str:
        xmin, ymin, xmax, ymax = self.bounds
        facts = [repr(self.name), f"{xmax - xmin:g} x {ymax - ymin:g} m", f"{len(self.obstacles):,} obstacles"]
        facts += ["a boundary"] if self.boundary is not None else []
        facts += [f"{len(self.zones)} zone{'s' if len(self.zones) > 1 else ''}"] if self.zones else []
        facts.append("no robot" if self.robot is None else f"robot {self.robot.describe()}")
        names = [query.name for query in self.queries[:5]] + (["…"] if len(self.queries) > 5 else [])
        return f"World({', '.join(facts)}, queries: {', '.join(names) or 'none'})"

    @classmethod
    def load(cls, path: str | FilePath, unknown: Literal["blocked", "free"] | float | None = None) -> World:
        """Read a world from a file, whose format is recognised by its content.

        Args:
            path: trailmark YAML, ROS/nav2 map YAML, MovingAI ``.map``, OMPL.app ``.cfg``, or an image of ARiADNE's kind
                (:mod:`trailmark.formats.png_grid`); or the name of a world that trailmark ships, such as ``office``,
                where there is no such file.
            unknown: what the unknown cells of a nav2 map are: ``blocked``, ``free``, or a factor (0.1 or more) by which
                a metre in them costs more. By default they are blocked and not told apart from occupied ones.

        Raises:
            FormatError: there is neither, or the file is of no known format or does not hold what its format asks for.
            WorldError: ``unknown`` is none of these, or the file is no nav2 map.
        """
        file = find_world(path)
        if unknown is None:
            return cls._made(file, lambda: read_world(file))
        if isinstance(unknown, str) and unknown not in ("blocked", "free"):
            raise WorldError(f"unknown: expected blocked, free or a factor, got {brief(unknown)}")
        factor = 1.0 if isinstance(unknown, str) else number(unknown, "unknown:", minimum=0.1, error=WorldError)
        world = cls._made(file, lambda: read_world(file, unknown == "blocked"))
        return world if factor == 1.0 else world.with_zones(*(CostZone(region, factor) for region in world.unknown))

    @classmethod
    def _made(cls, path: FilePath, read: Callable[[], dict[str, Any]]) -> World:
        """Return the world of the arguments that a file's reader gives; what is wrong with them is the file's error."""
        try:
            return cls(**read())
        except (ShapeError, WorldError, ConfigurationError) as error:
            raise FormatError(path, str(error)) from None

    @classmethod
    def from_grid(
        cls, cells: ArrayLike, resolution: float, origin: Sequence[float] = (0.0, 0.0), name: str = "grid"
    ) -> World:
        """Return the world of an occupancy grid: its cells that are not free, exactly, as polygons.

        Args:
            cells: truth values or whole numbers, shape (rows, columns), row 0 with the smallest y, as in
                ``nav_msgs/OccupancyGrid``. 0 is free; all else is not: 100 (occupied), -1 (unknown), and in between,
                and cells that a masked array masks.
            resolution: side of a cell, metres.
            origin: x, y of cell (0, 0)'s outer corner and, if given, the yaw by which the grid is turned about it.
            name: its name in reports.

        Raises:
            WorldError: an array of another shape or kind, a resolution that is not above 0, or too many cells.
        """
        return cls(**grid_fields(cells, resolution, origin, name))

    @classmethod
    def from_image(
        cls, path: str | FilePath, resolution: float, origin: Sequence[float] = (0.0, 0.0), **thresholds: Any
    ) -> World:
        """Return the world of a map's image, whose pixels are obstacles unless nav2 would take them for free.

        Args:
            path: PGM, PNG, BMP or JPEG; its stem names the world.
            resolution: side of a pixel, metres.
            origin: x, y of the lower left pixel's outer corner and, if given, the yaw.
            thresholds: ``negate``, ``occupied_thresh``, ``free_thresh`` and ``mode``, as in a nav2 map file.

        Raises:
            FormatError: the image cannot be read, or a value is not allowed.
        """
        from trailmark.formats.nav2_map import read_image

        file, given = FilePath(path), {"resolution": resolution, "origin": origin, **thresholds}
        return cls._made(file, lambda: read_image(file, given))

    @classmethod
    def from_geometries(
        cls,
        geometries: Any,
        bounds: Sequence[float] | None = None,
        name: str = "world",
        zones: Sequence[Zone] = (),
    ) -> World:
        """Return the world whose obstacles are geometries of shapely: polygons, multi-polygons, collections of them.

        Args:
            geometries: one or more.
            bounds: xmin, ymin, xmax, ymax in metres; by default the box around the obstacles.
            name: its name in reports.
            zones: of the world; their regions may be geometries, too.

        Raises:
            ShapeError: a geometry without area, such as a line, or an invalid polygon.
            WorldError: neither bounds nor an obstacle.
        """
        given = (geometries,) if type(geometries).__module__.startswith("shapely") else geometries
        shapes = cls(name, (0.0, 0.0, 1.0, 1.0), given).obstacles
        if bounds is None:
            if not shapes:
                raise WorldError("from_geometries: expected bounds or a geometry that is not empty, got neither")
            boxes = np.array([shape.bounding_box() for shape in shapes])
            bounds = (*boxes[:, :2].min(axis=0), *boxes[:, 2:].max(axis=0))
        return cls(name, bounds, shapes, zones=zones)  # type: ignore[arg-type]  # checked there

    from_shapely = from_geometries  # its name before

    def with_zones(self, *zones: Zone | str | FilePath) -> World:
        """Return the world with more zones.

        Args:
            zones: zones, or files: polygons as GeoJSON or WKT, which become keep-out zones, or a nav2 keep-out mask.

        Raises:
            WorldError: what is neither.
            FormatError: a file cannot be read, or holds no polygon.
        """
        world = self
        for zone in zones:
            if not isinstance(zone, str | FilePath):
                world = replace(world, zones=(*world.zones, zone))
            elif FilePath(zone).suffix.lower() in (".yaml", ".yml"):
                world = world.with_mask(zone)
            else:
                from trailmark.formats.geometries import read_polygons

                file = FilePath(zone)
                regions = tuple(KeepOutZone(region) for region in read_polygons(file))
                world = replace(world, zones=(*world.zones, *regions), sources=(*world.sources, file.absolute()))
        return world

    def with_mask(self, path: str | FilePath, kind: Literal["keep-out", "speed"] = "keep-out", **scale: float) -> World:
        """Return the world with the zones of a nav2 filter mask, a map file beside the map that the world is.

        Args:
            path: the mask's YAML file.
            kind: ``keep-out`` (cells that are occupied are keep-out zones) or ``speed`` (cells are speed zones).
            scale: of a keep-out mask: ``threshold`` (100), the least value of a cell, 1 to 100, that is kept out of,
                and ``max_factor`` (1), by which a metre costs more just below 100; of a speed mask: ``max_speed``
                (1.0 m/s), of which a cell of value v, 1 to 100, allows ``base`` (100) + ``multiplier`` (-1) · v
                percent; 0 is no limit. These are the parameters of nav2's speed filter.

        Raises:
            WorldError: another kind, or a number out of range.
            FormatError: the mask cannot be read.
        """
        from trailmark.formats.nav2_map import read_mask

        found, sources = read_mask(FilePath(path), kind, **scale)
        make: Callable[[Polygon, float], Zone] = SpeedZone if kind == "speed" else CostZone
        zones = (make(region, v) if np.isfinite(v) else KeepOutZone(region) for region, v in found)
        boxes = np.array([region.bounding_box() for region, _ in found]).reshape(-1, 4)
        low, high = np.array(self.bounds).reshape(2, 2)
        if kind == "keep-out" and not ((boxes[:, 2:] > low) & (boxes[:, :2] < high)).all(axis=1).any():
            warnings.warn(f"{path}: the keep-out mask covers nothing of the map", InputWarning, stacklevel=2)
        return replace(self, zones=(*self.zones, *zones), sources=(*self.sources, *sources))

    def save(self, path: str | FilePath) -> None:
        """Write the world as trailmark YAML (schema version 1), whole or not at all.

        Raises:
            OutputError: the path cannot be written, or is the map, image or scenario that the world was read from (a
                trailmark world file may be written again).
        """
        save_world(self, FilePath(path))

    def query(self, name: str | None = None) -> Query:
        """Return the query of that name, or the first one.

        Raises:
            WorldError: there is none.
        """
        one_of(name, (str, type(None)), "query:", error=WorldError)
        if not self.queries:
            given = "" if name is None else f" {name[:60]!r}"
            raise WorldError(f"world {self.name!r} holds no query{given}, give a start and a goal")
        if name is None:
            return self.queries[0]
        for query in self.queries:
            if query.name == name:
                return query
        names = (query.name for query in self.queries[:50])
        raise WorldError(f"world {self.name!r}: query: {expected_name(name, names)}")

    def with_robot(self, robot: Robot) -> World:
        """Return the same world with another robot."""
        return replace(self, robot=robot)

    def add(self, *obstacles: Any) -> World:
        """Return the world with more obstacles: shapes, or geometries of shapely (:meth:`edited` says the rest)."""
        given = enumerate(obstacles)
        return self.edited(add=[part for i, item in given for part in shapes_of(item, f"add: obstacles[{i}]")])

    def edited(
        self,
        add: Iterable[Obstacle] | Mapping[str, Obstacle] = (),
        remove: Iterable[str | int] = (),
        move: Mapping[Any, ArrayLike] | None = None,
        replace: Mapping[Any, Obstacle] | None = None,
    ) -> World:
        """Return the world with other obstacles; this one stays as it is.

        Obstacles are named by their id or by their index in this world. Those that are moved or replaced keep their
        place among the others, those added come last.

        Args:
            add: new obstacles (shapes, :class:`Moving`, :class:`ObstacleEstimate`), or a mapping of ids to them.
            remove: ids or indices.
            move: for each id or index (dx, dy) or (dx, dy, dtheta): metres and radians, a turn being one about the
                obstacle's own centre (:func:`trailmark.shapes.displaced`). An estimate's mean is moved too.
            replace: for each id or index the new obstacle.

        Raises:
            WorldError: an unknown or duplicate identity, an obstacle named twice, or what is no obstacle; an estimate
                or a turned estimated obstacle in a world whose obstacles are grown for a risk.
        """
        edits = add, remove, move or {}, replace or {}
        return self.apply(changes_of_edits(self._described(), *edits, grown=self.risk is not None))

    def difference(self, other: World) -> Changes:
        """Return what turns this world's obstacles into the other's, whatever else the two say.

        Obstacles with an id are matched by it, those without by equal content. Where the other world was made from
        this one (:meth:`edited`, :meth:`apply`), that is known already.

        Raises:
            WorldError: bounds, boundary or zones differ.
        """
        one_of(other, World, "difference:", error=WorldError)
        if other is self:
            return Changes()
        if other._origin is not None and other._origin[0]() is self:
            return other._origin[1]
        for name in _AROUND_OBSTACLES:
            mine, theirs = getattr(self, name), getattr(other, name)
            if mine is not theirs and mine != theirs:
                raise WorldError(f"difference: {name}: expected the same in both worlds, got {mine} and {theirs}")
        return difference(self._described(), other._described())

    def differs_in_obstacles_only(self, other: World) -> bool:
        """Return whether bounds, boundary and zones are the other world's, so that :meth:`difference` says the rest."""
        return all(getattr(self, name) == getattr(other, name) for name in _AROUND_OBSTACLES)

    def apply(self, changes: Changes) -> World:
        """Return the world after changes of its obstacles; this one stays as it is.

        What is changed or added stands at its index; the others stand around it, in their order.

        Raises:
            WorldError: changes of another world, or an id that would be there twice.
        """
        one_of(changes, Changes, "apply:", error=WorldError)
        obstacles, ids, estimates, moving = apply(self._described(), changes)
        # Not by __init__: with thousands of obstacles, checking again what did not change takes longer than all else.
        world = object.__new__(World)
        world.__dict__.update(self.__dict__, obstacles=obstacles, ids=ids, estimates=estimates, moving=moving)
        world.__dict__["_origin"] = (weakref.ref(self), changes)
        if any(item.estimate is not None for item in changes.items):
            world._check_shares()
        return world

    @property
    def extent(self) -> float:
        """The diagonal of the bounds, in metres."""
        return math.hypot(self.bounds[2] - self.bounds[0], self.bounds[3] - self.bounds[1])

    def _described(self) -> Obstacles:
        return Obstacles(self.obstacles, self.ids, self.estimates, self.moving)

    def _check_shares(self) -> None:
        # Rounding of many shares may carry their sum a little over 1.
        total = math.fsum(estimate.share or 0.0 for estimate in self.estimates if estimate is not None)
        if total > 1.0 + 1e-9:
            raise WorldError(f"estimates: expected shares that add up to at most 1, got {total:g}")


def keep_outs(world: World) -> dict[str, Polygon]:
    """Return the regions of a world's keep-out zones by their names: ``keep-out zone i``, i the index in ``zones``."""
    return {f"{KEEP_OUT} {i}": zone.region for i, zone in enumerate(world.zones) if isinstance(zone, KeepOutZone)}


def with_keep_outs(world: World) -> World:
    """Return the world in which each keep-out zone is also an obstacle, the zone's name its id.

    That is the world itself if it has no such zones, or if all of them stand there already.

    Raises:
        WorldError: another obstacle has such an id.
    """
    zones = keep_outs(world)
    known = dict(zip(world.ids, world.obstacles, strict=True)) if zones and world.ids else {}
    for name, region in zones.items():
        if known.get(name, region) != region:
            raise WorldError(f"ids: {name!r} is the name of a zone, expected another one for an obstacle")
    missing = {name: region for name, region in zones.items() if name not in known}
    return world.edited(add=missing) if missing else world
