"""Scans taken apart: groups, straight pieces, and the lines and discs of rooms that are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from tests.helpers.ray_casting import cast, end_points, room
from tests.helpers.trials import few, trials

from trailmark.estimation.covariance import average, nees
from trailmark.estimation.records import Scan
from trailmark.estimation.scan_features import (
    DiscTracks,
    LineTracks,
    ScanSettings,
    find_features,
    fit_circle_roughly,
    fit_disc,
    fit_line,
    jump_groups,
    scan_points,
    split_and_merge,
)
from trailmark.se2 import transform

SETTINGS = ScanSettings()
ROOM = room(0.0, 0.0, 6.0, 4.0)
POST = shapely.buffer(shapely.Point(4.0, 2.5), 0.25, quad_segs=256)
CRATE = shapely.box(1.0, 3.0, 1.6, 3.5)

seeds = st.integers(0, 2**32 - 1)


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


@pytest.mark.slow
@settings(max_examples=few(40))
@given(seeds, st.integers(1, 60))
def test_every_end_point_is_in_one_group(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    ranges = np.where(rng.random(n) < 0.2, np.inf, rng.uniform(0.5, 9.0, n))
    seen = scan_points(Scan(0.0, ranges, -math.pi, math.pi / n, 10.0), SETTINGS)
    groups = jump_groups(seen, SETTINGS)
    assert np.concatenate([[], *groups]).tolist() == list(range(len(seen.points)))
    assert all(len(group) for group in groups)


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


@pytest.mark.parametrize("mount", [(0.0, 0.0, 0.0), (0.3, -0.1, 0.4)])
def test_a_room_is_its_walls_and_its_post(mount: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(0)
    pose = (2.0, 1.5, 0.4)
    settings = ScanSettings(sigma_range=0.01)
    around = {"beams": 720, "field": 2 * math.pi, "sigma_range": 0.01, "sigma_bearing": 0.003}
    scan = cast([ROOM, POST, CRATE], pose, rng=rng, mount=mount, **around)  # type: ignore[arg-type]  # numbers
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


def beam_noise(points: np.ndarray, sigma_range: float, sigma_bearing: float) -> np.ndarray:
    """Covariances of points seen from the origin, shape (n, 2, 2)."""
    r = np.hypot(*points.T)
    u = points / r[:, None]
    v = np.column_stack([-u[:, 1], u[:, 0]])
    along, across = u[:, :, None] * u[:, None], v[:, :, None] * v[:, None]
    return np.asarray(sigma_range**2 * along + ((sigma_bearing * r) ** 2)[:, None, None] * across)


def drawn(rng: np.random.Generator, covariances: np.ndarray) -> np.ndarray:
    """Errors with covariances of shape (n, 2, 2), shape (n, 2)."""
    return np.asarray(np.einsum("nij,nj->ni", np.linalg.cholesky(covariances), rng.normal(size=(len(covariances), 2))))


def on_line(rho: float, alpha: float, places: np.ndarray) -> np.ndarray:
    n, t = np.array([math.cos(alpha), math.sin(alpha)]), np.array([-math.sin(alpha), math.cos(alpha)])
    return np.asarray(rho * n + places[:, None] * t)


def on_arc(x: float, y: float, radius: float, turns: np.ndarray) -> np.ndarray:
    return np.array([x, y]) + radius * np.column_stack([np.cos(turns), np.sin(turns)])


@pytest.mark.slow
@given(seeds)
def test_unequal_noise_gives_the_likeliest_line(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = on_line(2.0, 0.5, rng.uniform(-3, 3, 25))
    covariances = beam_noise(points, 0.03, 0.01) * rng.uniform(0.2, 5.0, 25)[:, None, None]
    noisy = points + drawn(rng, covariances)
    fit = fit_line(noisy, covariances)

    # Weights belong to the noise at the line that is found; the oracle takes them from there.
    n = np.array([math.cos(fit.line[1]), math.sin(fit.line[1])])
    sigma = np.sqrt(np.einsum("i,nij,j->n", n, covariances, n))

    def residuals(line: np.ndarray) -> np.ndarray:
        return np.asarray((noisy @ [math.cos(line[1]), math.sin(line[1])] - line[0]) / sigma)

    oracle = least_squares(residuals, [2.0, 0.5], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    assert fit.line == pytest.approx(oracle.x, abs=1e-5)
    jacobian = np.asarray(oracle.jac, dtype=np.float64)
    assert fit.covariance == pytest.approx(np.linalg.inv(jacobian.T @ jacobian), rel=0.05)


@pytest.mark.slow
def test_a_discs_covariance_is_that_of_its_errors() -> None:
    rng = np.random.default_rng(1)
    true = on_arc(3.0, 1.0, 0.4, np.linspace(2.0, 4.6, 25))
    covariances = beam_noise(true, 0.01, 0.002)
    errors, stated = [], []
    for _ in range(300):
        fit = fit_disc(true + drawn(rng, covariances), covariances)
        errors.append(fit.disc - [3.0, 1.0, 0.4])
        stated.append(fit.covariance)
    assert average(nees(errors, stated), 3.0, probability=0.999).inside


def test_points_that_are_no_arc() -> None:
    line = on_line(1.0, 0.3, np.linspace(0, 1, 10))
    noise = np.broadcast_to(1e-4 * np.eye(2), (10, 2, 2))
    assert fit_circle_roughly(line) is None
    assert fit_disc(line, noise) is None
    assert fit_disc(np.ones((10, 2)), noise) is None


SETTINGS_TRACKS = ScanSettings(sigma_range=0.02, sigma_bearing=0.003)
POSE_SIGMA = np.diag([0.01, 0.01, 0.002]) ** 2
WALL = shapely.box(3.0, -2.0, 3.3, 2.0)
POST_TRACKS = shapely.buffer(shapely.Point(3.0, 0.4), 0.3, quad_segs=64)


def scans(region: shapely.Geometry, n: int, rng: np.random.Generator, x: float = 0.0) -> list[Scan]:
    places = np.column_stack([x + rng.uniform(-0.5, 0.5, n), rng.uniform(-1, 1, n), rng.uniform(-0.5, 0.5, n)])
    return [cast([region], pose, beams=180, sigma_range=0.02, sigma_bearing=0.003, rng=rng) for pose in places.tolist()]


def follow_lines(tracks: LineTracks, seen_by: list[Scan], offset: np.ndarray | None = None) -> LineTracks:
    for scan in seen_by:
        pose = np.asarray(scan.pose) + (0.0 if offset is None else offset)
        seen, features = find_features(scan, SETTINGS_TRACKS)
        tracks.update([tracks.observation(fit, seen.points, pose) for fit in features.lines])
    return tracks


def test_a_walls_front_is_one_line_refined_with_every_scan() -> None:
    rng = np.random.default_rng(0)
    tracks = LineTracks(0.999, np.zeros((3, 3)), 0.3)
    sigmas = []
    for scan in scans(WALL, 20, rng):
        follow_lines(tracks, [scan])
        sigmas.append(math.sqrt(tracks.covariance(0)[0, 0]))
    assert len(tracks) == 1
    assert tracks.scans.tolist() == [20]
    assert tracks.states[0] == pytest.approx([3.0, 0.0], abs=0.005)
    assert (np.diff(sigmas) < 0.0).all()
    assert sigmas[-1] < 0.35 * sigmas[0]
    assert sum(map(len, tracks.readings[0])) > 500


@pytest.mark.slow
def test_errors_that_poses_have_in_common_do_not_average_out() -> None:
    """All scans of a run share the error of their poses; the stated covariance must hold nevertheless."""
    errors, stated = [], []
    for seed in trials(30, of=2):
        rng = np.random.default_rng(seed)
        offset = rng.multivariate_normal(np.zeros(3), POSE_SIGMA)
        tracks = follow_lines(LineTracks(0.999999, POSE_SIGMA, 0.3), scans(WALL, 8, rng), offset)
        errors.append(tracks.difference(tracks.states[0], np.array([3.0, 0.0])))
        stated.append(tracks.covariance(0))
    values = nees(errors, stated)
    assert average(values, 2.0, probability=0.999).mean < average(values, 2.0, probability=0.999).high
    assert values.mean() > 0.5


def test_the_two_faces_of_a_thin_wall_are_two_lines() -> None:
    thin = shapely.box(3.0, -2.0, 3.08, 2.0)
    rng = np.random.default_rng(3)
    tracks = follow_lines(LineTracks(0.999, POSE_SIGMA, 0.3), scans(thin, 8, rng))
    # From behind, looking back.
    for scan in scans(thin, 8, rng, x=6.0):
        x, y, theta = scan.pose or (0.0, 0.0, 0.0)
        back = cast([thin], (x, y, theta + math.pi), sigma_range=0.02, sigma_bearing=0.003, rng=rng)
        follow_lines(tracks, [back])
    tracks.merge()
    tracks.drop_unconfirmed(3)
    faces = tracks.states[np.argsort(tracks.states[:, 0])]
    assert faces[0] == pytest.approx([-3.08, math.pi], abs=0.02) or faces[0] == pytest.approx(
        [-3.08, -math.pi], abs=0.02
    )
    assert faces[1] == pytest.approx([3.0, 0.0], abs=0.02)
    assert len(faces) == 2


def test_lines_that_turn_out_to_be_one_are_joined() -> None:
    rng = np.random.default_rng(5)
    tracks = LineTracks(0.999, POSE_SIGMA, 0.3)
    halves = [shapely.box(3.0, -2.0, 3.3, -0.5), shapely.box(3.0, 0.5, 3.3, 2.0)]
    for half in halves:
        follow_lines(tracks, scans(half, 5, rng))
    fronts = int((np.abs(tracks.states[:, 1]) < 0.2).sum())
    assert fronts == 2
    # What joins them comes last.
    follow_lines(tracks, scans(WALL, 1, rng))
    before = sum(sum(map(len, own)) for own in tracks.readings)
    tracks.merge()
    at = np.flatnonzero(np.abs(tracks.states[:, 1]) < 0.2)
    assert len(at) == 1
    assert tracks.scans[at[0]] == 11
    assert sum(sum(map(len, own)) for own in tracks.readings) == before
    assert tracks.states[at[0]] == pytest.approx([3.0, 0.0], abs=0.02)


@pytest.mark.slow
def test_the_pose_turns_what_a_disc_is_known_by() -> None:
    """The pose's part of a disc's covariance against the spread of discs seen from drawn poses."""
    rng = np.random.default_rng(8)
    pose = np.array([1.0, 2.0, 0.7])
    (scan,) = (cast([POST_TRACKS], (0.0, 0.0, 0.0), beams=180),)
    seen, features = find_features(scan, SETTINGS_TRACKS)
    (fit,) = features.discs
    tracks = DiscTracks(0.99, POSE_SIGMA)
    one = tracks.observation(fit, seen.points, pose)
    draws = rng.multivariate_normal(pose, POSE_SIGMA, 2000)
    spread = np.cov(np.array([tracks.observation(fit, seen.points, draw).state for draw in draws]).T)
    assert one.R_pose == pytest.approx(spread, abs=0.08 * spread.max())
    lines = LineTracks(0.99, POSE_SIGMA, 0.3)
    seen, features = find_features(cast([WALL], (0.0, 0.0, 0.0), beams=180), SETTINGS_TRACKS)
    wall = lines.observation(features.lines[0], seen.points, pose)
    states = [lines.observation(features.lines[0], seen.points, draw).state for draw in draws]
    spread = np.cov(np.array(states).T)
    assert wall.R_pose == pytest.approx(spread, abs=0.08 * spread.max())
