"""What counts as covered by the robot wherever in a cell it is, is; shapely alone judges."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from tests.helpers.random_worlds import ROBOTS

from trailmark.planning.proofs.cell_core import core, discs, pivot
from trailmark.planning.proofs.region import MARGIN

NAMES = sorted(set(ROBOTS) - {"disc"})


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("share", [0.02, 0.2, 0.35])
def test_a_core_stays_covered_under_all_shifts_and_turns(name: str, share: float) -> None:
    robot = ROBOTS[name]
    outline = np.asarray(robot.outline.rings()[0]) - pivot(robot)
    shift = share * robot.inscribed_disc.radius
    turn = shift / robot.circumradius
    rings = core(outline, shift, turn)
    assert rings
    rng = np.random.default_rng(0)
    region = shapely.Polygon(outline)
    for ring in rings:
        middle = shapely.Polygon(ring)
        for extreme in [*np.ndindex(3, 8), *[(None, None)] * 20]:
            phi = turn * (rng.uniform(-1.0, 1.0) if extreme[0] is None else extreme[0] - 1.0)
            angle = rng.uniform(0.0, 2.0 * np.pi) if extreme[1] is None else 0.25 * np.pi * extreme[1]
            moved = shapely.affinity.rotate(region, phi, origin=(0.0, 0.0), use_radians=True)
            moved = shapely.affinity.translate(moved, shift * np.cos(angle), shift * np.sin(angle))
            assert shapely.covers(moved, middle)
            assert shapely.distance(moved.exterior, middle) >= MARGIN - 1e-9


@pytest.mark.parametrize("name", NAMES)
def test_little_is_lost_of_a_core(name: str) -> None:
    outline = np.asarray(ROBOTS[name].outline.rings()[0])
    shift = 0.02 * ROBOTS[name].inscribed_disc.radius
    covered = sum(shapely.Polygon(ring).area for ring in core(outline, shift, 0.0))
    region = shapely.Polygon(outline)
    assert covered > region.area - 1.3 * shift * region.length
    assert core(outline, 10.0, 0.1) == []
    assert core(outline, 0.0, 3.0) == []


@pytest.mark.parametrize("name", NAMES)
def test_discs_lie_inside_and_all_over_the_robot(name: str) -> None:
    robot = ROBOTS[name]
    region = robot.outline.shapely()
    found = discs(np.asarray(robot.outline.rings()[0]))
    assert 4 <= len(found) <= 24
    assert (np.diff(found[:, 2]) <= 0.0).all()
    for x, y, r in found:
        assert region.contains(shapely.Point(x, y))
        assert region.exterior.distance(shapely.Point(x, y)) >= r
    # No part of the robot is far from all of them.
    spread = shapely.distance(shapely.multipoints(found[:, :2]), shapely.points(region.exterior.segmentize(0.1).coords))
    assert spread.max() < 0.7 * robot.circumradius
