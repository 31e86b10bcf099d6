"""Shortest ways in polygons, against visibility graphs by shapely and networkx."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import networkx as nx
import numpy as np
import pytest
import shapely
from tests.helpers.random_worlds import random_world
from tests.support.trials import few, trials

from trailmark.planning.proofs import mesh as meshes
from trailmark.planning.proofs.mesh import Mesh, locate
from trailmark.planning.proofs.polyanya import shortest_point_path
from trailmark.planning.proofs.region import free_region


def triangulated(polygon: Any) -> Mesh:
    mesh = meshes.triangulated(polygon)
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
    mesh = triangulated(polygon)
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


def test_ends_at_vertices_and_on_edges() -> None:
    block = shapely.box(0, 0, 10, 10).difference(shapely.box(4, 0, 6, 8))
    mesh = triangulated(block)
    for start, goal, length in (
        ((4.0, 8.0), (6.0, 8.0), 2.0),
        ((0.0, 0.0), (10.0, 0.0), 2.0 * np.hypot(4, 8) + 2.0),
        ((4.0, 4.0), (6.0, 4.0), 10.0),
        ((0.0, 5.0), (0.0, 9.0), 4.0),
        ((2.0, 2.0), (2.0, 2.0), 0.0),
        ((0.0, 8.0), (10.0, 8.0), 10.0),
    ):
        found, _ = shortest_point_path(mesh, np.array(start), np.array(goal))
        assert found == pytest.approx(length, abs=1e-9)


def test_what_lies_outside_has_no_way() -> None:
    mesh = triangulated(shapely.box(0, 0, 1, 1))
    assert locate(mesh, np.array([2.0, 0.5])) == -1
    length, way = shortest_point_path(mesh, np.array([2.0, 0.5]), np.array([0.5, 0.5]))
    assert length == np.inf
    assert len(way) == 0


def test_neighbours_know_each_other_and_corners_are_reflex() -> None:
    mesh = triangulated(shapely.box(0, 0, 10, 10).difference(shapely.box(4, 4, 6, 6)))
    for t, row in enumerate(mesh.neighbours):
        for i, other in enumerate(row):
            if other >= 0:
                assert t in mesh.neighbours[other]
                edge = {int(mesh.triangles[t, i]), int(mesh.triangles[t, (i + 1) % 3])}
                assert edge <= set(mesh.triangles[other].tolist())
    corners = {tuple(p) for p in mesh.points[mesh.corner].tolist()}
    assert corners == {(4.0, 4.0), (4.0, 6.0), (6.0, 4.0), (6.0, 6.0)}


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
        mesh = triangulated(polygon)
        for (start, goal), known in zip(pairwise(q), by_visibility(polygon, q), strict=True):
            length, _ = shortest_point_path(mesh, start, goal)
            assert length == pytest.approx(known, rel=1e-8, abs=1e-9 * offset + 1e-9)
            pairs += 1
    assert pairs > few(20)
