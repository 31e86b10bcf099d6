"""Shortest paths over a roadmap whose edges are checked only when the search needs them.

Source: Cohen, Phillips & Likhachev, "Planning single-arm manipulations with n-arm robots", RSS 2014 (Lazy
Weighted A*, here with weight 1): an edge is checked when it leaves the queue, not when it enters it.
"""

from __future__ import annotations

from math import hypot, sqrt
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.clock import CLOCK_EVERY, Deadline, over
from trailmark.collision.certify import BUDGET
from trailmark.collision.kernels import BLOCKED, FREE, UNDECIDED
from trailmark.errors import ConfigurationError
from trailmark.heap import heap_grow, heap_pop, heap_push
from trailmark.jit import array_callee, callee, njit
from trailmark.motion.base import certified, charged, extra, new_scratch
from trailmark.roadmap.adjacency import root_of
from trailmark.roadmap.insertion import JOINED, joinable_nodes
from trailmark.roadmap.store import Store
from trailmark.se2 import FloatArray

__all__ = [
    "UNBOUNDED",
    "EndNodes",
    "FoundPath",
    "Search",
    "edges_near",
    "few_boxes",
    "join_end",
    "nodes_near",
    "only",
    "search",
    "search_between",
    "without_repetitions",
]

UNBOUNDED = 1 << 62
"""A budget without bounds."""

LATER = 1e-9
"""Metres by which a path must cost more than was thought to wait in the queue again."""


class Search(NamedTuple):
    """The result of a search between nodes.

    Attributes:
        nodes: (p,) the path's nodes from start to goal; empty if there is none.
        reached: (n,) bool, the nodes reached by certified motions from the start; without a path and a limit,
            all that can be reached.
        expanded: nodes and undecided edges that left the queue.
    """

    nodes: NDArray[np.int64]
    reached: NDArray[np.bool_]
    expanded: int


class FoundPath(NamedTuple):
    """The result of a search between configurations.

    Attributes:
        states: (p, 3) of a path of certified motions, ends included; (0, 3) if none was found.
        expanded: motions checked, nodes and undecided edges that left the queue.
        complete: whether a larger budget would have found no more.
    """

    states: FloatArray
    expanded: int
    complete: bool


class EndNodes(NamedTuple):
    """Nodes at which a path may begin, or end.

    Attributes:
        nodes: (e,).
        costs: (e,) from the query's start to each, or from each to the query's goal, metres.
    """

    nodes: NDArray[np.int64]
    costs: FloatArray


def only(node: int | None) -> EndNodes:
    """Return one node as the only end, at no cost; none for None."""
    nodes = np.array([] if node is None else [node], dtype=np.int64)
    return EndNodes(nodes, np.zeros(len(nodes)))


def search(
    store: Store,
    starts: EndNodes,
    goals: EndNodes,
    to_go: FloatArray,
    *,
    banned: NDArray[np.bool_] | None = None,
    limit: float = np.inf,
    budget: int = UNBOUNDED,
    seconds: float = np.inf,
    checking: bool = True,
    reverse: bool = False,
) -> Search:
    """Search a roadmap; the arguments are those of :func:`lazy_shortest_path`.

    Raises:
        ConfigurationError: ``to_go`` or ``banned`` of another length than there are nodes.
    """
    arrays = store.arrays()
    n = len(arrays.configurations)
    excluded = np.zeros(n, np.bool_) if banned is None else banned
    # Compiled code would read beyond the end of a shorter array.
    for name, rows in (("to_go", to_go), ("banned", excluded)):
        if np.shape(rows) != (n,):
            raise ConfigurationError(f"{name}: expected shape ({n},), one value for each node, got {np.shape(rows)}")
    found = lazy_shortest_path(
        store.motion.kind,
        arrays.configurations,
        arrays.incoming if reverse else arrays.outgoing,
        arrays.older,
        arrays.edges,
        arrays.lengths,
        arrays.status,
        *starts,
        *goals,
        to_go,
        excluded,
        float(limit),
        budget,
        Deadline.after(seconds),
        checking,
    )
    return Search(*found)


def join_end(store: Store, q: FloatArray, neighbours: int, *, reverse: bool) -> EndNodes:
    """Return the nodes near a configuration that certified motions join to it.

    Args:
        store: the roadmap's.
        q: valid, shape (3,).
        neighbours: how many nodes are tried until enough are joined.
        reverse: whether the motions lead to ``q`` instead of from it.
    """
    nodes, motion = store.nodes.view, store.motion
    neighbours = min(len(nodes), neighbours)
    found = joinable_nodes(motion.kind, nodes, store.index().forest(), q, neighbours, JOINED, reverse)
    return EndNodes(found, motion.costs(nodes[found], q) if reverse else motion.costs(q, nodes[found]))


