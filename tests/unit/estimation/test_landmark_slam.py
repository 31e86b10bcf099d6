"""Maps of logs with detections, smoothed: wrong noise, misread names, poses in between, coarse bearings, no names."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import shapely
from scipy.stats import binom, chi2
from tests.helpers.alignment import aligned, rms
from tests.helpers.trials import few, trials

from trailmark import Disc, World
from trailmark.estimation import (
    Detection,
    Detector,
    EkfSlam,
    EstimationError,
    Log,
    MapSettings,
    NotCertifiedError,
    Odometry,
    Pose,
    RangeBearing,
    Unicycle,
    map_log,
    simulate,
)
from trailmark.estimation.covariance import nees
from trailmark.estimation.landmark_graph import polar_readings
from trailmark.estimation.map_settings import MappingSettings
from trailmark.estimation.mapping import MappedLog
from trailmark.estimation.noise_fit import Batch
from trailmark.estimation.odometry import OdometryTrack
from trailmark.estimation.records import Record
from trailmark.se2 import wrap

POSTS = np.array([[2.0, 2.2], [5.0, 1.0], [9.5, 1.5], [10.5, 5.0], [7.0, 6.5], [3.0, 6.8], [1.0, 5.0], [6.0, 3.8]])
YARD = World("yard", (0.0, 0.0, 12.0, 8.0), tuple(Disc((float(x), float(y)), 0.15) for x, y in POSTS))
ROUND = [[1.0, 1.0], [8.0, 2.6], [9.0, 5.0], [4.5, 5.3], [2.2, 4.0]]
SENSOR, MOTION = RangeBearing(0.05, 0.02), Unicycle(0.03, 0.03, period=1.0)
RIGHT = MapSettings(range_bearing=SENSOR, velocity=MOTION)


@cache
def log(seed: int = 0, rounds: int = 2) -> Log:
    return simulate(YARD, rounds * ROUND, MOTION, detector=Detector(SENSOR, 7.0), random_state=seed).log


def errors(mapped: MappedLog) -> tuple[float, float]:
    """Root mean squares of landmarks and of the trajectory, after the landmarks' alignment."""
    surveyed = {int(i): (x, y) for i, x, y in mapped.log.landmarks}
    true = np.array([surveyed[f.identity] for f in mapped.slam.features if f.identity is not None])
    found = np.array([f.mean for f in mapped.slam.features])
    motion = aligned(found, true)
    truth = np.array([record[:3] for record in mapped.log.records if isinstance(record, Pose)])
    path = np.column_stack([np.interp(mapped.trajectory[:, 0], truth[:, 0], truth[:, j]) for j in (1, 2)])
    return rms(motion(found) - true), rms(motion(mapped.trajectory[:, 1:3]) - path)


FAR = np.array([[20.0, 2.0], [21.0, -3.0], [24.0, 1.0], [26.0, -2.0], [23.0, 4.0]])
"""What a robot that drives along the x axis sees from 6 m, after some 14 m."""
AHEAD = MapSettings(
    range_bearing=RangeBearing(0.05, 0.015),
    velocity=Unicycle(0.03, 0.02, period=1.0),
    start=(0.0, 0.0, 0.0),
    fit_noise=False,
)


def driven_ahead(seed: int, count: int = len(FAR), dt: float = 0.2) -> tuple[Log, np.ndarray]:
    """A log of 25 m at 0.5 m/s, and the true poses, rows t, x, y, theta."""
    rng, records, x, truth = np.random.default_rng(seed), list[Record](), np.zeros(3), []
    for k in range(250):
        records.append(Odometry(k * dt, 0.5, 0.0))
        ds, turn = 0.5 * dt + 0.03 * dt**0.5 * rng.standard_normal(), 0.02 * dt**0.5 * rng.standard_normal()
        x = x + np.array([ds * np.cos(x[2]), ds * np.sin(x[2]), turn])
        truth.append([(k + 1) * dt, *x])
        for i, post in enumerate(FAR[:count] if k % 3 == 2 else ()):
            z = AHEAD.range_bearing.h(x, post)
            if z[0] < 6.0:
                records.append(Detection((k + 1) * dt, z + rng.normal(0.0, (0.05, 0.015)), identity=i))
    return Log("ahead", tuple(records), np.empty((0, 3))), np.array(truth)


