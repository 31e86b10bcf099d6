"""What users ask the commands for: via points, starts in collision, unknown cells, route graphs, nav2's parameters."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from trailmark import Goal, World, check_path
from trailmark.formats.path_files import write_path
from trailmark.roadmap import read_route_graph

Shell = Callable[..., Any]
ENDS = ("--start", "1,1,0", "--goal", "9,5,1.5")


def plan(shell: Shell, *words: Any, status: int = 0) -> dict[str, Any]:
    run = shell("plan", *words, "--time-limit", 1, "--json")
    assert run.status == status, run.err
    record: dict[str, Any] = json.loads(run.out)
    return record


@pytest.mark.slow
def test_via_points_are_passed_in_their_order(shell: Shell, yard: Path) -> None:
    record = plan(shell, yard, *ENDS, "--via", "1.5,3.5", "--via", "5,1,0.5")
    states, at = np.array(record["states"]), []
    for place in ((1.5, 3.5), (5.0, 1.0)):
        off = np.abs(states[:, :2] - place).max(axis=1)
        assert off.min() < 1e-9
        at.append(int(off.argmin()))
    assert at == sorted(at)
    assert [leg["status"] for leg in record["legs"]] == ["solved"] * 3
    assert sum(leg["cost"] for leg in record["legs"]) == pytest.approx(record["cost"])
    assert check_path(World.load(yard), World.load(yard).robot, states).free
    failed = plan(shell, yard, *ENDS, "--via", "5,3", status=4)  # in an obstacle
    assert failed["reason"].startswith("leg 1 of 2, from start to via point 1: ")
    assert "legs  " in shell("plan", yard, *ENDS, "--via", "1.5,3.5", "--time-limit", 1).out


@pytest.mark.slow
def test_a_start_in_collision_is_left_first(shell: Shell, yard: Path) -> None:
    words = (yard, "--start", "0.3,1,0", "--goal", "9,5,1.5")
    run = shell("plan", *words)
    assert run.status == 2
    assert "reaches 0.1 m over the left bound; the way out is 0.1 m long" in run.problem
    record = plan(shell, *words, "--escape")
    assert (record["status"], record["escape"], record["lower_bound"]) == ("solved", 1, None)


@pytest.mark.slow
def test_either_heading_of_the_goal_will_do(shell: Shell, yard: Path) -> None:
    words = (yard, "--turning-radius", 0.6, "--forward-only", "--start", "8,1,3.14159", "--goal", "2,1,0")
    cost = plan(shell, *words, "--bidirectional")["cost"]
    assert cost == pytest.approx(6.0, rel=1e-3)


@pytest.fixture
def map_file(tmp_path: Path) -> Path:
    pixels = np.full((40, 100), 254, np.uint8)
    pixels[:, 45:55] = 205
    Image.fromarray(pixels).save(tmp_path / "map.png")
    text = "image: map.png\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.15\n"
    (tmp_path / "map.yaml").write_text(text)
    return tmp_path / "map.yaml"


ACROSS = ("--robot", "disc:0.3", "--start", "1,2,0", "--goal", "9,2,0")


@pytest.mark.slow
def test_unknown_cells_are_blocked_free_or_at_a_price(shell: Shell, map_file: Path, yard: Path) -> None:
    assert plan(shell, map_file, *ACROSS, status=4)["status"] == "infeasible"
    costs = [plan(shell, map_file, *ACROSS, "--unknown", word)["cost"] for word in ("free", "3")]
    assert costs == pytest.approx([8.0, 10.0], rel=1e-3)
    assert plan(shell, map_file, *ACROSS, "--unknown", "blocked", status=4)["states"] == []
    assert "expected blocked, free, or a factor" in shell("plan", map_file, *ACROSS, "--unknown", "maybe").problem
    assert "expected a nav2 map" in shell("plan", yard, "--unknown", "free").problem


@pytest.mark.slow
def test_nav2s_own_parameters(shell: Shell, map_file: Path) -> None:
    file = map_file.with_name("nav2_params.yaml")
    costmap = "robot_radius: 0.3, footprint_padding: 0.02"
    planner = "planner_plugins: [Grid], Grid: {plugin: navfn, tolerance: 0.5, allow_unknown: true}"
    file.write_text(
        f"global_costmap: {{global_costmap: {{ros__parameters: {{{costmap}}}}}}}\n"
        f"planner_server: {{ros__parameters: {{{planner}}}}}\n"
    )
    record = plan(shell, map_file, "--nav2-params", file, "--start", "1,2,0", "--goal", "9,2,0")
    assert (record["clearance"], record["cost"]) == (0.02, pytest.approx(8.0))
    assert "global_costmap.global_costmap.robot_radius 0.3" in record["nav2_params"]
    # Its tolerance is for goals that are not free.
    near = plan(shell, map_file, "--nav2-params", file, "--start", "1,2,0", "--goal", "9.8,2,0")
    x, y, _ = near["states"][-1]
    assert Goal((9.8, 2.0), position_tolerance=0.5).contains([x, y, 0.0])
    assert shell("plan", map_file, "--nav2-params", map_file, *ACROSS[2:]).status == 2


@pytest.mark.slow
def test_a_route_graph_is_driven_where_it_is_free(shell: Shell, yard: Path, tmp_path: Path) -> None:
    places = {1: (1.0, 1.0), 2: (9.0, 1.0), 3: (9.0, 5.0), 4: (1.0, 3.0), 5: (9.0, 3.0)}
    edges = {10: (1, 2), 11: (2, 3), 12: (4, 5)}  # the last leads through an obstacle
    features: list[Any] = [
        {"type": "Feature", "properties": {"id": i}, "geometry": {"type": "Point", "coordinates": at}}
        for i, at in places.items()
    ]
    for i, (a, b) in edges.items():
        line = {"type": "MultiLineString", "coordinates": [[places[a], places[b]]]}
        features.append({"type": "Feature", "properties": {"id": i, "startid": a, "endid": b}, "geometry": line})
    file = tmp_path / "graph.geojson"
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    run = shell("plan", yard, *ENDS, "--route-graph", file, "--json")
    record = json.loads(run.out)
    assert record["route"] == {"nodes": [1, 2, 3], "colliding": [12]}
    assert "the robot collides along the edges 12" in run.err
    assert shell("plan", yard, *ENDS, "--route-graph", file, "--via", "1.5,3.5").status == 2


@pytest.mark.slow
def test_polygons_keep_out_and_the_same_options_hold_elsewhere(shell: Shell, yard: Path, tmp_path: Path) -> None:
    zones, path, graph = (tmp_path / name for name in ("zones.wkt", "path.csv", "graph.geojson"))
    zones.write_text("POLYGON ((4 0, 6 0, 6 2.2, 4 2.2, 4 0))")
    write_path(path, np.array([[1.0, 1.0, 0.0], [9.0, 1.0, 0.0]]))
    assert shell("check", yard, path).status == 0
    assert shell("check", yard, path, "--keepout", zones).status == 5
    near = shell("check", yard, path, "--clearance", 0.9, "--json")
    assert (near.status, json.loads(near.out)["keeps_clearance"], json.loads(near.out)["free"]) == (5, False, True)
    free = np.array(plan(shell, yard, *ENDS)["states"])
    around = np.array(plan(shell, yard, *ENDS, "--keepout", zones)["states"])
    assert np.abs(free[:, 1]).max() > 0.0
    assert not ((around[:, 0] > 4.0) & (around[:, 0] < 6.0) & (around[:, 1] < 2.2)).any()
    assert shell("roadmap", yard, "--clearance", 0.3, "--keepout", zones, "-k", 30, "--output", graph).status == 0
    for _, at in read_route_graph(graph).nodes(data="position"):
        assert not (3.7 < at[0] < 6.3 and at[1] < 2.5)


@pytest.mark.slow
def test_a_dash_prints_the_result(shell: Shell, yard: Path) -> None:
    run = shell("plan", yard, "--time-limit", 0.2, "--output", "-")
    assert (run.status, json.loads(run.out)["status"]) == (0, "solved")


@pytest.mark.slow
def test_a_discs_path_may_be_positions_alone(shell: Shell, yard: Path, tmp_path: Path) -> None:
    (tmp_path / "path.csv").write_text("x,y\n1,1\n9,1\n")
    assert shell("check", yard, tmp_path / "path.csv", "--robot", "disc:0.3").status == 0
    refused = shell("check", yard, tmp_path / "path.csv")
    assert (refused.status, "is no disc; got x, y alone" in refused.problem) == (2, True)
