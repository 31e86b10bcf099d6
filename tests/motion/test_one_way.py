"""One-way zones: motions against an oracle that looks at points along them, and attacks on the corner cases."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st
from tests.support.trials import few

from trailmark import OneWayZone, Polygon, se2
from trailmark.curves import Steering
from trailmark.motion.one_way import OneWays, curve_allowed, one_ways, straight_allowed
from trailmark.se2 import FloatArray

SQUARE = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]]
UNCLEAR = 1e-5
"""Metres from an outline, and radians from a tolerance, where the oracle does not judge."""


def zone(heading: float, tolerance: float, vertices: object = SQUARE, holes: tuple[object, ...] = ()) -> OneWayZone:
    return OneWayZone(Polygon(vertices, holes), heading, tolerance)  # type: ignore[arg-type]


def straight(zones: list[OneWayZone], *ends: float) -> bool:
    ax, ay, bx, by = ends
    return bool(straight_allowed(one_ways(zones), np.array([ax, ay, 0.3]), np.array([bx, by, 2.0])))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("ends", "allowed"),
    [
        ((-1, 1, 3, 1), True),  # along the heading
        ((3, 1, -1, 1), False),
        ((1, -1, 1, 3), False),  # across
        ((1, 1, 1, 1), True),  # turning in place
        ((3, 0, -1, 0), True),  # along the outline, the wrong way
        ((3, 0 - 1e-9, -1, 0), True),
        ((3, 1e-6, -1, 1e-6), False),
        ((0, 3, 0, -1), True),
        ((-1, 1, 1, -1), True),  # through a corner
        ((-1 + 1e-5, 1, 1 + 1e-5, -1), False),
        ((-1 + 1.7e-7, 1, 1 + 1.7e-7, -1), True),  # by half of that into it
        ((-1 + 2.1e-7, 1, 1 + 2.1e-7, -1), False),
        ((-1, 1 - 2.1e-7, 1, 3 - 2.1e-7), False),
        ((3, 3, -1, -1), False),  # from corner to corner
        ((0.5, 0.5, 0.4, 0.5), False),  # wholly inside
        ((1, 2, 1, 2.5), True),  # away from the outline
        ((1, 2, 1, 1.9), False),
        ((1, 1, 1 - 1e-10, 1), True),
        ((-1e6, 1, 1e6, 1), True),
        ((1e6, 1, -1e6, 1), False),
    ],
)
def test_straight_motions_through_a_square(ends: tuple[float, ...], allowed: bool) -> None:
    assert straight([zone(0.0, 0.5)], *ends) is allowed
    assert straight([zone(0.0, math.pi)], *ends)
    assert straight([], *ends)


@pytest.mark.parametrize("heading", [-math.pi, math.pi, math.pi / 2, -math.pi / 2, 0.0])
def test_a_tolerance_of_zero_allows_the_heading_itself(heading: float) -> None:
    c, s = round(math.cos(heading)), round(math.sin(heading))
    assert straight([zone(heading, 0.0)], 1 - 2 * c, 1 - 2 * s, 1 + 2 * c, 1 + 2 * s)
    assert not straight([zone(heading, 0.0)], 1 - 2 * c, 1 - 2 * s, 1 + 2 * c + 1e-6, 1 + 2 * s + 1e-6)


def test_directions_beside_half_a_turn() -> None:
    west = zone(math.pi, 0.1)
    assert straight([west], 3, 1.1, -1, 1.0)  # -pi + 0.025
    assert straight([west], 3, 1.0, -1, 1.1)
    assert not straight([west], 3, 1.5, -1, 1.0)


def test_every_zone_has_to_be_suited() -> None:
    assert straight([zone(0.0, 0.5), zone(0.6, 0.5)], -1, 0.7, 3, 1.8)
    assert not straight([zone(0.0, 0.5), zone(math.pi, 0.5)], -1, 1, 3, 1)
    far = zone(math.pi, 0.5, np.array(SQUARE) + 10)
    assert straight([zone(0.0, 0.5), far], -1, 1, 3, 1)


def test_a_hole_is_outside() -> None:
    ring = zone(0.0, 0.5, np.array(SQUARE) * 2, ([[1, 1], [3, 1], [3, 3], [1, 3]],))
    assert straight([ring], 2.9, 2, 1.1, 2)
    assert straight([ring], 3, 1, 1, 1)
    assert not straight([ring], 3.1, 2, 1.1, 2)


def test_slivers_and_repeated_corners() -> None:
    sliver = zone(0.0, 0.5, [[0, 0], [0, 0], [10, 0], [10, 1e-5], [10, 1e-5]])
    assert not straight([sliver], 9.9, 1, 9.9, -1)
    assert straight([sliver], 5e-3, 1, 5e-3, -1)  # no wider than the depth that touching may have
    thin = zone(0.0, 0.5, [[0, 0], [10, 0], [10, 5e-8], [0, 5e-8]])
    assert straight([thin], 5, 1, 5, -1)


@st.composite
def zones(draw: st.DrawFn) -> OneWayZone:
    """Star-shaped about a centre, often with collinear or repeated corners, with a hole in the middle or without."""
    n = draw(st.integers(3, 9))
    radii = np.array(draw(st.lists(st.sampled_from([0.5, 1.0, 1.5, 2.0]), min_size=n, max_size=n)))
    angles = 2.0 * math.pi * np.arange(n) / n
    ring = radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    holes = (0.4 * ring,) if draw(st.booleans()) else ()
    heading = draw(st.floats(-math.pi, math.pi) | st.sampled_from([0.0, math.pi, math.pi / 2]))
    return OneWayZone(Polygon(ring, holes), heading, draw(st.floats(0.0, math.pi)))


coordinate = st.floats(-3.0, 3.0) | st.sampled_from([-1.0, 0.0, 1.0])
poses = st.tuples(coordinate, coordinate, st.floats(-math.pi, math.pi)).map(np.array)


def judged(zone: OneWayZone, xy: FloatArray, ahead: FloatArray) -> tuple[bool, bool]:
    """Return whether some point clearly goes the wrong way inside, and whether one may do so."""
    region, points = zone.region.shapely(), shapely.points(xy)
    depth = shapely.distance(region.boundary, points) * np.where(shapely.contains(region, points), 1.0, -1.0)
    off = np.abs(se2.wrap(ahead - zone.heading)) - zone.tolerance
    return bool(((depth > UNCLEAR) & (off > UNCLEAR)).any()), bool(((depth > -2e-3) & (off > -2e-3)).any())


@pytest.mark.slow
@settings(max_examples=few(120))
@given(zones(), poses, poses)
def test_straight_motions_against_the_oracle(zone: OneWayZone, a: FloatArray, b: FloatArray) -> None:
    if np.hypot(*(b - a)[:2]) < 1e-6:
        return
    xy = a[:2] + np.linspace(0.0, 1.0, 2001)[:, None] * (b - a)[:2]
    ahead = np.full(len(xy), math.atan2(*(b - a)[1::-1]))
    wrong, maybe = judged(zone, xy, ahead)
    allowed = bool(straight_allowed(one_ways([zone]), a, b))
    assert not (allowed and wrong)
    assert allowed or maybe


TRIANGLE = OneWayZone(Polygon(np.array([[0.5, 0.0], [-0.25, 0.4330127], [-0.25, -0.4330127]])), 3.0, 1.0)
"""Straight back out of it, which is an allowed direction."""


@pytest.mark.slow
@example(TRIANGLE, np.zeros(3), np.array([-1.0, 0.0, 0.0]), 0.3, True)
@settings(max_examples=few(120))
@given(zones(), poses, poses, st.sampled_from([0.3, 1.0, 5.0]), st.booleans())
def test_curves_against_the_oracle(
    zone: OneWayZone, a: FloatArray, b: FloatArray, radius: float, reverse: bool
) -> None:
    steering = Steering(radius, reverse)
    word = word_of(steering, a, b)
    length = np.abs(word[0]).sum() * radius
    if length < 1e-3:
        return
    along = np.linspace(0.0, length, 4001)
    states = steering.states(a[None], b[None], along[None])[0]
    # Which piece each point lies in, and so whether it is driven backwards there.
    used = np.flatnonzero(word[0])
    piece = used[np.searchsorted(np.cumsum(np.abs(word[0][used])) * radius, along).clip(0, len(used) - 1)]
    ahead = states[:, 2] + np.where(word[0][piece] < 0.0, math.pi, 0.0)
    wrong, maybe = judged(zone, states[:, :2], ahead)
    allowed = bool(curve_allowed(one_ways([zone]), a, word, radius))
    assert not (allowed and wrong)
    assert allowed or maybe


def word_of(steering: Steering, a: FloatArray, b: FloatArray) -> FloatArray:
    from trailmark.curves.shortest import curve_words

    return np.asarray(curve_words(a[None], b[None], steering.radius, steering.reverse)[0])


def test_no_zones_at_all() -> None:
    none = one_ways([])
    assert isinstance(none, OneWays)
    assert len(none.zones) == 0
    assert curve_allowed(none, np.zeros(3), np.ones((2, 5)), 1.0)
