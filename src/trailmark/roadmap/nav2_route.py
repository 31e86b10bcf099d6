"""Route graphs for nav2's route server, in GeoJSON: written from a roadmap, read into a networkx graph.

A file is a FeatureCollection. Point features are nodes (``properties.id``), line features are directed edges
(``properties.id``, ``startid``, ``endid``); positions are metres in the map's frame. nav2 joins an edge's two nodes by
a straight line, whatever the line feature's own coordinates say.

Source: nav2_route, GeoJsonGraphFileLoader and its documentation.
"""

from __future__ import annotations

import json
import math
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np

from trailmark.errors import FormatError, OutputError
from trailmark.formats.files import read_text
from trailmark.formats.path_files import geojson_feature, geojson_text

if TYPE_CHECKING:
    import networkx as nx

    from trailmark.roadmap.roadmap import Roadmap

__all__ = ["read_route_graph", "route_text"]

LINES = ("LineString", "MultiLineString")
MAX_ID = 2**32 - 1
"""nav2 keeps ids in 32 bits without a sign."""


def route_text(roadmap: Roadmap, path: FilePath, frame: str) -> str:
    """Return a roadmap's certified edges as GeoJSON, each once in either direction that was certified.

    nav2 uses positions only: headings are written as ``metadata.theta`` (radians), beside ``metadata.clearance``
    (metres). An edge's ``cost`` is its length in the roadmap, ‖Δxy‖ + 0.5·|Δθ| metres. What is certified is the
    motion from heading to heading; a robot that nav2 turns along the edge first makes another one. Nodes that no
    certified edge joins are left out.

    Args:
        roadmap: its certified edges are written.
        path: for the message.
        frame: name of the coordinate frame.

    Raises:
        OutputError: there is no certified edge; nav2 reads no graph without one.
    """
    pairs, lengths = roadmap.edges[roadmap.certified], roadmap.lengths[roadmap.certified]
    if len(pairs) == 0:
        raise OutputError(f"{path}: cannot be written: the roadmap has no certified edge, nav2 needs one or more")
    nodes = np.unique(pairs)
    q = roadmap.configurations[nodes]
    clearance = np.asarray(roadmap.checker.clearance(q))
    features: list[dict[str, Any]] = []
    for node, (x, y, theta), free in zip(nodes.tolist(), q.tolist(), clearance.tolist(), strict=True):
        metadata = {"theta": theta, "clearance": free}
        features.append(geojson_feature({"id": node, "frame": frame, "metadata": metadata}, "Point", [x, y]))
    number = len(roadmap)
    positions = roadmap.configurations[:, :2].tolist()
    for (u, v), length in zip(pairs.tolist(), lengths.tolist(), strict=True):
        for start, end in ((u, v),) if roadmap.directed else ((u, v), (v, u)):
            properties = {"id": number, "startid": start, "endid": end, "cost": length}
            features.append(geojson_feature(properties, "LineString", [positions[start], positions[end]]))
            number += 1
    return geojson_text(features)


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

    path = FilePath(path)
    graph = nx.DiGraph()
    edges = []
    for i, feature in enumerate(_features(path)):
        where = f"features[{i}]"
        geometry = feature.get("geometry") if isinstance(feature, dict) else None
        kind = geometry.get("type") if isinstance(geometry, dict) else None
        if not isinstance(geometry, dict) or kind not in ("Point", *LINES):
            continue
        properties = feature.get("properties")
        if not isinstance(properties, dict):
            raise FormatError(path, f"{where}: expected an object 'properties' with an id, got none")
        if kind != "Point":
            edges.append((where, properties))
            continue
        node = _id(properties, "id", where, path)
        if node in graph:
            raise FormatError(path, f"{where}: expected each node id once, got {node} again")
        extra = {key: properties[key] for key in ("frame", "metadata") if key in properties}
        graph.add_node(node, position=_position(geometry.get("coordinates"), where, path), **extra)
    for where, properties in edges:
        _add_edge(graph, properties, where, path)
    if graph.number_of_edges() == 0:
        raise FormatError(
            path, f"expected Point and LineString features, one or more of each, got {len(graph)} nodes and 0 edges"
        )
    return graph


def _features(path: FilePath) -> list[Any]:
    text = read_text(path, "expected GeoJSON")
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


def _add_edge(graph: nx.DiGraph, properties: dict[str, Any], where: str, path: FilePath) -> None:
    edge, start, end = (_id(properties, key, where, path) for key in ("id", "startid", "endid"))
    for key, node in (("startid", start), ("endid", end)):
        if node not in graph:
            raise FormatError(path, f"{where}: {key}: expected the id of a Point feature, got {node}")
    length = math.dist(graph.nodes[start]["position"], graph.nodes[end]["position"])
    attributes = {"id": edge, "length": length}
    if "cost" in properties:
        attributes["cost"] = _finite(properties["cost"], f"{where}: cost", path)
    if "metadata" in properties:
        attributes["metadata"] = properties["metadata"]
    before = graph.get_edge_data(start, end)
    if before is not None:
        if attributes.get("cost", length) >= before.get("cost", length):
            return
        graph.remove_edge(start, end)
    graph.add_edge(start, end, **attributes)


def _id(properties: dict[str, Any], key: str, where: str, path: FilePath) -> int:
    value = properties.get(key)
    # Editors of geographic data write 7.0 for 7.
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if type(value) is not int or not 0 <= value <= MAX_ID:
        raise FormatError(path, f"{where}: {key}: expected a whole number from 0 to {MAX_ID}, got {str(value)[:60]!r}")
    return value


def _position(coordinates: Any, where: str, path: FilePath) -> tuple[float, float]:
    if not isinstance(coordinates, list) or len(coordinates) < 2:
        raise FormatError(path, f"{where}: coordinates: expected [x, y], got {str(coordinates)[:60]}")
    x, y = (_finite(value, f"{where}: coordinates", path) for value in coordinates[:2])
    return x, y


def _finite(value: Any, what: str, path: FilePath) -> float:
    if type(value) in (int, float) and abs(value) < math.inf:
        try:
            return float(value)
        except OverflowError:
            pass
    raise FormatError(path, f"{what}: expected a finite number, got {str(value)[:60]!r}")
