"""Meshes fill their polygons, whatever lies in a row or touches; what does not is no mesh."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import shapely

from trailmark.planning.proofs.mesh import Mesh, locate, triangulated
from trailmark.planning.proofs.polyanya import shortest_point_path


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
