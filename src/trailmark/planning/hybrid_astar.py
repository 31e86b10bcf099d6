"""Hybrid A*: where a car gets to from given configurations by short drives to the left, straight on and to the right.

In a tight place a car gets on by many short drives to and fro, each of which depends on the one before: independent
samples hardly ever join there. So a tree of drives grows, every one of them certified, those first that promise to be
on the cheapest path; of the drives that lead to one cell of configurations in one direction the cheapest counts. After
hybrid A* (Dolgov, Thrun, Montemerlo & Diebel, "Practical search techniques in path planning for autonomous driving",
2008), with several sources, with the relaxed problem's costs as its guide, and with several targets, to which curves
lead now and then.
"""

from __future__ import annotations

from math import ceil, cos, floor, hypot, pi, sin
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.clock import CLOCK_EVERY, Deadline, over
from trailmark.collision.certify import BUDGET, curve_motion
from trailmark.collision.kernels import FREE, state
from trailmark.curves.shortest import all_words, curve_states
from trailmark.curves.words import PIECES, reversed_word, unit_length, walk
from trailmark.heap import COUNT, WAITING, add_label, entry_of, new_labels, next_label, with_room
from trailmark.jit import array_callee, callee, njit
from trailmark.landmarks.relaxation import CostMap, Relaxation
from trailmark.landmarks.sampling import lloyd
from trailmark.motion import Motion, WeightedMotion
from trailmark.motion.base import Scratch, new_scratch
from trailmark.motion.curve import Curve, word_extra
from trailmark.motion.one_way import OneWays, curve_allowed, one_ways
from trailmark.se2 import FloatArray

__all__ = ["Reached", "Targets", "drive_to", "hybrid_astar"]

FINEST = 0.005
"""Turning radii: drives that no shorter ones follow."""

LONGEST_ARC = 0.5 * pi
"""Radians: drives on one side are put together up to this arc, which is the shortest curve between its ends."""

GREED = 1.5
"""How much a metre still to go counts against one driven already."""

EVERY = 10
"""Expanded nodes for each from which curves to the targets are tried."""

MAX_TRIED = 3
"""Curves tried from a node to a target at most, the cheapest first."""


class Reached(NamedTuple):
    """Configurations that hang on sources, or on one another, by drives.

    Attributes:
        configurations: (n, 3), valid.
        parents: (n,): index of a source, or, from the number of sources on, of one of ``configurations``.
    """

    configurations: FloatArray
    parents: NDArray[np.int64]


class Targets(NamedTuple):
    """Configurations from which it is known how to go on.

    Attributes:
        configurations: (t, 3).
        costs: (t,) of going on from each, metres.
        gears: (t,) in which that begins: 1 forwards, -1 backwards, 0 for neither.
    """

    configurations: FloatArray
    costs: FloatArray
    gears: FloatArray


NO_TARGETS = Targets(np.empty((0, 3)), np.empty(0), np.empty(0))


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

    deadline, m = Deadline.after(seconds), len(sources)
    while True:
        options = step, 0.5 * step, NO_TARGETS, np.inf, most, deadline
        tree = _grown(motions, relaxation, costs, sources, reverse, *options)
        if len(tree.q) >= m + most or step <= FINEST * tree.radius or over(deadline):
            break
        # All cells that these drives lead to are entered: smaller ones may lead farther.
        step *= 0.5
    if len(tree.q) == m:
        return Reached(np.empty((0, 3)), np.empty(0, np.int64))
    points = se2.embed(tree.q[m:], tree.radius)
    first = points[rng.choice(len(points), min(landmarks, len(points)), replace=False)]
    chosen = m + np.unique(cKDTree(points).query(lloyd(points, first, 2))[1])
    return _joined(tree, np.unique(np.append(chosen, m + np.argmin(tree.drives[m:, TO_GO]))), m)


def drive_to(
    motions: Motion,
    relaxation: Relaxation,
    costs: CostMap,
    source: FloatArray,
    targets: Targets,
    *,
    reverse: bool,
    step: float,
    cell: float,
    most: int,
    limit: float,
    seconds: float,
) -> tuple[FloatArray, int]:
    """Return the knots of drives from a source to the best of some targets, shape (n, 3), and which it is.

    Args:
        motions: certifies the drives, and says what changes of direction cost.
        relaxation: the relaxed problem's grid.
        costs: its costs to where the drives should lead.
        source: valid configuration, shape (3,).
        targets: valid; what is known of going on from them.
        reverse: whether they lead from the target to the source; the knots are in that order then.
        step: longest drive, metres.
        cell: edge of a cell, metres.
        most: configurations reached at most.
        limit: maximum cost of the drives and of going on, metres.
        seconds: that the drives may take.

    Returns:
        Knots of shape (0, 3), and -1, if no target is reached below the limit. The curves between knots are to be
        certified anew: they are the drives but for rounding.
    """
    options = step, cell, targets, limit, most, Deadline.after(seconds)
    tree = _grown(motions, relaxation, costs, source[None], reverse, *options)
    if tree.node < 0:
        return np.empty((0, 3)), -1
    driven = _joined(tree, np.array([tree.node] if tree.node else [], np.int64), 1).configurations
    halves = np.repeat(0.5 * np.abs(tree.word[0]), 2)  # so that no arc is longer than a half of its circle
    along = tree.radius * np.cumsum(halves[halves > 0.0])[None, :-1]
    onward = curve_states(tree.q[tree.node][None], tree.word[None], tree.radius, along)[0]
    knots = np.concatenate([source[None], driven, onward, targets.configurations[tree.target][None]])
    return (knots[::-1].copy() if reverse else knots), int(tree.target)


