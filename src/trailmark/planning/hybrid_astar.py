"""Hybrid A*: where a car gets to from given configurations by short drives to the left, straight on and to the right.

In a tight place a car gets on by many short drives to and fro, each of which depends on the one before: independent
samples hardly ever join there. So a tree of drives grows, every one of them certified, those first that promise to be
on the cheapest path; of the drives that lead to one cell of configurations in one direction the cheapest counts. After
hybrid A* (Dolgov, Thrun, Montemerlo & Diebel, "Practical search techniques in path planning for autonomous driving",
2008), with several sources, and with the relaxed problem's costs as its guide.
"""

from __future__ import annotations

from math import ceil, cos, floor, pi, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.clock import CLOCK_EVERY, Deadline, over
from trailmark.collision.certify import BUDGET, curve_motion
from trailmark.collision.kernels import FREE, state
from trailmark.curves.words import PIECES, reversed_word, walk
from trailmark.heap import COUNT, WAITING, add_label, entry_of, new_labels, next_label, with_room
from trailmark.jit import array_callee, callee, njit
from trailmark.landmarks.relaxation import CostMap, Relaxation
from trailmark.landmarks.sampling import lloyd
from trailmark.motion import Motion, WeightedMotion
from trailmark.motion.base import Scratch, new_scratch
from trailmark.motion.curve import Curve
from trailmark.motion.one_way import OneWays, curve_allowed, one_ways
from trailmark.se2 import FloatArray

__all__ = ["Reached", "hybrid_astar"]

FINEST = 0.005
"""Turning radii: drives that no shorter ones follow."""

LONGEST_ARC = 0.5 * pi
"""Radians: drives on one side are put together up to this arc, which is the shortest curve between its ends."""

GREED = 1.5
"""How much a metre still to go counts against one driven already."""


class Reached(NamedTuple):
    """Configurations that hang on sources, or on one another, by drives.

    Attributes:
        configurations: (n, 3), valid.
        parents: (n,): index of a source, or, from the number of sources on, of one of ``configurations``.
    """

    configurations: FloatArray
    parents: NDArray[np.int64]


def hybrid_astar(
    motions: Motion,
    relaxation: Relaxation,
    costs: CostMap,
    sources: FloatArray,
    *,
    reverse: bool,
    step: float,
    most: int,
    landmarks: int,
    rng: np.random.Generator,
    seconds: float = np.inf,
) -> Reached:
    """Return landmarks among what drives from the sources reach, and what leads there.

    The landmarks are the configurations nearest to K-means centres of all that was reached, and the one with the
    least cost to go.

    Args:
        motions: certifies the drives.
        relaxation: the relaxed problem's grid.
        costs: its costs to where the drives should lead.
        sources: valid configurations, shape (m, 3).
        reverse: whether the drives are to lead to the sources, not away from them.
        step: longest drive, metres; cells are half as large. Both are halved until so many configurations are reached.
        most: configurations reached at most.
        landmarks: about so many of them are kept.
        rng: source of randomness.
        seconds: that the drives may take.
    """
    from scipy.spatial import cKDTree

    # What its metres are charged makes no difference to how a car moves.
    weighted = motions if isinstance(motions, WeightedMotion) else None
    kind: Curve = motions.kind if weighted is None else weighted.motion.kind
    car = _Car(kind, one_ways(()) if weighted is None else weighted.kind.one_way, -1.0 if reverse else 1.0)
    guide = _Guide(costs.cost, float(relaxation.x0), float(relaxation.y0), float(relaxation.size), relaxation.center)
    deadline, m = Deadline.after(seconds), len(sources)
    while True:
        q, parents, drives = _grow(car, guide, np.array(sources, order="C"), step, most, deadline)
        if len(q) >= m + most or step <= FINEST * kind.radius or over(deadline):
            break
        # All cells that these drives lead to are entered: smaller ones may lead farther.
        step *= 0.5
    if len(q) == m:
        return Reached(np.empty((0, 3)), np.empty(0, np.int64))
    points = se2.embed(q[m:], kind.radius)
    first = points[rng.choice(len(points), min(landmarks, len(points)), replace=False)]
    chosen = m + np.append(cKDTree(points).query(lloyd(points, first, 2))[1], np.argmin(drives[m:, TO_GO]))
    above = _put_together(parents, drives, np.unique(chosen), m, LONGEST_ARC * kind.radius)
    kept = sorted(above)
    number = {node: m + i for i, node in enumerate(kept)}
    return Reached(q[kept], np.array([number.get(above[node], above[node]) for node in kept], dtype=np.int64))


def _put_together(
    parents: NDArray[np.int32], drives: FloatArray, chosen: NDArray[np.int64], m: int, longest_arc: float
) -> dict[int, int]:
    """Return what chosen nodes and those that lead to them hang on, drives under one control put together."""
    above: dict[int, int] = {}
    for node in chosen.tolist():
        at = node
        while at >= m and at not in above:
            side, way, _ = drives[at]
            up, arc = int(parents[at]), abs(way)
            while up >= m and up not in above and drives[up, SIDE] == side and drives[up, WAY] * way > 0.0:
                arc += abs(drives[up, WAY])
                if side != 0.0 and arc > longest_arc:
                    break
                up = int(parents[up])
            above[at] = up
            at = up
    return above


# --- Growing, compiled.

