"""Meshes fill their polygons, whatever lies in a row or touches; shortest ways in them, against visibility graphs."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import networkx as nx
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.helpers.oracles import sign_of_turn
from tests.helpers.trials import few, trials
from tests.helpers.worlds import random_world

from trailmark.proofs.mesh import Mesh, locate, orientation, orientations, shortest_point_path, triangulated
from trailmark.proofs.region import free_region


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1.0, 1e3, 1e6, 1e7]), st.integers(0, 8))
@settings(max_examples=few(200), deadline=None)
def test_the_sign_is_exact(seed: int, offset: float, ulps: int) -> None:
    rng = np.random.default_rng(seed)
    a, d = rng.uniform(-1.0, 1.0, (2, 2)) + offset
    shares = rng.choice([0.0, 0.25, 0.5, 1.0, 2.0, rng.uniform(-2.0, 3.0)], 2)
    b, c = a + shares[0] * (d - a), a + shares[1] * (d - a)
    c = c + rng.integers(-ulps, ulps + 1, 2) * np.spacing(c)
    for p, q, r in ((a, b, c), (b, c, a), (c, b, a), (a, a, b)):
        assert np.sign(orientation(*p, *q, *r)) == sign_of_turn(p, q, r)
        points = np.array([p, q, r])
        assert np.sign(orientations(points, np.array([[0, 1, 2]])))[0] == sign_of_turn(p, q, r)


def judge(mesh: Mesh, polygon: shapely.Polygon) -> None:
    """Areas add up, no triangle is turned over, neighbours know each other, boundary edges are the polygon's."""
    a, b, c = (mesh.points[mesh.triangles[:, i]] for i in range(3))
    doubled = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    size = np.abs(mesh.points).max()
    assert doubled.min() >= -1e-14 * size * size
    assert 0.5 * doubled.sum() == pytest.approx(polygon.area, rel=1e-9)
    for t, row in enumerate(mesh.neighbours):
        for i, other in enumerate(row):
            if other >= 0:
                shared = {int(mesh.triangles[t, i]), int(mesh.triangles[t, (i + 1) % 3])}
                assert t in mesh.neighbours[other]
                assert shared <= set(mesh.triangles[other].tolist())
    edges = {tuple(sorted(map(tuple, mesh.points[e].tolist()))) for e in mesh.edges}
    wanted = set()
    for ring in shapely.get_rings(polygon):
        points = shapely.get_coordinates(ring).tolist()
        wanted |= {tuple(sorted((tuple(p), tuple(q)))) for p, q in pairwise(points)}
    assert edges == wanted


@pytest.mark.parametrize("heading", [0.0, 0.3, 0.7, 2.0])
@pytest.mark.parametrize("offset", [0.0, 1e3, 1e6])
def test_vertices_in_a_row_make_flat_triangles_and_no_harm(heading: float, offset: float) -> None:
    c, s = np.cos(heading), np.sin(heading)
    turn = np.array([[c, s], [-s, c]])
    x = np.linspace(0.0, 10.0, 21)
    for thick in (0.0, 1e-9, 1.0):
        ring = np.array([*zip(x, 0.0 * x, strict=True), *zip(x[::-1], 0.0 * x + 4.0, strict=True)])
        hole = np.array([*zip(x[3:8], 0.0 * x[3:8] + 2.0 + thick, strict=True), (5.0, 1.0)])
        polygon = shapely.Polygon(ring @ turn + offset, [hole @ turn + offset])
        mesh = triangulated(polygon)
        assert mesh is not None
        judge(mesh, polygon)
        ends = np.array([(1.0, 1.9), (9.0, 1.9)]) @ turn + offset
        length, way = shortest_point_path(mesh, *ends)
        assert 8.0 - 1e-6 <= length < 8.3
        assert np.hypot(*np.diff(way, axis=0).T).sum() == pytest.approx(length, abs=1e-9 * max(1.0, offset))


def test_holes_that_touch_the_outline_or_each_other() -> None:
    # As overlays make them: where they touch, both have a vertex.
    outline = [(0, 0), (10, 0), (10, 5), (10, 10), (0, 10), (0, 5)]
    for holes in (
        [[(0, 5), (2, 4), (2, 6)]],
        [[(2, 2), (4, 4), (2, 6)], [(4, 4), (6, 2), (6, 6)]],
        [[(10, 5), (8, 4), (8, 6)], [(8, 4), (6, 3), (6, 5)]],
    ):
        polygon = shapely.Polygon(outline, holes)
        mesh = triangulated(polygon)
        assert mesh is not None
        judge(mesh, polygon)
        assert locate(mesh, np.array([5.0, 9.0])) >= 0
        assert locate(mesh, np.array(shapely.Polygon(holes[0]).centroid.coords[0])) == -1


