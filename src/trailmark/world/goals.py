"""Goal: configurations at which a path may end, and what ending there costs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark import se2
from trailmark.arguments import brief, number, number_array, one_of, warn_of_degrees
from trailmark.errors import ConfigurationError, ShapeError, WorldError
from trailmark.se2 import FloatArray
from trailmark.shapes import Polygon, triangulate

__all__ = ["Ends", "Goal", "Query", "ReachedGoal", "goals_of"]

INWARDS = (0.0, 1e-14, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1.0)
"""Shares by which a point on the rim of a region is moved towards its middle, until it lies inside despite rounding."""

NEARLY = 1e-9
"""Metres by which a position may lie beside a square and still count as in it, despite rounding."""

FLAT = 1e-12
"""Share of the largest triangle's area below which one counts as flat."""


@dataclass(frozen=True)
class Goal:
    """Where a path may end: at a pose, near one, or with the reference point in a region.

    Give either ``pose`` or ``region``. A heading that is not given is free: the path may end at any.

    Attributes:
        pose: x, y, theta, or x and y alone; metres, radians.
        position_tolerance: metres by which the reference point may lie beside the pose.
        heading_tolerance: radians by which the heading may differ from the one given; pi or more leaves it free.
        region: polygon that the reference point ends in, its outline included: a Polygon or its vertices, shape (n, 2).
        heading: in the region, radians; by default any.
        cost: added to the cost of a path that ends here, metres, 0 or more.

    Raises:
        ConfigurationError: both or neither of ``pose`` and ``region``, a region without area, a negative cost or
            tolerance, values that are not finite, or an option that does not belong to what is given.
    """

    pose: tuple[float, ...] | None = None
    position_tolerance: float = 0.0
    heading_tolerance: float = 0.0
    region: Any = None
    heading: float | None = None
    cost: float = 0.0

    def __post_init__(self) -> None:
        if (self.pose is None) == (self.region is None):
            given = "neither" if self.pose is None else "both"
            raise ConfigurationError(f"goal: expected a pose or a region, got {given}")
        for name, unit in (("position_tolerance", "m"), ("heading_tolerance", "rad")):
            self.__dict__[name] = number(getattr(self, name), f"goal: {name}:", minimum=0.0, unit=unit)
        self.__dict__["cost"] = cost = number(self.cost, "goal: cost:")
        if cost < 0.0:
            hint = "(only differences count: add as much to each goal)"
            raise ConfigurationError(f"goal: cost: expected 0 or more, got {cost:g} {hint}")
        warn_of_degrees(self.heading_tolerance, "goal: heading_tolerance")
        if self.heading is not None:
            heading = number(self.heading, "goal: heading:")
            warn_of_degrees(heading, "goal: heading")
            self.__dict__["heading"] = float(se2.wrap(heading))
        if self.region is None:
            pose = number_array(self.pose, "goal: pose", "{} is not an array of numbers x, y, theta or x, y")
            if pose.shape not in ((2,), (3,)):
                raise ConfigurationError(f"goal: pose: expected [x, y, theta] or [x, y], got shape {pose.shape}")
            if self.heading is not None:
                raise ConfigurationError("goal: heading: expected the heading of a pose in the pose, got both")
            whole = se2.configurations([*pose, 0.0][:3], name="goal: pose", by_hand=True)
            self.__dict__["pose"] = tuple(whole.tolist()[: len(pose)])
        elif self.position_tolerance > 0.0:
            raise ConfigurationError("goal: position_tolerance: expected a pose, got a region")
        elif not isinstance(self.region, Polygon):
            try:
                self.__dict__["region"] = Polygon(self.region)
            except ShapeError as error:
                raise ConfigurationError(f"goal: region: {error}") from None
        if self.heading_tolerance > 0.0 and self._heading is None:
            raise ConfigurationError(f"goal: heading_tolerance: expected a heading, got {brief(self)}")

    @classmethod
    def bidirectional(cls, pose: ArrayLike, **options: Any) -> tuple[Goal, Goal]:
        """Return two goals: a pose (x, y, theta), and the same place headed the opposite way.

        Raises:
            ConfigurationError: as the goal itself; or the pose has no heading.
        """
        return cls(pose, **options).either_way()  # type: ignore[arg-type]  # arrays, too

    def either_way(self) -> tuple[Goal, Goal]:
        """Return the goal, and the same headed the opposite way.

        Raises:
            ConfigurationError: it has no pose with a heading.
        """
        if self.pose is None or len(self.pose) != 3:
            raise ConfigurationError(f"goal: expected a pose x, y, theta with a heading, got {self}")
        x, y, theta = self.pose
        return self, replace(self, pose=(x, y, float(se2.wrap(theta + math.pi))))

    def __repr__(self) -> str:
        fields = ", ".join(f"{name}={value}" for name, value in self.to_dict().items())
        return f"Goal({fields})"

    def to_dict(self) -> dict[str, Any]:
        """Return what a world file says of the goal, without what is by default."""
        data: dict[str, Any] = {}
        if self.pose is not None:
            data["pose"] = list(self.pose)
        if self.region is not None:
            data["region"] = self.region.vertices.tolist()
        if self.heading is not None:
            data["heading"] = self.heading
        for name in ("position_tolerance", "heading_tolerance", "cost"):
            if getattr(self, name):
                data[name] = getattr(self, name)
        return data

    @property
    def configuration(self) -> tuple[float, float, float] | None:
        """The one configuration that it consists of, x, y, theta; None if there are more."""
        if self.pose is None or len(self.pose) == 2 or self.position_tolerance or self.heading_tolerance:
            return None
        x, y, theta = self.pose
        return x, y, theta

    @property
    def headings(self) -> tuple[float, float] | None:
        """The heading, and by how much another may differ from it, radians; None if it is free."""
        heading = self._heading
        return None if heading is None or self.heading_tolerance >= math.pi else (heading, self.heading_tolerance)

    @property
    def _heading(self) -> float | None:
        return self.heading if self.pose is None else self.pose[2] if len(self.pose) == 3 else None

    @cached_property
    def disc(self) -> tuple[FloatArray, float]:
        """A disc that holds all its positions: centre, shape (2,), and radius, metres."""
        if self.pose is not None:
            return np.array(self.pose[:2]), self.position_tolerance
        low, high = self._triangles.min(axis=(0, 1)), self._triangles.max(axis=(0, 1))
        center = 0.5 * (low + high)
        return center, float(np.hypot(*(self._triangles - center).reshape(-1, 2).T).max() * (1.0 + 1e-12))

    @cached_property
    def _triangles(self) -> FloatArray:
        """What the region consists of, shape (m, 3, 2); for a pose none."""
        if self.region is None:
            return np.empty((0, 3, 2))
        triangles = triangulate(self.region)
        # Flat ones, where vertices lie on a line, have no middle to move to.
        u, v = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
        area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
        return np.asarray(triangles[area > FLAT * area.max()])

    def contains(self, q: ArrayLike) -> NDArray[np.bool_]:
        """Return whether paths may end at configurations, shape (..., 3); exact, boundaries included."""
        states = np.asarray(q, dtype=np.float64)
        x, y = states[..., 0], states[..., 1]
        if self.region is not None:
            import shapely

            inside = shapely.intersects_xy(self.region.shapely(), x, y)
        else:
            inside = np.hypot(x - self.disc[0][0], y - self.disc[0][1]) <= self.position_tolerance
        headings = self.headings
        if headings is not None and inside.any():
            inside = inside & (np.abs(se2.wrap(states[..., 2] - headings[0])) <= headings[1])
        return np.asarray(inside)

    def near_boxes(self, middle: FloatArray, half: float) -> NDArray[np.bool_]:
        """Return which squares hold positions of the goal, shape (n,): all that do, and those that nearly do.

        ``middle`` is that of each, shape (n, 2), and ``half`` half of an edge, metres.
        """
        if self.region is None:
            off = np.maximum(np.abs(middle - self.disc[0]) - half, 0.0)
            return np.asarray(np.hypot(*off.T) <= self.position_tolerance + NEARLY)
        import shapely

        boxes = shapely.box(*(middle - half - NEARLY).T, *(middle + half + NEARLY).T)
        return np.asarray(shapely.intersects(self.region.shapely(), boxes))

    def nearest(self, q: ArrayLike) -> FloatArray:
        """Return the goal's configurations of the nearest position and the nearest heading to others, shape (n, 3)."""
        states = np.array(q, dtype=np.float64).reshape(-1, 3)
        xy = self._nearest_positions(states[:, :2])
        return np.column_stack([xy, self._nearest_headings(states[:, 2])])

    def draw(self, rng: np.random.Generator, count: int) -> FloatArray:
        """Return configurations of the goal, spread evenly over positions and headings, shape (count, 3)."""
        if self.pose is not None:
            radius, angle = self.position_tolerance * np.sqrt(rng.random(count)), 2.0 * math.pi * rng.random(count)
            xy = self.disc[0] + np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
        else:
            a, b, c = (self._triangles[:, i] for i in range(3))
            area = np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
            k = rng.choice(len(a), count, p=area / area.sum())
            u, v = rng.random((2, count, 1))
            u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
            xy = a[k] + u * (b - a)[k] + v * (c - a)[k]
        heading, tolerance = self.headings or (0.0, math.pi)
        theta = np.asarray(se2.wrap(heading + tolerance * rng.uniform(-1.0, 1.0, count)))
        return self.nearest(np.column_stack([xy, theta]))

    def _nearest_positions(self, xy: FloatArray) -> FloatArray:
        """Return the nearest points of the goal's positions to points (n, 2), inside it despite rounding."""
        found = xy.copy()
        if self.region is None:
            center, radius = self.disc
            away = np.hypot(*(xy - center).T)
            far = away > radius
            rim = center + (xy - center)[far] * (radius / away[far])[:, None]
            found[far] = _inwards(rim, np.broadcast_to(center, rim.shape), lambda p: np.hypot(*(p - center).T) > radius)
            return found
        import shapely

        region = self.region.shapely()
        far = ~shapely.intersects_xy(region, *xy.T)
        rim = shapely.get_coordinates(shapely.shortest_line(region, shapely.points(xy[far])))[::2]
        apart = shapely.distance(shapely.polygons(self._triangles), shapely.points(rim)[:, None])
        middle = self._triangles.mean(axis=1)[apart.argmin(axis=1)]
        found[far] = _inwards(rim, middle, lambda p: ~shapely.intersects_xy(region, *p.T))
        return found

    def _nearest_headings(self, theta: FloatArray) -> FloatArray:
        """Return the nearest allowed headings to others (n,), in (-pi, pi]."""
        found = np.asarray(se2.wrap(theta))
        if self.headings is not None:
            heading, tolerance = self.headings
            turn = np.asarray(se2.wrap(theta - heading))
            far = np.abs(turn) > tolerance
            rim = heading + np.copysign(tolerance, turn[far])
            beyond = _inwards(
                rim, np.full_like(rim, heading), lambda t: np.abs(se2.wrap(se2.wrap(t) - heading)) > tolerance
            )
            found[far] = se2.wrap(beyond)
        return found


