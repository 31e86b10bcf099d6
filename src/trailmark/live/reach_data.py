"""What can be reached from an end of a query, to be drawn: where there is no path, it is what proves that."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import Any, Final

import numpy as np
import shapely

from trailmark.planning import LandmarkPlanner
from trailmark.planning.proofs import Enclosure
from trailmark.planning.reach import ENDS, reach
from trailmark.se2 import FloatArray

__all__ = ["reach_data"]

SECONDS: Final = 5.0
"""For finding a proof anew: planning tells that there is one, not which."""

PIXELS: Final = 2000
"""Of a screen: outlines need not be finer."""

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
    deadline = perf_counter() + seconds

    def over() -> bool:
        return perf_counter() > deadline or (stop is not None and stop())

    found = reach(planner.checker, start, goal, infeasible=infeasible, over=over, seconds=seconds)
    data: Reach = {"end": ENDS[found.end], "proof": found.proof, "text": f"{found.why[:1].upper()}{found.why[1:]}."}
    if found.cells is not None:
        data["text"] += f" All that it reaches lies in {len(found.cells.centers):,} cells of (x, y, heading)."
        return {**data, "boxes": _boxes(found.cells)}
    if found.part is None:
        return {**data, "text": "", "rings": []}
    data["rings"] = _rings(found.part, found.origin)
    if found.proof is not None:
        return {**data, "gap": found.gap, "radius": planner.checker.robot.inscribed_disc.radius}
    return {**data, "text": "Where the middle of a disc inside the robot gets to from the start."}


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
