"""World and Query: what there is to plan in, and from where to where.

A world made from noisy readings also says how well each obstacle is known (:class:`ObstacleEstimate`) and for which
risk it was grown (:class:`RiskBound`); :mod:`trailmark.estimation.risk.allocation` makes such worlds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from trailmark import se2
from trailmark.arguments import brief, each_of, number_array, one_of, real
from trailmark.errors import WorldError, expected_name
from trailmark.robot import Robot
from trailmark.shapes import Disc, Polygon, Rectangle, Shape

__all__ = ["BOUNDS_LIMIT", "ObstacleEstimate", "Query", "RiskBound", "Robot", "World"]

BOUNDS_LIMIT = 1e7
"""Metres: farther from the origin, rounding would eat up the touching tolerance of 1e-7 m."""


@dataclass(frozen=True)
class Query:
    """One planning problem: start and goal configuration (x, y, theta), metres and radians."""

    name: str
    start: tuple[float, float, float]
    goal: tuple[float, float, float]

    def __post_init__(self) -> None:
        one_of(self.name, str, "query: name:", error=WorldError)
        for end in ("start", "goal"):
            q = se2.configurations(getattr(self, end), name=f"query {self.name!r}: {end}")
            if q.ndim != 1:
                raise WorldError(f"query {self.name!r}: {end}: expected shape (3,), got {q.shape}")
            object.__setattr__(self, end, tuple(float(v) for v in q))


@dataclass(frozen=True, eq=False)
class ObstacleEstimate:
    """An obstacle that is known from noisy readings: its mean shape, and the covariance of the numbers that place it.

    Those numbers are, in this order, a disc's x, y and radius; a rectangle's x, y, heading, length and width; a
    polygon's shift in x and y and its turn about the mean of its outline's vertices. The covariance is that of the
    first k of them; the others count as known exactly.

    Attributes:
        mean: the most likely shape.
        covariance: shape (k, k), 2 <= k <= 5 (rectangle) or 3; metres and radians.
        share: the part of the world's risk that this obstacle may take, above 0 and at most 1; None if not shared
            out.

    Raises:
        WorldError: a covariance of another shape, not finite, not symmetric or with a negative variance; a share
            out of range.
    """

    mean: Shape
    covariance: se2.FloatArray
    share: float | None = None

    def __post_init__(self) -> None:
        one_of(self.mean, (Disc, Rectangle, Polygon), "estimate: mean:", error=WorldError)
        max_size = 5 if isinstance(self.mean, Rectangle) else 3
        kind = type(self.mean).__name__.lower()
        name = f"estimate of a {kind}: covariance"
        object.__setattr__(self, "covariance", _covariance(self.covariance, name, range(2, max_size + 1)))
        if self.share is not None:
            object.__setattr__(self, "share", _between(self.share, "estimate: share", 0.0, 1.0))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ObstacleEstimate):
            return NotImplemented
        alike = self.mean == other.mean and self.share == other.share
        return alike and np.array_equal(self.covariance, other.covariance)

    def __hash__(self) -> int:
        return hash((self.mean, self.share, (self.covariance + 0.0).tobytes()))


@dataclass(frozen=True, eq=False)
class RiskBound:
    """What a world's obstacles are grown for.

    Attributes:
        confidence: least probability, above 0 and below 1, with which a valid path meets none of the true obstacles.
        pose_covariance: shape (3, 3), of the robot's x, y and theta in the world's frame about where it takes itself
            to be; None if that counts as exact.
        reach: metres that a radian of heading moves the robot's outline at most (``Robot.sweep_radius``), >= 0.

    Raises:
        WorldError: a value out of these ranges.
    """

    confidence: float
    pose_covariance: se2.FloatArray | None = None
    reach: float = 0.0

    def __post_init__(self) -> None:
        confidence = _between(self.confidence, "risk: confidence", 0.0, 1.0)
        if confidence == 1.0:
            raise WorldError("risk: confidence: expected a number above 0 and below 1, got 1")
        object.__setattr__(self, "confidence", confidence)
        reach = real(self.reach)
        if not 0.0 <= reach < math.inf:
            raise WorldError(f"risk: reach: expected metres, 0 or more, got {brief(self.reach)}")
        object.__setattr__(self, "reach", reach)
        if self.pose_covariance is not None:
            covariance = _covariance(self.pose_covariance, "risk: pose_covariance", (3,))
            object.__setattr__(self, "pose_covariance", covariance)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, RiskBound):
            return NotImplemented
        mine, theirs = self.pose_covariance, other.pose_covariance
        same = mine is theirs if mine is None or theirs is None else np.array_equal(mine, theirs)
        return same and self.confidence == other.confidence and self.reach == other.reach

    def __hash__(self) -> int:
        return hash((self.confidence, self.reach))

    def covers(self, robot: Robot) -> bool:
        """Return whether obstacles grown for this bound keep it for that robot too: a heading error moves it less."""
        pose = self.pose_covariance
        return pose is None or pose[2, 2] == 0.0 or robot.sweep_radius <= (1.0 + 1e-9) * self.reach


@dataclass(frozen=True)
class World:
    """A planar world: free space lies inside ``bounds`` and ``boundary`` and outside all obstacles.

    Attributes:
        name: what reports call it.
        bounds: xmin, ymin, xmax, ymax in metres; no part of the robot may leave it.
        obstacles: discs, rectangles and polygons; they may overlap.
        robot: the robot to plan for, if the file names one.
        boundary: optional simple polygon, also not left by any part of the robot.
        queries: named planning problems.
        estimates: one for each obstacle, None where the obstacle is known exactly; empty if all are.
        risk: what the obstacles with estimates are grown for; None if they stand as they were measured.
        sources: the files that it was read from, absolute, which nothing that is written may replace. Worlds compare
            without them.

    Raises:
        WorldError: empty or infinite bounds, two queries of the same name, a boundary with holes, another number of
            estimates than of obstacles, shares of the risk that add up to more than 1.
    """

    name: str
    bounds: tuple[float, float, float, float]
    obstacles: tuple[Shape, ...] = ()
    robot: Robot | None = None
    boundary: Polygon | None = None
    queries: tuple[Query, ...] = field(default=())
    estimates: tuple[ObstacleEstimate | None, ...] = field(default=())
    risk: RiskBound | None = None
    sources: tuple[FilePath, ...] = field(default=(), repr=False, compare=False)

    def __post_init__(self) -> None:
        one_of(self.name, str, "world: name:", error=WorldError)
        try:
            bounds = tuple(real(v) for v in self.bounds)
        except TypeError:
            bounds = ()
        if len(bounds) != 4 or not all(abs(v) <= BOUNDS_LIMIT for v in bounds):
            raise WorldError(
                f"bounds: expected four numbers xmin, ymin, xmax, ymax of at most {BOUNDS_LIMIT:g} m, got "
                f"{brief(self.bounds)}"
            )
        if not (bounds[0] < bounds[2] and bounds[1] < bounds[3]):
            raise WorldError(f"bounds: expected xmin < xmax and ymin < ymax, got {list(bounds)}")
        object.__setattr__(self, "bounds", bounds)
        kinds: dict[str, Any] = {"obstacles": (Disc, Rectangle, Polygon), "queries": Query}
        kinds["estimates"] = (ObstacleEstimate, type(None))
        for name, kind in kinds.items():
            object.__setattr__(self, name, each_of(getattr(self, name), kind, name, error=WorldError))
        one_of(self.robot, (Robot, type(None)), "world: robot:", hint=" (Robot.parse)", error=WorldError)
        one_of(self.boundary, (Polygon, type(None)), "world: boundary:", error=WorldError)
        one_of(self.risk, (RiskBound, type(None)), "world: risk:", error=WorldError)
        if self.boundary is not None and self.boundary.holes:
            raise WorldError("boundary: expected a polygon without holes, got one with holes (make them obstacles)")
        names = [query.name for query in self.queries]
        twice = sorted({name for name in names if names.count(name) > 1}) if len(set(names)) < len(names) else []
        if twice:
            raise WorldError(f"queries: expected each name once, got {twice[0]!r} more than once")
        self._check_estimates()

    def __repr__(self) -> str:
        xmin, ymin, xmax, ymax = self.bounds
        facts = [repr(self.name), f"{xmax - xmin:g} x {ymax - ymin:g} m", f"{len(self.obstacles):,} obstacles"]
        facts += ["a boundary"] if self.boundary is not None else []
        facts.append("no robot" if self.robot is None else f"robot {self.robot.describe()}")
        names = [query.name for query in self.queries[:5]] + (["…"] if len(self.queries) > 5 else [])
        return f"World({', '.join(facts)}, queries: {', '.join(names) or 'none'})"

    @classmethod
    def load(cls, path: str | FilePath) -> World:
        """Read a world from a file, whose format is recognised by its content.

        Args:
            path: trailmark YAML, ROS/nav2 map YAML, MovingAI ``.map``, or OMPL.app ``.cfg``.

        Raises:
            FormatError: the file is missing, of no known format, or does not hold what its format asks for.
        """
        from trailmark import formats

        return formats.load_world(FilePath(path))

    def save(self, path: str | FilePath) -> None:
        """Write the world as trailmark YAML (schema version 1), whole or not at all.

        Raises:
            OutputError: the path cannot be written, or is the map, image or scenario that the world was read from (a
                trailmark world file may be written again).
        """
        from trailmark import formats

        formats.save_world(self, FilePath(path))

    def query(self, name: str | None = None) -> Query:
        """Return the query of that name, or the first one.

        Raises:
            WorldError: there is none.
        """
        if name is None:
            if not self.queries:
                raise WorldError(f"world {self.name!r} holds no query, give a start and a goal")
            return self.queries[0]
        one_of(name, (str, type(None)), "query:", error=WorldError)
        for query in self.queries:
            if query.name == name:
                return query
        names = (query.name for query in self.queries[:50])
        raise WorldError(f"world {self.name!r}: query: {expected_name(name, names)}")

    def with_robot(self, robot: Robot) -> World:
        """Return the same world with another robot."""
        return replace(self, robot=robot)

    @property
    def extent(self) -> float:
        """The diagonal of the bounds, in metres."""
        return math.hypot(self.bounds[2] - self.bounds[0], self.bounds[3] - self.bounds[1])

    def _check_estimates(self) -> None:
        estimates = tuple(self.estimates)
        known = [estimate for estimate in estimates if estimate is not None]
        if estimates and len(estimates) != len(self.obstacles):
            raise WorldError(
                f"estimates: expected one for each of {len(self.obstacles)} obstacles, or none, got {len(estimates)}"
            )
        # Rounding of many shares may carry their sum a little over 1.
        total = math.fsum(estimate.share or 0.0 for estimate in known)
        if total > 1.0 + 1e-9:
            raise WorldError(f"estimates: expected shares that add up to at most 1, got {total:g}")
        object.__setattr__(self, "estimates", estimates if known else ())


def _covariance(value: ArrayLike, name: str, sizes: Sequence[int]) -> se2.FloatArray:
    """Return a symmetric matrix without negative eigenvalues, read-only, or say what is wrong."""
    matrix = number_array(value, name, "no matrix of numbers given", error=WorldError)
    if matrix.shape not in {(k, k) for k in sizes}:
        allowed = " or ".join(f"({k}, {k})" for k in sizes)
        raise WorldError(f"{name}: expected shape {allowed}, got {matrix.shape}")
    if not np.isfinite(matrix).all():
        raise WorldError(f"{name}: holds a value that is not a finite number")
    slack = 1e-9 * float(np.abs(matrix).max())
    if np.abs(matrix - matrix.T).max() > slack:
        raise WorldError(f"{name}: expected a symmetric matrix, got {matrix.tolist()}")
    matrix = 0.5 * (matrix + matrix.T)
    if float(np.linalg.eigvalsh(matrix)[0]) < -slack:
        raise WorldError(f"{name}: expected a matrix without negative eigenvalues, got {matrix.tolist()}")
    matrix.flags.writeable = False
    return matrix


def _between(value: object, name: str, low: float, high: float) -> float:
    """Return a number above ``low`` and at most ``high``, or say what is wrong."""
    number = real(value)
    if not low < number <= high:
        raise WorldError(f"{name}: expected a number above {low:g} and at most {high:g}, got {brief(value)}")
    return number