def _inwards(rim: FloatArray, middle: FloatArray, outside: Callable[[FloatArray], NDArray[np.bool_]]) -> FloatArray:
    """Return points of a rim, moved towards a middle inside by as little as rounding asks for, shape (n, ...)."""
    found, remaining = rim.copy(), np.arange(len(rim))
    for share in INWARDS:
        found[remaining] = rim[remaining] + share * (middle[remaining] - rim[remaining])
        remaining = remaining[outside(found[remaining])]
    return found


@dataclass(frozen=True)
class ReachedGoal:
    """Which of its goals a path ends at.

    Attributes:
        index: of the goal, from 0 on.
        pose: the path's last state, x, y, theta.
        cost: of the goal, metres, which the result's cost includes.
    """

    index: int
    pose: tuple[float, float, float]
    cost: float = 0.0

    def to_dict(self) -> dict[str, Any]:
        """Return what ``plan --json`` says of it."""
        return {"index": self.index, "pose": list(self.pose)}


Ends = ArrayLike | Goal | Sequence[Goal]
"""Where a path may end: a configuration, a goal, or several of which one is to be reached."""


def goals_of(value: Any) -> tuple[Goal, ...] | None:
    """Return a goal or several as a tuple; None if the value is neither, but perhaps a configuration.

    Raises:
        ConfigurationError: goals among other things.
    """
    if isinstance(value, Goal):
        return (value,)
    if isinstance(value, np.ndarray) or not isinstance(value, Iterable):
        return None
    found = tuple(value)
    if not any(isinstance(item, Goal) for item in found):
        return None
    for i, item in enumerate(found):
        one_of(item, Goal, f"goal[{i}]:")
    return found


