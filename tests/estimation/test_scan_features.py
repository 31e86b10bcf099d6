"""Scans taken apart: groups, straight pieces, and the lines and discs of rooms that are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.estimation.ray_casting import cast, end_points, room
from tests.support.trials import few

from trailmark.estimation.records import Scan
from trailmark.estimation.scan_features import ScanSettings, find_features, jump_groups, scan_points, split_and_merge
from trailmark.se2 import transform

SETTINGS = ScanSettings()
ROOM = room(0.0, 0.0, 6.0, 4.0)
POST = shapely.buffer(shapely.Point(4.0, 2.5), 0.25, quad_segs=256)
CRATE = shapely.box(1.0, 3.0, 1.6, 3.5)

seeds = st.integers(0, 2**32 - 1)


# --- End points


@pytest.mark.slow
@given(
    st.tuples(st.floats(0.5, 5.5), st.floats(0.5, 3.5), st.floats(-3, 3)),
    st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4), st.floats(-3, 3)),
)
def test_end_points_stand_in_the_robots_frame(
    pose: tuple[float, float, float], mount: tuple[float, float, float]
) -> None:
    scan = cast([ROOM], pose, mount=mount, beams=40)
    seen = scan_points(scan, SETTINGS)
    assert np.allclose(transform(pose, seen.points), end_points(scan), atol=1e-9)
    assert np.allclose(seen.origin, mount[:2])
    # Their noise: σ_r along the beam, r·σ_β across it.
    away = seen.points - seen.origin
    u = away / np.hypot(*away.T)[:, None]
    v = np.column_stack([-u[:, 1], u[:, 0]])
    assert np.einsum("ni,nij,nj->n", u, seen.covariances, u) == pytest.approx(np.full(len(u), 0.02**2))
    assert np.einsum("ni,nij,nj->n", v, seen.covariances, v) == pytest.approx((0.003 * seen.ranges) ** 2)
    assert np.einsum("ni,nij,nj->n", u, seen.covariances, v) == pytest.approx(np.zeros(len(u)), abs=1e-12)


def test_beams_that_met_nothing_have_no_end_points() -> None:
    ranges = np.array([1.0, math.nan, math.inf, 30.0, 29.9, 0.0, 12.0, 2.0])
    seen = scan_points(Scan(0.0, ranges, 0.0, 0.1, 30.0), SETTINGS)
    assert seen.beams.tolist() == [0, 4, 6, 7]
    assert scan_points(Scan(0.0, ranges, 0.0, 0.1, 30.0), ScanSettings(max_range=12.0)).beams.tolist() == [0, 6, 7]
    nothing = scan_points(Scan(0.0, np.full(5, math.inf), 0.0, 0.1, 30.0), SETTINGS)
    assert len(nothing.points) == 0
    assert jump_groups(nothing, SETTINGS) == []


# --- Groups


@pytest.mark.slow
@settings(max_examples=few(40))
@given(seeds, st.integers(1, 60), st.booleans())
def test_every_end_point_is_in_one_group(seed: int, n: int, whole_turn: bool) -> None:
    rng = np.random.default_rng(seed)
    ranges = np.where(rng.random(n) < 0.2, np.inf, rng.uniform(0.5, 9.0, n))
    step = 2 * math.pi / n if whole_turn else math.pi / n
    seen = scan_points(Scan(0.0, ranges, -math.pi, step, 10.0), SETTINGS)
    groups = jump_groups(seen, SETTINGS)
    assert sorted(np.concatenate([[], *groups]).tolist()) == list(range(len(seen.points)))
    assert all(len(group) for group in groups)


# --- Straight pieces


@given(st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), max_size=40), st.floats(0.01, 2.0))
def test_pieces_share_the_points_out_and_are_straight(points: list[tuple[float, float]], threshold: float) -> None:
    p = np.array(points).reshape(-1, 2)
    pieces = split_and_merge(p, threshold)
    assert [i for piece in pieces for i in piece] == list(range(len(p)))
    for piece in pieces:
        own = p[piece] - p[piece].mean(axis=0)
        off = own @ np.linalg.svd(own, full_matrices=False)[2][-1] if len(own) > 2 else np.zeros(1)
        # Within the threshold of the chord is within twice of it of the mean line.
        assert np.abs(off).max() <= 2.0 * threshold + 1e-9


# --- Lines and discs


@pytest.mark.parametrize("mount", [(0.0, 0.0, 0.0), (0.3, -0.1, 0.4)])
def test_a_room_is_its_walls_and_its_post(mount: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(0)
    pose = (2.0, 1.5, 0.4)
    settings = ScanSettings(sigma_range=0.01)
    scan = cast(
        [ROOM, POST, CRATE],
        pose,
        beams=720,
        field=2 * math.pi,
        sigma_range=0.01,
        sigma_bearing=0.003,
        rng=rng,
        mount=mount,
    )
    seen, features = find_features(scan, settings)
    world = transform(pose, seen.points)
    (disc,) = features.discs
    centre = transform(pose, disc.disc[None, :2])[0]
    assert centre == pytest.approx([4.0, 2.5], abs=5 * math.sqrt(disc.covariance[0, 0]))
    assert disc.disc[2] == pytest.approx(0.25, abs=5 * math.sqrt(disc.covariance[2, 2]))
    # Each line runs along one of the sides, its normal pointing into the wall.
    sides = {"left": (0.0, math.pi), "right": (6.0, 0.0), "low": (0.0, -math.pi / 2), "high": (4.0, math.pi / 2)}
    met, astray = set(), 0
    for fit in features.lines:
        rho, alpha = compose_line(pose, fit.line)
        names = [
            name
            for name, (distance, normal) in sides.items()
            if abs(rho - distance) < 0.05 and abs(math.remainder(alpha - normal, 2 * math.pi)) < 0.05
        ]
        met.update(names)
        # The crate's sides are lines too; a corner may be cut off with less than the split's threshold of a side.
        if not names and shapely.distance(CRATE, shapely.points(world[fit.indices])).max() > 0.05:
            astray += len(fit.indices)
    assert met == set(sides)
    assert astray < 0.03 * len(seen.points)
    share = sum(len(fit.indices) for fit in features.lines) + len(disc.indices)
    assert share > 0.9 * len(seen.points)
    rest = sum(len(group) for group in features.others)
    assert share + rest == len(seen.points)


def compose_line(pose: tuple[float, float, float], line: np.ndarray) -> tuple[float, float]:
    alpha = float(line[1] + pose[2])
    return float(line[0] + pose[0] * math.cos(alpha) + pose[1] * math.sin(alpha)), alpha


def test_a_wall_is_no_disc_and_a_small_arc_neither() -> None:
    scan = cast(
        [shapely.box(2.0, -0.25, 2.5, 0.25)], (0, 0, 0), beams=721, sigma_range=0.01, rng=np.random.default_rng(1)
    )
    _, features = find_features(scan, ScanSettings(sigma_range=0.01))
    assert features.discs == ()
    assert len(features.lines) == 1
    # The inside of a round bay bulges away from the scanner.
    bay = shapely.difference(shapely.box(0.5, -2, 3, 2), shapely.buffer(shapely.Point(0.5, 0.0), 0.5))
    _, features = find_features(cast([bay], (-1.0, 0, 0), beams=721), SETTINGS)
    assert features.discs == ()
