"""Features without names: which readings are of distinct ones, and which features are one and the same."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark.estimation import EkfSlam, RangeBearing, SlamSettings, Unicycle
from trailmark.estimation.records import Detection, Odometry, Record

SENSOR = RangeBearing(0.1, 0.02)


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
