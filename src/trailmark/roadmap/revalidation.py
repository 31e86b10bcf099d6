"""Revalidation: a roadmap for a world in which obstacles changed, made from the one for the world before."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from trailmark.jit import njit
from trailmark.motion import Motion
from trailmark.roadmap.roadmap import EdgeStatus, Roadmap
from trailmark.se2 import FloatArray

__all__ = ["Revalidated", "edges_near", "few_boxes", "revalidated"]

MANY = 32
"""Boxes from which on some that lie together are taken for one: each is compared with every edge."""

SLACK = 1e-6
"""Metres, and share of a length, by which distances may be wrong; counted as near."""


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
    q, edges, lengths, known = roadmap.rows()
    # A copy: whoever asks the roadmap at the same time may be deciding an edge.
    status = known.copy()
    reach = float(motion.checker.robot.circumradius)
    removed, added = few_boxes(removed), few_boxes(added)
    every = np.arange(len(q), dtype=np.int32)
    invalid = edges_near(q, np.column_stack([every, every]), np.zeros(len(q)), reach, added, np.ones(len(q), np.bool_))
    near = np.flatnonzero(invalid)
    invalid[near] = ~motion.checker.states_free(q[near])
    free, blocked = status == EdgeStatus.FREE, status == EdgeStatus.BLOCKED
    longest = motion.longest(lengths)
    again = edges_near(q, edges, longest, reach, added, free) | edges_near(q, edges, longest, reach, removed, blocked)
    stay = ~(invalid[edges[:, 0]] | invalid[edges[:, 1]])
    check = np.flatnonzero(again & stay)
    found = motion.motions_between_valid(q[edges[check, 0]], q[edges[check, 1]])
    status[check] = np.where(found, EdgeStatus.FREE, EdgeStatus.BLOCKED)
    gained = int(np.count_nonzero(found & ~free[check]))
    lost = int(np.count_nonzero(~found & free[check]) + np.count_nonzero(free & ~stay))
    number = np.cumsum(~invalid) - 1
    rest = q[~invalid], number[edges[stay]], status[stay]
    changed = Roadmap.from_arrays(motion.checker, *rest, motion=motion, lengths=lengths[stay])
    return Revalidated(changed, q[invalid], len(check), gained, lost)


def few_boxes(boxes: FloatArray) -> FloatArray:
    """Return about :data:`MANY` boxes at most that hold all of some boxes, shape (b, 4), xmin, ymin, xmax, ymax."""
    if len(boxes) <= MANY:
        return boxes
    low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
    place = np.floor(sqrt(MANY) * (boxes[:, :2] - low) / np.maximum(high - low, 1e-9))
    group = np.unique(place, axis=0, return_inverse=True)[1].ravel()
    found = np.tile([np.inf, np.inf, -np.inf, -np.inf], (int(group.max()) + 1, 1))
    np.minimum.at(found[:, :2], group, boxes[:, :2])
    np.maximum.at(found[:, 2:], group, boxes[:, 2:])
    return found


@njit(nogil=True)
def edges_near(
    q: FloatArray,
    edges: NDArray[np.int32],
    lengths: FloatArray,
    reach: float,
    boxes: FloatArray,
    among: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Return along which edges the robot may touch one of the boxes, shape (m,).

    A motion of cost c moves the reference point by at most c metres, whatever kind of motion it is: where it is at
    distance d of a box, its ends' distances from it add up to at most c + 2·d.

    Args:
        q: nodes, shape (n, 3).
        edges: nodes joined, shape (m, 2).
        lengths: their costs, metres, shape (m,).
        reach: metres from the reference point to the robot's farthest point.
        boxes: (b, 4), xmin, ymin, xmax, ymax, metres.
        among: edges that are asked about, shape (m,).
    """
    found = np.zeros(len(edges), np.bool_)
    distance = np.empty(len(q))
    for box in boxes:
        for i in range(len(q)):
            x, y = q[i, 0], q[i, 1]
            distance[i] = hypot(max(box[0] - x, 0.0, x - box[2]), max(box[1] - y, 0.0, y - box[3]))
        for i in range(len(edges)):
            if among[i] and not found[i]:
                most = lengths[i] + 2.0 * reach
                found[i] = distance[edges[i, 0]] + distance[edges[i, 1]] <= most + SLACK * (1.0 + most)
    return found
