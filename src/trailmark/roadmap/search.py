"""Shortest paths over a graph of motions, which are checked only when the search needs them.

Source: Cohen, Phillips & Likhachev, "Planning single-arm manipulations with n-arm robots", RSS 2014 (Lazy
Weighted A*): an edge is checked when it leaves the queue, not when it enters it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark import se2
from trailmark.clock import CLOCK_EVERY, Deadline, over
from trailmark.collision.certify import BUDGET
from trailmark.collision.kernels import BLOCKED, FREE, UNDECIDED
from trailmark.errors import ConfigurationError
from trailmark.heap import heap_grow, heap_pop, heap_push
from trailmark.jit import njit
from trailmark.motion import Motion
from trailmark.motion.base import certified, charged, cost, extra, new_scratch
from trailmark.se2 import FloatArray

__all__ = [
    "JOINED",
    "UNBOUNDED",
    "EndNodes",
    "FoundPath",
    "Graph",
    "Links",
    "Search",
    "join",
    "links_of",
    "only",
    "require_nodes",
    "search",
    "tree_of",
    "without_repetitions",
]

UNBOUNDED = 1 << 62
"""A budget without bounds."""

JOINED = 3
"""Nodes that an end of a query is joined to."""

LATER = 1e-9
"""Metres by which a path must cost more than was thought to wait in the queue again."""


class Links(NamedTuple):
    """Edges by the node that they leave: a compressed sparse row matrix.

    Attributes:
        start: (n + 1,) where each node's links begin.
        node: (l,) int32, where each leads to.
        edge: (l,) int32, which edge it is.
        length: (l,) metres.
    """

    start: NDArray[np.int64]
    node: NDArray[np.int32]
    edge: NDArray[np.int32]
    length: FloatArray


class Graph(NamedTuple):
    """What a search reads.

    Attributes:
        motion: what edges are.
        configurations: (n, 3) nodes.
        edges: (m, 2) nodes joined; of directed edges from, to.
        status: (m,) FREE, BLOCKED or UNDECIDED; what a search finds out is written here.
        links: of these edges.
        tree: of the nodes: :func:`tree_of`.
    """

    motion: Motion
    configurations: FloatArray
    edges: NDArray[np.int32]
    status: NDArray[np.uint8]
    links: Links
    tree: Any


class EndNodes(NamedTuple):
    """Nodes at which a path may begin, or end.

    Attributes:
        nodes: (e,).
        costs: (e,) from the query's start to each, or from each to the query's goal, metres.
    """

    nodes: NDArray[np.int64]
    costs: FloatArray


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


def links_of(n: int, edges: NDArray[np.int32], lengths: FloatArray, directed: bool) -> Links:
    """Return the links of n nodes along edges, shape (m, 2), of lengths (m,), both ways unless they are directed."""
    # Compiled code gives back plain tuples: a signal may arrive while they are made.
    return Links(*_rows(n, edges, lengths, 1 if directed else 2))


@njit(nogil=True)
def _rows(n: int, edges: NDArray[np.int32], lengths: FloatArray, sides: int) -> tuple[NDArray[Any], ...]:
    """Return the parts of :class:`Links`."""
    start = np.zeros(n + 1, np.int64)
    for i in range(len(edges)):
        for side in range(sides):
            start[edges[i, side] + 1] += 1
    start = np.cumsum(start)
    place, count = start[:-1].copy(), start[-1]
    node, edge, length = np.empty(count, np.int32), np.empty(count, np.int32), np.empty(count)
    for i in range(len(edges)):
        for side in range(sides):
            k = place[edges[i, side]]
            place[edges[i, side]] = k + 1
            node[k], edge[k], length[k] = edges[i, 1 - side], i, lengths[i]
    return start, node, edge, length


def tree_of(q: FloatArray, radius: float) -> Any:
    """Return a ``scipy.spatial.cKDTree`` of configurations in the embedding (:func:`trailmark.se2.embed`)."""
    from scipy.spatial import cKDTree

    # Built in a fraction of the time that a balanced one takes, and hardly slower to ask.
    return cKDTree(se2.embed(q, radius), balanced_tree=False, compact_nodes=False)


def only(node: int | None) -> EndNodes:
    """Return one node as the only end, at no cost; none for None."""
    nodes = np.array([] if node is None else [node], dtype=np.int64)
    return EndNodes(nodes, np.zeros(len(nodes)))


def join(graph: Graph, q: FloatArray, tried: int, enough: int = JOINED, *, reverse: bool = False) -> EndNodes:
    """Return the nodes near a configuration that certified motions join to it.

    Args:
        graph: whose nodes.
        q: valid, shape (3,).
        tried: how many of the nearest nodes are tried until enough are joined.
        enough: how many are joined at most.
        reverse: whether the motions lead to ``q`` instead of from it.
    """
    kind, tried = graph.motion.kind, min(tried, len(graph.configurations))
    if tried == 0:
        return only(None)
    near = graph.tree.query(se2.embed(q, graph.motion.radius), np.arange(1, tried + 1))[1]
    # A copy: a path's states are read-only, which numba would take for another type and compile anew for.
    return EndNodes(*_joined(kind, graph.configurations, near, np.array(q), enough, reverse))


def search(
    graph: Graph,
    starts: EndNodes,
    goals: EndNodes,
    to_go: FloatArray,
    *,
    banned: NDArray[np.bool_] | None = None,
    limit: float = np.inf,
    budget: int = UNBOUNDED,
    seconds: float = np.inf,
    checking: bool = True,
) -> Search:
    """Return the shortest certified path between nodes; undecided edges that it needs are checked and marked.

    Args:
        graph: to search.
        starts: where the path may begin.
        goals: where it may end; without any, the search reaches all that it can.
        to_go: (n,) lower estimate of the cost from each node to the end, the goals' costs included; with a factor above
            1, the path costs at most so many times the shortest, and is found sooner.
        banned: (n,) nodes not to be used.
        limit: longest cost of interest, with a factor of its estimate.
        budget: maximum number of nodes and undecided edges that leave the queue.
        seconds: time limit.
        checking: whether undecided edges are checked; otherwise only edges known to be free are used.

    Raises:
        ConfigurationError: ``to_go`` or ``banned`` of another length than there are nodes.
    """
    motion, q, edges, status, links, _ = graph
    excluded = np.zeros(len(q), np.bool_) if banned is None else banned
    # Compiled code would read beyond the end of a shorter array.
    for name, rows in (("to_go", to_go), ("banned", excluded)):
        if np.shape(rows) != (len(q),):
            raise ConfigurationError(f"{name}: expected shape ({len(q)},), one for each node, got {np.shape(rows)}")
    limits = float(limit), budget, Deadline.after(seconds), checking
    arguments: tuple[Any, ...] = motion.kind, q, edges, status, links, *starts, *goals, to_go, excluded, *limits
    end, parent, reached, expanded = lazy_shortest_path(*arguments)
    nodes = []
    while end >= 0:
        nodes.append(end)
        end = parent[end]
    return Search(np.array(nodes[::-1], dtype=np.int64), reached, expanded)


def without_repetitions(states: FloatArray) -> FloatArray:
    """Return the states, shape (m, 3), without those that equal the one before."""
    return states[np.append(True, (states[1:] != states[:-1]).any(axis=1))] if len(states) else states


def require_nodes(nodes: ArrayLike, n: int) -> None:
    """Raise a ConfigurationError unless all nodes exist, of n."""
    numbers = np.asarray(nodes)
    wrong = numbers[(numbers < 0) | (numbers >= n)]
    if len(wrong):
        raise ConfigurationError(f"node: expected 0 or more, below {n}, got {wrong[0]}")


@njit(nogil=True)
def _joined(
    kind: Any, configurations: FloatArray, near: NDArray[np.int64], q: FloatArray, enough: int, reverse: bool
) -> tuple[NDArray[np.int64], FloatArray]:
    """Return the nodes, of those near q the first ``enough``, that certified motions join to it, and their costs."""
    scratch, nodes, costs, count = new_scratch(kind), np.empty(enough, np.int64), np.empty(enough), 0
    for node in near:
        other = configurations[node]
        a, b = (other, q) if reverse else (q, other)
        if certified(kind, scratch, a, b, BUDGET):
            nodes[count], costs[count] = node, cost(kind, scratch, a, b)
            count += 1
            if count == enough:
                break
    return nodes[:count], costs[:count]


@njit(nogil=True)
def lazy_shortest_path(
    kind: Any,
    configurations: FloatArray,
    edges: NDArray[np.int32],
    status: NDArray[np.uint8],
    links: Links,
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
) -> tuple[int, NDArray[np.int64], NDArray[np.bool_], int]:
    """Return the last node of the shortest certified path, each node's parent, the nodes reached, how many expanded.

    The last node is -1 if there is no path. What a car is charged for changes of direction counts as it comes to each
    node on the path that reached the node first: another may be as cheap there and go on in the other direction at a
    lower cost.
    """
    n = len(configurations)
    scratch, charging = new_scratch(kind), charged(kind)
    done = np.zeros(n, np.bool_)
    # Known to be reached at this cost, over free edges.
    best, parent = np.full(n, np.inf), np.full(n, -1, np.int64)
    left, gears = np.full(n, np.inf), np.zeros(n if charging else 0)
    for i in range(len(goals)):
        left[goals[i]] = min(left[goals[i]], goal_costs[i])
    keys, values = np.empty(1024), np.empty(1024, np.int64)
    # A value in the queue is a link, or -1 - i for the i-th of ``starts``.
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
        link = values[size]
        if keys[size] >= total:
            break
        back, node = -1, starts[-1 - link] if link < 0 else np.int64(links.node[link])
        if done[node]:
            continue
        if link < 0:
            reached = start_costs[-1 - link]
        else:
            edge = links.edge[link]
            a, b = edges[edge, 0], edges[edge, 1]
            if status[edge] == UNDECIDED:
                expanded += 1
                free = certified(kind, scratch, configurations[a], configurations[b], BUDGET)
                status[edge] = FREE if free else BLOCKED
            if status[edge] != FREE:
                continue
            back = a + b - node
            reached = best[back] + links.length[link]
            if charging:
                more, gear = extra(kind, scratch, configurations[back], configurations[node], gears[back])
                # What an edge is charged beyond its own cost is computed only once it leaves the queue.
                if reached + more + to_go[node] > keys[size] + LATER:
                    size = heap_push(keys, values, size, reached + more + to_go[node], link)
                    continue
                reached, gears[node] = reached + more, gear
        expanded += 1
        parent[node], done[node], best[node] = back, True, reached
        if reached + left[node] < total:
            end, total = int(node), reached + left[node]
        for k in range(links.start[node], links.start[node + 1]):
            other, through = links.node[k], reached + links.length[k]
            if done[other] or banned[other] or through + to_go[other] >= total or through >= best[other]:
                continue
            state = status[links.edge[k]]
            if state == BLOCKED or (state != FREE and not checking):
                continue
            if state == FREE and not charging:
                best[other] = through
            if size == len(keys):
                keys, values = heap_grow(keys, values)
            size = heap_push(keys, values, size, through + to_go[other], k)
    return end, parent, done, expanded