SIDE, WAY, TO_GO = range(3)
"""What is known of a drive beside its cost: the side it turns to, metres driven, negative backwards, and the relaxed
cost to go, metres."""


class _Car(NamedTuple):
    """How a car moves whatever its metres are charged, the one-way zones that it minds, -1 if it drives to sources."""

    kind: Curve
    zones: OneWays
    sign: float


class _Guide(NamedTuple):
    """The relaxed problem's costs to go with their grid, metres, and the disc's centre in the robot's frame."""

    cost: FloatArray
    x0: float
    y0: float
    size: float
    center: FloatArray


@callee
def _cost_at(guide: _Guide, q: FloatArray) -> float:
    """Return the relaxed cost at the inscribed disc's centre; infinite outside of the grid."""
    c, s, (cx, cy) = cos(q[2]), sin(q[2]), guide.center
    column = floor((q[0] + c * cx - s * cy - guide.x0) / guide.size)
    row = floor((q[1] + s * cx + c * cy - guide.y0) / guide.size)
    if 0 <= row < guide.cost.shape[0] and 0 <= column < guide.cost.shape[1]:
        return float(guide.cost[row, column])
    return np.inf


@callee
def _cell_of(q: FloatArray, guide: _Guide, cell: float, columns: int, headings: int, layer: int) -> int:
    """Return the number of a configuration's cell, and of the direction in which it is reached."""
    column, row = floor((q[0] - guide.x0) / cell), floor((q[1] - guide.y0) / cell)
    heading = floor((q[2] + pi) * headings / (2.0 * pi))
    return int(((row * columns + column) * headings + heading) * 2 + layer)


@array_callee
def _free(car: _Car, scratch: Scratch, q: FloatArray, word: FloatArray, end: FloatArray) -> bool:
    """Return whether a word from q to ``end`` is certified, in the direction in which it is driven."""
    kind = car.kind
    if car.sign > 0.0:
        allowed = curve_allowed(car.zones, q, word, kind.radius)
    else:
        allowed = curve_allowed(car.zones, end, reversed_word(word), kind.radius)
    placed, queue = scratch.placed, scratch.queue
    if not allowed:
        return False
    return bool(curve_motion(kind.grid, kind.field, kind.robot, placed, queue, q, word, kind.radius, BUDGET) == FREE)


@njit(nogil=True)
def _grow(
    car: _Car, guide: _Guide, sources: FloatArray, step: float, most: int, deadline: Deadline
) -> tuple[FloatArray, NDArray[np.int32], FloatArray]:
    """Return nodes (n, 3), sources first, what each hangs on, -1 for sources, and by which drive (n, 3)."""
    m, kind, sign, scratch = len(sources), car.kind, car.sign, new_scratch(car.kind)
    radius, word, end, cell = kind.radius, np.zeros((2, PIECES)), np.empty(3), 0.5 * step
    charged = kind.direction_change > 0.0 or kind.reverse_metre > 0.0
    headings = max(8, min(1440, ceil(2.0 * pi * radius / cell)))
    columns = ceil(guide.cost.shape[1] * guide.size / cell) + 2
    labels = with_room(new_labels(1024, 3), m)
    for i in range(m):
        ahead = _cost_at(guide, sources[i])
        node = _cell_of(sources[i], guide, cell, columns, headings, 0)
        add_label(labels, entry_of(labels, node), node, -1, 0.0, GREED * ahead)
        labels.q[i] = sources[i]
        labels.more[i, SIDE], labels.more[i, WAY], labels.more[i, TO_GO] = 0.0, 0.0, ahead
    expanded = 0
    while labels.counts[WAITING] > 0 and labels.counts[COUNT] < m + most:
        labels = with_room(labels, 6)
        at = next_label(labels)
        if labels.keys[labels.counts[WAITING]] == np.inf:
            break
        if at < 0:
            continue
        here, driven, gear = labels.q[at], labels.cost[at], sign * labels.more[at, WAY]
        expanded += 1
        if expanded % CLOCK_EVERY == 0 and over(deadline):
            break
        for side in (0.0, 1.0, -1.0):
            for direction in (1.0, -1.0):
                if sign * direction < 0.0 and not kind.reverse:
                    continue
                way, metre = step, 1.0 + (kind.reverse_metre if sign * direction < 0.0 else 0.0)
                change = kind.direction_change if gear * sign * direction < 0.0 else 0.0
                for _ in range(4):
                    word[0, 0], word[1, 0] = direction * way / radius, side
                    walk(here, word, radius, way, end)
                    ahead, cost = _cost_at(guide, end), driven + change + way * metre
                    node = _cell_of(end, guide, cell, columns, headings, int(charged and direction > 0.0))
                    entry = entry_of(labels, node)
                    known = labels.table[entry]
                    if known >= 0 and labels.cost[known] <= cost:
                        break
                    if (
                        ahead < np.inf
                        and state(kind.grid, kind.field, kind.robot, scratch.placed, end[0], end[1], end[2]) == FREE
                        and _free(car, scratch, here, word, end)
                    ):
                        if known >= 0:
                            labels.closed[known] = 1
                        new = add_label(labels, entry, node, at, cost, cost + GREED * ahead)
                        labels.q[new] = end
                        labels.more[new, SIDE], labels.more[new, WAY] = side, direction * way
                        labels.more[new, TO_GO] = ahead
                        break
                    way *= 0.5
    n = labels.counts[COUNT]
    return labels.q[:n], labels.parent[:n], labels.more[:n]
