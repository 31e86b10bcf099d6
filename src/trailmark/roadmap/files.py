"""Roadmap files: ``.npz`` and GraphML, both ways; route graphs for nav2's route server, in GeoJSON, both ways.

A certificate holds for one world and one robot only. ``.npz`` and GraphML therefore carry a fingerprint of both, and a
checksum over nodes and edges: the status of an edge is read only if both match. Otherwise (another world, another
robot, a file edited since) every edge is UNDECIDED, to be checked when a search needs it.

A route graph is a FeatureCollection. Point features are nodes (``properties.id``), line features are directed edges
(``properties.id``, ``startid``, ``endid``); positions are metres in the map's frame. nav2 joins an edge's two nodes by
a straight line, whatever the line feature's own coordinates say. Source: nav2_route, GeoJsonGraphFileLoader.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import zipfile
from functools import partial
from itertools import count
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.arguments import number, whole
from trailmark.collision.obstacles import boundary_segments, obstacle_discs
from trailmark.errors import FormatError, OutputError
from trailmark.formats import files, path_files
from trailmark.motion import CurveMotion, motion_of
from trailmark.motion.one_way import one_ways
from trailmark.roadmap.roadmap import EdgeStatus, Roadmap

if TYPE_CHECKING:
    import networkx as nx

    from trailmark.collision import StateChecker

__all__ = ["fingerprint", "load_roadmap", "read_route_graph", "save_roadmap"]

VERSION = 1
"""Of the content of ``.npz`` and ``.graphml`` files; part of the fingerprint."""

LOADED = (".graphml", ".npz")

ARRAYS = {
    "configurations": ("fiu", "numbers"),
    "edges": ("iu", "whole numbers"),
    "status": ("iu", "whole numbers"),
    "fingerprint": ("U", "text"),
    "checksum": ("U", "text"),
}
"""Of an ``.npz`` file: numpy's kinds of their elements, and what these are called."""

MAX_ID = 2**32 - 1
"""nav2 keeps ids in 32 bits without a sign."""


def save_roadmap(roadmap: Roadmap, path: str | FilePath, frame: str = "map") -> None:
    """Write a roadmap to a file, whole or not at all.

    - ``.npz``: arrays ``configurations`` (n, 3), ``edges`` (m, 2), ``status`` (m,), and strings ``fingerprint``
      and ``checksum``.
    - ``.graphml``: node attributes ``x``, ``y``, ``theta``, ``clearance``; edge attributes ``length``,
      ``certified``, ``clearance``; blocked edges are left out (:attr:`Roadmap.graph`).
    - ``.geojson``: a route graph for nav2: certified edges, each once in either direction that was certified, and the
      nodes that they join; undecided edges are checked first. nav2 uses positions only: headings are written as
      ``metadata.theta`` (radians), beside ``metadata.clearance`` (metres). An edge's ``cost`` is its length in the
      roadmap, ‖Δxy‖ + 0.5·|Δθ| metres. What is certified is the motion from heading to heading; a robot that nav2 turns
      along the edge first makes another one.

    Args:
        roadmap: what to write.
        path: the file; its suffix chooses the format.
        frame: name of the coordinate frame, for GeoJSON.

    Raises:
        OutputError: another suffix, a path that cannot be written or that the world was read from, or a GeoJSON file
            of a car's curves or without a certified edge.
    """
    path = FilePath(path)
    files.check_writable(path, (".geojson", *LOADED))
    files.require_not_an_input(path, roadmap.checker.world.sources)
    suffix = path.suffix.lower()
    if suffix == ".geojson":
        content: str | bytes = _route_text(roadmap, path, frame)
    else:
        content = _npz_bytes(roadmap) if suffix == ".npz" else _graphml_bytes(roadmap)
    files.write_atomically(path, content)