class _Tree(NamedTuple):
    """Drives that hang on sources.

    Attributes:
        radius: in which the car turns, metres.
        q: (n, 3) nodes, sources first.
        parents: (n,), -1 of sources.
        drives: (n, 3): side, metres driven, negative backwards, and the relaxed cost to go, metres.
        node: from which the cheapest curve leads to a target; -1 if none does.
        target: to which it leads.
        word: (2, 5), that curve.
    """

    radius: float
    q: FloatArray
    parents: NDArray[np.int32]
    drives: FloatArray
    node: int
    target: int
    word: FloatArray


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


def _grown(
    motions: Motion, relaxation: Relaxation, costs: CostMap, sources: FloatArray, reverse: bool, *options: Any
) -> _Tree:
    """Return a tree of drives; the options are those of :func:`_grow`."""
    kind, zones = motions.kind, one_ways(())
    if isinstance(motions, WeightedMotion):
        kind, zones = motions.motion.kind, motions.kind.one_way
    guide = _Guide(costs.cost, float(relaxation.x0), float(relaxation.y0), float(relaxation.size), relaxation.center)
    car = _Car(kind, zones, -1.0 if reverse else 1.0)
    return _Tree(kind.radius, *_grow(car, guide, np.array(sources, order="C"), *options))


def _joined(tree: _Tree, chosen: NDArray[np.int64], m: int) -> Reached:
    """Return the chosen nodes and those that lead to them, with drives under one control put together."""
    above: dict[int, int] = {}
    for node in chosen.tolist():
        at = node
        while at >= m and at not in above:
            side, way, _ = tree.drives[at]
            up, arc = int(tree.parents[at]), abs(way)
            while up >= m and up not in above and tree.drives[up, SIDE] == side and tree.drives[up, WAY] * way > 0.0:
                arc += abs(tree.drives[up, WAY])
                if side != 0.0 and arc > LONGEST_ARC * tree.radius:
                    break
                up = int(tree.parents[up])
            above[at] = up
            at = up
    kept = sorted(above)
    number = {node: m + i for i, node in enumerate(kept)}
    return Reached(tree.q[kept], np.array([number.get(above[node], above[node]) for node in kept], dtype=np.int64))


# --- Growing, compiled.

SIDE, WAY, TO_GO = range(3)
"""What is known of a drive beside its cost: as :class:`_Tree` has it."""


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


@array_callee
def _word_to(
    car: _Car, scratch: Scratch, q: FloatArray, gear: float, targets: Targets, t: int, limit: float
) -> tuple[float, int]:
    """Return the cost of the cheapest certified word from q to a target, and its number; infinite if none is found.

    The words of the scratch memory are then those that lead from q.
    """
    kind, words = car.kind, scratch.words
    n, swapped = all_words(q, targets.configurations[t], kind.radius, kind.reverse, words)
    prices = np.empty(n)
    for k in range(n):
        if swapped:
            words[k] = reversed_word(words[k])
        words[k, 0] *= car.sign
        more, last = word_extra(words[k], kind.radius, kind.direction_change, kind.reverse_metre, gear)
        words[k, 0] *= car.sign
        change = kind.direction_change if last * targets.gears[t] < 0 else 0.0
        prices[k] = kind.radius * unit_length(words[k]) + more + change
    for _ in range(MAX_TRIED):
        k = int(np.argmin(prices))
        if prices[k] >= limit:
            break
        if _free(car, scratch, q, words[k], targets.configurations[t]):
            return prices[k], k
        prices[k] = np.inf
    return np.inf, -1


@njit(nogil=True)
def _grow(
    car: _Car,
    guide: _Guide,
    sources: FloatArray,
    step: float,
    cell: float,
    targets: Targets,
    limit: float,
    most: int,
    deadline: Deadline,
) -> tuple[FloatArray, NDArray[np.int32], FloatArray, int, int, FloatArray]:
    """Return what :class:`_Tree` holds beside the radius; the arguments are those of :func:`drive_to`."""
    m, kind, sign, scratch = len(sources), car.kind, car.sign, new_scratch(car.kind)
    radius, word, end = kind.radius, np.zeros((2, PIECES)), np.empty(3)
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
    expanded, best, best_label, best_target, best_word = 0, limit, -1, -1, np.zeros((2, PIECES))
    while labels.counts[WAITING] > 0 and labels.counts[COUNT] < m + most:
        labels = with_room(labels, 6)
        at = next_label(labels)
        if labels.keys[labels.counts[WAITING]] >= best:
            break
        if at < 0:
            continue
        here, driven, gear = labels.q[at], labels.cost[at], sign * labels.more[at, WAY]
        if expanded % EVERY == 0:
            for t in range(len(targets.costs)):
                target, beyond = targets.configurations[t], driven + targets.costs[t]
                if beyond + hypot(target[0] - here[0], target[1] - here[1]) < best:
                    price, k = _word_to(car, scratch, here, gear, targets, t, best - beyond)
                    if k >= 0:
                        best, best_label, best_target = beyond + price, at, t
                        best_word[:] = scratch.words[k]
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
                        cost + ahead < best
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
    return labels.q[:n], labels.parent[:n], labels.more[:n], best_label, best_target, best_word
