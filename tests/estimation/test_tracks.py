"""Features over time: found again, refined by as much as the scans tell, kept apart where they are two."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from tests.estimation.ray_casting import cast
from tests.support.trials import trials

from trailmark.estimation.covariance import average, nees
from trailmark.estimation.records import Scan
from trailmark.estimation.scan_features import DiscTracks, LineTracks, ScanSettings, find_features

SETTINGS = ScanSettings(sigma_range=0.02, sigma_bearing=0.003)
POSE_SIGMA = np.diag([0.01, 0.01, 0.002]) ** 2
WALL = shapely.box(3.0, -2.0, 3.3, 2.0)
POST = shapely.buffer(shapely.Point(3.0, 0.4), 0.3, quad_segs=64)


def scans(region: shapely.Geometry, n: int, rng: np.random.Generator, x: float = 0.0) -> list[Scan]:
    places = np.column_stack([x + rng.uniform(-0.5, 0.5, n), rng.uniform(-1, 1, n), rng.uniform(-0.5, 0.5, n)])
    return [cast([region], pose, beams=180, sigma_range=0.02, sigma_bearing=0.003, rng=rng) for pose in places.tolist()]


def follow_lines(tracks: LineTracks, seen_by: list[Scan], offset: np.ndarray | None = None) -> LineTracks:
    for scan in seen_by:
        pose = np.asarray(scan.pose) + (0.0 if offset is None else offset)
        seen, features = find_features(scan, SETTINGS)
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
def test_with_exact_poses_the_covariance_is_that_of_the_errors() -> None:
    errors, stated = [], []
    for seed in trials(30, of=2):
        tracks = LineTracks(0.999999, np.zeros((3, 3)), 0.3)
        follow_lines(tracks, scans(WALL, 4, np.random.default_rng(seed)))
        errors.append(tracks.difference(tracks.states[0], np.array([3.0, 0.0])))
        stated.append(tracks.covariance(0))
    result = average(nees(errors, stated), 2.0, probability=0.999)
    assert result.mean < result.high
    assert result.mean > 0.5 * result.low


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
def test_discs_are_found_again_and_refined() -> None:
    errors, stated = [], []
    for seed in trials(40, of=2):
        rng = np.random.default_rng(seed)
        tracks = DiscTracks(0.999999, np.zeros((3, 3)))
        for scan in scans(POST, 5, rng):
            seen, features = find_features(scan, SETTINGS)
            tracks.update([tracks.observation(fit, seen.points, np.asarray(scan.pose)) for fit in features.discs])
        tracks.merge()
        assert len(tracks) == 1
        errors.append(tracks.states[0] - [3.0, 0.4, 0.3])
        stated.append(tracks.covariance(0))
    result = average(nees(errors, stated), 3.0, probability=0.9999)
    assert 0.3 * result.low < result.mean < result.high


@pytest.mark.slow
def test_the_pose_turns_what_a_disc_is_known_by() -> None:
    """The pose's part of a disc's covariance against the spread of discs seen from drawn poses."""
    rng = np.random.default_rng(8)
    pose = np.array([1.0, 2.0, 0.7])
    (scan,) = (cast([POST], (0.0, 0.0, 0.0), beams=180),)
    seen, features = find_features(scan, SETTINGS)
    (fit,) = features.discs
    tracks = DiscTracks(0.99, POSE_SIGMA)
    one = tracks.observation(fit, seen.points, pose)
    draws = rng.multivariate_normal(pose, POSE_SIGMA, 2000)
    spread = np.cov(np.array([tracks.observation(fit, seen.points, draw).state for draw in draws]).T)
    assert one.R_pose == pytest.approx(spread, abs=0.08 * spread.max())
    lines = LineTracks(0.99, POSE_SIGMA, 0.3)
    seen, features = find_features(cast([WALL], (0.0, 0.0, 0.0), beams=180), SETTINGS)
    wall = lines.observation(features.lines[0], seen.points, pose)
    states = [lines.observation(features.lines[0], seen.points, draw).state for draw in draws]
    spread = np.cov(np.array(states).T)
    assert wall.R_pose == pytest.approx(spread, abs=0.08 * spread.max())
