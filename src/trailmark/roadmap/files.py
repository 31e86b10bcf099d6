"""Roadmap files: ``.npz`` and GraphML, both ways, and nav2 route GeoJSON, out.

A certificate holds for one world and one robot only. A file therefore carries a fingerprint of both, and a
checksum over its nodes and edges: the status of an edge is read only if both match. Otherwise (another world, another
robot, a file edited since) every edge is UNDECIDED, to be checked when a search needs it.
"""

from __future__ import annotations

import hashlib
import io
import zipfile
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision.obstacles import boundary_segments, obstacle_discs
from trailmark.errors import FormatError, OutputError
from trailmark.formats.files import (
    MAX_FILE_BYTES,
    check_writable,
    read_bytes,
    require_not_an_input,
    write_atomically,
)
from trailmark.motion import CurveMotion, motion_of
from trailmark.motion.one_way import one_ways
from trailmark.roadmap.nav2_route import route_text
from trailmark.roadmap.roadmap import Roadmap
from trailmark.roadmap.store import EdgeStatus

if TYPE_CHECKING:
    from trailmark.collision import StateChecker

__all__ = ["fingerprint", "load_roadmap", "save_roadmap"]

VERSION = 1
"""Of the content of ``.npz`` and ``.graphml`` files; part of the fingerprint."""

LOADED = (".graphml", ".npz")
SAVED = (".geojson", ".graphml", ".npz")


class _Content(NamedTuple):
    """The content of a file, before any check."""

    configurations: NDArray[Any]
    edges: NDArray[Any]
    status: NDArray[Any]
    fingerprint: str
    checksum: str


def save_roadmap(roadmap: Roadmap, path: str | FilePath, frame: str = "map") -> None:
    """Write a roadmap to a file, whole or not at all.

    - ``.npz``: arrays ``configurations`` (n, 3), ``edges`` (m, 2), ``status`` (m,), and strings ``fingerprint``
      and ``checksum``.
    - ``.graphml``: node attributes ``x``, ``y``, ``theta``, ``clearance``; edge attributes ``length``,
      ``certified``, ``clearance``; blocked edges are left out (:attr:`Roadmap.graph`).
    - ``.geojson``: certified edges for nav2's route server (:mod:`trailmark.roadmap.nav2_route`); undecided edges are
      checked first.

    Args:
        roadmap: what to write.
        path: the file; its suffix chooses the format.
        frame: name of the coordinate frame, for GeoJSON.

    Raises:
        OutputError: another suffix, a path that cannot be written or that the world was read from, or a GeoJSON file
            without a certified edge.
    """
    path = FilePath(path)
    check_writable(path, SAVED)
    require_not_an_input(path, roadmap.checker.world.sources)
    suffix = path.suffix.lower()
    if suffix == ".geojson":
        if isinstance(roadmap.motion, CurveMotion):
            raise OutputError(
                f"{path}: expected straight motions for a route graph, got a car's curves (.graphml and .npz take them)"
            )
        roadmap.certify_all()
        write_atomically(path, route_text(roadmap, path, frame))
    else:
        write_atomically(path, _npz_bytes(roadmap) if suffix == ".npz" else _graphml_bytes(roadmap))


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
    data = read_bytes(path)
    content = _read_npz(data, path) if suffix == ".npz" else _read_graphml(data, path)
    motion = motion_of(checker)
    q, edges, status = _checked(content, path, motion.directed)
    known = content.fingerprint == fingerprint(checker)
    if not known or content.checksum != _checksum(content.fingerprint, q, edges, status, motion.directed):
        status[:] = EdgeStatus.UNDECIDED
    if not motion.directed:
        # An edge without a direction stands for motions both ways.
        status[~motion.reversible(q[edges[:, 0]], q[edges[:, 1]])] = EdgeStatus.BLOCKED
    valid = checker.valid(q) if len(q) else np.ones(0, dtype=np.bool_)
    if not valid.all():
        if not drop_invalid:
            count = np.count_nonzero(~valid)
            where = ", ".join(f"{v:g}" for v in q[np.argmin(valid)])
            raise FormatError(
                path,
                f"expected nodes that are valid for this robot in this world (drop_invalid leaves the others out), "
                f"got {count} of {len(q)} that are not, the first at ({where})",
            )
        intact = valid[edges].all(axis=1)
        q, edges, status = q[valid], (np.cumsum(valid) - 1)[edges[intact]].astype(np.int32), status[intact]
    return Roadmap.from_arrays(checker, q, edges, status)


