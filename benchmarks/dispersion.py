"""How well nodes fill free space: dispersion, the largest empty disc, and coverage, the share that sees a node.

Source of both measures: LaValle, "Planning Algorithms" (2006), section 5.2.3 (dispersion), and Hsu, Latombe &
Motwani, "Path planning in expansive configuration spaces", ICRA 1997 (what a set of configurations sees).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision import StateChecker, kernels
from trailmark.collision.footprint import build_footprint
from trailmark.errors import ConfigurationError
from trailmark.world import Robot

__all__ = ["Dispersion", "FreePositions", "coverage", "dispersion", "free_positions"]

MAX_CELLS = 1 << 22
"""Maximum number of cells: more would not fit into the memory of a small machine."""

SPECK = 1e-9
"""Radius (metres) of a disc in place of a point."""


class FreePositions(NamedTuple):
    """Where a robot's reference point may be, on a grid of square cells.

    Attributes:
        certain: (m, 2), metres: cell centres at which some heading is proven valid.
        possible: (l, 2): centres of all cells that may hold a free position, those of ``certain`` among them.
        reach: metres, half of a cell's diagonal: no point of a cell is farther from its centre.
        area: square metres: the cells of ``certain``. An estimate of the free area, not a bound.
    """

    certain: se2.FloatArray
    possible: se2.FloatArray
    reach: float
    area: float


class Dispersion(NamedTuple):
    """The radius of the largest disc that contains no node and whose centre is a free position.

    Attributes:
        lower: metres; a free position this far from every node was found.
        upper: metres; no free position is farther from the nearest node: ``lower`` plus the grid's error.
        place: (2,), that free position.
    """

    lower: float
    upper: float
    place: se2.FloatArray


def free_positions(checker: StateChecker, *, cells: int = 1 << 16, headings: int = 16) -> FreePositions:
    """Return where the robot's reference point may be.

    A cell is possible unless the disc about the reference point inside the footprint
    (:attr:`trailmark.world.Robot.reference_radius`) fits nowhere in it. That excludes little where the disc is smaller
    than a cell, and nothing if the reference point lies outside of the footprint: then every cell is possible.

    Args:
        checker: decides what is valid.
        cells: approximate number of cells, 1 to MAX_CELLS.
        headings: tried at each centre, evenly spaced, >= 1; a disc robot needs only one.

    Raises:
        ConfigurationError: ``cells`` or ``headings`` out of range, or no valid configuration was found.
    """
    if not 1 <= cells <= MAX_CELLS:
        raise ConfigurationError(f"cells: expected 1 to {MAX_CELLS}, got {cells}")
    if headings < 1:
        raise ConfigurationError(f"headings: expected 1 or more, got {headings}")
    centers, size = _grid(checker, cells)
    reach = size * np.sqrt(0.5)
    q = np.column_stack([centers, np.zeros(len(centers))])
    certain = checker.valid(q)
    for heading in np.arange(1, headings) * (2.0 * np.pi / headings) if not checker.footprint.is_disc else ():
        rest = np.flatnonzero(~certain)
        q[rest, 2] = se2.wrap(heading)
        certain[rest] = checker.valid(q[rest])
    if not certain.any():
        raise ConfigurationError(f"world {checker.world.name!r}: no free place for the robot was found")
    # Contact is allowed up to 1e-7 m; ten times that counts as possible.
    least = checker.robot.reference_radius - reach - 1e-6
    possible = np.ones(len(q), dtype=np.bool_)
    if least > 0.0:
        speck = build_footprint(Robot.disc(SPECK))
        possible = kernels.clearances(checker.grid, checker.field, speck, q, least + SPECK) + SPECK >= least
    return FreePositions(centers[certain], centers[possible | certain], float(reach), float(certain.sum() * size**2))


def dispersion(nodes: se2.FloatArray, free: FreePositions) -> Dispersion:
    """Return the radius of the largest empty disc, between two proven bounds.

    Distances from cell centres to the nodes are exact; a position in a cell is at most ``free.reach`` from the
    cell's centre. The disc may hold obstacles: distances are straight, as between neighbours in a roadmap.

    Args:
        nodes: configurations (n, 3) or positions (n, 2), n >= 1.
        free: from :func:`free_positions`.

    Raises:
        ConfigurationError: no nodes.
    """
    from scipy.spatial import cKDTree

    if len(nodes) == 0:
        raise ConfigurationError("dispersion: expected 1 node or more, got none")
    tree = cKDTree(nodes[:, :2])
    gaps = np.asarray(tree.query(free.certain)[0])
    widest = int(np.argmax(gaps))
    largest = float(np.max(tree.query(free.possible)[0]))
    return Dispersion(float(gaps[widest]), largest + free.reach, free.certain[widest])


def coverage(checker: StateChecker, nodes: se2.FloatArray, q: se2.FloatArray) -> NDArray[np.bool_]:
    """Return which configurations see a node: a certified motion leads straight from it to one, however far away.

    Args:
        checker: decides which motions are certified.
        nodes: valid configurations, shape (n, 3); a disc robot's headings do not matter.
        q: valid configurations, shape (m, 3).

    Returns:
        Shape (m,). The mean over random valid ``q`` estimates the share of free space that the nodes cover.
    """
    from scipy.spatial import cKDTree

    seen = np.zeros(len(q), dtype=np.bool_)
    if len(nodes) == 0 or len(q) == 0:
        return seen
    radius = checker.footprint.sweep_radius
    tree, points = cKDTree(se2.embed(nodes, radius)), se2.embed(q, radius)
    # Near nodes first: hardly any configuration needs them all.
    tried, count = 0, 1
    while tried < len(nodes) and not seen.all():
        count = min(count, len(nodes))
        rest = np.flatnonzero(~seen)
        nearest = np.asarray(tree.query(points[rest], count)[1]).reshape(len(rest), count)[:, tried:]
        starts, ends = np.repeat(q[rest], nearest.shape[1], axis=0), nodes[nearest.ravel()]
        seen[rest] = checker.motions_between_valid(starts, ends).reshape(nearest.shape).any(axis=1)
        tried, count = count, 4 * count
    return seen


def _grid(checker: StateChecker, cells: int) -> tuple[se2.FloatArray, float]:
    """Return the centres (n, 2) of about so many square cells that hold all free positions, and their edge (metres)."""
    robot = checker.robot
    # A reference point outside of the footprint may lie outside of the bounds too.
    margin = 0.0 if robot.reference_radius > 0.0 else robot.circumradius
    xmin, ymin, xmax, ymax = np.array(checker.world.bounds) + margin * np.array([-1.0, -1.0, 1.0, 1.0])
    size = float(np.sqrt((xmax - xmin) * (ymax - ymin) / cells))
    columns, rows = max(1, int(np.ceil((xmax - xmin) / size))), max(1, int(np.ceil((ymax - ymin) / size)))
    # Centred, so that the excess of whole cells over the bounds is the same on either side.
    x = 0.5 * (xmin + xmax) + (np.arange(columns) - 0.5 * (columns - 1)) * size
    y = 0.5 * (ymin + ymax) + (np.arange(rows) - 0.5 * (rows - 1)) * size
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2), size
