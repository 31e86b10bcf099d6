"""Noise and systematic errors found again in logs that were made with them."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.helpers.alignment import aligned, rms
from tests.helpers.trials import trials

from trailmark import Disc, World
from trailmark.estimation import Detector, RangeBearing, Unicycle, simulate
from trailmark.estimation.landmark_graph import polar_readings, relative_covariance
from trailmark.estimation.models import PoseIncrement
from trailmark.estimation.noise_fit import Batch, correlation_time, disagreement, misfit, scale
from trailmark.estimation.odometry import OdometryTrack
from trailmark.estimation.records import Detection, Log, Odometry, Pose, Record

FloatArray = NDArray[np.float64]
POSTS = np.array([[2.0, 2.2], [5.0, 1.0], [9.5, 1.5], [10.5, 5.0], [7.0, 6.5], [3.0, 6.8], [1.0, 5.0], [6.0, 3.8]])
YARD = World("yard", (0.0, 0.0, 12.0, 8.0), tuple(Disc((float(x), float(y)), 0.15) for x, y in POSTS))
ROUNDS = [[1.0, 1.0], [8.0, 2.6], [9.0, 5.0], [4.5, 5.3], [2.2, 4.0]] * 3
SENSOR, MOTION = RangeBearing(0.03, 0.01), Unicycle(0.02, 0.02, period=1.0)


class Case(NamedTuple):
    batch: Batch
    poses: FloatArray
    feature: NDArray[np.intp]
    true: FloatArray

    def places(self) -> FloatArray:
        return self.true.copy()


@cache
def log(seed: int = 0) -> Log:
    return simulate(YARD, ROUNDS, MOTION, detector=Detector(SENSOR, 7.0), random_state=seed).log


def unstated(records: list[Record]) -> list[Record]:
    return [r._replace(covariance=None) if isinstance(r, Detection) else r for r in records]


def case(records: list[Record], sensor: RangeBearing = SENSOR, motion: Unicycle = MOTION) -> Case:
    """A batch over records, from the true poses and places on."""
    detections = [record for record in records if isinstance(record, Detection)]
    truth = np.array([record[:4] for record in records if isinstance(record, Pose)])
    instants = np.unique([detection.t for detection in detections])
    landmarks = {int(i): np.array([x, y]) for i, x, y in log().landmarks}
    order = sorted(landmarks)
    feature = np.array([order.index(detection.identity or 0) for detection in detections])
    track = OdometryTrack(records)
    readings = polar_readings(detections, instants, sensor)
    variances = track.stated_variances(motion, PoseIncrement(0.1, 0.1, 0.1))
    unwrapped = np.unwrap(truth[:, 3])
    poses = np.column_stack(
        [np.interp(instants, truth[:, 0], column) for column in (truth[:, 1], truth[:, 2], unwrapped)]
    )
    batch = Batch(track, readings, instants, variances)
    return Case(batch, poses, feature, np.array([landmarks[i] for i in order]))


def changed(record: Record) -> Record:
    """Odometry that overstates, and a camera that reads depth, right on average over its view."""
    if isinstance(record, Odometry):
        return record._replace(v=record.v / 0.95, omega=record.omega / 0.9)
    if isinstance(record, Detection):
        return record._replace(z=np.array([1.06 * record.z[0] * np.cos(record.z[1]), record.z[1]]), covariance=None)
    return record


def in_view(records: list[Record]) -> list[Record]:
    return [r for r in records if not isinstance(r, Detection) or abs(r.z[1]) < 0.6]


@pytest.mark.slow
def test_right_noise_is_left_as_it_is() -> None:
    given = case(list(log().records))
    estimate = given.batch.solve(given.poses, given.places(), given.feature)
    found = misfit(given.batch, estimate)
    assert not found.understated
    assert not found.overstated
    assert found.ratios["range"] == pytest.approx(1.0, abs=0.25)
    assert (estimate.feature >= 0).mean() > 0.999
    assert disagreement(given.batch, estimate) == 1.0


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.3, 3.0])
def test_wrong_noise_is_found(factor: float) -> None:
    sensor = RangeBearing(0.03 * factor, 0.01 * factor)
    given = case(unstated(list(log().records)), sensor, Unicycle(0.02 * factor, 0.02 * factor, period=1.0))
    first = misfit(given.batch, given.batch.solve(given.poses, given.places(), given.feature))
    assert (first.understated, first.overstated) == (factor < 1.0, factor > 1.0)
    estimate = given.batch.fit(given.poses, given.places(), given.feature)
    sigma = np.sqrt(np.diagonal(given.batch.readings(single=True).covariance, axis1=1, axis2=2)).mean(axis=0)
    assert sigma == pytest.approx([0.03, 0.01], rel=0.2)
    assert (estimate.feature >= 0).mean() > 0.99


@pytest.mark.slow
def test_systematic_errors_are_found_and_taken_off() -> None:
    given = case([changed(record) for record in in_view(list(log().records))])
    plain = given.batch.solve(given.poses, given.places(), given.feature).solution.features
    estimate = given.batch.fit(given.poses, given.places(), given.feature)
    _, turn, *_, projection = given.batch.noise.calibration
    assert turn == pytest.approx(0.9, abs=0.02)
    assert projection == pytest.approx(-0.5, abs=0.1)
    factor, sigma = scale(given.batch, estimate)
    features = factor * estimate.solution.features
    errors = [rms(aligned(points, given.true)(points) - given.true) for points in (plain, features)]
    assert errors[1] < 0.06
    assert errors[1] < errors[0]
    assert 0.0 < sigma < 0.02


@pytest.mark.slow
def test_stated_covariances_are_those_of_the_errors() -> None:
    """NEES over logs, relative to the map, of noise that is estimated."""
    values = []
    for seed in trials(6, of=2):
        given = case(unstated(list(log(seed).records)), RangeBearing(0.06, 0.02))
        estimate = given.batch.fit(given.poses, given.places(), given.feature)
        points = estimate.solution.features
        joint = relative_covariance(points, estimate.feature_covariance())
        motion = aligned(points, given.true)
        errors = (motion(points) - given.true) @ motion.R
        blocks = [joint[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] for i in range(len(points))]
        values += [float(e @ np.linalg.solve(P, e)) for e, P in zip(errors, blocks, strict=True)]
    assert 1.0 < np.mean(values) < 3.0


@pytest.mark.parametrize("share", [0.0, 0.5, 0.8])
def test_errors_that_last(share: float) -> None:
    rng = np.random.default_rng(3)
    sequences = []
    for _ in range(30):
        e = rng.standard_normal(400)
        for i in range(1, len(e)):
            e[i] = share * e[i - 1] + np.sqrt(1.0 - share**2) * e[i]
        sequences.append(e)
    # Of an autoregression of the first order, τ = (1 + ρ) / (1 − ρ).
    assert correlation_time(sequences) == pytest.approx((1.0 + share) / (1.0 - share), rel=0.15)