@pytest.mark.slow
@pytest.mark.parametrize("count", [2, 5])
def test_what_is_driven_before_the_first_reading_is_as_uncertain_as_odometry(count: int) -> None:
    nees, inside = [], []
    for seed in range(20, 32):
        given, truth = driven_ahead(seed, count)
        mapped = map_log(given, AHEAD, confidence=0.99)
        alone = EkfSlam(AHEAD.range_bearing, velocity=AHEAD.velocity).run(given.records)
        # At 20 s, 10 m on, nothing was seen yet.
        at, then, true = (np.abs(rows[:, 0] - 20.0).argmin() for rows in (mapped.trajectory, alone.trajectory, truth))
        assert mapped.slam.covariances[at] == pytest.approx(alone.covariances[then], rel=1e-6, abs=1e-9)
        error = mapped.trajectory[at, 1:] - truth[true, 1:]
        assert error @ np.linalg.solve(mapped.slam.covariances[at] + 1e-6 * np.eye(3), error) < 20.0
        assert mapped.figures()["obstacles"]["frame"] == "start"
        for feature, grown in zip(mapped.slam.features, mapped.world.obstacles, strict=True):
            assert feature.identity is not None
            off = feature.mean - FAR[feature.identity]
            nees.append(off @ np.linalg.solve(feature.covariance, off))
            post = shapely.Point(FAR[feature.identity])
            inside.append(grown.polygon(1e-3).shapely().contains(post))
    # The landmarks of one log share its errors.
    assert 0.5 < np.mean(nees) < 3.0
    # One log in some hundred may lie outside, with all of its landmarks.
    assert np.mean(inside) >= 0.94


def test_the_frame_of_covariances_is_named_and_chosen() -> None:
    given, _ = driven_ahead(0)
    size = {}
    for name, settings in {
        "start": AHEAD,
        "map": replace(AHEAD, frame="map"),
        "no start": replace(AHEAD, start=None),
        "start without": replace(AHEAD, start=None, frame="start"),
    }.items():
        estimates = [e for e in map_log(given, settings).world.estimates if e is not None]
        size[name] = estimates[-1].frame, sum(np.trace(e.covariance) for e in estimates)
    assert {name: frame for name, (frame, _) in size.items()} == {
        "start": "start",
        "map": "map",
        "no start": "map",
        "start without": "start",
    }
    assert size["map"][1] == pytest.approx(size["no start"][1])
    assert size["start"][1] == pytest.approx(size["start without"][1])
    assert size["map"][1] < 0.1 * size["start"][1]
    # Of two features there is no frame but the start's.
    few = map_log(driven_ahead(0, 2)[0], replace(AHEAD, start=None))
    assert few.figures()["obstacles"]["frame"] == "start"
    assert any("frame of the first pose" in note for note in few.notes)


@pytest.mark.slow
def test_poses_between_readings_are_as_sure_as_with_a_pose_at_each_record() -> None:
    whole = log()
    start = next(record[1:4] for record in whole.records if isinstance(record, Pose))
    blind = [r for r in whole.records if not (isinstance(r, Detection) and (r.t < 8.0 or 20.0 < r.t < 40.0))]
    settings = replace(RIGHT, start=start, fit_noise=False)
    mapped = map_log(whole._replace(records=tuple(blind)), settings)
    every = np.concatenate([[blind[0].t - 1.0], mapped.trajectory[:, 0]])
    detections = [assignment.detection for assignment in mapped.slam.assignments]
    numbers = {feature.identity: i for i, feature in enumerate(mapped.slam.features)}
    track, readings = OdometryTrack(blind), polar_readings(detections, every, SENSOR)
    batch = Batch(track, readings, every, track.stated_variances(MOTION, settings.increment))
    poses = np.vstack([start, mapped.trajectory[:, 1:]])
    places = np.array([feature.mean for feature in mapped.slam.features])
    dense = batch.solve(poses, places, np.array([numbers[d.identity] for d in detections]))
    pairs, _ = dense.smoother.pair_covariances(dense.solution)
    # After the first metres: before, no odometry errs sideways, and gtsam takes no noise of 0.
    right, found = pairs[21:, :3, :3], mapped.slam.covariances[20:-1]
    ratio = np.linalg.eigvals(np.linalg.solve(right, found)).real
    assert ratio.min() > 0.95
    assert ratio.max() < 1.05