def search_between(
    store: Store,
    start: FloatArray,
    goal: FloatArray,
    weight: float,
    limit: float,
    budget: int,
    seconds: float,
    checking: bool,
    neighbours: int,
) -> FoundPath:
    """Search between configurations, which are joined to nodes near them; the roadmap's method describes the arguments.

    See :meth:`trailmark.roadmap.Roadmap.find_path`.
    """
    q = store.nodes.view
    starts, goals = (
        join_end(store, end, neighbours, reverse=reverse) for end, reverse in ((start, False), (goal, True))
    )
    tried = 2 * min(len(q), neighbours)
    if len(starts.nodes) == 0 or len(goals.nodes) == 0:
        return FoundPath(q[:0], tried, complete=True)
    if not checking:
        parents = store.component_parents()
        if {root_of(parents, i) for i in starts.nodes}.isdisjoint(root_of(parents, i) for i in goals.nodes):
            return FoundPath(q[:0], tried, complete=False)
    to_go = weight * np.hypot(*(q[:, :2] - goal[:2]).T)
    begin = perf_counter()
    found = search(store, starts, goals, to_go, limit=limit, budget=budget, seconds=seconds, checking=checking)
    ended = found.expanded < budget and perf_counter() - begin < seconds
    complete = len(found.nodes) > 0 or (checking and ended)
    states = np.vstack([start, q[found.nodes], goal]) if len(found.nodes) else q[:0]
    # An end may be a node.
    return FoundPath(without_repetitions(states), tried + found.expanded, complete)


def without_repetitions(states: FloatArray) -> FloatArray:
    """Return the states, shape (m, 3), without those that equal the one before."""
    return states[np.append(True, (states[1:] != states[:-1]).any(axis=1))] if len(states) else states


