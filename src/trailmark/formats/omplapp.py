"""OMPL.app planning problems in the plane: a ``.cfg`` file that names a robot mesh and a world mesh.

OMPL.app moves the robot's mesh in the plane that is left when the height is taken away: (x, z) of a file with z up,
so that y_world = z. The robot is re-centred by the mean of its vertices (``sceneCenter`` of its assimpUtil.cpp).
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.errors import FormatError
from trailmark.formats.collada import Mesh, read_collada
from trailmark.shapes import Polygon

if TYPE_CHECKING:
    import shapely

__all__ = ["QUERY", "read_cfg"]

QUERY = "problem"
"""Name of the one query of such a world."""

SHEET = 1e-6
"""Half the thickness that a face seen edge-on gets, as a share of the mesh's extent."""

MAX_GAP = 0.01
"""Widest gap between parts of a robot that is bridged, as a share of the robot's extent."""

MAX_PARTS = 100
"""Largest number of a robot's parts that are joined."""

_POSES = ("start.x", "start.y", "start.theta", "goal.x", "goal.y", "goal.theta")
_VOLUME = ("volume.min.x", "volume.min.y", "volume.max.x", "volume.max.y")


class _Entry(NamedTuple):
    value: str
    line: int


def read_cfg(text: str, path: Path) -> dict[str, Any]:
    """Return the arguments of the :class:`trailmark.World` of an OMPL.app problem.

    Obstacles are the world mesh, seen from above: the union of its faces, as polygons with holes. Faces seen edge-on
    that stand free get the thickness of :data:`SHEET` on both sides, so that no wall is lost. The robot is the outline
    of its mesh; its holes are filled, and parts that a gap below :data:`MAX_GAP` separates are joined by filling the
    gap, so that it never covers less than the mesh. ``volume`` gives the bounds (OMPL.app bounds the reference point
    by it; here it bounds the whole robot). The one query is called ``problem``.

    Args:
        text: the cfg file's content.
        path: the cfg file; meshes are sought beside it. Its stem names the world if ``name`` does not.

    Raises:
        FormatError: no section [problem], keys missing or not numbers, a problem in space, a mesh that cannot be read,
            a robot of several parts.
    """
    problem = _section(text, path)
    missing = [key for key in ("robot", "world", *_POSES, *_VOLUME) if key not in problem]
    if any(key in problem for key in ("start.z", "goal.z", "volume.min.z")):
        raise FormatError(path, "[problem]: a problem in space given (it has z); expected problems in the plane")
    if missing:
        raise FormatError(
            path, f"[problem]: missing {', '.join(missing)}; expected all of robot, world, start, goal, volume"
        )
    numbers = {key: _number(problem[key], key, path) for key in (*_POSES, *_VOLUME)}
    sx, sy, st, gx, gy, gt = (numbers[key] for key in _POSES)
    xmin, ymin, xmax, ymax = (numbers[key] for key in _VOLUME)
    name = problem["name"].value if "name" in problem else ""
    world, robot = (path.parent / problem[key].value for key in ("world", "robot"))
    return {
        "name": name or path.stem,
        "bounds": (xmin, ymin, xmax, ymax),
        "obstacles": _obstacles(world),
        "robot": {"footprint": _footprint(robot)},
        "queries": ((QUERY, (sx, sy, st), (gx, gy, gt)),),
        "sources": (path.absolute(), world.absolute(), robot.absolute()),
    }


def _section(text: str, path: Path) -> dict[str, _Entry]:
    """Return the entries of [problem]; of a repeated key the last counts. Other sections are for OMPL.app alone."""
    entries: dict[str, _Entry] = {}
    section, found = "", False
    for number, line in enumerate(text.splitlines(), start=1):
        content = line.partition("#")[0].strip()
        if not content or content.startswith(";"):
            continue
        if content.startswith("[") and content.endswith("]"):
            section = content[1:-1].strip().lower()
            found |= section == "problem"
        elif section == "problem":
            key, equals, value = content.partition("=")
            if not equals:
                raise FormatError(path, f"expected key = value, got {content[:60]!r}", number)
            entries[key.strip().lower()] = _Entry(value.strip(), number)
    if not found:
        raise FormatError(path, "expected an OMPL.app cfg with a section [problem], got none")
    return entries


def _number(entry: _Entry, key: str, path: Path) -> float:
    try:
        number = float(entry.value)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise FormatError(path, f"{key}: expected a finite number, got {entry.value!r}", entry.line)
    return number