@pytest.mark.slow
def test_noise_is_estimated_where_it_is_wrong_and_asked_for() -> None:
    wrong = MapSettings(range_bearing=RangeBearing(0.01, 0.004), velocity=MOTION, stated_noise=False)
    fits = dict[bool | str, tuple[bool, float]]()
    for mode in ("auto", True, False):
        mapped = map_log(log(rounds=1), replace(wrong, fit_noise=mode))
        fits[mode] = mapped.batch.figures["fitted"], errors(mapped)[0]
    assert {mode: fitted for mode, (fitted, _) in fits.items()} == {"auto": True, True: True, False: False}
    right = map_log(log(rounds=1), RIGHT)
    assert right.batch.figures["fitted"] is False
    assert fits["auto"][1] < 1.5 * errors(right)[0]


@pytest.mark.slow
def test_halves_of_a_log_that_disagree_enlarge_the_covariances_and_are_told() -> None:
    middle = log().records[len(log().records) // 2].t
    bent = [
        r._replace(z=r.z + np.array([0.15 if (r.identity or 0) % 2 else -0.15, 0.0]))
        if isinstance(r, Detection) and r.t > middle
        else r
        for r in log().records
    ]
    settings = replace(RIGHT, fit_noise=False)
    straight, mapped = (map_log(log()._replace(records=tuple(r)), settings) for r in (log().records, bent))
    sizes = [sum(np.trace(e.covariance) for e in m.world.estimates if e) for m in (straight, mapped)]
    assert sizes[1] > 3.0 * sizes[0]
    assert [any("two halves differ" in warning for warning in m.warnings) for m in (straight, mapped)] == [False, True]
    # A fit takes the noise for as large as it is.
    assert errors(map_log(log()._replace(records=tuple(bent)), RIGHT))[0] < 0.15


@pytest.mark.slow
def test_landmarks_and_poses_are_as_wrong_as_their_covariances_say() -> None:
    """NEES by its expectation: of landmarks in the map's own frame, of landmarks and poses in the start's."""
    found = []
    for seed in trials(8, of=2):
        truth = np.array([record[:4] for record in log(seed).records if isinstance(record, Pose)])
        mapped = map_log(log(seed), replace(RIGHT, start=tuple(truth[0, 1:].tolist()), frame="map"))
        features, rows = mapped.slam.features, mapped.trajectory[10::20]
        places = np.array([POSTS[f.identity] for f in features if f.identity is not None])
        means = np.array([f.mean for f in features])
        motion = aligned(means, places)
        within = nees((motion(means) - places) @ motion.R, [e.covariance for e in mapped.world.estimates if e])
        whole = nees(means - places, [f.covariance for f in features])
        true = [np.interp(rows[:, 0], truth[:, 0], column) for column in np.unwrap(truth[:, 1:], axis=0).T]
        off = rows[:, 1:] - np.column_stack(true)
        off[:, 2] = wrap(off[:, 2])
        found.append([within.mean() / 2.0, whole.mean() / 2.0, nees(off, mapped.slam.covariances[10::20]).mean() / 3.0])
    within_map, of_landmarks, of_poses = np.mean(found, axis=0)
    assert 0.6 < within_map < 1.6
    # What is the same in all of a log, its heading most of all, averages over logs alone.
    assert 0.3 < of_landmarks < 2.5
    assert 0.3 < of_poses < 2.5


@pytest.mark.parametrize(
    ("z", "identity"),
    [
        *(([1e18, 0.0], identity) for identity in (0, 99, None)),
        *((z, 0) for z in ([1e308, 0.0], [5.0, 1e308], [np.inf, 0.0], [np.nan, 0.0])),
    ],
)
def test_a_reading_that_cannot_be_is_told_in_one_line(z: list[float], identity: int | None) -> None:
    records = [*log().records, Detection(log().records[-1].t, np.array(z), identity=identity)]
    with pytest.raises(EstimationError, match="expected z of at most"):
        map_log(log()._replace(records=tuple(records)), RIGHT)


def test_what_a_confidence_rests_on_and_what_was_seen_once_are_told() -> None:
    once = Detection(log().records[-1].t, np.array([3.0, 0.0]), identity=99)
    mapped = map_log(log()._replace(records=(*log().records, once)), RIGHT, confidence=0.9)
    x, y = next(feature.mean for feature in mapped.slam.features if feature.identity == 99)
    assert f"seen less than twice: near ({x:.1f}, {y:.1f})" in mapped.notes
    assert any("0.9 holds if errors are Gaussian" in note for note in mapped.notes)
    assert not any("seen" in note for note in map_log(log(), RIGHT).notes)


POSTS_BEARINGS = np.array([[6.0, 1.0], [4.0, -2.0], [2.0, 3.0], [8.0, 4.0], [5.0, -5.0]])
CERTAIN = MappingSettings(pose_sigma=(0.0, 0.0))


def log_bearings(rng: np.random.Generator, count: int, sigma: tuple[float, float], stated: bool) -> Log:
    """Return a straight drive past the posts, by poses or by odometry, with all of them read each second."""
    records: list[Record] = [] if stated else [Odometry(0.0, 0.3, 0.0)]
    for t in range(count):
        x = 0.3 * t
        records += [Pose(float(t), x, 0.0, 0.0)] if stated else []
        dx, dy = (POSTS_BEARINGS - [x, 0.0]).T
        z = np.column_stack([np.hypot(dx, dy), np.arctan2(dy, dx)]) + rng.normal(0.0, sigma, (len(POSTS_BEARINGS), 2))
        records += [Detection(float(t), z[i], identity=i, covariance=np.square(np.diag(sigma))) for i in range(len(z))]
    return Log("coarse", tuple(records), np.empty((0, 3)))


def scores(way: str, count: int, sigma: tuple[float, float], runs: int, posts: int) -> np.ndarray:
    """Return eᵀ P⁻¹ e of each of the first posts in each of the runs, P as the world states it if they are few."""
    rng, found = np.random.default_rng(0), list[float]()
    for _ in range(runs):
        given, settings = log_bearings(rng, count, sigma, way == "log"), MapSettings(mapping=CERTAIN)
        kept = [r for r in given.records if not isinstance(r, Detection) or (r.identity or 0) < posts]
        if way == "filter":
            features = EkfSlam(settings.range_bearing, velocity=settings.velocity).run(kept).features
            covariances = [f.covariance for f in features]
        else:
            mapped = map_log(given._replace(records=tuple(kept)), settings)
            features = mapped.slam.features
            stated = [e.covariance for e in mapped.world.estimates if e is not None]
            covariances = stated if posts < 4 else [f.covariance for f in features]
        off = [f.mean - POSTS_BEARINGS[f.identity or 0] for f in features]
        found += [float(e @ np.linalg.solve(P, e)) for e, P in zip(off, covariances, strict=True)]
    return np.array(found)


FINE, COARSE, COARSEST, NARROW = (0.05, 0.02), (0.05, 0.2), (0.05, 0.3), (0.01, 0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("way", "count", "sigma", "posts"),
    [
        *(("log", count, sigma, 5) for count in (1, 20) for sigma in (FINE, COARSE, NARROW)),
        *(("smoothed", count, sigma, 5) for count in (1, 20) for sigma in (FINE, COARSE, COARSEST)),
        *(("smoothed", 3, sigma, posts) for posts in (1, 2, 3) for sigma in (FINE, COARSE)),
        *(("filter", count, sigma, 5) for count in (3, 20) for sigma in (FINE, COARSEST)),
    ],
)
def test_confidences_hold_from_fine_to_coarse_bearings(
    way: str, count: int, sigma: tuple[float, float], posts: int
) -> None:
    # Features of one run share its errors, and of few one run in some forty is far off.
    found = scores(way, count, sigma, few(40) if posts < 5 else few(20 if way == "smoothed" else 40, of=4), posts)
    # Where bearings are coarse, what a linearised reading misses counts six times, for the sake of the 0.99, so that
    # covariances are too large on average.
    assert (0.1 if sigma == COARSEST else 0.5) < found.mean() < 2.8
    # No more of the values lie beyond the quantile of 99 % than once in two hundred times.
    assert np.count_nonzero(found > chi2.ppf(0.99, 2)) <= binom.ppf(0.995, len(found), 0.01)


@pytest.mark.parametrize("variance", [0.0, 1e-30, np.nan])
def test_a_reading_without_error_is_told_in_one_line(variance: float) -> None:
    given = log_bearings(np.random.default_rng(0), 3, (0.05, 0.02), stated=False)
    sure = np.diag([variance, 0.01])
    wrong = [r._replace(covariance=sure) if isinstance(r, Detection) and r.t == 2.0 else r for r in given.records]
    with pytest.raises(EstimationError, match=r"^detection at 2 s: expected a (finite )?covariance of s"):
        map_log(given._replace(records=tuple(wrong)), MapSettings())


# Pairs 0.4 m apart.
SINGLE = np.array([[2.0, 2.2], [5.0, 1.0], [9.5, 1.5], [10.5, 5.0], [7.0, 6.5], [3.0, 6.8]])
POSTS_FEATURES = np.vstack([SINGLE, SINGLE + np.array([0.4, 0.0])])
YARD_FEATURES = World("yard", (0.0, 0.0, 12.0, 8.0), tuple(Disc((float(x), float(y)), 0.1) for x, y in POSTS_FEATURES))


def log_features(rounds: int, turn: float = 1.0, depth: bool = False) -> Log:
    """A drive whose odometry states its turns too large, and whose camera reads depth, right on average."""
    detector = Detector(RangeBearing(0.05, 0.01), 6.0, period=0.5 if depth else 1.0)
    made = simulate(
        YARD_FEATURES, rounds * ROUND, Unicycle(0.02, 0.03, period=1.0), detector=detector, random_state=0
    ).log
    records = []
    for record in made.records:
        if isinstance(record, Odometry):
            record = record._replace(omega=turn * record.omega)
        if isinstance(record, Detection):
            if depth and abs(record.z[1]) > 0.7:
                continue
            z = np.array([record.z[0] * (1.085 * np.cos(record.z[1]) if depth else 1.0), record.z[1]])
            record = record._replace(z=z, covariance=None)
        records.append(record)
    return made._replace(records=tuple(records))


def mapped(given: Log) -> tuple[MappedLog, float, float]:
    """The map made without names; the share of readings in a wrong feature, and the places' error, by the names."""
    names = [record.identity for record in given.records if isinstance(record, Detection)]
    hidden = tuple(r._replace(identity=None) if isinstance(r, Detection) else r for r in given.records)
    found = map_log(given._replace(records=hidden), MapSettings())
    assert found.association == "joint"
    pairs = [(a.feature, name) for a, name in zip(found.slam.assignments, names, strict=True) if a.feature is not None]
    owner = {f: Counter(n for g, n in pairs if g == f).most_common(1)[0][0] for f in {f for f, _ in pairs}}
    wrong = sum(owner[f] != name for f, name in pairs) / len(pairs)
    surveyed = {int(i): (x, y) for i, x, y in given.landmarks}
    kept = [f for f in found.slam.features if f.id in owner]
    points = np.array([f.mean for f in kept])
    true = np.array([surveyed[owner[f.id] or 0] for f in kept])
    return found, wrong, rms(aligned(points, true)(points) - true)


@pytest.mark.slow
@pytest.mark.parametrize(("rounds", "turn", "depth"), [(2, 1.0, False), (3, 1.1, True)])
def test_features_are_those_that_there_are(rounds: int, turn: float, depth: bool) -> None:
    found, wrong, error = mapped(log_features(rounds, turn, depth))
    assert len(found.world.obstacles) == len(POSTS_FEATURES)
    assert wrong < 0.05
    # Posts that hide others are missed.
    assert depth or found.world.not_certified is None
    assert error < 0.15  # of that, 0.1 m by the scale, which is known to a percent or two


@pytest.mark.slow
def test_a_robot_that_was_carried_gets_no_confidence() -> None:
    """It goes on at once where it was set down; without identities all that it sees there is new, or taken for else."""
    whole = log_features(2)
    end = max(record.t for record in whole.records)
    first, last = 0.35 * end, 0.45 * end
    records = tuple(
        record._replace(t=record.t - (last - first if record.t > first else 0.0), **named(record))
        for record in whole.records
        if not first < record.t < last and not isinstance(record, Pose)
    )
    carried = whole._replace(records=records)
    with pytest.raises(NotCertifiedError, match="not certified"):
        map_log(carried, MapSettings(), confidence=0.99)
    found = map_log(carried, MapSettings(), confidence=0.99, even_if_uncertain=True)
    assert found.world.risk is not None
    assert found.world.not_certified is not None
    assert found.figures()["not_certified"] == found.world.not_certified
    assert any(found.world.not_certified in warning for warning in found.warnings)


def named(record: Record) -> dict[str, Any]:
    return {"identity": None} if isinstance(record, Detection) else {}
