"""Paths on a route graph drawn by hand: its edges are certified for the robot, then the cheapest way over it is taken.

The robot drives each edge in the edge's direction and turns in place at nodes. Start and goal are joined to the nodes
near them by one motion each or, where none is free, by a query of their own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import ArrayLike

from trailmark.arguments import brief, checked, one_of, shaped
from trailmark.errors import ConfigurationError
from trailmark.planning.incumbent import Budget, Incumbent, vertices_of
from trailmark.planning.model import WorldModel
from trailmark.planning.pipeline import plan_single
from trailmark.planning.result import PlanResult
from trailmark.se2 import FloatArray
from trailmark.trajectories import path_of

if TYPE_CHECKING:
    import networkx as nx

__all__ = ["RouteResult", "plan_on_route"]

NEAREST, QUERIES = 24, 4
"""Ends of edges near start and goal that one motion is tried to, and that are planned to where there is none."""

Motions = dict[tuple[Any, Any], FloatArray]
"""States, shape (n, 3), from one node of the search to another."""


@dataclass(frozen=True, repr=False)
class RouteResult(PlanResult):
    """The answer to a query on a route graph.

    Attributes:
        nodes: that the path leads over, by their ids.
        colliding: ids of the edges along which the robot would collide; none of them is driven.
    """

    nodes: tuple[int, ...] = ()
    colliding: tuple[int, ...] = ()

    def to_dict(self, world: str, query: str | None = None) -> dict[str, Any]:
        """Return the record that ``plan --json`` prints, with the route."""
        route = {"nodes": list(self.nodes), "colliding": list(self.colliding)}
        return {**super().to_dict(world, query), "route": route}


def plan_on_route(
    model: WorldModel, graph: nx.DiGraph, start: ArrayLike, goal: ArrayLike, budget: Budget
) -> RouteResult:
    """Return the cheapest path over a route graph (:func:`trailmark.read_route_graph`); the caller holds the lock.

    Raises:
        ConfigurationError: start or goal is not valid; the graph has no edge, or a node without a position; or the
            robot is a car, which cannot turn at a node.
    """
    import networkx as nx

    one_of(graph, nx.DiGraph, "route graph:", hint=" (trailmark.roadmap.read_route_graph reads one)")
    robot, motion, ends = model.checker.robot, model.motion, model.valid_pair(start, goal)
    if robot.turning_radius is not None:
        raise ConfigurationError(f"route graph: expected a robot that turns in place, got {robot.describe()}")
    xy, where = Annotated[ArrayLike, shaped(2)], "route graph: node {}: position"
    placed = graph.nodes(data="position")
    at = {node: checked(q, xy, where.format(brief(node)), ConfigurationError) for node, q in placed}
    every = enumerate(graph.edges(data=True))
    edges = [(a, b, each.get("id", i)) for i, (a, b, each) in every if (at[a] != at[b]).any()]
    if not edges:
        raise ConfigurationError("route graph: expected one edge or more, got none")
    places = np.array([[at[node] for node in edge[:2]] for edge in edges])
    way = places[:, 1] - places[:, 0]
    heading = np.repeat(np.arctan2(way[:, 1], way[:, 0])[:, None], 2, axis=1)
    tails, heads = np.moveaxis(np.dstack([places, heading]), 1, 0)
    free = motion.motions_valid(tails, heads)
    colliding = tuple(edges[i][2] for i in np.flatnonzero(~free))
    known: Motions = {(("tail", i), ("head", i)): np.array([tails[i], heads[i]]) for i in np.flatnonzero(free)}
    known |= _turns(model, [edge[:2] for edge in edges], tails, heads, free)
    joins = [
        _joins(model, name, q, rows, np.flatnonzero(free), budget)
        for name, q, rows in (("start", ends[0], tails), ("goal", ends[1], heads))
    ]
    nodes: tuple[int, ...] = ()
    incumbent, path, reason = Incumbent(motion, ends[0], ends[1], budget.begin), None, ""
    known |= joins[0] | joins[1]
    steps = _cheapest(model, known)
    if steps is None:
        name = next((name for name, each in zip(("start", "goal"), joins, strict=True) if not each), None)
        reason = f"the {name} cannot be joined to the graph" if name else "no free edges lead from start to goal"
    else:
        states = np.vstack([known[pair][int(k > 0) :] for k, pair in enumerate(pairwise(steps))])
        states = states[np.r_[True, (np.diff(states, axis=0) != 0.0).any(axis=1)]]
        nodes = (*(edges[i][0] for kind, i in steps[1:-1] if kind == "tail"), edges[steps[-2][1]][1])
        incumbent.offer(states if motion.turns else states * [1.0, 1.0, 0.0])
        path = path_of(motion, motion.whole_states(states, ends[0], ends[1]))
        if not model.verification.certified(path, ends):
            path, nodes, reason = None, (), "the path did not pass the final check"
    made = model.verification.result(incumbent, "timeout" if path is None else "solved", path, model.shared.roadmap)
    fields = {**made.__dict__, "lower_bound": motion.least_cost(ends[0], ends[1]), "reason": reason}
    return RouteResult(**fields, nodes=nodes, colliding=colliding)


def _cheapest(model: WorldModel, known: Motions) -> list[Any] | None:
    """Return the nodes of the cheapest way from start to goal; None if there is none."""
    import networkx as nx

    lines = nx.DiGraph()
    for (a, b), states in known.items():
        lines.add_edge(a, b, cost=_cost(model, states))
    try:
        return nx.dijkstra_path(lines, "start", "goal", weight="cost")  # type: ignore[no-any-return]
    except (nx.NetworkXNoPath, nx.NodeNotFound):
        return None


def _turns(model: WorldModel, edges: list[tuple[int, int]], tails: FloatArray, heads: FloatArray, free: Any) -> Motions:
    """Return the turns from one free edge's direction to the next one's at each node."""
    out: dict[int, list[int]] = {}
    for i in np.flatnonzero(free).tolist():
        out.setdefault(edges[i][0], []).append(i)
    pairs = [(i, k) for i in np.flatnonzero(free).tolist() for k in out.get(edges[i][1], [])]
    if not pairs:
        return {}
    ends, begins = heads[[i for i, _ in pairs]], tails[[k for _, k in pairs]]
    valid = model.motion.motions_valid(ends, begins)
    turns = zip(pairs, ends, begins, valid, strict=True)
    return {(("head", i), ("tail", k)): np.array([a, b]) for (i, k), a, b, each in turns if each}


def _joins(model: WorldModel, name: str, q: FloatArray, rows: FloatArray, free: Any, budget: Budget) -> Motions:
    """Return ways from the start to the tails of free edges at the nearest node there is one to, or from heads there.

    A graph is drawn to be followed: a motion to a node far away might cut it short.
    """
    away = np.hypot(*(rows[:, :2] - q[:2]).T)
    order = free[np.argsort(away[free], kind="stable")][:NEAREST]
    here = np.repeat(q[None], len(order), axis=0)
    a, b = (here, rows[order]) if name == "start" else (rows[order], here)
    valid = model.motion.motions_valid(a, b) if len(order) else np.zeros(0, np.bool_)
    nearest = away[order[valid]].min(initial=np.inf) * (1.0 + 1e-9)
    ways = zip(order.tolist(), a, b, valid & (away[order] <= nearest), strict=True)
    found = {i: np.array(pair) for i, *pair, each in ways if each}
    if not found:
        found = dict(_planned(model, name, q, rows, order[:QUERIES].tolist(), budget))
    if name == "start":
        return {("start", ("tail", i)): states for i, states in found.items()}
    return {(("head", i), "goal"): states for i, states in found.items()}


def _planned(
    model: WorldModel, name: str, q: FloatArray, rows: FloatArray, which: list[int], budget: Budget
) -> Iterator[tuple[int, FloatArray]]:
    """Yield a way that is planned, to the nearest end of an edge to which there is one."""
    for k, i in enumerate(which):
        part = budget.part(budget.seconds_left() / (len(which) - k), np.inf)
        a, b = (q, rows[i]) if name == "start" else (rows[i], q)
        if model.checker.valid(rows[i]) and (path := plan_single(model, a, b, part).path) is not None:
            yield i, np.array(path.states)
            return


def _cost(model: WorldModel, states: FloatArray) -> float:
    motion = model.motion
    rows = vertices_of(motion, path_of(motion, states))
    return motion.whole_cost(motion.cost_of(rows), states[0], states[-1])
