"""What can be reached from an end of a query, to be drawn: where there is no path, it is what proves that."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import Any, Final

import numpy as np
import shapely

from trailmark.planning import LandmarkPlanner
from trailmark.planning.proofs.enclosure import Enclosure, enclosure
from trailmark.planning.proofs.region import local_origin, region_parts
from trailmark.se2 import FloatArray, transform
from trailmark.world import World

__all__ = ["reach_data"]

SECONDS: Final = 5.0
"""For finding a proof anew: planning tells that there is one, not which."""

PIXELS: Final = 2000
"""Of a screen: outlines need not be finer."""

FEWEST, HALVINGS = 5, 12
"""Steps in which the width of the widest way is found, at least and at most."""

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
    the robot's; null where no disc does, or there was no time.

    Args:
        planner: of the world.
        start: valid, shape (3,).
        goal: valid, shape (3,).
        infeasible: whether it is proven that there is no path; the proof is found anew.
        stop: asked whether to give up looking for it, or for the narrowest place.
        seconds: for that.
    """
    checker, deadline = planner.checker, perf_counter() + seconds

    def over() -> bool:
        return perf_counter() > deadline or (stop is not None and stop())

    disc, origin = checker.robot.inscribed_disc, local_origin(checker.world)
    centers = [transform(np.asarray(q), np.asarray(disc.center)[None])[0] for q in (start, goal)]
    parts = region_parts(checker.world, disc.radius, origin=origin)
    if len(parts) == 0:
        return {"end": "start", "proof": None, "text": "", "rings": [], "radius": disc.radius}
    # By rounding, an end may lie just outside.
    near = [int(np.argmin(shapely.distance(parts, shapely.Point(c - origin)))) for c in centers]
    if near[0] != near[1]:
        end = int(np.argmin(shapely.area(parts[near])))
        gap = _narrowest(checker.world, disc.radius, centers, origin, over)
        return {
            "end": ENDS[end],
            "proof": "disc",
            "text": _disc_text(end, gap, disc.radius),
            "rings": _rings(parts[near[end]], origin),
            "gap": gap or None,
            "radius": disc.radius,
        }
    proof = enclosure(checker, start, goal, seconds=seconds, stop=over) if infeasible else None
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
        return f"Shut in at the {ENDS[end]}: a disc inside the robot does not get out."
    if not gap:
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


def _narrowest(
    world: World, radius: float, centers: list[FloatArray], origin: FloatArray, over: Callable[[], bool]
) -> list[float] | None:
    """Return x, y and radius of the largest disc that gets from one point to another, where it is narrowest.

    Of discs a little larger, what can be reached from the one and from the other nearly meets there. Nothing is in the
    list if no disc gets there; None is returned if time was up too soon to tell.

    Args:
        world: obstacles, bounds, boundary.
        radius: of a disc that does not get there, metres.
        centers: the points, shape (2,) each.
        origin: what regions are relative to, shape (2,).
        over: whether time is up.
    """

    def sides(size: float) -> list[Any]:
        parts = region_parts(world, size, origin=origin)
        if len(parts) == 0:
            return []
        return [parts[int(np.argmin(shapely.distance(parts, shapely.Point(c - origin))))] for c in centers]

    low, high, apart = 0.0, radius, list[Any]()
    for halving in range(HALVINGS):
        if over():
            if halving < FEWEST:
                return None
            break
        size = 0.5 * (low + high)
        found = sides(size)
        if found and found[0] is found[1]:
            low = size
        else:
            high, apart = size, found
    apart = apart or sides(high)
    if low == 0.0 or not apart:
        return []
    place = shapely.get_coordinates(shapely.shortest_line(*apart)).mean(axis=0) + origin
    return [round(float(v), 4) for v in (*place, low)]
