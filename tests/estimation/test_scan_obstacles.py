"""What tracks and grids come to: heaps, gaps, and the unknown, in grids that are filled by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from trailmark.estimation.grid import EvidenceGrid
from trailmark.estimation.map_settings import MappingSettings
from trailmark.estimation.obstacles import find_obstacles
from trailmark.estimation.scan_features import DiscTracks, LineTracks, Observation
from trailmark.shapes import Polygon

CELL = 0.1
HERE = np.array([[1.05, 1.05, 0.0]])
SETTINGS = MappingSettings(cell=CELL, pose_sigma=(0.02, 0.01))
POSE = np.diag([4e-4, 4e-4, 1e-4])


def nothing() -> tuple[LineTracks, DiscTracks]:
    return LineTracks(0.99, POSE, 0.3), DiscTracks(0.99, POSE)


def open_grid() -> EvidenceGrid:
    """Six by four metres, all of which beams went through once."""
    grid = EvidenceGrid((0.0, 0.0, 6.0, 4.0), CELL)
    grid.passes[:] = 1
    return grid


def hit(grid: EvidenceGrid, rows: slice, columns: slice, times: int = 5, length: float = 2.0) -> None:
    grid.hits[rows, columns], grid.passes[rows, columns] = times, 0
    grid.variance[rows, columns] = times * (0.02**2 + (0.01 * length) ** 2)


def test_cells_that_nothing_explains_are_heaps() -> None:
    grid = open_grid()
    hit(grid, np.s_[20:23], np.s_[30:35], length=3.0)
    # Beside it, within three cells, what was seen from far away: no part of it.
    hit(grid, np.s_[20:23], np.s_[37:38], length=40.0)
    found = find_obstacles(*nothing(), grid, HERE, SETTINGS)
    assert (found.walls, found.discs, found.unknown) == ([], [], [])
    near, far = sorted(found.heaps, key=lambda heap: float(heap.mean.polygon().vertices[:, 0].min()))
    assert isinstance(near.mean, Polygon)
    assert shapely.hausdorff_distance(near.mean.shapely(), shapely.box(3.0, 2.0, 3.5, 2.3)) < 1e-9
    for heap, away in ((near, 3.0), (far, 40.0)):
        assert heap.covariance == pytest.approx((4e-4 + 4e-4 + (0.01 * away) ** 2) * np.eye(2))


def test_what_is_cut_off_or_unseen_is_blocked() -> None:
    grid = open_grid()
    grid.passes[:, 40:] = 0
    grid.passes[5, 20] = 0
    hit(grid, np.s_[:], np.s_[30:32])
    found = find_obstacles(*nothing(), grid, HERE, SETTINGS)
    blocked = shapely.union_all([shape.polygon().shapely() for shape in found.unknown])
    assert shapely.covers(blocked, shapely.box(4.0, 0.0, 6.0, 4.0))
    # Behind the wall beams went, but no robot came there; one unseen cell among free ones is none.
    assert shapely.covers(blocked, shapely.box(3.4, 0.1, 4.0, 3.9))
    assert shapely.distance(blocked, shapely.box(0.0, 0.0, 2.9, 4.0)) > 0.0
    free = find_obstacles(*nothing(), grid, HERE, MappingSettings(cell=CELL, unknown="free"))
    assert free.unknown == []


def test_a_wall_that_is_gone_is_no_wall() -> None:
    grid = open_grid()
    lines, discs = nothing()
    points = np.column_stack([np.linspace(1.0, 3.0, 60), np.full(60, 2.05)])
    lines.update([Observation(np.array([2.05, 0.5 * math.pi]), 1e-4 * np.eye(2), np.zeros((2, 2)), points)])
    assert find_obstacles(lines, discs, grid, HERE, SETTINGS).walls == []
    post = np.array([3.0, 1.0, 0.2])
    discs.update([Observation(post, 1e-4 * np.eye(3), np.zeros((3, 3)), post[:2] - [[0.2, 0.0], [0.1, 0.17]])])
    assert find_obstacles(lines, discs, grid, HERE, SETTINGS).discs == []
    hit(grid, np.s_[8:13], np.s_[27:31])
    grid.passes[8:13, 28:33] = 0  # beams end at it, and none goes through
    ((disc, _),) = find_obstacles(lines, discs, grid, HERE, SETTINGS).discs
    assert disc.covariance.shape == (3, 3)


def test_a_disc_that_beams_went_through_is_none() -> None:
    """Two faces at the end of a wall fit a circle that reaches into free space: cells stand for it."""
    for free in (0, 1):
        grid = open_grid()
        _, discs = nothing()
        points = np.array([[2.75, 0.85], [2.75, 0.95], [2.75, 1.05], [2.85, 0.85], [2.95, 0.85]])
        hit(grid, np.s_[8:11], np.s_[27:28])
        hit(grid, np.s_[8:9], np.s_[28:30])
        # Behind the faces, where the circle bulges: in sight, or not.
        grid.passes[9:13, 28:33] = free
        discs.update([Observation(np.array([3.0, 1.05, 0.3]), 1e-4 * np.eye(3), np.zeros((3, 3)), points)])
        found = find_obstacles(*(nothing()[0], discs), grid, HERE, SETTINGS)
        assert (len(found.discs), len(found.heaps)) == ((0, 1) if free else (1, 0))
