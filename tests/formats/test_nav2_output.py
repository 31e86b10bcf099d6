"""Worlds as nav2 maps: read back, they hold what they held."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import shapely

from trailmark.formats.nav2_map import save_nav2_map
from trailmark.shapes import Disc, Polygon, Rectangle
from trailmark.world import ObstacleEstimate, World

BOUNDS = (-1.0, 2.0, 5.0, 6.0)
WALL, POST = Rectangle((2.0, 4.0), 2.0, 0.04, 0.3), Disc((0.0, 3.0), 0.4)
HIDDEN = Polygon(np.array([[4.0, 5.0], [5.0, 5.0], [5.0, 6.0], [4.0, 6.0]]))


def test_a_saved_map_holds_the_obstacles_and_hardly_more(tmp_path: Path) -> None:
    known = tuple(ObstacleEstimate(shape, 1e-4 * np.eye(2)) for shape in (WALL, POST))
    world = World("w", BOUNDS, (WALL, POST, HIDDEN), estimates=(*known, None))
    files = save_nav2_map(world, tmp_path / "map.yaml", 0.05)
    assert files == (tmp_path / "map.yaml", tmp_path / "map.pgm")
    read = World.load(files[0])
    assert np.allclose(read.bounds, BOUNDS)
    blocked = shapely.union_all([shape.polygon().shapely() for shape in read.obstacles])
    for shape in (WALL, POST, HIDDEN):
        assert shapely.covers(shapely.buffer(blocked, 1e-6), shape.polygon(1e-4).shapely())
    outside = shapely.union_all([shape.polygon(1e-4).shapely().buffer(0.12) for shape in (WALL, POST, HIDDEN)])
    assert shapely.covers(outside, blocked)
    image = np.frombuffer(files[1].read_bytes()[-120 * 80 :], dtype=np.uint8).reshape(80, 120)
    assert set(np.unique(image)) == {0, 205, 254}
    assert image[5, 110] == 205  # the first row has the largest y
    assert (image == 205).sum() == 400


def test_without_estimates_all_obstacles_are_solid(tmp_path: Path) -> None:
    boundary = Polygon(np.array([[-1.0, 2.0], [5.0, 2.0], [5.0, 4.0], [-1.0, 4.0]]))
    _, image = save_nav2_map(World("w", BOUNDS, (POST,), boundary=boundary), tmp_path / "map.yaml", 0.1)
    cells = np.frombuffer(image.read_bytes()[-60 * 40 :], dtype=np.uint8).reshape(40, 60)
    assert cells[29, 10] == 0
    assert (cells[:20] == 205).all()
    assert cells[39, 59] == 254
