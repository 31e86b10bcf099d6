"""Collada meshes (``.dae``, version 1.4): what OMPL.app's problems need of them.

Read are the geometries that the file's scene places, through its nodes and their transforms; materials, cameras,
animations and skins are passed over. Coordinates come out with y up, as Assimp (OMPL.app's reader) turns them; lengths
stay in the file's own unit.

pycollada is no help: it rounds coordinates to single precision, takes negative indices, and reads all else in a file.

Source: Khronos, COLLADA 1.4.1 specification.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from trailmark.errors import FormatError
from trailmark.formats.xml_file import local_name, read_xml
from trailmark.shapes import LIMIT

__all__ = ["MAX_FACES", "Mesh", "read_collada"]

MAX_FACES = 500_000
"""Largest number of nodes and faces of a scene, each counted as often as instances place it."""

_MAX_DEPTH = 64

FloatArray = NDArray[np.float64]


class Mesh(NamedTuple):
    """The faces of a scene, y up.

    Attributes:
        triangles: shape (n, 3, 3).
        polygons: the faces with more corners, each of shape (k, 3).
        vertices: shape (m, 3); the vertices that a renderer would need: for each group of faces (or lines) of one
            material, one for each different combination of position, normal and other per-corner data.
    """

    triangles: FloatArray
    polygons: tuple[FloatArray, ...]
    vertices: FloatArray


def read_collada(path: Path) -> Mesh:
    """Return the mesh of a Collada file.

    Raises:
        FormatError: the file is missing, not XML, has a document type (entities are never expanded), is not Collada,
            refers to what it does not hold, or holds no face.
    """
    root = read_xml(path)
    if local_name(root) != "COLLADA":
        raise FormatError(path, f"root element: expected <COLLADA>, got <{local_name(root)}>")
    try:
        return _Reader(root).scene()
    except _ColladaError as error:
        raise FormatError(path, str(error)) from None


class _ColladaError(Exception):
    pass


class _Group(NamedTuple):
    """One <triangles>, <polylist> or other group of a geometry, in the geometry's own frame."""

    triangles: FloatArray
    polygons: list[FloatArray]
    vertices: FloatArray


