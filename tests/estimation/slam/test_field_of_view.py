"""Where a sensor reads: learned from readings; features that should be read there and are not are dropped."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark.estimation import EkfSlam, EstimationError, RangeBearing, SlamSettings, Unicycle
from trailmark.estimation.logs.records import Detection, Odometry, Record
from trailmark.estimation.slam.field_of_view import FieldOfView

SENSOR = RangeBearing(0.1, 0.02)


def test_the_middle_of_the_readings() -> None:
    rng, view = np.random.default_rng(1), FieldOfView(tail=0.1)
    readings = np.column_stack([rng.uniform(1.0, 5.0, 2000), rng.uniform(-0.5, 0.5, 2000)])
    for part in np.array_split(readings, 700):
        view.learn(part)
    places = np.array([[3.0, 0.0], [1.6, 0.3], [4.9, 0.0], [3.0, 0.49], [0.5, 0.0], [9.0, 3.0]])
    assert view.holds(places).tolist() == [True, True, False, False, False, False]


def test_before_enough_readings_nothing_is_known() -> None:
    view = FieldOfView(fewest=50)
    view.learn(np.ones((49, 2)))
    assert not view.holds(np.ones((3, 2))).any()
    view.learn(np.ones((1, 2)))
    assert view.holds(np.ones((3, 2))).all()


def run(absences: int | None) -> tuple[int, list[int]]:
    """Run a log of four posts, and a fifth that goes away after a while; return how many were absent, and readings."""
    posts = np.array([[3.0, -1.0], [4.0, 1.0], [2.0, 0.8], [5.0, -0.5], [3.5, 0.0]])
    rng = np.random.default_rng(5)
    records: list[Record] = [Odometry(0.0, 0.0, 0.0)]
    for t in range(80):
        seen = posts if t < 30 else posts[:4]
        records += [Detection(float(t), SENSOR.sample(np.zeros(3), post, rng)) for post in seen]
    settings = SlamSettings(association="joint", new_gate=0.99999999, absences=absences)
    result = EkfSlam({"range-bearing": SENSOR}, velocity=Unicycle(1e-3, 1e-3), settings=settings).run(records)
    return result.counts.absent, sorted(feature.readings for feature in result.features)


@pytest.mark.slow
def test_a_post_that_went_away_is_dropped() -> None:
    absent, readings = run(20)
    assert (absent, len(readings)) == (1, 4)
    assert min(readings) > 70
    absent, readings = run(None)
    assert (absent, len(readings)) == (0, 5)


def test_misuse() -> None:
    with pytest.raises(EstimationError, match=r"absences: expected .*, got 0"):
        SlamSettings(absences=0)
    with pytest.raises(EstimationError, match="margin"):
        SlamSettings(margin=-1.0)