def load_roadmap(path: str | FilePath, checker: StateChecker, *, drop_invalid: bool = False) -> Roadmap:
    """Read a roadmap from a file written by :func:`save_roadmap`.

    The status of the edges is read only from a file made for the checker's world and robot and unchanged since;
    otherwise all edges are UNDECIDED. Lengths and clearances are computed anew.

    Args:
        path: ``.npz`` or ``.graphml``.
        checker: of the world and robot to plan for.
        drop_invalid: leave out the nodes that are not valid there, with their edges, instead of refusing the
            file: for a world that has changed.

    Raises:
        FormatError: another suffix; a file that is missing, damaged, or does not hold a roadmap; nodes that are
            not valid for the checker, unless ``drop_invalid``.
    """
    path = FilePath(path)
    suffix = path.suffix.lower()
    if suffix not in LOADED:
        hint = "; a route graph is read by read_route_graph" if suffix == ".geojson" else ""
        raise FormatError(path, f"expected suffix {' or '.join(LOADED)}, got {path.suffix!r}{hint}")
    data, motion = files.read_bytes(path), motion_of(checker)
    arrays = _read_npz(data, path) if suffix == ".npz" else _read_graphml(data, path)
    q, edges, status = _checked(arrays, path)
    world, checksum = str(arrays["fingerprint"]), str(arrays["checksum"])
    if world != fingerprint(checker) or checksum != _checksum(world, q, edges, status, motion.directed):
        status[:] = EdgeStatus.UNDECIDED
    if not motion.directed:
        # An edge without a direction stands for motions both ways; a file of edges with directions may have both.
        once = np.sort(np.unique(np.sort(edges, axis=1), axis=0, return_index=True)[1])
        edges, status = edges[once], status[once]
        status[~motion.reversible(q[edges[:, 0]], q[edges[:, 1]])] = EdgeStatus.BLOCKED
    valid = checker.valid(q) if len(q) else np.ones(0, dtype=np.bool_)
    if not (drop_invalid or valid.all()):
        where = ", ".join(f"{v:g}" for v in q[np.argmin(valid)])
        raise FormatError(
            path,
            f"expected nodes that are valid for this robot in this world (drop_invalid leaves the others out), "
            f"got {np.count_nonzero(~valid)} of {len(q)} that are not, the first at ({where})",
        )
    intact = valid[edges].all(axis=1)
    return Roadmap.from_arrays(checker, q[valid], (np.cumsum(valid) - 1)[edges[intact]], status[intact])


def fingerprint(checker: StateChecker) -> str:
    """Return the SHA-256, in hexadecimal, of what an edge's certificate depends on.

    That is bounds, obstacles (keep-out zones among them), one-way zones, footprint and steering.
    """
    footprint, world, robot = checker.footprint, checker.world, checker.robot
    # Segments and discs not as the checker has them: in which order depends on how the world came about. And files of
    # robots that keep no clearance stay what they were.
    parts = [world.bounds, boundary_segments(world)[0], obstacle_discs(world), footprint.outline]
    parts.append(footprint.dilation or -1.0)
    if robot.drive == "differential":
        parts.append([0.0, robot.reverse])
    if robot.turning_radius is not None:
        parts.append([robot.turning_radius, robot.reverse])
    directions = one_ways(world.zones)
    parts += directions if len(directions.headings) else ()
    return _digest(f"trailmark roadmap {VERSION}", *((part, "<f8") for part in parts))


def _checksum(
    world: str, q: se2.FloatArray, edges: NDArray[np.int32], status: NDArray[np.uint8], directed: bool
) -> str:
    """Return the SHA-256 over a file's content, whatever the order in which it lists the edges."""
    pairs = edges if directed else np.sort(edges, axis=1)
    order = np.lexsort((pairs[:, 1], pairs[:, 0]))
    return _digest(world, (q, "<f8"), (pairs[order], "<i4"), (status[order], "u1"))


def _digest(text: str, *arrays: tuple[Any, str]) -> str:
    digest = hashlib.sha256(text.encode())
    for values, kind in arrays:
        array = np.asarray(values)
        # The shape too, so that numbers cannot move from one array into the next.
        digest.update(repr(array.shape).encode())
        digest.update(np.ascontiguousarray(array, dtype=kind).tobytes())
    return digest.hexdigest()


def _npz_bytes(roadmap: Roadmap) -> bytes:
    world, (q, edges, _, status) = fingerprint(roadmap.checker), roadmap.rows()
    values = q, edges, status, world, _checksum(world, q, edges, status, roadmap.directed)
    buffer = io.BytesIO()
    arrays: dict[str, Any] = {name: np.asarray(value) for name, value in zip(ARRAYS, values, strict=True)}
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def _graphml_bytes(roadmap: Roadmap) -> bytes:
    import networkx as nx

    graph = roadmap.graph
    for _, attributes in graph.nodes(data=True):
        attributes["x"], attributes["y"], attributes["theta"] = attributes.pop("configuration")
    world, (q, edges, _, status) = fingerprint(roadmap.checker), roadmap.rows()
    written = status != EdgeStatus.BLOCKED
    checksum = _checksum(world, q, edges[written], status[written], roadmap.directed)
    graph.graph.update(trailmark_roadmap=VERSION, fingerprint=world, checksum=checksum)
    buffer = io.BytesIO()
    nx.write_graphml_xml(graph, buffer)
    return buffer.getvalue()