@dataclass(frozen=True)
class Query:
    """One planning problem.

    Attributes:
        name: what reports call it.
        start: configuration x, y, theta; metres, radians.
        goal: configuration, or goals of which one is to be reached; one Goal that is but a configuration becomes that.
    """

    name: str
    start: tuple[float, float, float]
    goal: Any  # tuple[float, float, float] | tuple[Goal, ...]; who wrote the world's queries knows which

    def __post_init__(self) -> None:
        one_of(self.name, str, "query: name:", error=WorldError)
        object.__setattr__(self, "start", self._configuration("start"))
        goals = goals_of(self.goal)
        if goals is not None and len(goals) == 1 and goals[0].configuration is not None and not goals[0].cost:
            object.__setattr__(self, "goal", goals[0].configuration)
            goals = None
        object.__setattr__(self, "goal", self._configuration("goal") if goals is None else goals)

    def _configuration(self, end: str) -> tuple[float, ...]:
        q = se2.configurations(getattr(self, end), name=f"query {self.name!r}: {end}", by_hand=True)
        if q.ndim != 1:
            raise WorldError(f"query {self.name!r}: {end}: expected shape (3,), got {q.shape}")
        return tuple(float(v) for v in q)

    @property
    def goals(self) -> tuple[Goal, ...]:
        """The goals of which one is to be reached."""
        return goals_of(self.goal) or (Goal(self.pose()),)

    def to_dict(self) -> dict[str, Any]:
        """Return what a world file says of it, in plain numbers, texts and lists."""
        goal = [part.to_dict() if isinstance(part, Goal) else part for part in self.goal]
        return {"name": self.name, "start": list(self.start), "goal": goal}

    def pose(self) -> tuple[float, float, float]:
        """Return the goal for who can plan to a configuration only.

        Raises:
            WorldError: the goal is a region, has a tolerance, or is one of several.
        """
        if isinstance(self.goal[0], Goal):
            raise WorldError(f"query {self.name!r}: expected a goal that is one configuration, got {brief(self.goal)}")
        x, y, theta = self.goal
        return x, y, theta
