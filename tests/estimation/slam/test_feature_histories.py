"""Features without names: which readings are of distinct ones, and which features are one and the same."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark.estimation import EkfSlam, RangeBearing, SlamFilter, SlamSettings, Unicycle
from trailmark.estimation.logs.records import Detection, Odometry, Record
from trailmark.estimation.slam.association import IGNORED, NEW, distinct
from trailmark.estimation.slam.feature_histories import FeatureHistories

SENSOR = RangeBearing(0.1, 0.02)


@pytest.mark.parametrize(
    ("assigned", "d2", "expected"),
    [
        # Its only near feature went to the other reading: it is a new one.
        ([0, IGNORED], [[0.1, 50.0], [3.0, 50.0]], [0, NEW]),
        # The second feature is near too, and nobody took it: it may still be that one.
        ([0, IGNORED], [[0.1, 50.0], [3.0, 12.0]], [0, IGNORED]),
        ([NEW, 1], [[99.0, 99.0], [99.0, 0.5]], [NEW, 1]),
        ([IGNORED, IGNORED], [[5.0], [6.0]], [IGNORED, IGNORED]),
    ],
)
def test_readings_of_an_instant_are_of_distinct_features(
    assigned: list[int], d2: list[list[float]], expected: list[int]
) -> None:
    assert distinct(assigned, d2, 15.0).tolist() == expected


def histories(places: list[list[float]], sigma: float = 0.1) -> tuple[SlamFilter, FeatureHistories, list[int]]:
    ekf = SlamFilter()
    known = FeatureHistories(ekf, SlamSettings(association="joint", merge_gate=0.99))
    ids = [ekf.add_known_feature(place, sigma**2 * np.eye(2)) for place in places]
    for n, i in enumerate(ids):
        known.add(i, None, confirmed=False, time=0.0, readings=n + 1)
    return ekf, known, ids


def test_near_features_are_merged_and_keep_their_readings() -> None:
    ekf, known, ids = histories([[0.0, 1.0], [0.2, 1.0], [5.0, 5.0]])
    assert known.merge([ids[0]]) == {ids[0]: ids[1]}
    assert list(ekf.features) == [ids[1], ids[2]]
    assert known.histories[ids[1]].readings == 3
    # Both have the same covariance: the mean of the two.
    assert np.allclose(ekf.feature(ids[1]), [0.1, 1.0], atol=1e-6)


def test_features_that_were_read_together_are_two() -> None:
    ekf, known, ids = histories([[0.0, 1.0], [0.2, 1.0]])
    known.separate(ids)
    assert known.merge(ids) == {}
    assert len(ekf.features) == 2


def test_features_farther_apart_than_their_covariance_are_two() -> None:
    _, known, ids = histories([[0.0, 1.0], [0.2, 1.0]], sigma=0.02)
    assert known.merge(ids) == {}


def test_a_merged_feature_is_not_one_that_its_duplicate_was_read_beside() -> None:
    _, known, ids = histories([[0.0, 1.0], [0.1, 1.0], [0.2, 1.0]])
    known.separate([ids[0], ids[2]])
    gone = known.merge([ids[0]])
    assert gone == {ids[0]: ids[1]}
    assert known.merge([ids[1]]) == {}
    assert known.histories[ids[2]].seen_with == {ids[1]}


@pytest.mark.slow
def test_a_run_without_identities_finds_posts_that_stand_close_together() -> None:
    # Two posts 25 cm apart, at first seen one at a time: their readings go to one feature until both are seen at once.
    posts = np.array([[4.0, 0.0], [4.0, 0.25], [0.0, 4.0], [-3.0, -2.0]])
    found = {}
    for name, settings in {
        "distinct": SlamSettings(association="joint", new_gate=0.99999999, distinct=True, merge_gate=0.95),
        "plain": SlamSettings(association="joint", new_gate=0.99999999),
    }.items():
        rng = np.random.default_rng(5)
        records: list[Record] = [Odometry(0.0, 0.0, 0.0)]
        for t in range(60):
            seen = [t % 4] if t < 10 else [0, 1, 2, 3]
            records += [Detection(float(t), SENSOR.sample(np.zeros(3), posts[i], rng)) for i in seen]
        result = EkfSlam({"range-bearing": SENSOR}, velocity=Unicycle(1e-3, 1e-3), settings=settings).run(records)
        found[name] = np.array([feature.mean for feature in result.features])
        kept = {feature.id for feature in result.features}
        assert {a.feature for a in result.assignments if a.feature is not None} <= kept | set(range(20))
    assert len(found["distinct"]) == 4
    for post in posts:
        assert np.hypot(*(found["distinct"] - post).T).min() < 0.1
