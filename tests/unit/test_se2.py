"""SE(2) algebra: wrapping, the metric, interpolation, composition, embedding and the bounds on motion."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark import ConfigurationError, se2

EDGE_ANGLES = [0.0, -0.0, math.pi, -math.pi, np.nextafter(math.pi, 0), np.nextafter(-math.pi, 0), 1e-300, -1e-300]

angles = st.one_of(st.floats(-math.pi, math.pi, exclude_min=True), st.sampled_from(EDGE_ANGLES[:3] + EDGE_ANGLES[4:]))
lengths = st.one_of(st.floats(-1e3, 1e3), st.floats(-1e-6, 1e-6), st.floats(-1e6, 1e6))
poses = st.tuples(lengths, lengths, angles).map(np.array)
fractions = st.one_of(st.floats(0.0, 1.0), st.sampled_from([0.0, 0.5, 1.0]))


def unit(theta: object) -> complex | np.ndarray:
    return np.exp(1j * np.asarray(theta, dtype=float))


def close(a: np.ndarray, b: np.ndarray, scale: float = 1.0) -> bool:
    """Whether configurations are the same place and heading, the cut at half a turn left aside."""
    tolerance = 1e-12 * max(1.0, scale, float(np.abs(a[..., :2]).max()))
    return bool(
        (np.abs(a[..., :2] - b[..., :2]) <= tolerance).all()
        and (np.abs(unit(a[..., 2]) - unit(b[..., 2])) <= 1e-11).all()
    )


# --- wrap


@given(st.one_of(st.floats(-1e6, 1e6), st.sampled_from(EDGE_ANGLES)))
def test_wrap_keeps_the_direction_and_lands_in_the_half_open_turn(theta: float) -> None:
    wrapped = se2.wrap(theta)
    assert isinstance(wrapped, float)
    assert -math.pi < wrapped <= math.pi
    assert abs(unit(wrapped) - unit(theta)) <= 1e-9 * max(1.0, abs(theta) / 1e3)


@given(angles)
def test_wrap_leaves_wrapped_angles_alone_to_the_bit(theta: float) -> None:
    assert se2.wrap(theta) == theta
    assert se2.wrap(se2.wrap(theta)) == se2.wrap(theta)


def test_wrap_of_half_a_turn_is_plus_pi() -> None:
    assert se2.wrap(-math.pi) == math.pi
    assert se2.wrap(np.nextafter(-math.pi, -4.0)) == pytest.approx(math.pi, abs=1e-15)
    assert se2.wrap(3 * math.pi) == pytest.approx(math.pi, abs=1e-15)
    assert se2.wrap(1e300) <= math.pi


# --- difference and distance


@pytest.mark.slow
@given(poses, poses)
def test_difference_leads_from_a_to_b_and_never_turns_more_than_half(a: np.ndarray, b: np.ndarray) -> None:
    delta = se2.difference(a, b)
    assert abs(delta[2]) <= math.pi
    assert close(a + delta, b, float(np.abs([a, b]).max()))


def test_difference_of_half_a_turn_is_plus_pi() -> None:
    assert se2.difference((0, 0, 0), (0, 0, math.pi))[2] == math.pi
    assert se2.difference((0, 0, math.pi), (0, 0, 0))[2] == math.pi


@pytest.mark.slow
@given(poses, poses, poses)
def test_distance_is_a_metric(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> None:
    ab, bc, ac = se2.distance(a, b), se2.distance(b, c), se2.distance(a, c)
    assert ab >= 0.0
    assert se2.distance(a, a) == 0.0
    assert ab == pytest.approx(se2.distance(b, a), rel=1e-12, abs=1e-12)
    assert ac <= ab + bc + 1e-12 * max(1.0, float(np.abs([a, b, c]).max()))


@pytest.mark.slow
@given(poses, poses)
def test_distance_is_way_plus_half_of_the_turn(a: np.ndarray, b: np.ndarray) -> None:
    turn = abs(np.angle(unit(b[2]) / unit(a[2])))
    assert se2.distance(a, b) == pytest.approx(math.dist(a[:2], b[:2]) + 0.5 * turn, rel=1e-12, abs=1e-12)


# --- interpolate


@pytest.mark.slow
@given(poses, poses, fractions)
def test_interpolation_goes_straight_along_the_shorter_arc(a: np.ndarray, b: np.ndarray, t: float) -> None:
    q = se2.interpolate(a, b, t)
    assert -math.pi < q[2] <= math.pi
    assert se2.distance(a, q) == pytest.approx(t * se2.distance(a, b), rel=1e-9, abs=1e-9)
    assert se2.distance(a, q) + se2.distance(q, b) == pytest.approx(se2.distance(a, b), rel=1e-9, abs=1e-9)


def test_half_a_turn_goes_counter_clockwise() -> None:
    assert se2.interpolate((0, 0, 0), (0, 0, math.pi), 0.5) == pytest.approx((0, 0, math.pi / 2))
    assert se2.interpolate((0, 0, math.pi), (0, 0, 0), 0.5) == pytest.approx((0, 0, -math.pi / 2))


# --- compose and transform


@pytest.mark.slow
@given(poses, poses, poses)
def test_composition_is_associative(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> None:
    left = se2.compose(se2.compose(a, b), c)
    right = se2.compose(a, se2.compose(b, c))
    assert close(left, right, float(np.abs([a, b, c]).max()))


@given(poses)
def test_composition_has_an_identity_and_inverses(a: np.ndarray) -> None:
    identity = np.zeros(3)
    assert close(se2.compose(a, identity), a)
    assert close(se2.compose(identity, a), a)
    z = -complex(a[0], a[1]) / unit(a[2])
    inverse = np.array([z.real, z.imag, -a[2]])
    scale = float(np.abs(a).max())
    assert close(se2.compose(a, inverse), identity, scale)
    assert close(se2.compose(inverse, a), identity, scale)
    assert close(se2.between(a, identity), inverse, scale)


@pytest.mark.slow
@given(poses, poses, st.lists(st.tuples(lengths, lengths), min_size=1, max_size=4))
def test_transform_moves_points_as_composition_moves_frames(
    a: np.ndarray, b: np.ndarray, points: list[tuple[float, float]]
) -> None:
    scale = float(np.abs([*a, *b, *np.ravel(points)]).max())
    at_once = se2.transform(se2.compose(a, b), points)
    one_by_one = se2.transform(a, se2.transform(b, points))
    assert at_once == pytest.approx(one_by_one, abs=1e-11 * max(1.0, scale))
    z = complex(a[0], a[1]) + unit(a[2]) * (np.asarray(points) @ (1, 1j))
    placed = se2.transform(a, points)
    assert placed[:, 0] + 1j * placed[:, 1] == pytest.approx(z, abs=1e-11 * max(1.0, scale))
    heading_free = np.column_stack([points, np.zeros(len(points))])
    assert se2.compose(a[None], heading_free)[:, :2] == pytest.approx(placed, abs=1e-11 * max(1.0, scale))


# --- embedding and bounds

radii = st.one_of(st.just(0.0), st.floats(1e-6, 100.0))


@pytest.mark.slow
@given(poses, poses, radii, st.floats(-math.pi, math.pi))
def test_embedding_bounds_the_displacement_of_every_point(
    a: np.ndarray, b: np.ndarray, radius: float, bearing: float
) -> None:
    e = float(np.linalg.norm(se2.embed(a, radius) - se2.embed(b, radius)))
    rim = [(radius * math.cos(bearing), radius * math.sin(bearing)), (0.5 * radius, 0.0), (0.0, 0.0)]
    moved = np.hypot(*(se2.transform(a, rim) - se2.transform(b, rim)).T).max()
    rounding = 1e-12 * max(1.0, float(np.abs([*a, *b]).max()), radius)
    assert moved <= math.sqrt(2.0) * e + rounding


def test_the_bound_of_the_embedding_is_reached() -> None:
    # A turn about a point on the rim moves the opposite point by the sum of both legs, equal here.
    radius, turn = 2.0, 0.4
    way = 2.0 * radius * math.sin(turn / 2)
    a = np.array([0.0, 0.0, -turn / 2])
    b = np.array([0.0, way, turn / 2])
    e = float(np.linalg.norm(se2.embed(a, radius) - se2.embed(b, radius)))
    moved = se2.transform(b, [(radius, 0)]) - se2.transform(a, [(radius, 0)])
    assert np.hypot(*moved[0]) == pytest.approx(math.sqrt(2.0) * e)


OUTLINE = np.array([(-0.5, -0.5), (1.5, -0.5), (1.5, 0.1), (0.1, 0.1), (0.1, 1.5), (-0.5, 1.5)])
CIRCUMRADIUS = math.hypot(1.5, 0.5)


@given(poses, poses)
def test_motion_bound_bounds_every_point_at_every_moment(a: np.ndarray, b: np.ndarray) -> None:
    bound = float(se2.motion_bound(a, b, CIRCUMRADIUS))
    t = np.linspace(0.0, 1.0, 33)
    corners = se2.transform(se2.interpolate(a, b, t), OUTLINE)
    # Between any two moments, not only from the start: that is what certified motions rest on.
    moved = np.hypot(*(corners[:, None] - corners[None, :]).transpose(3, 0, 1, 2)).max(axis=-1)
    allowed = bound * np.abs(t[:, None] - t[None, :])
    assert (moved <= allowed + 1e-12 * max(1.0, float(np.abs([a, b]).max()))).all()


# --- configurations


def test_configurations_are_copied_and_wrapped() -> None:
    given_rows = np.array([[1.0, 2.0, 4.0], [0.0, 0.0, -math.pi]])
    rows = se2.configurations(given_rows)
    assert rows[0, 2] == pytest.approx(4.0 - 2 * math.pi)
    assert rows[1, 2] == math.pi
    assert given_rows[0, 2] == 4.0
    assert se2.configurations((1, 2, 3)).dtype == np.float64
    assert se2.configurations(np.empty((0, 3))).shape == (0, 3)


@pytest.mark.parametrize(
    ("q", "part"),
    [
        ([1.0, 2.0], "expected shape (3,) or (n, 3) for x, y, theta, got (2,)"),
        (np.zeros((2, 2, 3)), "shape (3,) or (n, 3) for x, y, theta, got (2, 2, 3)"),
        ([1.0, 2.0, math.nan], "[1.0, 2.0, nan] holds a value that is not a finite number"),
        ([[0.0, 0.0, 0.0], [1.0, math.inf, 0.0]], "[1.0, inf, 0.0] holds a value"),
        ("door", "'door' is not an array of numbers"),
        (None, "shape (3,) or (n, 3) for x, y, theta, got ()"),
        ([[1, 2, 3], [1, 2]], "is not an array of numbers"),
        ([10**400, 0, 0], "is not an array of numbers"),
    ],
)
def test_bad_configurations_are_refused_in_one_line(q: object, part: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        se2.configurations(q, name="start")  # type: ignore[arg-type]  # that is what is tested
    message = str(caught.value)
    assert message.startswith("start: ")
    assert part in message
    assert len(message) < 300
