"""Hybrid A*: where a car gets to from given configurations by short drives to the left, straight on and to the right.

In a tight place a car gets on by many short drives to and fro, each of which depends on the one before: independent
samples hardly ever join there. So a tree of drives grows, every one of them certified, those first that promise to be
on the cheapest path; of the drives that lead to one cell of configurations in one direction the cheapest counts. After
hybrid A* (Dolgov, Thrun, Montemerlo & Diebel, "Practical search techniques in path planning for autonomous driving",
2008), with several sources, with the relaxed problem's costs as its guide, and with several targets, to which curves
lead now and then.
"""

from __future__ import annotations

from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.clock import Deadline
from trailmark.curves.shortest import curve_states
from trailmark.landmarks.kmeans import lloyd
from trailmark.landmarks.relaxation import CostMap, Relaxation
from trailmark.motion import Motion
from trailmark.nearest import nearest_to
from trailmark.planning.drive_tree import NO_TARGETS, Guide, Targets, Tree, grow

__all__ = ["Reached", "drive_to", "hybrid_astar"]

FINEST = 0.005
"""Turning radii: drives that no shorter ones follow."""

LONGEST_ARC = 0.5 * pi
"""Radians: drives on one side are put together up to this arc, which is the shortest curve between its ends."""


class Reached(NamedTuple):
    """Configurations that hang on sources, or on one another, by drives.

    Attributes:
        configurations: (n, 3), valid.
        parents: (n,): index of a source, or, from the number of sources on, of one of ``configurations``.
    """

    configurations: se2.FloatArray
    parents: NDArray[np.int64]


def hybrid_astar(
    motions: Motion,
    relaxation: Relaxation,
    costs: CostMap,
    sources: se2.FloatArray,
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
    kind, deadline, m = motions.kind, Deadline.after(seconds), len(sources)
    guide, starts = _guide(relaxation, costs), np.array(sources, order="C")
    while True:
        tree = Tree(*grow(kind, guide, starts, reverse, step, 0.5 * step, NO_TARGETS, np.inf, most, deadline))
        if len(tree.q) >= m + most or step <= FINEST * kind.radius or deadline.shown[0]:
            break
        # All cells that these drives lead to are entered: smaller ones may lead farther.
        step *= 0.5
    if len(tree.q) == m:
        return Reached(np.empty((0, 3)), np.empty(0, np.int64))
    points = se2.embed(tree.q[m:], kind.radius)
    first = points[rng.choice(len(points), min(landmarks, len(points)), replace=False)]
    chosen = m + np.unique(nearest_to(lloyd(points, first, 2), points))
    return _joined(tree, np.unique(np.append(chosen, m + np.argmin(tree.to_go[m:]))), m, kind.radius)


def drive_to(
    motions: Motion,
    relaxation: Relaxation,
    costs: CostMap,
    source: se2.FloatArray,
    targets: Targets,
    *,
    reverse: bool,
    step: float,
    cell: float,
    most: int,
    limit: float,
    seconds: float,
) -> tuple[se2.FloatArray, int]:
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
    kind, guide, sources = motions.kind, _guide(relaxation, costs), np.array(source[None], order="C")
    tree = Tree(*grow(kind, guide, sources, reverse, step, cell, targets, limit, most, Deadline.after(seconds)))
    if tree.node < 0:
        return np.empty((0, 3)), -1
    driven = _joined(tree, np.array([tree.node] if tree.node else [], np.int64), 1, kind.radius).configurations
    pieces = np.abs(tree.word[0])
    halves = np.repeat(0.5 * pieces, 2)  # so that no arc is longer than a half of its circle
    along = kind.radius * np.cumsum(halves[halves > 0.0])[None, :-1]
    onward = curve_states(tree.q[tree.node][None], tree.word[None], kind.radius, along)[0]
    knots = np.concatenate([sources, driven, onward, targets.configurations[tree.target][None]])
    return (knots[::-1].copy() if reverse else knots), int(tree.target)


def _guide(relaxation: Relaxation, costs: CostMap) -> Guide:
    return Guide(costs.cost, float(relaxation.x0), float(relaxation.y0), float(relaxation.size), relaxation.center)


def _joined(tree: Tree, chosen: NDArray[np.int64], m: int, radius: float) -> Reached:
    """Return the chosen nodes and those that lead to them, with drives under one control put together."""
    q, parents, controls = tree.q, tree.parents, tree.controls
    above: dict[int, int] = {}
    for node in chosen.tolist():
        at = node
        while at >= m and at not in above:
            side, way = controls[at]
            up, arc = int(parents[at]), abs(way)
            while up >= m and up not in above and controls[up, 0] == side and controls[up, 1] * way > 0.0:
                arc += abs(controls[up, 1])
                if side != 0.0 and arc > LONGEST_ARC * radius:
                    break
                up = int(parents[up])
            above[at] = up
            at = up
    kept = sorted(above)
    number = {node: m + i for i, node in enumerate(kept)}
    return Reached(q[kept], np.array([number.get(above[node], above[node]) for node in kept], dtype=np.int64))
