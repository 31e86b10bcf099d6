"""Arrays to OMPL's states, paths and planner data, and back."""

from __future__ import annotations

import math
from typing import Any

import pytest


def test_states_and_paths_there_and_back(run_ompl: Any) -> None:
    found = run_ompl("""
si = SE2Problem(shipped("office")).information
rng = np.random.default_rng(0)
q = rng.uniform((0, 0, -3.14), (20, 12, 3.14), (100, 3))
back = np.array([configuration(state(si, row)) for row in q])
path = states_of(path_to_ompl(si, q))
half = states_of(path_to_ompl(si, [[1.0, 1.0, np.pi / 2], [1.0, 1.0, -np.pi / 2], [2.0, 1.0, -np.pi / 2]]))
tell(half=half[:, 2].tolist())
one = state(si, q[0])
write_state(one, (1.0, 2.0, 3.0 * np.pi))
tell(states=bool((back == q).all()), path=bool((path == q).all()), wrapped=configuration(one).tolist(),
     length=path_to_ompl(si, q).length(), ours=float(sum(
        np.hypot(*(b - a)[:2]) + 0.5 * abs((b[2] - a[2] + np.pi) % (2 * np.pi) - np.pi) for a, b in zip(q, q[1:]))))
try:
    state(si, (1.0, float("nan"), 0.0))
except Exception as error:
    tell(error=type(error).__name__)
""")
    assert found["states"]
    assert found["path"]
    assert found["wrapped"][:2] == [1.0, 2.0]
    assert abs(abs(found["wrapped"][2]) - 3.141592653589793) < 1e-12
    assert abs(found["length"] - found["ours"]) < 1e-9
    assert found["error"] == "ConfigurationError"
    # Half a turn back is turned as it was certified: counter-clockwise, by way of pi.
    assert len(found["half"]) == 4
    assert abs(found["half"][1]) == pytest.approx(math.pi)


def test_planner_data_becomes_a_graph(run_ompl: Any) -> None:
    found = run_ompl(
        """
problem = SE2Problem(shipped("office"))
problem.set_planner("PRM")
for _ in range(50):  # a busy machine needs longer
    if problem.solve(0.2).asString() == "Exact solution":
        break
graph = problem.graph()
import networkx as nx
start = next(n for n, d in graph.nodes(data=True) if d["start"])
goal = next(n for n, d in graph.nodes(data=True) if d["goal"])
ends = [list(graph.nodes[n]["configuration"]) for n in (start, goal)]
lengths = [d["length"] for _, _, d in graph.edges(data=True)]
from trailmark import se2
true = [float(se2.distance(np.array(graph.nodes[a]["configuration"]), np.array(graph.nodes[b]["configuration"])))
        for a, b in graph.edges]
tell(ends=ends, wanted=[problem.start.tolist(), problem.goal.tolist()], joined=nx.has_path(graph, start, goal),
     edges=len(lengths), worst=max(abs(a - b) for a, b in zip(lengths, true)))
"""
    )
    assert found["ends"] == found["wanted"]
    assert found["joined"]
    assert found["edges"] > 10
    assert found["worst"] < 1e-9
