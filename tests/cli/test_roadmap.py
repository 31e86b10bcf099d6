"""``trailmark roadmap``: what it writes is what others read."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import networkx as nx
import numpy as np
import pytest

from trailmark import StateChecker, World
from trailmark.roadmap import Roadmap, read_route_graph

Shell = Callable[..., Any]


@pytest.mark.slow
def test_each_format_holds_the_same_roadmap(shell: Shell, yard: Path, tmp_path: Path) -> None:
    records = []
    for suffix in ("geojson", "graphml", "npz") * 2:  # the second time each is written again
        file = tmp_path / f"graph.{suffix}"
        run = shell("roadmap", yard, "-k", 40, "--seed", 3, "--output", file, "--json")
        assert (run.status, run.err) == (0, "")
        records.append(json.loads(run.out))
    assert all(record | {"time": 0} == records[0] | {"time": 0} for record in records)
    record = records[0]
    assert record["world"] == "yard"
    assert record["landmarks"] >= 40

    world = World.load(yard)
    loaded = Roadmap.load(tmp_path / "graph.npz", StateChecker(world, world.robot))
    assert len(loaded) == record["landmarks"]
    assert int(loaded.certified.sum()) == record["edges"]
    graph = nx.read_graphml(tmp_path / "graph.graphml", node_type=int)
    assert (len(graph), graph.number_of_edges()) == (record["landmarks"], record["edges"])
    assert all(certified for _, _, certified in graph.edges(data="certified"))
    route = read_route_graph(tmp_path / "graph.geojson")
    assert route.number_of_edges() == 2 * record["edges"]
    for node, position in route.nodes(data="position"):
        assert np.array_equal(loaded.configurations[node, :2], position)


def test_a_car_s_roadmap_and_the_frames_name(shell: Shell, yard: Path, tmp_path: Path) -> None:
    words = ["roadmap", yard, "-k", 10, "--turning-radius", 0.5, "--output"]
    assert "turning radius 0.5 m" in shell(*words, tmp_path / "graph.graphml").out
    run = shell(*words, tmp_path / "graph.geojson")
    assert "expected straight motions for a route graph, got a car's curves" in run.problem
    assert (run.status, (tmp_path / "graph.geojson").exists()) == (2, False)
    assert shell("roadmap", yard, "-k", 10, "--frame-id", "odom", "--output", tmp_path / "a.geojson").status == 0
    assert '"frame": "odom"' in (tmp_path / "a.geojson").read_text()
