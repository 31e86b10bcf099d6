"""What can be reached from an end of a query, to be drawn: where there is no path, it is what proves that."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from trailmark.planning import LandmarkPlanner
from trailmark.planning.proofs import Enclosure, enclosure
from trailmark.planning.proofs.region import free_region, local_origin
from trailmark.se2 import FloatArray, transform

__all__ = ["reach_data"]

SECONDS: Final = 5.0
"""For finding a proof anew: planning tells that there is one, not which."""

PIXELS: Final = 2000
"""Of a screen: outlines need not be finer."""

HALVINGS: Final = 24
"""Steps in which the width of the widest way is found."""

ENDS: Final = ("start", "goal")

Reach = dict[str, Any]


def reach_data(
    planner: LandmarkPlanner,
    start: FloatArray,
    goal: FloatArray,
    *,
    infeasible: bool = False,
    stop: Callable[[], bool] | None = None,
    seconds: float = SECONDS,
) -> Reach:
    """Return what the disc inside the robot reaches from an end, or, if only headings prove it, what the robot does.

    ``end`` says from which; ``proof`` is ``disc``, ``headings`` or null; ``text`` is a sentence. ``rings`` are the
    outline and holes of where the disc's centre can be, metres. For ``headings``, ``boxes`` are xmin, ymin, xmax, ymax
    and the share of headings of all cells of SE(2) that hold what the robot's pivot reaches, one after the other.
    ``gap`` is x, y and radius of the largest disc that gets to the other end, where it is narrowest, and ``radius``
    the robot's; null where no disc does.

    Args:
        planner: of the world.
        start: valid, shape (3,).
        goal: valid, shape (3,).
        infeasible: whether it is proven that there is no path; the proof is found anew.
        stop: asked whether to give up looking for it.
        seconds: for that.
    """
    checker = planner.checker
    disc, origin = checker.robot.inscribed_disc, local_origin(checker.world)
    centers = [transform(np.asarray(q), np.asarray(disc.center)[None])[0] for q in (start, goal)]
    parts = shapely.get_parts(free_region(checker.world, disc.radius, origin=origin))
    if len(parts) == 0:
        return {"end": "start", "proof": None, "text": "", "rings": [], "radius": disc.radius}
    # By rounding, an end may lie just outside.
    near = [int(np.argmin(shapely.distance(parts, shapely.Point(c - origin)))) for c in centers]
    if near[0] != near[1]:
        end = int(np.argmin(shapely.area(parts[near])))
        gap = _narrowest(planner, *centers)
        return {
            "end": ENDS[end],
            "proof": "disc",
            "text": _disc_text(end, gap, disc.radius),
            "rings": _rings(parts[near[end]], origin),
            "gap": gap,
            "radius": disc.radius,
        }
    proof = enclosure(checker, start, goal, seconds=seconds, stop=stop) if infeasible else None
    if proof is not None:
        text = (
            f"Shut in at the {ENDS[proof.end]}: a disc inside the robot would get out, the robot does not, at any "
            f"heading. All that it reaches lies in {len(proof.centers):,} cells of (x, y, heading)."
        )
        return {"end": ENDS[proof.end], "proof": "headings", "text": text, "boxes": _boxes(proof)}
    text = "Where the middle of a disc inside the robot gets to from the start."
    return {"end": "start", "proof": None, "text": text, "rings": _rings(parts[near[0]], origin)}


def _disc_text(end: int, gap: list[float] | None, radius: float) -> str:
    if gap is None:
        return f"Shut in at the {ENDS[end]}: obstacles close every way to the {ENDS[1 - end]}."
    return (
        f"Shut in at the {ENDS[end]}: the widest way to the {ENDS[1 - end]} lets a disc of about {2.0 * gap[2]:.2f} m "
        f"through, and the robot holds one of {2.0 * radius:.2f} m."
    )


def _rings(part: Any, origin: FloatArray) -> list[list[list[float]]]:
    xmin, ymin, xmax, ymax = part.bounds
    rings = shapely.get_rings(shapely.simplify(part, max(xmax - xmin, ymax - ymin) / PIXELS))
    return [np.round(shapely.get_coordinates(ring) + origin, 4).tolist() for ring in rings]


def _boxes(proof: Enclosure) -> list[float]:
    """Return the cells over each other as one: xmin, ymin, xmax, ymax, share of headings."""
    flat = np.round(np.column_stack([proof.centers[:, :2], proof.extents[:, :2]]), 6)
    cells, which = np.unique(flat, axis=0, return_inverse=True)
    share = np.bincount(which.ravel(), proof.extents[:, 2]) / np.pi
    corners = [cells[:, :2] - cells[:, 2:], cells[:, :2] + cells[:, 2:]]
    return np.round(np.column_stack([*corners, np.minimum(share, 1.0)]), 4).ravel().tolist()


def _narrowest(planner: LandmarkPlanner, start: FloatArray, goal: FloatArray) -> list[float] | None:
    """Return x, y and radius of the largest disc that gets from one point to another, where it is narrowest.

    By the field of clearances, whose cells bound how exact it is; None if no disc gets there.
    """
    field = planner.checker.field
    distance = field.distance
    columns, rows = ((np.array([start, goal]) - (field.x0, field.y0)) / field.size).astype(np.int64).T
    rows, columns = np.clip(rows, 0, distance.shape[0] - 1), np.clip(columns, 0, distance.shape[1] - 1)

    def joined(radius: float) -> tuple[NDArray[Any], bool]:
        labels, _ = ndimage.label(distance >= radius, structure=np.ones((3, 3)))
        first, last = labels[rows, columns]
        return labels, bool(first == last != 0)

    low, high = 0.5 * field.size, float(distance[rows, columns].min())
    if high <= low or not joined(low)[1]:
        return None
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if joined(middle)[1] else (low, middle)
    labels, _ = joined(high)
    # The cells that only the smaller disc may be in: the one between what is reached from here and from there.
    sides = [ndimage.distance_transform_edt(labels != labels[r, c]) for r, c in zip(rows, columns, strict=True)]
    between = np.where((distance >= low) & (distance < high), sides[0] + sides[1], np.inf)
    row, column = np.unravel_index(np.argmin(between), between.shape)
    place = field.x0 + (column + 0.5) * field.size, field.y0 + (row + 0.5) * field.size
    return [round(float(v), 4) for v in (*place, low)]