def _read_npz(data: bytes, path: FilePath) -> dict[str, NDArray[Any]]:
    """Return a file's content, before any check of its values."""
    arrays: dict[str, NDArray[Any]] = {}
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            unpacked = sum(member.file_size for member in archive.infolist())
        if unpacked <= files.MAX_FILE_BYTES:
            with np.load(io.BytesIO(data), allow_pickle=False) as file:
                arrays = {name: file[name] for name in ARRAYS if name in file}
    except Exception as error:  # zipfile, zlib and numpy each have their own exceptions for damaged data
        raise FormatError(path, f"not a readable .npz file: {_one_line(error)}") from None
    if unpacked > files.MAX_FILE_BYTES:
        raise FormatError(path, f"expected at most {files.MAX_FILE_BYTES:,} bytes unpacked, got {unpacked:,}")
    for name, (kinds, expected) in ARRAYS.items():
        if name not in arrays:
            raise FormatError(path, f"expected arrays {', '.join(ARRAYS)}, got none named {name!r}")
        if arrays[name].dtype.kind not in kinds:
            raise FormatError(path, f"array {name!r}: expected {expected}, got {arrays[name].dtype}")
    return arrays


def _read_graphml(data: bytes, path: FilePath) -> dict[str, NDArray[Any]]:
    """Return a file's content, before any check of its values."""
    import warnings

    import networkx as nx

    try:
        with warnings.catch_warnings():
            # Of what networkx warns of, ports do not matter; undeclared keys are reported as missing attributes below.
            warnings.simplefilter("ignore")
            graph = nx.read_graphml(io.BytesIO(data), node_type=int, edge_key_type=str)
    except Exception as error:  # networkx lets XML, key and number errors through as they come
        raise FormatError(path, f"not a readable GraphML file: {_one_line(error)}") from None
    nodes = sorted(graph.nodes)
    position = {node: i for i, node in enumerate(nodes)}
    wrong: Any = partial(FormatError, path)
    q = [
        [number(graph.nodes[node].get(a), f"node {node}: {a}:", error=wrong) for a in ("x", "y", "theta")]
        for node in nodes
    ]
    edges, status = [], []
    for u, v, attributes in graph.edges(data=True):
        certified = attributes.get("certified")
        if not isinstance(certified, bool):
            raise wrong(f"edge {u}-{v}: certified: expected true or false, got {str(certified)[:60]!r}")
        edges.append((position[u], position[v]))
        status.append(EdgeStatus.FREE if certified else EdgeStatus.UNDECIDED)
    arrays = np.array(q).reshape(-1, 3), np.array(edges, dtype=int).reshape(-1, 2), np.array(status, dtype=int)
    texts = (np.array(str(graph.graph.get(name, ""))) for name in ("fingerprint", "checksum"))
    return dict(zip(ARRAYS, (*arrays, *texts), strict=True))


def _checked(
    arrays: dict[str, NDArray[Any]], path: FilePath
) -> tuple[se2.FloatArray, NDArray[np.int32], NDArray[np.uint8]]:
    """Return configurations, edges and status, as far as a file alone can tell whether they make sense."""
    q, edges, status = (arrays[name] for name in ("configurations", "edges", "status"))
    for name, rows, width, shape in (("configurations", q, 3, "(n, 3)"), ("edges", edges, 2, "(m, 2)")):
        if rows.ndim != 2 or rows.shape[1] != width:
            raise FormatError(path, f"{name}: expected shape {shape}, got {rows.shape}")
    if status.shape != (len(edges),):
        raise FormatError(path, f"status: expected shape ({len(edges)},), one for each edge, got {status.shape}")
    _, first = np.unique(edges, axis=0, return_index=True)
    for name, rows, bad, expected in (
        ("configurations", q, ~np.isfinite(q).all(axis=1), "finite numbers"),
        ("edges", edges, ((edges < 0) | (edges >= len(q))).any(axis=1), f"nodes 0 to {len(q) - 1}"),
        ("edges", edges, edges[:, 0] == edges[:, 1], "two different nodes"),
        ("status", status, ~np.isin(status, list(EdgeStatus)), "0, 1, 2"),
        ("edges", edges, ~np.isin(np.arange(len(edges)), first), "each pair once"),
    ):
        if bad.any():
            row = int(np.argmax(bad))
            raise FormatError(path, f"{name}[{row}]: expected {expected}, got {rows[row].tolist()}")
    return se2.configurations(q), edges.astype(np.int32), status.astype(np.uint8)


# --- Route graphs.