def _obstacles(path: Path) -> tuple[Polygon, ...]:
    import shapely

    parts = shapely.get_parts(_region(read_collada(path)))
    rings = ([shapely.get_coordinates(ring)[:-1] for ring in (part.exterior, *part.interiors)] for part in parts)
    return tuple(Polygon(outline, tuple(holes)) for outline, *holes in rings)


def _footprint(path: Path) -> Polygon:
    import shapely

    mesh = read_collada(path)
    outline = shapely.get_coordinates(_outline(_region(mesh), path))[:-1]
    return Polygon(outline - mesh.vertices[:, :2].mean(axis=0))


def _region(mesh: Mesh) -> shapely.Geometry:
    """Return the mesh seen along its height: the union of its faces, and free-standing walls as thin sheets."""
    import shapely

    faces = [*shapely.polygons(mesh.triangles[..., :2]), *(_face(polygon[:, :2]) for polygon in mesh.polygons)]
    loops = [*mesh.triangles[..., :2], *(polygon[:, :2] for polygon in mesh.polygons)]
    sheet = SHEET * _extent(mesh.vertices[:, :2])
    # For a sliver this is its thickness; for any other shape it is of its size.
    thickness = 4.0 * shapely.area(faces) / np.maximum(shapely.length(faces), 1e-300)
    region = shapely.union_all([face for face, thick in zip(faces, thickness, strict=True) if thick > 1e-6 * sheet])
    walls = [_longest(loop) for loop, thick in zip(loops, thickness, strict=True) if thick <= sheet]
    if walls:
        lines = shapely.union_all(shapely.linestrings(walls))
        free = shapely.difference(lines, shapely.buffer(region, 0.5 * sheet))
        # Square caps reach over the half sheet that was cut off, so that a wall meets its neighbours again.
        sheets = shapely.buffer(free, sheet, cap_style="square", join_style="mitre")
        region = shapely.union_all([region, sheets])
    return shapely.simplify(region, 0.0)


def _outline(region: shapely.Geometry, path: Path) -> shapely.LinearRing:
    """Return the outer boundary of a robot's region, narrow gaps between its parts filled."""
    import shapely

    parts = list(shapely.get_parts(region))
    count = len(parts)
    if count == 0:
        raise FormatError(path, "expected a mesh that covers an area or a line, got one without extent in the plane")
    if count == 1:
        return parts[0].exterior
    extent, links, joined = _extent(shapely.get_coordinates(region)), [], parts.pop()
    while parts and count <= MAX_PARTS:
        nearest = int(np.argmin(shapely.distance(joined, parts)))
        links.append(shapely.shortest_line(joined, parts[nearest]))
        joined = shapely.union(joined, parts.pop(nearest))
    gap = float(shapely.length(links).max(initial=0.0))
    if gap <= MAX_GAP * extent and not parts:
        # A gap closes when both its sides grow by half of it; three quarters leave no doubt.
        reach = max(0.75 * gap, SHEET * extent)
        grown = shapely.buffer(joined, reach, join_style="mitre")
        closed = shapely.buffer(grown, -reach, join_style="mitre")
        joined = shapely.union(joined, closed)
        if joined.geom_type != "Polygon":  # parts that meet in a corner
            joined = shapely.union_all([joined, *shapely.buffer(links, reach, quad_segs=1)])
        if joined.geom_type == "Polygon":
            # Growing and shrinking leaves vertices side by side that differ by rounding alone.
            return shapely.remove_repeated_points(shapely.simplify(joined.exterior, 0.0), 1e-9 * extent)
    allowed = f"expected one, or up to {MAX_PARTS} with gaps below {MAX_GAP:.0%} of its extent"
    raise FormatError(path, f"{allowed}, got a robot of {count} parts")


def _face(loop: NDArray[np.float64]) -> shapely.Geometry:
    import shapely

    return shapely.make_valid(shapely.Polygon(loop), method="structure", keep_collapsed=False)


def _longest(loop: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the two ends of a loop seen edge-on."""
    along = loop @ np.linalg.svd(loop - loop.mean(axis=0))[2][0]
    return loop[[along.argmin(), along.argmax()]]


def _extent(points: NDArray[np.float64]) -> float:
    return float(np.hypot(*(points.max(axis=0) - points.min(axis=0))))
