# ruff: noqa: N806 # the filter's own symbols: F, P, W
"""Odometry put together: as the filter does it, step by step."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from trailmark.estimation.ekf_slam import EkfSlam
from trailmark.estimation.models import PoseIncrement, Unicycle
from trailmark.estimation.odometry import OdometryCalibration, OdometryTrack
from trailmark.estimation.records import Increment, Odometry, Record

VELOCITY = Unicycle(0.02, 0.05, (0.1, 0.0, 0.0, 0.2), period=1.0)
INCREMENT = PoseIncrement(0.01, 0.01, 0.02, (0.003, 0.004, 0.005))


def velocities(seed: int = 0) -> list[Record]:
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.02, 0.3, 60))
    return [Odometry(float(t), *rng.normal([0.4, 0.0], [0.2, 0.7]).tolist()) for t in times]


def increments(seed: int = 0, covariance: bool = False) -> list[Record]:
    rng = np.random.default_rng(seed)
    P = np.diag([1e-4, 2e-4, 3e-4]) if covariance else None
    steps = rng.normal([0.2, 0.0, 0.0], 0.1, (39, 3)).tolist()
    return [Increment(float(t), step[0], step[1], step[2], P) for t, step in enumerate(steps, start=1)]


def test_velocities_give_the_motion_of_the_filters_steps() -> None:
    records, instants = velocities(), np.array([0.5, 1.3, 1.31, 4.0, 20.0])
    track = OdometryTrack(records)
    found = track.motions(instants, OdometryCalibration())
    P_found = found.covariance(track.stated_variances(VELOCITY, INCREMENT))
    cuts = np.unique(np.concatenate([[r.t for r in records], instants]))
    for i in range(len(instants) - 1):
        x, P = np.zeros(3), np.zeros((3, 3))
        own = cuts[(cuts >= instants[i]) & (cuts <= instants[i + 1])]
        for a, b in itertools.pairwise(own):
            held = [r for r in records if isinstance(r, Odometry) and r.t <= a]
            if held:
                u = np.array([held[-1].v, held[-1].omega, b - a])
                x, F, W = VELOCITY.step(x, u)
                P = F @ P @ F.T + W @ VELOCITY.Q(u) @ W.T
        assert found.u[i, :2] == pytest.approx(x[:2], abs=1e-12)
        assert np.cos(found.u[i, 2] - x[2]) == pytest.approx(1.0)
        assert P_found[i] == pytest.approx(P, abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("stated", [True, False])
def test_increments_give_the_motion_of_the_filters_steps(stated: bool) -> None:
    records, instants = increments(covariance=stated), np.array([0.0, 3.0, 4.0, 17.5])
    track = OdometryTrack(records)
    assert track.states_noise == stated
    found = track.motions(instants, OdometryCalibration())
    P_found = found.covariance(track.stated_variances(VELOCITY, INCREMENT))
    for i in range(len(instants) - 1):
        x, P = np.zeros(3), np.zeros((3, 3))
        for r in records:
            if isinstance(r, Increment) and instants[i] < r.t <= instants[i + 1]:
                u = np.array(r[1:4])
                x, F, W = INCREMENT.step(x, u)
                P = F @ P @ F.T + W @ (INCREMENT.Q(u) if r.covariance is None else r.covariance) @ W.T
        assert found.u[i] == pytest.approx(x, abs=1e-12)
        assert P_found[i] == pytest.approx(P, abs=1e-12)


@pytest.mark.parametrize("stated", [True, False])
def test_velocities_and_increments_add_up_as_in_the_filter(stated: bool) -> None:
    records = sorted([*velocities(3), *increments(3, stated)], key=lambda record: record.t)
    instants = np.array([0.0, 4.0, 60.0])
    track = OdometryTrack(records)
    assert not track.states_noise
    found = track.motions(instants, OdometryCalibration())
    P_found = found.covariance(track.stated_variances(VELOCITY, INCREMENT))
    for i in range(2):
        slam = EkfSlam({}, velocity=VELOCITY, increment=INCREMENT)
        own = [record for record in records if instants[i] < record.t <= instants[i + 1]]
        before = [r for r in records if isinstance(r, Odometry) and r.t <= instants[i]]
        held = [before[-1]._replace(t=instants[i])] if before else []
        result = slam.run([*held, *own, Odometry(instants[i + 1], 0.0, 0.0)])
        assert found.u[i, :2] == pytest.approx(result.trajectory[-1, 1:3], abs=1e-9)
        assert np.cos(found.u[i, 2] - result.trajectory[-1, 3]) == pytest.approx(1.0)
        assert P_found[i] == pytest.approx(result.covariances[-1], rel=1e-6, abs=1e-9)


def test_calibration_turns_stated_velocities_into_driven_ones() -> None:
    true = OdometryCalibration(0.9, 1.1, 0.05, 0.02, 0.25)
    straight = OdometryTrack([Odometry(0.0, 1.0, 0.0), Odometry(2.0, 0.0, 0.0)])
    moved = straight.motions(np.array([0.0, 5.0]), true).u[0]
    assert moved[2] == pytest.approx(0.9 * 2.0 * 0.05)
    assert np.hypot(*moved[:2]) == pytest.approx(1.8, rel=1e-3)
    assert np.arctan2(moved[1], moved[0]) == pytest.approx(0.02 + 0.045)
    # A quarter of a second late: the motion of the first two seconds is not over yet.
    assert straight.motions(np.array([0.0, 2.0]), OdometryCalibration(delay=0.25)).u[0, 0] == pytest.approx(1.75)


def test_a_repeated_increment_counts_once() -> None:
    step = Increment(1.0, 1.0, 0.0, 0.0)
    once, twice = OdometryTrack([step]), OdometryTrack([step, step])
    instants = np.array([0.0, 2.0])
    assert twice.motions(instants, OdometryCalibration()).u == pytest.approx(
        once.motions(instants, OdometryCalibration()).u
    )
