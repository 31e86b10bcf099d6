"""Revalidation: a roadmap for a world in which obstacles changed, made from the one for the world before."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trailmark.motion import Motion
from trailmark.roadmap.roadmap import Roadmap
from trailmark.roadmap.search import edges_near, few_boxes, nodes_near
from trailmark.roadmap.store import EdgeStatus
from trailmark.se2 import FloatArray

__all__ = ["Revalidated", "revalidated"]


@dataclass(frozen=True)
class Revalidated:
    """A roadmap for a changed world.

    Attributes:
        roadmap: in which the changed world's obstacles decide every status.
        dropped: configurations of nodes that are valid no more, shape (d, 3).
        checked: edges that were looked at again.
        gained: of those, edges that were not certified before and are now.
        lost: of those, edges that were certified before and are not any more, those of dropped nodes included.
    """

    roadmap: Roadmap
    dropped: FloatArray
    checked: int
    gained: int
    lost: int


def revalidated(roadmap: Roadmap, motion: Motion, removed: FloatArray, added: FloatArray) -> Revalidated:
    """Return a roadmap's nodes and edges as they are in a changed world; the roadmap itself stays as it is.

    Looked at again are the certified edges along which the robot may touch what was added, and the blocked ones along
    which it may have touched what was removed. Nodes that are not valid any more are dropped, with their edges.

    Args:
        roadmap: for the world before.
        motion: for the changed world, of the same kind.
        removed: boxes xmin, ymin, xmax, ymax (metres) that hold what was removed, shape (r, 4).
        added: boxes that hold what was added, shape (a, 4).
    """
    # Copies: whoever asks the roadmap at the same time may be deciding an edge.
    q, edges, lengths, status = roadmap.rows()
    q, edges, lengths, status = q.copy(), edges.copy(), lengths.copy(), status.copy()
    reach = float(motion.checker.robot.circumradius)
    removed, added = few_boxes(removed), few_boxes(added)
    invalid = nodes_near(q, reach, added)
    near = np.flatnonzero(invalid)
    invalid[near] = ~motion.checker.states_free(q[near])
    free = status == EdgeStatus.FREE
    blocked = status == EdgeStatus.BLOCKED
    longest = motion.longest(lengths)
    again = edges_near(q, edges, longest, reach, added, free) | edges_near(q, edges, longest, reach, removed, blocked)
    ends_valid = ~(invalid[edges[:, 0]] | invalid[edges[:, 1]])
    check = np.flatnonzero(again & ends_valid)
    found = motion.motions_between_valid(q[edges[check, 0]], q[edges[check, 1]])
    status[check] = np.where(found, EdgeStatus.FREE, EdgeStatus.BLOCKED)
    gained = int(np.count_nonzero(found & ~free[check]))
    lost = int(np.count_nonzero(~found & free[check]) + np.count_nonzero(free & ~ends_valid))
    dropped = q[invalid]
    if len(dropped):
        q, edges, lengths, status = _without(invalid, q, edges, lengths, status, ends_valid)
    changed = Roadmap.from_arrays(motion.checker, q, edges, status, motion=motion, lengths=lengths)
    return Revalidated(changed, dropped, len(check), gained, lost)


def _without(
    nodes: NDArray[np.bool_],
    q: FloatArray,
    edges: NDArray[np.int32],
    lengths: FloatArray,
    status: NDArray[np.uint8],
    stay: NDArray[np.bool_],
) -> tuple[FloatArray, NDArray[np.int32], FloatArray, NDArray[np.uint8]]:
    """Return the arrays of a roadmap without some nodes, shape (n,), and with the edges, shape (m,), that stay."""
    number = np.cumsum(~nodes, dtype=np.int32) - 1
    return q[~nodes], number[edges[stay]].reshape(-1, 2).astype(np.int32), lengths[stay], status[stay]
