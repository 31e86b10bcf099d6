"""Plane regions: discs, rectangles and polygons with holes. Obstacles and footprints are made of them.

All lengths are metres, all arrays float64. Shapes are immutable values: they compare by content and check
themselves when they are made.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark.arguments import brief, number, number_array, warn_of_degrees
from trailmark.errors import ShapeError

if TYPE_CHECKING:
    import shapely

__all__ = [
    "LIMIT",
    "Disc",
    "LazyShapes",
    "Polygon",
    "Rectangle",
    "Shape",
    "displaced",
    "shape_of",
    "shapes_of",
    "signed_area",
    "triangulate",
]

FloatArray = NDArray[np.float64]

LIMIT = 1e8
"""Metres: no coordinate or length may be larger, since a double then no longer holds the touching tolerance."""


@dataclass(frozen=True)
class Disc:
    """A disc.

    Attributes:
        center: x, y in metres.
        radius: metres, positive.
    """

    center: tuple[float, float]
    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", _point(self.center, "disc: center"))
        object.__setattr__(self, "radius", _positive(self.radius, "disc: radius"))

    @property
    def area(self) -> float:
        """Area in square metres."""
        return math.pi * self.radius**2

    def polygon(self, tolerance: float = 1e-3) -> Polygon:
        """Return a regular polygon that contains the disc and reaches at most ``tolerance`` metres beyond it."""
        # A circumscribed n-gon's corners stand r/cos(pi/n) from the centre.
        n = max(8, math.ceil(math.pi / math.acos(self.radius / (self.radius + tolerance))))
        angles = 2.0 * math.pi * np.arange(n) / n
        reach = self.radius / math.cos(math.pi / n)
        return Polygon(np.asarray(self.center) + reach * np.column_stack([np.cos(angles), np.sin(angles)]))

    def bounding_box(self) -> tuple[float, float, float, float]:
        """Return xmin, ymin, xmax, ymax."""
        (x, y), r = self.center, self.radius
        return x - r, y - r, x + r, y + r


@dataclass(frozen=True)
class Rectangle:
    """A rectangle, its length along its own heading.

    Attributes:
        center: x, y in metres.
        length: metres, positive; along the heading.
        width: metres, positive; across it.
        heading: radians, counter-clockwise.
    """

    center: tuple[float, float]
    length: float
    width: float
    heading: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", _point(self.center, "rectangle: center"))
        object.__setattr__(self, "length", _positive(self.length, "rectangle: length"))
        object.__setattr__(self, "width", _positive(self.width, "rectangle: width"))
        object.__setattr__(self, "heading", number(self.heading, "rectangle: heading", error=ShapeError))
        warn_of_degrees(self.heading, "rectangle: heading")

    @property
    def area(self) -> float:
        """Area in square metres."""
        return self.length * self.width

    def polygon(self, tolerance: float = 0.0) -> Polygon:
        """Return the rectangle as a polygon, exactly; ``tolerance`` is there so that all shapes are called alike."""
        return Polygon(self.corners())

    def corners(self) -> FloatArray:
        """Return the corners, shape (4, 2), counter-clockwise."""
        return self._corners.copy()

    @cached_property
    def _corners(self) -> FloatArray:
        # Computed once: a world of thousands of rectangles that changes is asked for them again and again.
        half = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * (self.length / 2, self.width / 2)
        cos, sin = math.cos(self.heading), math.sin(self.heading)
        corners: FloatArray = np.asarray(self.center) + half @ np.array([[cos, sin], [-sin, cos]])
        return corners

    def bounding_box(self) -> tuple[float, float, float, float]:
        """Return xmin, ymin, xmax, ymax."""
        return self._box

    @cached_property
    def _box(self) -> tuple[float, float, float, float]:
        return _box_of(self._corners)


@dataclass(frozen=True, eq=False)
class Polygon:
    """A simple polygon, convex or not, with any number of holes.

    Attributes:
        vertices: shape (n, 2), n >= 3, in either sense of rotation, not closed (a repeated first vertex at the
            end is dropped).
        holes: each of shape (m, 2), inside the outline, disjoint from one another.

    Raises:
        ShapeError: fewer than three vertices, values not finite, zero area, self-intersection, a hole outside.
    """

    vertices: FloatArray
    holes: tuple[FloatArray, ...] = field(default=())

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", _ring(self.vertices, "polygon: vertices"))
        if not isinstance(self.holes, Iterable) or isinstance(self.holes, str):
            raise ShapeError(f"polygon: holes: expected a list of rings of points [x, y], got {brief(self.holes)}")
        holes = tuple(_ring(hole, f"polygon: holes[{i}]") for i, hole in enumerate(self.holes))
        object.__setattr__(self, "holes", holes)
        import shapely

        region = self.shapely()
        if not region.is_valid:
            raise ShapeError(f"polygon: not simple: {shapely.is_valid_reason(region)}")
        if not region.area > 0.0:
            raise ShapeError(f"polygon: expected an area above 0, got {region.area}")

    @classmethod
    def unchecked(cls, vertices: FloatArray, holes: Sequence[FloatArray] = ()) -> Polygon:
        """Return a polygon over rings of shape (n, 2) that are known to be finite, in range, and valid together."""
        polygon = object.__new__(cls)
        for ring in (vertices, *holes):
            ring.flags.writeable = False
        polygon.__dict__.update(vertices=vertices, holes=tuple(holes))
        return polygon

    @property
    def area(self) -> float:
        """Area in square metres, holes left out."""
        return abs(signed_area(self.vertices)) - sum(abs(signed_area(hole)) for hole in self.holes)

    def polygon(self, tolerance: float = 0.0) -> Polygon:
        """Return the polygon itself; ``tolerance`` is there so that all shapes are called alike."""
        return self

    def bounding_box(self) -> tuple[float, float, float, float]:
        """Return xmin, ymin, xmax, ymax."""
        return self._box

    @cached_property
    def _box(self) -> tuple[float, float, float, float]:
        return _box_of(self.vertices)

    def rings(self) -> list[FloatArray]:
        """Return the outline counter-clockwise and the holes clockwise: the region lies left of every edge."""
        return list(self._rings)

    @cached_property
    def _rings(self) -> tuple[FloatArray, ...]:
        # Computed once, like the box: worlds that change share most of their polygons.
        outline = self.vertices if signed_area(self.vertices) > 0 else self.vertices[::-1]
        return (outline, *(hole if signed_area(hole) < 0 else hole[::-1] for hole in self.holes))

    def shapely(self) -> shapely.Polygon:
        """Return the region as a shapely polygon."""
        import shapely

        return shapely.Polygon(self.vertices, self.holes)

    def __repr__(self) -> str:
        holes = f", {len(self.holes)} hole{'s' if len(self.holes) > 1 else ''}" if self.holes else ""
        return f"Polygon({len(self.vertices)} vertices{holes}, area {self.area:.4g} m²)"

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Polygon):
            return NotImplemented
        return (
            np.array_equal(self.vertices, other.vertices)
            and len(self.holes) == len(other.holes)
            and all(np.array_equal(a, b) for a, b in zip(self.holes, other.holes, strict=True))
        )

    def __hash__(self) -> int:
        # Adding 0 makes -0.0 to 0.0: the two are equal, so their hashes must be.
        return hash(tuple((ring + 0.0).tobytes() for ring in (self.vertices, *self.holes)))


Shape = Disc | Rectangle | Polygon


class LazyShapes(Sequence[Shape]):
    """Obstacles that a file or an array describes otherwise, made when one is asked for; equal to a tuple of them."""

    @abstractmethod
    def make(self) -> tuple[Shape, ...]:
        """Return the shapes, made anew."""

    def as_tuple(self) -> tuple[Shape, ...]:
        """Return this object, which does what a tuple does, under the type that worlds state."""
        return cast(Any, self)  # type: ignore[no-any-return]  # a tuple cannot be filled later

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:
        """The shapes, made once."""
        return self.make()

    def __getitem__(self, index: Any) -> Any:
        return self.shapes[index]

    def __len__(self) -> int:
        return len(self.shapes)

    def __iter__(self) -> Iterator[Shape]:
        return iter(self.shapes)

    def __add__(self, others: Sequence[Shape]) -> tuple[Shape, ...]:
        return (*self, *others)

    def __radd__(self, others: Sequence[Shape]) -> tuple[Shape, ...]:
        return (*others, *self)

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        return tuple(other) == self.shapes if isinstance(other, tuple | LazyShapes) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.shapes)

    def __repr__(self) -> str:
        return repr(self.shapes)

    def __getstate__(self) -> dict[str, Any]:
        # They take many times the memory of what describes them.
        return {key: value for key, value in self.__dict__.items() if key != "shapes"}


def shapes_of(value: Any, name: str) -> tuple[Any, ...]:
    """Return the polygons that a geometry of shapely consists of; anything else, alone, as it is.

    Empty geometries have no polygons, and z coordinates are left out. ``name`` is what the message calls it.

    Raises:
        ShapeError: a geometry without an area, such as a point or a line, or an invalid polygon.
    """
    if not type(value).__module__.startswith("shapely"):
        return (value,)
    import shapely

    found, parts = [], [value]
    for part in parts:
        if hasattr(part, "geoms"):
            parts.extend(part.geoms)  # which are reached later in this loop
        elif part.geom_type != "Polygon":
            raise ShapeError(f"{name}: expected a Polygon or MultiPolygon of shapely, got a {part.geom_type}")
        elif not part.is_empty:
            rings = (shapely.get_coordinates(ring) for ring in (part.exterior, *part.interiors))
            try:
                found.append(Polygon(next(rings), tuple(rings)))
            except ShapeError as error:
                raise ShapeError(f"{name}: {error}") from None
    return tuple(found)


def shape_of(value: Any, name: str) -> Any:
    """Return the polygon that a geometry of shapely is; several, and anything else, come back as they are."""
    parts = shapes_of(value, name)
    return parts[0] if len(parts) == 1 else value


def displaced(shape: Shape, dx: float, dy: float, dtheta: float = 0.0) -> Shape:
    """Return a shape moved by (dx, dy) metres and turned by dtheta radians about its own centre.

    The centre is that of a disc or rectangle, and the mean of a polygon's outline's vertices.

    Raises:
        ShapeError: it would leave the range of coordinates.
    """
    if isinstance(shape, Disc):
        return Disc((shape.center[0] + dx, shape.center[1] + dy), shape.radius)
    if isinstance(shape, Rectangle):
        center = shape.center[0] + dx, shape.center[1] + dy
        # Who turns a shape again and again means no degrees.
        return Rectangle(center, shape.length, shape.width, math.fmod(shape.heading + dtheta, 2.0 * math.pi))
    step = np.array([dx, dy])
    if dtheta == 0.0:
        return Polygon(shape.vertices + step, tuple(hole + step for hole in shape.holes))
    center = shape.vertices.mean(axis=0)
    cos, sin = math.cos(dtheta), math.sin(dtheta)
    turn = np.array([[cos, sin], [-sin, cos]])
    outline, *holes = ((ring - center) @ turn + center + step for ring in (shape.vertices, *shape.holes))
    return Polygon(outline, tuple(holes))


def signed_area(ring: ArrayLike) -> float:
    """Return the area of a ring, shape (n, 2), positive when it runs counter-clockwise."""
    points = np.asarray(ring, dtype=np.float64)
    # Relative to the first vertex: far from the origin the plain shoelace formula loses digits.
    x, y = (points - points[0]).T
    # np.roll would take five times as long.
    next_x, next_y = np.concatenate([x[1:], x[:1]]), np.concatenate([y[1:], y[:1]])
    return float(0.5 * (np.dot(x, next_y) - np.dot(y, next_x)))


def _box_of(points: FloatArray) -> tuple[float, float, float, float]:
    low, high = points.min(axis=0), points.max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _ring(points: ArrayLike, name: str) -> FloatArray:
    ring = number_array(points, name, "{} is not a list of points [x, y]", error=ShapeError)
    if ring.ndim != 2 or ring.shape[1] != 2:
        raise ShapeError(f"{name}: expected shape (n, 2), got {ring.shape}")
    if not np.isfinite(ring).all():
        raise ShapeError(f"{name}: holds a value that is not a finite number")
    if np.abs(ring).max(initial=0.0) > LIMIT:
        raise ShapeError(f"{name}: expected coordinates of at most {LIMIT:g} m, got {np.abs(ring).max():g}")
    if len(ring) > 1 and np.array_equal(ring[0], ring[-1]):
        ring = ring[:-1]
    if len(ring) < 3:
        raise ShapeError(f"{name}: expected 3 or more different points, got {len(ring)}")
    ring.flags.writeable = False
    return ring


def _point(value: object, name: str) -> tuple[float, float]:
    if type(value) is tuple and len(value) == 2:  # mostly, and the quickest way to see that all is well
        x, y = value
        if type(x) is type(y) is float and -LIMIT <= x <= LIMIT and -LIMIT <= y <= LIMIT:
            return value
    try:
        x, y = list(value)  # type: ignore[call-overload]  # the except below is the check
    except (TypeError, ValueError):
        raise ShapeError(f"{name}: expected two numbers x, y, got {brief(value)}") from None
    x, y = (number(v, name, minimum=-LIMIT, maximum=LIMIT, unit="m", error=ShapeError) for v in (x, y))
    return x, y


def _positive(value: object, name: str) -> float:
    if type(value) is float and 0.0 < value <= LIMIT:
        return value
    return number(value, name, above=0.0, maximum=LIMIT, unit="m", error=ShapeError)


def triangulate(polygon: Polygon) -> FloatArray:
    """Return triangles that fill the polygon exactly and lie in it, shape (m, 3, 2), counter-clockwise.

    The triangulation is constrained Delaunay (GEOS), so it uses the polygon's own vertices only.
    """
    import shapely

    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon.shapely()))
    corners = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3]
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    clockwise = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] < 0.0
    corners[clockwise] = corners[clockwise][:, ::-1]
    return np.ascontiguousarray(corners)
