"""benchmarks/kmeans*.py: roadmaps of points against networkx, and what the page says of figures that are made up."""

from __future__ import annotations

from typing import Any

import networkx as nx
import numpy as np
import pytest
from benchmarks.kmeans_report import _counts, _many, _narrow
from benchmarks.kmeans_roadmaps import NEAREST, PlainRoadmap, placed_roadmap
from benchmarks.placements import PLACEMENTS, UNIFORM

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.landmarks import free_samples
from trailmark.shapes import Rectangle
from trailmark.world import Robot, World


@pytest.fixture(scope="module")
def checker() -> StateChecker:
    wall = Rectangle((5.0, 2.0), 0.4, 4.0)
    return StateChecker(World("room", (0.0, 0.0, 10.0, 6.0), (wall,), Robot.rectangle(0.6, 0.4)))


@pytest.mark.slow
def test_queries_cost_what_networkx_finds(checker: StateChecker) -> None:
    roadmap = placed_roadmap(checker, PLACEMENTS[UNIFORM], 40, seed=1)
    assert len(roadmap.nodes) == roadmap.k == 40
    queries = free_samples(checker, 60, random_state=3).reshape(-1, 2, 3)
    costs = roadmap.costs(checker, queries)
    for query, cost in zip(queries, costs, strict=True):
        graph = nx.Graph()
        for a, b in roadmap.edges:
            graph.add_edge(int(a), int(b), weight=float(se2.distance(roadmap.nodes[a], roadmap.nodes[b])))
        for end, q in zip(("start", "goal"), query, strict=True):
            graph.add_node(end)
            apart = se2.distance(q, roadmap.nodes)
            for i in np.argsort(apart, kind="stable")[:NEAREST]:
                if checker.motions_between_valid(q[None], roadmap.nodes[i][None])[0]:
                    graph.add_edge(end, int(i), weight=float(apart[i]))
        if checker.motions_between_valid(query[:1], query[1:])[0]:
            graph.add_edge("start", "goal", weight=float(se2.distance(*query)))
        wanted = (
            nx.shortest_path_length(graph, "start", "goal", "weight") if nx.has_path(graph, "start", "goal") else np.inf
        )
        assert cost == pytest.approx(wanted)
    assert np.isfinite(costs).any()


def test_a_roadmap_without_motions_answers_straight_queries_alone(checker: StateChecker) -> None:
    roadmap = PlainRoadmap(1, np.array([[1.0, 1.0, 0.0]]), np.empty((0, 2), np.int64), 0.0)
    ends = np.array([[[1.0, 3.0, 0.0], [2.0, 3.0, 0.0]], [[1.0, 1.0, 0.0], [9.0, 1.0, 0.0]]])
    assert roadmap.costs(checker, ends).tolist() == [1.0, np.inf]


@pytest.mark.parametrize(
    ("only", "verdict"),
    [
        ((9, 0), "`roadmap` solves more, beyond chance"),
        ((0, 9), "`roadmap-uniform` solves more"),
        ((3, 2), "do not solve"),
    ],
)
def test_chance_is_told_from_a_difference(only: tuple[int, int], verdict: str) -> None:
    rows = [
        {"problem": "p", "seed": i, "roadmap": i < only[0], "roadmap-uniform": i >= only[0]} for i in range(sum(only))
    ]
    assert verdict in " ".join(_narrow(rows))


def test_tables_count_what_is_solved_and_compare_costs() -> None:
    about: dict[str, Any] = {"problem": "p", "group": "worlds", "seed": 0, "k": 50, "seconds": 0.01}
    rows = [{**about, "planner": "roadmap", "cost": 10.0}, {**about, "planner": "PRM", "cost": 12.0}]
    rows += [
        {**about, "seed": 1, "planner": "roadmap", "cost": 10.0},
        {**about, "seed": 1, "planner": "PRM", "cost": None},
    ]
    text = "\n".join(_counts(rows))
    assert "| 50 | 100%    | 50%" in text
    assert "| 50 | 1.000   | 1.200" in text
    many = [
        {
            "problem": "w",
            "seed": 0,
            "k": 50,
            "nodes": "PRM",
            "queries": 7,
            "success": 0.5,
            "over_best": 1.1,
            "seconds": 1.0,
        }
    ]
    assert "| 50 | 50.0% |" in "\n".join(_many(many))