@njit(nogil=True)
def lazy_shortest_path(
    kind: Any,
    configurations: FloatArray,
    newest: NDArray[np.int64],
    older: NDArray[np.int64],
    edges: NDArray[np.int32],
    cost: FloatArray,
    status: NDArray[np.uint8],
    starts: NDArray[np.int64],
    start_costs: FloatArray,
    goals: NDArray[np.int64],
    goal_costs: FloatArray,
    to_go: FloatArray,
    banned: NDArray[np.bool_],
    limit: float,
    budget: int,
    deadline: Deadline,
    checking: bool,
) -> tuple[NDArray[np.int64], NDArray[np.bool_], int]:
    """Return the nodes of the shortest certified path, the nodes that were reached, and how many were expanded.

    The path is empty if there is none below ``limit``, or the budget or the time is used up. What a car is charged for
    changes of direction counts as it comes to each node on the path that reached the node first: another may be as
    cheap there and go on in the other direction at a lower cost.

    Args:
        kind: of motion that edges are (:mod:`trailmark.motion.base`).
        configurations: (n, 3) nodes.
        newest: (n,) newest entry of each node (:mod:`trailmark.roadmap.adjacency`): among those that leave it, or among
            those that lead to it to search in the reverse direction.
        older: (2 m,) next older entry of the same node.
        edges: (m, 2) nodes joined; of directed edges from, to.
        cost: (m,) length of each edge.
        status: (m,) FREE, BLOCKED or UNDECIDED; undecided edges that the search needs are checked and marked.
        starts: (s,) nodes that the path may begin at.
        start_costs: (s,) cost to reach each of them.
        goals: (g,) nodes that it may end at; without any, the search reaches all that it can.
        goal_costs: (g,) cost from each of them to the end.
        to_go: (n,) lower estimate of the cost from each node to the end, ``goal_costs`` included.
        banned: (n,) nodes not to be used.
        limit: longest cost of interest.
        budget: maximum number of nodes and undecided edges that leave the queue.
        deadline: when the search ends at the latest.
        checking: whether undecided edges are checked; otherwise only edges known to be free are used.
    """
    n = len(configurations)
    scratch = new_scratch(kind)
    done = np.zeros(n, np.bool_)
    best, parent = np.full(n, np.inf), np.full(n, -1, np.int64)
    left, charging = np.full(n, np.inf), charged(kind)
    gears = np.zeros(n if charging else 0)
    for i in range(len(goals)):
        left[goals[i]] = min(left[goals[i]], goal_costs[i])
    keys, values = np.empty(1024), np.empty(1024, np.int64)
    # A value in the queue is an entry, or -1 - i for the i-th of ``starts``.
    size = 0
    for i in range(len(starts)):
        if size == len(keys):
            keys, values = heap_grow(keys, values)
        size = heap_push(keys, values, size, start_costs[i] + to_go[starts[i]], -1 - i)
    end, total, expanded, steps = -1, limit, 0, 0
    while size > 0 and expanded < budget:
        steps += 1
        if steps % CLOCK_EVERY == 0 and over(deadline):
            break
        size = heap_pop(keys, values, size)
        entry = values[size]
        if keys[size] >= total:
            break
        node, reached, back = 0, 0.0, -1
        if entry < 0:
            node, reached = starts[-1 - entry], start_costs[-1 - entry]
            if done[node]:
                continue
        else:
            edge = entry >> 1
            back, node = edges[edge, entry & 1], edges[edge, 1 - (entry & 1)]
            if done[node]:
                continue
            if status[edge] == UNDECIDED:
                expanded += 1
                a, b = configurations[edges[edge, 0]], configurations[edges[edge, 1]]
                status[edge] = FREE if certified(kind, scratch, a, b, BUDGET) else BLOCKED
            if status[edge] != FREE:
                continue
            reached = best[back] + cost[edge]
            if charging:
                more, gear = extra(kind, scratch, configurations[back], configurations[node], gears[back])
                # What an edge is charged beyond its own cost is computed only once it leaves the queue.
                if reached + more + to_go[node] > keys[size] + LATER:
                    size = heap_push(keys, values, size, reached + more + to_go[node], entry)
                    continue
                reached, gears[node] = reached + more, gear
        expanded += 1
        parent[node], done[node], best[node] = back, True, reached
        if reached + left[node] < total:
            end, total = node, reached + left[node]
        entry = newest[node]
        while entry >= 0:
            edge = entry >> 1
            if status[edge] == FREE or (checking and status[edge] != BLOCKED):
                other = edges[edge, 1 - (entry & 1)]
                key = reached + cost[edge] + to_go[other]
                if key < total and not (done[other] or banned[other]):
                    if size == len(keys):
                        keys, values = heap_grow(keys, values)
                    size = heap_push(keys, values, size, key, entry)
            entry = older[entry]
    return trace_back(parent, end), done, expanded


@array_callee
def trace_back(parent: NDArray[np.int64], end: int) -> NDArray[np.int64]:
    """Return the nodes of the path that the parents describe, from its first to ``end``; none if ``end`` is -1."""
    length, node = 0, end
    while node >= 0:
        node, length = parent[node], length + 1
    path = np.empty(length, np.int64)
    node = end
    for i in range(length - 1, -1, -1):
        path[i] = node
        node = parent[node]
    return path


# --- Which nodes and edges of a roadmap a changed obstacle may touch.

MANY = 32
"""Boxes from which on some that lie together are taken for one: each is compared with every edge."""

SLACK = 1e-6
"""Metres, and share of a length, by which distances may be wrong; counted as near."""


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


@callee
def _distance(x: float, y: float, box: FloatArray) -> float:
    """Return the distance (metres) of a point from a box xmin, ymin, xmax, ymax; 0 inside it."""
    return hypot(max(box[0] - x, 0.0, x - box[2]), max(box[1] - y, 0.0, y - box[3]))


@njit(nogil=True)
def nodes_near(q: FloatArray, reach: float, boxes: FloatArray) -> NDArray[np.bool_]:
    """Return in which configurations, shape (n, 3), the robot may touch one of the boxes, shape (n,).

    Args:
        q: shape (n, 3).
        reach: metres from the reference point to the robot's farthest point.
        boxes: (b, 4), xmin, ymin, xmax, ymax, metres.
    """
    found = np.zeros(len(q), np.bool_)
    for i in range(len(q)):
        for box in boxes:
            if _distance(q[i, 0], q[i, 1], box) <= reach + SLACK * (1.0 + reach):
                found[i] = True
                break
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
            distance[i] = _distance(q[i, 0], q[i, 1], box)
        for i in range(len(edges)):
            if among[i] and not found[i]:
                most = lengths[i] + 2.0 * reach
                found[i] = distance[edges[i, 0]] + distance[edges[i, 1]] <= most + SLACK * (1.0 + most)
    return found