def fingerprint(checker: StateChecker) -> str:
    """Return the SHA-256, in hexadecimal, of what an edge's certificate depends on.

    That is bounds, obstacles (keep-out zones among them), one-way zones, footprint and steering.
    """
    robot, world = checker.footprint, checker.world
    digest = hashlib.sha256(f"trailmark roadmap {VERSION}".encode())
    # Not as the checker has them: in which order depends on how the world came about.
    segments, discs = boundary_segments(world)[0], obstacle_discs(world)
    # Files of robots that keep no clearance stay what they were.
    dilation = robot.dilation or -1.0
    for array in (world.bounds, segments, discs, robot.outline, dilation):
        _digest(digest, np.asarray(array), "<f8")
    if checker.robot.drive == "differential":
        _digest(digest, np.array([0.0, checker.robot.reverse]), "<f8")
    if checker.robot.turning_radius is not None:
        _digest(digest, np.array([checker.robot.turning_radius, checker.robot.reverse]), "<f8")
    directions = one_ways(world.zones)
    for part in directions if len(directions.zones) else ():
        _digest(digest, part, "<f8")
    return digest.hexdigest()


def _checksum(
    world: str, q: se2.FloatArray, edges: NDArray[np.int32], status: NDArray[np.uint8], directed: bool
) -> str:
    """Return the SHA-256 over a file's content, whatever the order in which it lists the edges."""
    pairs = edges if directed else np.sort(edges, axis=1)
    order = np.lexsort((pairs[:, 1], pairs[:, 0]))
    digest = hashlib.sha256(world.encode())
    _digest(digest, q, "<f8")
    _digest(digest, pairs[order], "<i4")
    _digest(digest, status[order], "u1")
    return digest.hexdigest()


def _digest(digest: Any, array: NDArray[Any], kind: str) -> None:
    # The shape too, so that numbers cannot move from one array into the next.
    digest.update(repr(array.shape).encode())
    digest.update(np.ascontiguousarray(array, dtype=kind).tobytes())


def _npz_bytes(roadmap: Roadmap) -> bytes:
    world = fingerprint(roadmap.checker)
    q, edges, _, status = roadmap.rows()
    checksum = _checksum(world, q, edges, status, roadmap.directed)
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        configurations=q,
        edges=edges,
        status=status,
        fingerprint=np.array(world),
        checksum=np.array(checksum),
    )
    return buffer.getvalue()


def _graphml_bytes(roadmap: Roadmap) -> bytes:
    import networkx as nx

    graph = roadmap.graph
    for _, attributes in graph.nodes(data=True):
        attributes["x"], attributes["y"], attributes["theta"] = attributes.pop("configuration")
    world, written = fingerprint(roadmap.checker), roadmap.status != EdgeStatus.BLOCKED
    directed = roadmap.directed
    checksum = _checksum(world, roadmap.configurations, roadmap.edges[written], roadmap.status[written], directed)
    graph.graph.update(trailmark_roadmap=VERSION, fingerprint=world, checksum=checksum)
    buffer = io.BytesIO()
    nx.write_graphml_xml(graph, buffer)
    return buffer.getvalue()


