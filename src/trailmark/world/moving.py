"""Moving: an obstacle with a velocity, as the region that it sweeps up to a horizon."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from trailmark.arguments import brief, number, one_of, real
from trailmark.errors import ShapeError, WorldError
from trailmark.shapes import Disc, Polygon, Rectangle, Shape, displaced, triangulate

__all__ = ["DISC_ERROR", "Moving"]

DISC_ERROR = 0.01
"""Share of its radius by which the swept region of a disc, a polygon, may reach beyond the true one."""


@dataclass(frozen=True)
class Moving:
    """An obstacle that moves in a straight line without turning, for some time from now on.

    Attributes:
        shape: where it is now.
        velocity: vx, vy in metres per second.
        until: horizon of the prediction, seconds from now, above 0.
        swept: the region that it covers from now to ``until``, for planning without time. Exact (to rounding) for
            rectangles and polygons; for a disc, a polygon that contains it and reaches at most :data:`DISC_ERROR` of
            the radius beyond.

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
            velocity = tuple(map(real, self.velocity))
        except TypeError:
            velocity = ()
        if len(velocity) != 2 or not all(map(math.isfinite, velocity)):
            raise WorldError(f"moving: velocity: expected two finite numbers vx, vy, got {brief(self.velocity)}")
        until = number(self.until, "moving: until", above=0.0, unit="s", error=WorldError)
        swept = _swept(self.shape, np.array(velocity) * until)
        self.__dict__.update(velocity=velocity, until=until, swept=swept)

    def at(self, time: float) -> Shape:
        """Return the obstacle's shape ``time`` seconds from now."""
        return displaced(self.shape, self.velocity[0] * time, self.velocity[1] * time)

    def displaced(self, dx: float, dy: float, dtheta: float = 0.0) -> Moving:
        """Return it with its shape displaced as :func:`trailmark.shapes.displaced` does; the velocity stays."""
        return Moving(displaced(self.shape, dx, dy, dtheta), self.velocity, self.until)


def _swept(shape: Shape, step: np.ndarray) -> Shape:
    """Return the region that a shape covers on its way along a step, shape (2,), metres."""
    if not step.any():
        return shape
    import shapely

    try:
        polygon = shape.polygon(DISC_ERROR * shape.radius) if isinstance(shape, Disc) else shape.polygon()
        pieces = triangulate(polygon) if isinstance(shape, Polygon) else polygon.vertices[None]
        # The hull of a convex piece's both ends is what the piece sweeps; the pieces fill the shape.
        hulls = shapely.convex_hull(shapely.multipoints(np.concatenate([pieces, pieces + step], axis=1)))
        region = shapely.union_all(hulls)
        if region.geom_type != "Polygon" or not region.is_valid:  # pieces that abut by a corner, to rounding
            region = shapely.convex_hull(region)
        return Polygon(region.exterior.coords, tuple(ring.coords for ring in region.interiors))
    except ShapeError as error:
        raise ShapeError(f"moving: the region swept: {error}") from None
