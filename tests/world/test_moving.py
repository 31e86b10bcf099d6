"""Moving: the region swept holds every place of the obstacle, and no more."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely

from trailmark.errors import ShapeError, TrailmarkError, WorldError
from trailmark.shapes import Disc, Polygon, Rectangle, Shape
from trailmark.world import World
from trailmark.world.moving import DISC_ERROR, Moving

L_SHAPE = Polygon(np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 3], [0, 3.0]]))
FRAME = Polygon(np.array([[0, 0], [4, 0], [4, 4], [0, 4.0]]), (np.array([[1, 1], [3, 1], [3, 3], [1, 3.0]]),))


def covered(motion: Moving, steps: int = 150) -> shapely.Geometry:
    """Return the union of the obstacle's places at many moments, discs drawn from within."""
    places = []
    for time in np.linspace(0.0, motion.until, steps):
        shape = motion.at(time)
        if isinstance(shape, Disc):
            places.append(shapely.Point(shape.center).buffer(shape.radius, quad_segs=64))
        else:
            places.append(shape.polygon().shapely())
    return shapely.union_all(places)


@pytest.mark.slow
@pytest.mark.parametrize("velocity", [(1.0, 0.0), (-0.3, 0.8), (0.0, -2.0)])
@pytest.mark.parametrize("shape", [Rectangle((1, 2), 3, 1, 0.4), L_SHAPE, FRAME])
def test_the_region_swept_is_exact_for_polygons(shape: Shape, velocity: tuple[float, float]) -> None:
    motion = Moving(shape, velocity, 2.0)
    swept, true = motion.swept.polygon().shapely(), covered(motion)
    assert swept.buffer(1e-9).covers(true)
    # What stands between two moments of the sample is a sliver along edges that lie askew to the motion.
    step = math.hypot(*velocity) * 2.0 / 149
    assert swept.area - true.area < 0.6 * step * true.length
    assert true.buffer(step).covers(swept)


def test_a_disc_sweeps_a_capsule_at_most_one_per_cent_larger() -> None:
    motion = Moving(Disc((1.0, -2.0), 0.5), (3.0, 1.0), 2.0)
    swept = motion.swept.polygon().shapely()
    line = shapely.LineString([(1.0, -2.0), (7.0, 0.0)])
    assert swept.exterior.distance(line) >= 0.5 * (1 - 1e-12)
    assert swept.contains(line)
    assert max(line.distance(shapely.Point(p)) for p in swept.exterior.coords) <= 0.5 * (1 + DISC_ERROR) * (1 + 1e-12)


@pytest.mark.parametrize(
    ("shape", "velocity", "until", "error", "message"),
    [
        ("disc", (1, 0), 1.0, WorldError, "moving: shape: expected Disc or Rectangle or Polygon"),
        (Disc((0, 0), 1), (1, 0, 0), 1.0, WorldError, "velocity: expected two finite numbers vx, vy"),
        (Disc((0, 0), 1), (1, 0), 0.0, WorldError, "until: expected a finite number above 0, got 0.0 s"),
        (Disc((0, 0), 1), (1e9, 0), 1.0, ShapeError, "moving: the region swept"),
    ],
)
def test_bad_motions_are_refused_in_one_line(
    shape: Any, velocity: Any, until: Any, error: type[TrailmarkError], message: str
) -> None:
    with pytest.raises(error, match=message) as caught:
        Moving(shape, velocity, until)
    assert "\n" not in str(caught.value)


def test_a_world_holds_the_region_that_moving_obstacles_sweep() -> None:
    motion = Moving(Rectangle((2, 2), 1, 1), (1.0, 0.0), 3.0)
    world = World("w", (0, 0, 9, 9), (Disc((7, 7), 1), motion))  # type: ignore[arg-type]  # what World takes apart
    assert world.obstacles[1] is motion.swept
    assert world.moving == (None, motion)
    renamed = world.with_robot(world.robot)  # type: ignore[arg-type]  # none is fine for replace
    assert renamed == world
    with pytest.raises(WorldError, match=r"moving\[1\]: expected the region that it sweeps in its place"):
        World("w", (0, 0, 9, 9), (Disc((7, 7), 1), Disc((1, 1), 1)), moving=(None, motion))
    with pytest.raises(WorldError, match="moving: expected one for each of 1 obstacles, or none, got 2"):
        World("w", (0, 0, 9, 9), (motion.swept,), moving=(None, motion))
