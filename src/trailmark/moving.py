"""Moving: an obstacle with a velocity, as the region that it sweeps up to a horizon."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from trailmark.arguments import brief, one_of, real
from trailmark.errors import ShapeError, WorldError
from trailmark.shapes import LIMIT, Disc, Polygon, Rectangle, Shape, displaced, triangulate

__all__ = ["DISC_ERROR", "Moving"]

DISC_ERROR = 0.01
"""Share of its radius by which the swept region of a disc, a polygon, may reach beyond the true one."""


@dataclass(frozen=True)
class Moving:
    """An obstacle that moves in a straight line without turning, for some time from now on.

    Attributes:
        shape: where it is now.
        velocity: vx, vy in metres per second.
        until: seconds from now up to which it is foreseen, above 0.
        swept: the region that it covers at any time from 0 to ``until``, which is the obstacle to whoever knows no
            time. Exact (to rounding) for rectangles and polygons; of a disc, a polygon that contains it and reaches
            at most :data:`DISC_ERROR` of the radius beyond.

    Raises:
        WorldError: a shape of another kind, a velocity that is not two finite numbers, a horizon that is not a finite
            number above 0.
        ShapeError: the obstacle leaves the range of coordinates.
    """

    shape: Shape
    velocity: tuple[float, float]
    until: float
    swept: Shape = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        one_of(self.shape, (Disc, Rectangle, Polygon), "moving: shape:", error=WorldError)
        try:
            velocity = tuple(real(v) for v in self.velocity)
        except TypeError:
            velocity = ()
        if len(velocity) != 2 or not all(map(math.isfinite, velocity)):
            raise WorldError(f"moving: velocity: expected two finite numbers vx, vy, got {brief(self.velocity)}")
        until = real(self.until)
        if not 0.0 < until < math.inf:
            raise WorldError(f"moving: until: expected a finite number of seconds above 0, got {brief(self.until)}")
        object.__setattr__(self, "velocity", velocity)
        object.__setattr__(self, "until", until)
        object.__setattr__(self, "swept", _swept(self.shape, velocity[0] * until, velocity[1] * until))

    def at(self, time: float) -> Shape:
        """Return the obstacle's shape ``time`` seconds from now."""
        return displaced(self.shape, self.velocity[0] * time, self.velocity[1] * time)

    def displaced(self, dx: float, dy: float, dtheta: float = 0.0) -> Moving:
        """Return it with its shape displaced as :func:`trailmark.shapes.displaced` does; the velocity stays."""
        return Moving(displaced(self.shape, dx, dy, dtheta), self.velocity, self.until)


def _swept(shape: Shape, dx: float, dy: float) -> Shape:
    """Return the region that a shape covers on its way along (dx, dy), metres."""
    if dx == 0.0 and dy == 0.0:
        return shape
    if isinstance(shape, Disc):
        return _capsule(shape, dx, dy)
    import shapely

    polygon = shape.polygon()
    pieces = triangulate(polygon) if isinstance(shape, Polygon) else polygon.vertices[None]
    corners = np.concatenate([pieces, pieces + np.array([dx, dy])], axis=1)
    # The hull of a convex piece's both ends is what the piece sweeps; the pieces fill the shape.
    region = shapely.union_all(shapely.convex_hull(shapely.multipoints(corners)))
    if region.geom_type != "Polygon" or not region.is_valid:  # pieces that abut by a corner, to rounding
        region = shapely.convex_hull(region)
    try:
        return Polygon(region.exterior.coords, tuple(ring.coords for ring in region.interiors))
    except ShapeError as error:
        raise ShapeError(f"moving: the region swept: {error}") from None


CORNERS = 24
"""Of a polygon around a disc: a multiple of 4, so that edges of the disc's capsule run along its sides."""

_angles = math.pi / CORNERS * np.arange(1 - CORNERS // 2, CORNERS // 2, 2)
FRONT = np.column_stack([np.cos(_angles), np.sin(_angles)]) / math.cos(math.pi / CORNERS)
"""Corners in front of the centre of a disc of radius 1 that moves along x, shape (CORNERS / 2, 2)."""


def _capsule(disc: Disc, dx: float, dy: float) -> Polygon:
    """Return a polygon around the region that a disc sweeps: its front and its back, each half of a regular polygon."""
    (x, y), r, length = disc.center, disc.radius, math.hypot(dx, dy)
    farthest = max(abs(x), abs(y), abs(x + dx), abs(y + dy)) + (1.0 + DISC_ERROR) * r
    if farthest > LIMIT:
        raise ShapeError(f"moving: the region swept: expected coordinates of at most {LIMIT:g} m, got {farthest:g}")
    c, s = r * dx / length, r * dy / length
    front = FRONT @ np.array([[c, s], [-s, c]])
    vertices = np.empty((CORNERS, 2))
    vertices[: CORNERS // 2] = front + np.array([x + dx, y + dy])
    vertices[CORNERS // 2 :] = np.array([x, y]) - front
    # A disc that is hardly more than rounding, so far from the origin, may have corners in the same place.
    return Polygon.unchecked(vertices) if r > 1e-9 * farthest else Polygon(vertices)