def _route_text(roadmap: Roadmap, path: FilePath, frame: str) -> str:
    if isinstance(roadmap.motion, CurveMotion):
        raise OutputError(
            f"{path}: expected straight motions for a route graph, got a car's curves (.graphml and .npz take them)"
        )
    roadmap.certify_all()
    q, pairs, lengths = roadmap.configurations, roadmap.edges[roadmap.certified], roadmap.lengths[roadmap.certified]
    if len(pairs) == 0:
        raise OutputError(f"{path}: cannot be written: the roadmap has no certified edge, nav2 needs one or more")
    nodes = np.unique(pairs)
    features: list[dict[str, Any]] = []
    clearance = np.asarray(roadmap.checker.clearance(q[nodes]))
    for node, (x, y, theta), free in zip(nodes.tolist(), q[nodes].tolist(), clearance.tolist(), strict=True):
        properties: dict[str, Any] = {"id": node, "frame": frame, "metadata": {"theta": theta, "clearance": free}}
        features.append(path_files.geojson_feature(properties, "Point", [x, y]))
    ids, positions = count(len(q)), q[:, :2].tolist()
    for (u, v), length in zip(pairs.tolist(), lengths.tolist(), strict=True):
        for start, end in ((u, v),) if roadmap.directed else ((u, v), (v, u)):
            properties = {"id": next(ids), "startid": start, "endid": end, "cost": length}
            features.append(path_files.geojson_feature(properties, "LineString", [positions[start], positions[end]]))
    return path_files.geojson_text(features)


def read_route_graph(path: str | FilePath) -> nx.DiGraph:
    """Read a nav2 route graph.

    Returns:
        Nodes are the file's ids, with attributes ``position`` ((x, y), metres) and, where the file gives them,
        ``frame`` and ``metadata``. Edges have ``id``, ``length`` (metres, straight) and, where given, ``cost`` and
        ``metadata``. Of several edges from one node to another the cheapest is kept.

    Raises:
        FormatError: the file is missing, no JSON, or no route graph.
    """
    import networkx as nx

    path, graph, edges = FilePath(path), nx.DiGraph(), []
    wrong: Any = partial(FormatError, path)

    def id_of(properties: dict[str, Any], key: str) -> int:
        return whole(properties.get(key), f"{where}: {key}:", 0, MAX_ID, error=wrong)

    def given(properties: dict[str, Any], *keys: str) -> dict[str, Any]:
        return {key: properties[key] for key in keys if key in properties}

    for i, feature in enumerate(_features(path)):
        where = f"features[{i}]"
        geometry = feature.get("geometry") if isinstance(feature, dict) else None
        kind = geometry.get("type") if isinstance(geometry, dict) else None
        if not isinstance(geometry, dict) or kind not in ("Point", "LineString", "MultiLineString"):
            continue
        properties = feature.get("properties")
        if not isinstance(properties, dict):
            raise wrong(f"{where}: expected an object 'properties' with an id, got none")
        if kind != "Point":
            edges.append((where, properties))
            continue
        node, at = id_of(properties, "id"), geometry.get("coordinates")
        if node in graph:
            raise wrong(f"{where}: expected each node id once, got {node} again")
        if not isinstance(at, list) or len(at) < 2:
            raise wrong(f"{where}: coordinates: expected [x, y], got {str(at)[:60]}")
        position = tuple(number(value, f"{where}: coordinates:", error=wrong) for value in at[:2])
        graph.add_node(node, position=position, **given(properties, "frame", "metadata"))
    for where, properties in edges:
        edge, start, end = (id_of(properties, key) for key in ("id", "startid", "endid"))
        for key, node in (("startid", start), ("endid", end)):
            if node not in graph:
                raise wrong(f"{where}: {key}: expected the id of a Point feature, got {node}")
        length = math.dist(graph.nodes[start]["position"], graph.nodes[end]["position"])
        attributes = {"id": edge, "length": length, **given(properties, "cost", "metadata")}
        if "cost" in attributes:
            attributes["cost"] = number(attributes["cost"], f"{where}: cost:", error=wrong)
        if (before := graph.get_edge_data(start, end)) is not None:
            if attributes.get("cost", length) >= before.get("cost", length):
                continue
            graph.remove_edge(start, end)
        graph.add_edge(start, end, **attributes)
    if graph.number_of_edges() == 0:
        raise wrong(f"expected Point and LineString features, one or more of each, got {len(graph)} nodes and 0 edges")
    return graph


def _features(path: FilePath) -> list[Any]:
    text = files.read_text(path, "expected GeoJSON")
    try:
        document = json.loads(text)
    except json.JSONDecodeError as error:
        raise FormatError(path, f"not valid JSON: {error.msg}", error.lineno) from None
    except (RecursionError, ValueError):
        raise FormatError(path, "not valid JSON: nested too deeply or a number too long") from None
    features = document.get("features") if isinstance(document, dict) else None
    if not isinstance(features, list):
        raise FormatError(path, "expected a GeoJSON FeatureCollection, got no list 'features'")
    return features


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__