class _Reader:
    def __init__(self, root: ElementTree.Element) -> None:
        self.root = root
        self.by_id = {element.get("id"): element for element in root.iter() if element.get("id")}
        self.groups: dict[str, list[_Group]] = {}
        self.places = 0

    def scene(self) -> Mesh:
        """Return all groups that the scene places, each where its nodes put it."""
        link = next((e for e in self.root.iter() if local_name(e) == "instance_visual_scene"), None)
        if link is None:
            raise _ColladaError("expected an <instance_visual_scene>, got none")
        triangles, polygons, vertices = [], [], []
        for matrix, group in self._placed(self._target(link), self._upright(), 0):
            self._count(len(group.triangles) + len(group.polygons))
            triangles.append(_moved(matrix, group.triangles))
            polygons += [_moved(matrix, polygon) for polygon in group.polygons]
            vertices.append(_moved(matrix, group.vertices))
        if not any(map(len, triangles)) and not polygons:
            raise _ColladaError("expected a scene that places one face or more, got none")
        mesh = Mesh(np.concatenate(triangles), tuple(polygons), np.concatenate(vertices))
        if not all(np.isfinite(array).all() for array in (mesh.triangles, mesh.vertices, *polygons)):
            raise _ColladaError("a coordinate that is not a finite number given")
        # Beyond what shapes may hold, growing a wall to a sheet takes memory without end.
        if (largest := float(np.abs(mesh.vertices).max())) > LIMIT:
            raise _ColladaError(f"expected coordinates of at most {LIMIT:g} m, got {largest:g} m")
        return mesh

    def _placed(self, node: ElementTree.Element, matrix: FloatArray, depth: int) -> Iterator[tuple[FloatArray, _Group]]:
        """Yield the groups below a node with the transform that places each."""
        if depth > _MAX_DEPTH:
            raise _ColladaError(f"expected nodes nested at most {_MAX_DEPTH} levels deep, got more")
        self._count(1)
        for child in node:
            # A node's transforms stand before its content and apply from the last to the first.
            matrix = matrix @ _transform(child)
        for child in node:
            if local_name(child) == "node":
                yield from self._placed(child, matrix, depth + 1)
            elif local_name(child) == "instance_node":
                yield from self._placed(self._target(child), matrix, depth + 1)
            elif local_name(child) == "instance_geometry":
                for group in self._geometry(child):
                    yield matrix, group

    def _count(self, places: int) -> None:
        self.places += places
        if self.places > MAX_FACES:
            raise _ColladaError(f"expected at most {MAX_FACES:,} nodes and faces placed, got more")

    def _upright(self) -> FloatArray:
        axis = next((e.text for e in self.root.iter() if local_name(e) == "up_axis"), None)
        name = (axis or "Y_UP").strip()
        if name not in _UPRIGHT:
            raise _ColladaError(f"up_axis: expected {', '.join(_UPRIGHT)}, got {name!r}")
        return np.array(_UPRIGHT[name], dtype=np.float64)

    def _target(self, element: ElementTree.Element, attribute: str = "url") -> ElementTree.Element:
        link = element.get(attribute, "")
        found = self.by_id.get(link.removeprefix("#"))
        if found is None:
            raise _ColladaError(f"<{local_name(element)}> refers to {link!r}, which is not there")
        return found

    def _geometry(self, instance: ElementTree.Element) -> list[_Group]:
        url = instance.get("url", "")
        if url not in self.groups:
            parts = [part for mesh in self._target(instance) if local_name(mesh) == "mesh" for part in mesh]
            self.groups[url] = [self._group(part) for part in parts if local_name(part) in (*_FACES, *_LINES)]
        return self.groups[url]

    def _group(self, element: ElementTree.Element) -> _Group:
        inputs = [(_integer(e, "offset", 0), e) for e in element if local_name(e) == "input"]
        stride = 1 + max((offset for offset, _ in inputs), default=0)
        place = next((offset for offset, e in inputs if e.get("semantic") == "VERTEX"), None)
        if place is None:
            raise _ColladaError(f"<{local_name(element)}> has no input VERTEX")
        runs = [_numbers(e, np.int64) for e in element if local_name(e) == "p"]
        if any(len(run) % stride for run in runs):
            raise _ColladaError(f"<{local_name(element)}> has a <p> whose length is no multiple of {stride}")
        runs = [run.reshape(-1, stride) for run in runs if len(run)]
        if not runs:
            return _Group(np.empty((0, 3, 3)), [], np.empty((0, 3)))
        corners = np.concatenate(runs)
        data = [column for offset, e in inputs for column in self._columns(e, corners[:, offset])]
        # The positions lead, so that they are the first three columns of each vertex.
        data.sort(key=lambda named: named[0] != "POSITION")
        if data[0][0] != "POSITION" or data[0][1].shape[1] != 3:
            raise _ColladaError(f"<{local_name(element)}> has no POSITION of three numbers")
        positions = data[0][1]
        vertices = np.unique(np.hstack([values for _, values in data]) + 0.0, axis=0)[:, :3]  # + 0.0 makes -0.0 0.0
        loops = [positions[loop] for loop in _loops(element, [len(run) for run in runs])]
        triangles = [loop for loop in loops if len(loop) == 3]
        return _Group(np.array(triangles).reshape(-1, 3, 3), [loop for loop in loops if len(loop) > 3], vertices)

    def _columns(self, element: ElementTree.Element, index: NDArray[np.int64]) -> Iterator[tuple[str, FloatArray]]:
        target = self._target(element, "source")
        if local_name(target) != "vertices":
            yield self._column(element, index)
            return
        for nested in target:
            if local_name(nested) == "input":
                yield self._column(nested, index)

    def _column(self, element: ElementTree.Element, index: NDArray[np.int64]) -> tuple[str, FloatArray]:
        target = self._target(element, "source")
        accessor = next((e for e in target.iter() if local_name(e) == "accessor"), None)
        if local_name(target) != "source" or accessor is None:
            raise _ColladaError(f"input {element.get('semantic')} has no <accessor>")
        stride, count, first = (_integer(accessor, *named) for named in (("stride", 1), ("count", 0), ("offset", 0)))
        numbers = _numbers(self._target(accessor, "source"), np.float64)
        if stride < 1 or first + stride * count > len(numbers):
            raise _ColladaError(f"<accessor> asks for {count} x {stride} numbers, {len(numbers)} are there")
        values = numbers[first : first + stride * count].reshape(count, stride)
        if len(index) and (index.min() < 0 or index.max() >= count):
            raise _ColladaError(f"input {element.get('semantic')} has an index beyond its {count} entries")
        return element.get("semantic", ""), values[index]