def test_a_mesh_that_does_not_fill_its_polygon_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    square = shapely.box(0.0, 0.0, 4.0, 4.0)
    whole = shapely.constrained_delaunay_triangles(square)
    first, second = shapely.get_parts(whole)
    flat = shapely.Polygon([(0, 0), (2, 2), (4, 4)])
    wrong = {
        "one left out": [first],
        "one twice": [first, second, second],
        "none": [],
        "turned over": [first, shapely.reverse(second)],
        "one too many": [first, second, flat],
        "another": [first, shapely.Polygon([(9, 9), (9, 8), (8, 9)])],
    }
    assert triangulated(square) is not None
    for name, parts in wrong.items():
        monkeypatch.setattr(shapely, "constrained_delaunay_triangles", lambda _, p=parts: shapely.GeometryCollection(p))
        assert triangulated(square) is None, name


def meshed(polygon: Any) -> Mesh:
    mesh = triangulated(polygon)
    assert mesh is not None
    return mesh


def by_visibility(polygon: Any, places: np.ndarray) -> list[float]:
    """Return the lengths of the shortest paths from each place to the next, over all straight lines that stay inside.

    They join vertices and places; no shortest path bends at a place.
    """
    points = np.array([*places, *np.unique(shapely.get_coordinates(polygon), axis=0)])
    i, j = np.triu_indices(len(points), 1)
    lines = shapely.linestrings(np.stack([points[i], points[j]], axis=1))
    inside = shapely.covers(polygon.buffer(1e-9 * max(1.0, 1e-3 * float(np.abs(points).max()))), lines)
    graph = nx.Graph()
    lengths = np.hypot(*(points[i] - points[j]).T)
    graph.add_weighted_edges_from(zip(i[inside].tolist(), j[inside].tolist(), lengths[inside].tolist(), strict=True))
    return [float(nx.dijkstra_path_length(graph, k, k + 1)) for k in range(len(places) - 1)]


@pytest.mark.parametrize("seed", trials(12, of=2))
def test_lengths_are_those_of_the_visibility_graph(seed: int) -> None:
    world = random_world(seed, 6 + seed % 10, size=10.0, radii=(0.3, 1.5), discs=0.0, holes=0.3, boundary=seed % 3 == 0)
    polygon = max(shapely.get_parts(free_region(world, 0.0)), key=shapely.area)
    mesh = meshed(polygon)
    assert sum(shapely.Polygon(mesh.points[t]).area for t in mesh.triangles) == pytest.approx(polygon.area)
    rng = np.random.default_rng(seed)
    q = rng.uniform(0.0, 10.0, (400, 2))
    q = q[shapely.contains_xy(polygon, q)][:7]
    roomy = shapely.buffer(polygon, 1e-9)
    for (start, goal), known in zip(pairwise(q), by_visibility(polygon, q), strict=True):
        length, way = shortest_point_path(mesh, start, goal)
        assert length == pytest.approx(known, abs=1e-9)
        assert np.hypot(*np.diff(way, axis=0).T).sum() == pytest.approx(length, abs=1e-9)
        assert (way[0] == start).all()
        assert (way[-1] == goal).all()
        assert shapely.covers(roomy, shapely.LineString(way))


@pytest.mark.parametrize("offset", [0.0, 1e3, 1e5])
def test_many_vertices_in_a_row_turned_and_moved(offset: float) -> None:
    # Unit cells and lattice triangles: on paper most vertices lie in rows, as doubles beside them.
    pairs = 0
    for seed in trials(25):
        rng = np.random.default_rng(seed)
        cells = [shapely.box(x, y, x + 1, y + 1) for x in range(8) for y in range(8) if rng.random() < 0.25]
        corners = rng.integers(0, 9, (2, 3, 2))
        triangles = [t for t in map(shapely.Polygon, corners.astype(float)) if t.area > 0.0]
        region = shapely.difference(shapely.box(0, 0, 8, 8), shapely.union_all(cells + triangles))
        part = max(shapely.get_parts(region), key=shapely.area)
        angle, scale = seed * 0.7, (1.0, 0.1, 1.0 / 3.0)[seed % 3]
        turn = scale * np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        polygon = shapely.transform(part, lambda points, turn=turn: points @ turn + offset)
        own = [len(ring.coords) - 1 for ring in shapely.get_rings(polygon)]
        if not polygon.is_valid or sum(own) != len(np.unique(shapely.get_coordinates(polygon), axis=0)):
            # Where it touches itself, a mesh has no way and a visibility graph has.
            continue
        q = rng.uniform(0.0, 8.0, (60, 2))
        q = q[shapely.contains_xy(shapely.buffer(part, -1e-3), q)][:4] @ turn + offset
        mesh = meshed(polygon)
        for (start, goal), known in zip(pairwise(q), by_visibility(polygon, q), strict=True):
            length, _ = shortest_point_path(mesh, start, goal)
            assert length == pytest.approx(known, rel=1e-8, abs=1e-9 * offset + 1e-9)
            pairs += 1
    assert pairs > few(20)