def _read_npz(data: bytes, path: FilePath) -> _Content:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            unpacked = sum(member.file_size for member in archive.infolist())
        arrays = {}
        if unpacked <= MAX_FILE_BYTES:
            with np.load(io.BytesIO(data), allow_pickle=False) as file:
                arrays = {name: file[name] for name in _Content._fields if name in file}
    except Exception as error:  # zipfile, zlib and numpy each have their own exceptions for damaged data
        raise FormatError(path, f"not a readable .npz file: {_one_line(error)}") from None
    if unpacked > MAX_FILE_BYTES:
        raise FormatError(path, f"expected at most {MAX_FILE_BYTES:,} bytes unpacked, got {unpacked:,}")
    for name, kinds, expected in (
        ("configurations", "fiu", "numbers"),
        ("edges", "iu", "whole numbers"),
        ("status", "iu", "whole numbers"),
        ("fingerprint", "U", "text"),
        ("checksum", "U", "text"),
    ):
        if name not in arrays:
            raise FormatError(path, f"expected arrays {', '.join(_Content._fields)}, got none named {name!r}")
        if arrays[name].dtype.kind not in kinds:
            raise FormatError(path, f"array {name!r}: expected {expected}, got {arrays[name].dtype}")
    texts = [str(arrays.pop(name)) for name in ("fingerprint", "checksum")]
    return _Content(**arrays, fingerprint=texts[0], checksum=texts[1])


def _read_graphml(data: bytes, path: FilePath) -> _Content:
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
    number = {node: i for i, node in enumerate(nodes)}
    q = [[_number(graph.nodes[node], name, f"node {node}", path) for name in ("x", "y", "theta")] for node in nodes]
    edges, status = [], []
    for u, v, attributes in graph.edges(data=True):
        certified = attributes.get("certified")
        if not isinstance(certified, bool):
            raise FormatError(path, f"edge {u}-{v}: certified: expected true or false, got {str(certified)[:60]!r}")
        edges.append((number[u], number[v]))
        status.append(EdgeStatus.FREE if certified else EdgeStatus.UNDECIDED)
    texts = [str(graph.graph.get(name, "")) for name in ("fingerprint", "checksum")]
    return _Content(
        np.array(q, dtype=np.float64).reshape(-1, 3),
        np.array(edges, dtype=np.int64).reshape(-1, 2),
        np.array(status, dtype=np.uint8),
        *texts,
    )


def _number(attributes: dict[str, Any], name: str, where: str, path: FilePath) -> float:
    value = attributes.get(name)
    try:
        if isinstance(value, int | float) and not isinstance(value, bool):
            return float(value)
    except OverflowError:  # a whole number of hundreds of digits
        pass
    raise FormatError(path, f"{where}: {name}: expected a finite number, got {str(value)[:60]!r}")


def _checked(
    content: _Content, path: FilePath, directed: bool
) -> tuple[se2.FloatArray, NDArray[np.int32], NDArray[np.uint8]]:
    """Return configurations, edges and status, as far as a file alone can tell whether they make sense."""
    q, edges, status = content.configurations, content.edges, content.status
    if q.ndim != 2 or q.shape[1] != 3:
        raise FormatError(path, f"configurations: expected shape (n, 3), got {q.shape}")
    if edges.ndim != 2 or edges.shape[1] != 2:
        raise FormatError(path, f"edges: expected shape (m, 2), got {edges.shape}")
    if status.shape != (len(edges),):
        raise FormatError(path, f"status: expected shape ({len(edges)},), one for each edge, got {status.shape}")
    _refuse(~np.isfinite(q).all(axis=1), "configurations", q, "finite numbers", path)
    _refuse(np.any((edges < 0) | (edges >= len(q)), axis=1), "edges", edges, f"nodes 0 to {len(q) - 1}", path)
    _refuse(edges[:, 0] == edges[:, 1], "edges", edges, "two different nodes", path)
    _refuse(~np.isin(status, list(EdgeStatus)), "status", status, "0, 1, 2", path)
    _, first = np.unique(edges if directed else np.sort(edges, axis=1), axis=0, return_index=True)
    _refuse(~np.isin(np.arange(len(edges)), first), "edges", edges, "each pair once", path)
    return se2.configurations(q), edges.astype(np.int32), status.astype(np.uint8)


def _refuse(bad: NDArray[Any], name: str, rows: NDArray[Any], expected: str, path: FilePath) -> None:
    """Raise for the first bad row."""
    if bad.any():
        first = int(np.argmax(bad))
        raise FormatError(path, f"{name}[{first}]: expected {expected}, got {rows[first].tolist()}")


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__