_FACES = ("triangles", "polylist", "polygons", "trifans", "tristrips")
_LINES = ("lines", "linestrips")

# To y up; the same turns as Assimp's Collada reader makes.
_UPRIGHT = {
    "X_UP": [[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
    "Y_UP": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
    "Z_UP": [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]],
}


def _loops(element: ElementTree.Element, runs: list[int]) -> list[NDArray[np.int64]]:
    """Return the faces of a group as indices into its corners; ``runs`` counts the corners of each <p>."""
    kind, total = local_name(element), sum(runs)
    spans = list(pairwise(np.concatenate([[0], np.cumsum(runs)])))
    if kind in _LINES:
        return []
    if kind == "triangles":
        return list(np.arange(total // 3 * 3).reshape(-1, 3))
    if kind == "polylist":
        counts = next(
            (_numbers(e, np.int64) for e in element if local_name(e) == "vcount"), np.empty(0, dtype=np.int64)
        )
        if counts.sum() != total or (counts < 0).any():
            raise _ColladaError(f"<vcount> asks for {counts.sum()} corners, <p> has {total}")
        return [loop for loop in np.split(np.arange(total), np.cumsum(counts)[:-1]) if len(loop) > 2]
    if kind == "polygons":
        if any(local_name(e) == "ph" for e in element):
            raise _ColladaError("expected polygons without holes, got <ph>")
        return [np.arange(a, b) for a, b in spans if b - a > 2]
    fan = kind == "trifans"
    return [np.array([a if fan else i - 2, i - 1, i]) for a, b in spans for i in range(a + 2, b)]


def _transform(element: ElementTree.Element) -> FloatArray:
    kind, matrix = local_name(element), np.eye(4)
    if kind in ("lookat", "skew"):
        raise _ColladaError(f"expected <matrix>, <translate>, <rotate>, <scale>, got <{kind}>")
    length = {"matrix": 16, "translate": 3, "rotate": 4, "scale": 3}.get(kind)
    if length is None:
        return matrix
    values = _numbers(element, np.float64)
    if len(values) != length:
        raise _ColladaError(f"<{kind}>: expected {length} numbers, got {len(values)}")
    if kind == "matrix":
        return values.reshape(4, 4)
    if kind == "translate":
        matrix[:3, 3] = values
    elif kind == "scale":
        matrix[:3, :3] = np.diag(values)
    else:
        x, y, z = values[:3] / (np.linalg.norm(values[:3]) or 1.0)
        angle = math.radians(values[3])
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])  # Rodrigues' formula
        matrix[:3, :3] += math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross
    return matrix


def _moved(matrix: FloatArray, points: FloatArray) -> FloatArray:
    with np.errstate(over="ignore", invalid="ignore"):  # what is no number after that is refused
        return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])


def _numbers(element: ElementTree.Element, kind: type[np.int64 | np.float64]) -> NDArray[Any]:
    try:
        return np.array((element.text or "").split(), dtype=kind)
    except (ValueError, OverflowError):
        raise _ColladaError(f"<{local_name(element)}> holds something other than numbers") from None


def _integer(element: ElementTree.Element, name: str, default: int) -> int:
    value = element.get(name, str(default)).strip()
    if not (value.isascii() and value.isdigit() and len(value) < 10):
        raise _ColladaError(f"<{local_name(element)}> {name}: expected a whole number, 0 or more, got {value!r}")
    return int(value)
