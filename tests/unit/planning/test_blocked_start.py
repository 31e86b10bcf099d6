"""A start that is not free, as of a robot that is not quite where it is thought to be: the way out, then the plan."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from tests.helpers.worlds import random_world

from trailmark import ConfigurationError, LandmarkPlanner, Robot, StateChecker, World, check_path
from trailmark.curves.words import drive
from trailmark.planning.escape import way_out
from trailmark.se2 import FloatArray, transform

BODY = Robot.rectangle(1.0, 0.5)
DRIVES = {
    "omnidirectional": BODY,
    "differential": BODY.differential(reverse=True),
    "forward-only differential": BODY.differential(),
    "car": BODY.steered(1.0),
    "forward-only car": BODY.steered(1.0, reverse=False),
}
THIRD = 0.5 / 3.0
"""Metres: a third of the footprint's width."""


def overlap(blocked: shapely.Geometry, q: FloatArray) -> float:
    """Return how far a robot would have to be shrunk at least, metres, to be free: by shapely, without our depths."""
    outline = shapely.Polygon(transform(q, BODY.outline.vertices))
    inside = shapely.get_coordinates(shapely.intersection(outline, blocked))
    return float(shapely.distance(shapely.points(inside), outline.exterior).max()) if len(inside) else 0.0


def carved(name: str, checker: StateChecker, blocked: shapely.Geometry, rng: np.random.Generator) -> FloatArray | None:
    """Return where a motion of this drive begins that leads out, less and less deep: found by driving it backwards."""
    x, y = rng.uniform(3.0, 37.0, 2)
    free = np.array([x, y, rng.uniform(-3.0, 3.0)])
    if not checker.valid(free):
        return None
    side = rng.choice([-1.0, 0.0, 1.0]) if "car" in name else 0.0
    ahead = "forward" in name or rng.random() < 0.5  # it leaves driving forward
    deepest, place, last = 0.0, None, 0.0
    for s in np.arange(0.02, 1.5, 0.02):
        way = -s if ahead else s
        q = (
            np.array(drive(free[0], free[1], free[2], side, way, 1.0), np.float64)
            if side
            else free + way * np.array([np.cos(free[2]), np.sin(free[2]), 0.0])
        )
        now = overlap(blocked, q)
        if now < last or now > THIRD:
            break
        last = now
        if now > 0.005:
            deepest, place = now, q
    return place if deepest > 0.005 else None


@pytest.mark.slow
@pytest.mark.parametrize("name", DRIVES)
def test_each_drive_leaves_what_a_motion_of_it_leads_out_of(name: str) -> None:
    rng, found = np.random.default_rng(3), 0
    for seed in range(40):
        world = random_world(seed, 40, size=40.0, discs=0.0)
        blocked = shapely.union_all([shape.polygon().shapely() for shape in world.obstacles])
        checker = StateChecker(world, DRIVES[name])
        for _ in range(60):
            start = carved(name, checker, blocked, rng)
            if start is None:
                continue
            out = way_out(checker, start, 5.0)
            assert out is not None, (seed, start.tolist())
            assert np.array_equal(out[0], start)
            assert checker.valid(out[-1])
            found += 1
            break
    assert found >= 20


@pytest.mark.slow
def test_without_escape_the_error_says_how_deep_and_how_far_out(worlds: Path) -> None:
    world = World.load(worlds / "office.yaml")
    planner = LandmarkPlanner(world, seed=0)
    start = np.array([0.25, 1.0, 0.0])
    with pytest.raises(ConfigurationError, match=r"start .*0\.05 m over the left bound; the way out is 0\.2 m long"):
        planner.plan(start, world.queries[0].goal)
    result = planner.plan(start, world.queries[0].goal, escape=True)
    assert (result.status, result.escape, result.lower_bound) == ("solved", 1, None)
    assert np.array_equal(result.path.states[0], start)
    assert check_path(world, planner.robot, result.path.states[result.escape :]).free
    assert planner.plan(world.queries[0].start, world.queries[0].goal, escape=True).escape == 0


def test_who_cannot_move_out_is_told_why(worlds: Path) -> None:
    world = World.load(worlds / "office.yaml")
    robot = replace(Robot.rectangle(0.6, 0.4), drive="car", turning_radius=0.5, reverse=False)
    result = LandmarkPlanner(world, robot, seed=0).plan((19.75, 1.0, 0.0), (18.0, 10.0, 1.57), escape=True)
    assert (result.status, result.path) == ("timeout", None)
    assert "right bound, and no motion leads out along which it gets no deeper" in result.reason
