"""One-way zones: planning, the final check and the audit allow what points along a motion say, and all the same."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st
from tests.helpers.trials import few

from trailmark import OneWayZone, Polygon, Robot, StateChecker, World, check_path, se2
from trailmark.curves.shortest import curve_words
from trailmark.motion import CurveMotion, motion_of
from trailmark.se2 import FloatArray
from trailmark.trajectories import path_of
from trailmark.verify import RIM, Verifier

SQUARE = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]]
SPECK = Robot.rectangle(0.02, 0.01)
UNCLEAR = 1e-5
"""Metres from an outline, and radians from a tolerance, where the oracle does not judge."""


def zone(heading: float, tolerance: float, vertices: object = SQUARE, holes: tuple[object, ...] = ()) -> OneWayZone:
    return OneWayZone(Polygon(vertices, holes), heading, tolerance)  # type: ignore[arg-type]


def verdicts(
    zones: list[OneWayZone], a: FloatArray, b: FloatArray, robot: Robot = SPECK, far: float = 1e3
) -> set[bool]:
    """Return what planning, the final check and the audit say; what is planned, the others let pass."""
    world = World("w", (-far, -far, far, far), zones=tuple(zones))
    checker = StateChecker(world, robot, cell=far / 100.0)
    motion = motion_of(checker)
    path = path_of(motion, np.array([a, b]))
    planned = bool(motion.motion_valid(a, b))
    passed = Verifier(checker.world, robot, RIM).fault(path, *path.states[[0, -1]]) is None
    audited = check_path(world, robot, path).free
    assert planned <= min(passed, audited)
    return {planned, passed, audited}


def straight(zones: list[OneWayZone], *ends: float) -> bool:
    ax, ay, bx, by = ends
    far = 2.0 * max(500.0, *map(abs, ends))
    (verdict,) = verdicts(zones, np.array([ax, ay, 0.3]), np.array([bx, by, 2.0]), far=far)
    return verdict


@pytest.mark.slow
@pytest.mark.parametrize(
    ("ends", "free"),
    [
        ((-1, 1, 3, 1), True),  # along the heading
        ((3, 1, -1, 1), False),
        ((1, -1, 1, 3), False),  # across
        ((1, 1, 1, 1), True),  # turning in place
        ((3, 0, -1, 0), True),  # along the outline, the wrong way
        ((3, 1e-6, -1, 1e-6), False),
        ((0, 3, 0, -1), True),
        ((-1, 1, 1, -1), True),  # through a corner
        ((-1 + 1e-5, 1, 1 + 1e-5, -1), False),
        ((3, 3, -1, -1), False),  # from corner to corner
        ((0.5, 0.5, 0.4, 0.5), False),  # wholly inside
        ((1, 2, 1, 2.5), True),  # away from the outline
        ((1, 2, 1, 1.9), False),
        ((-1e5, 1, 1e5, 1), True),
        ((1e5, 1, -1e5, 1), False),
    ],
)
def test_straight_motions_through_a_square(ends: tuple[float, ...], free: bool) -> None:
    assert straight([zone(0.0, 0.5)], *ends) is free
    assert straight([zone(0.0, math.pi)], *ends)


@pytest.mark.slow
def test_headings_holes_and_several_zones() -> None:
    for heading in (-math.pi, math.pi, math.pi / 2, -math.pi / 2, 0.0):
        c, s = round(math.cos(heading)), round(math.sin(heading))
        assert straight([zone(heading, 0.0)], 1 - 2 * c, 1 - 2 * s, 1 + 2 * c, 1 + 2 * s)
        assert not straight([zone(heading, 0.0)], 1 - 2 * c, 1 - 2 * s, 1 + 2 * c + 1e-4, 1 + 2 * s + 1e-4)
    west = zone(math.pi, 0.1)
    assert straight([west], 3, 1.1, -1, 1.0)  # -pi + 0.025
    assert not straight([west], 3, 1.5, -1, 1.0)
    assert straight([zone(0.0, 0.5), zone(0.6, 0.5)], -1, 0.7, 3, 1.8)
    assert not straight([zone(0.0, 0.5), zone(math.pi, 0.5)], -1, 1, 3, 1)
    ring = zone(0.0, 0.5, np.array(SQUARE) * 2, ([[1, 1], [3, 1], [3, 3], [1, 3]],))
    assert straight([ring], 2.9, 2, 1.1, 2)
    assert straight([ring], 3, 1, 1, 1)
    assert not straight([ring], 3.1, 2, 1.1, 2)
    sliver = zone(0.0, 0.5, [[0, 0], [0, 0], [10, 0], [10, 1e-5], [10, 1e-5]])
    assert not straight([sliver], 9.9, 1, 9.9, -1)
    assert straight([sliver], 5e-3, 1, 5e-3, -1)  # no wider than the depth that touching may have


@st.composite
def zones(draw: st.DrawFn) -> OneWayZone:
    """Star-shaped about a centre, often with collinear corners, with a hole in the middle or without."""
    n = draw(st.integers(3, 9))
    radii = np.array(draw(st.lists(st.sampled_from([0.5, 1.0, 1.5, 2.0]), min_size=n, max_size=n)))
    angles = 2.0 * math.pi * np.arange(n) / n
    ring = radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    heading = draw(st.floats(-math.pi, math.pi) | st.sampled_from([0.0, math.pi, math.pi / 2]))
    return zone(heading, draw(st.floats(0.0, math.pi)), ring, (0.4 * ring,) if draw(st.booleans()) else ())


coordinate = st.floats(-3.0, 3.0) | st.sampled_from([-1.0, 0.0, 1.0])
poses = st.tuples(coordinate, coordinate, st.floats(-math.pi, math.pi)).map(np.array)
TRIANGLE = zone(3.0, 1.0, [[0.5, 0.0], [-0.25, 0.4330127], [-0.25, -0.4330127]])
"""Straight back out of it, which is an allowed direction."""


@pytest.mark.slow
@example(TRIANGLE, np.zeros(3), np.array([-1.0, 0.0, 0.0]), 0.3, True)
@settings(max_examples=few(240))
@given(zones(), poses, poses, st.sampled_from([None, 0.3, 1.0, 5.0]), st.booleans())
def test_all_verdicts_are_those_of_points_along_the_way(
    region: OneWayZone, a: FloatArray, b: FloatArray, radius: float | None, reverse: bool
) -> None:
    robot = SPECK if radius is None else SPECK.steered(radius, reverse)
    motion = motion_of(StateChecker(World("w", (-1e3, -1e3, 1e3, 1e3)), robot, cell=10.0))
    if isinstance(motion, CurveMotion):
        word = np.asarray(curve_words(a[None], b[None], motion.steering.radius, reverse)[0])
        ends = np.cumsum(np.abs(word[0])) * motion.steering.radius
        along = np.linspace(0.0, ends[-1], 4001)
        states = motion.steering.states(a[None], b[None], along[None])[0]
        # Which piece each point lies in, and so whether it is driven backwards there.
        used = np.flatnonzero(word[0])
        piece = used[np.searchsorted(ends[used], along).clip(0, len(used) - 1)] if len(used) else np.zeros(4001, int)
        ahead, length = states[:, 2] + np.where(word[0][piece] < 0.0, math.pi, 0.0), ends[-1]
    else:
        states = a + np.linspace(0.0, 1.0, 4001)[:, None] * (b - a)
        ahead, length = np.full(4001, math.atan2(*(b - a)[1::-1])), float(np.hypot(*(b - a)[:2]))
    if length < 1e-3:
        return
    shape, points = region.region.shapely(), shapely.points(states[:, :2])
    depth = shapely.distance(shape.boundary, points) * np.where(shapely.contains(shape, points), 1.0, -1.0)
    off = np.abs(se2.wrap(ahead - region.heading)) - region.tolerance
    found = verdicts([region], a, b, robot)
    if ((depth > UNCLEAR) & (off > UNCLEAR)).any():
        assert found == {False}
    elif not ((depth > -2e-3) & (off > -2e-3)).any():
        assert found == {True}


@pytest.mark.parametrize(
    ("states", "expected"),
    [
        ([[-1, 1, 0], [3, 1, 0]], []),
        ([[3, 1, 0], [1, 1, 0], [-1, 1, 0]], [(1.0, 3.0, 1.0)]),
        ([[1, -1, 0], [1, 0.5, 0], [1.5, 0.5, 0], [1.5, -1, 0]], [(1.0, 1.5, 0.5), (2.0, 2.5, 0.5)]),
    ],
)
def test_audits_tell_where_and_how_deep(states: list[list[float]], expected: list[tuple[float, ...]]) -> None:
    audit = check_path(World("w", (-9.0, -9.0, 9.0, 9.0), zones=(zone(0.0, 0.5),)), SPECK, states)
    assert [c.obstacle for c in audit.collisions] == ["one-way zone 0"] * len(expected)
    for c, row in zip(audit.collisions, expected, strict=True):
        assert (c.begin, c.end, c.depth) == pytest.approx(row, abs=2e-3)
