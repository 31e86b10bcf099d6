"""What the worlds are built of: shapes, walls and curves, with coordinates rounded to millimetres."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from trailmark import Disc, Polygon, Rectangle

PI = math.pi
QUARTER = 1.57  # a quarter turn, as a person writes it
Shape = Disc | Rectangle | Polygon
Points = Sequence[tuple[float, float]] | NDArray[np.float64]


def mm(value: float) -> float:
    """Round to millimetres (or milliradians); adding 0 turns -0.0 into 0.0."""
    return round(float(value), 3) + 0.0


def disc(x: float, y: float, radius: float) -> Disc:
    """Return a disc about x, y."""
    return Disc((mm(x), mm(y)), mm(radius))


def rect(x: float, y: float, length: float, width: float, heading: float = 0.0) -> Rectangle:
    """Return a rectangle about x, y."""
    return Rectangle((mm(x), mm(y)), mm(length), mm(width), mm(heading))


def box(x0: float, y0: float, x1: float, y1: float) -> Rectangle:
    """Return the axis-aligned rectangle between two corners."""
    # The middle of two millimetres may need one digit more; rounded, it would move the box off its neighbours.
    return Rectangle((round((x0 + x1) / 2, 4), round((y0 + y1) / 2, 4)), mm(x1 - x0), mm(y1 - y0))


def poly(points: Points, holes: Iterable[Points] = ()) -> Polygon:
    """Return a polygon."""
    return Polygon(_rounded(points), tuple(_rounded(hole) for hole in holes))


def placed(points: Points, x: float, y: float, heading: float) -> NDArray[np.float64]:
    """Return points of a body's frame in the world, the body standing at x, y, heading."""
    cos, sin = math.cos(heading), math.sin(heading)
    turned = np.asarray(points, dtype=np.float64) @ np.array([[cos, sin], [-sin, cos]])
    return np.asarray(turned + np.array([x, y]))


def ngon(x: float, y: float, a: float, b: float, n: int, turn: float = 0.0) -> NDArray[np.float64]:
    """Return n points of an ellipse with half axes a, b, the first at angle ``turn``."""
    angles = turn + 2 * PI * np.arange(n) / n
    return np.column_stack([x + a * np.cos(angles), y + b * np.sin(angles)])


def ribbon(line: NDArray[np.float64], width: float) -> Polygon:
    """Return a wall of that width along a smooth line, shape (n, 2)."""
    along = np.gradient(line, axis=0)
    across = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
    return poly(np.concatenate([line + across * width / 2, (line - across * width / 2)[::-1]]))


def wall(a: tuple[float, float], b: tuple[float, float], width: float, *doors: tuple[float, float]) -> list[Shape]:
    """Return a straight wall along x or y with doors, each from one coordinate to another along the wall."""
    along = 0 if a[1] == b[1] else 1
    stops = [a[along], *(stop for door in doors for stop in door), b[along]]
    half = width / 2
    if along == 0:
        return [box(p, a[1] - half, q, a[1] + half) for p, q in zip(stops[::2], stops[1::2], strict=True)]
    return [box(a[0] - half, p, a[0] + half, q) for p, q in zip(stops[::2], stops[1::2], strict=True)]


def frame(width: float, length: float, thickness: float) -> list[Shape]:
    """Return the outer walls just inside the bounds [0, 0, width, length]."""
    return [
        box(0, 0, width, thickness),
        box(0, length - thickness, width, length),
        box(0, thickness, thickness, length - thickness),
        box(width - thickness, thickness, width, length - thickness),
    ]


def _rounded(points: Points) -> NDArray[np.float64]:
    return np.asarray(np.round(np.asarray(points, dtype=np.float64), 3) + 0.0)
