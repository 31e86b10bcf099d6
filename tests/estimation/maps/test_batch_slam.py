"""Maps of logs, smoothed: better than the filter's, with wrong noise, misread names, and poses in between."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from tests.helpers.alignment import aligned, rms
from tests.support.trials import trials

from trailmark.estimation import (
    Detection,
    Detector,
    EstimationError,
    Log,
    MapSettings,
    Pose,
    RangeBearing,
    Unicycle,
    map_log,
    simulate,
)
from trailmark.estimation.maps.mapped_log import MappedLog
from trailmark.shapes import Disc
from trailmark.world import World

POSTS = np.array([[2.0, 2.2], [5.0, 1.0], [9.5, 1.5], [10.5, 5.0], [7.0, 6.5], [3.0, 6.8], [1.0, 5.0], [6.0, 3.8]])
YARD = World("yard", (0.0, 0.0, 12.0, 8.0), tuple(Disc((float(x), float(y)), 0.15) for x, y in POSTS))
ROUND = [[1.0, 1.0], [8.0, 2.6], [9.0, 5.0], [4.5, 5.3], [2.2, 4.0]]
SENSOR, MOTION = RangeBearing(0.05, 0.02), Unicycle(0.03, 0.03, period=1.0)
RIGHT = MapSettings(range_bearing=SENSOR, velocity=MOTION)


@cache
def log(seed: int = 0, rounds: int = 2) -> Log:
    return simulate(YARD, rounds * ROUND, MOTION, detector=Detector(SENSOR, 7.0), random_state=seed).log


@cache
def filtered(seed: int = 0) -> MappedLog:
    return map_log(log(seed), MapSettings(smooth=False))


@cache
def smoothed(seed: int = 0) -> MappedLog:
    return map_log(log(seed), RIGHT)


def errors(mapped: MappedLog) -> tuple[float, float]:
    """Root mean squares of landmarks and of the trajectory, after the landmarks' alignment."""
    assert mapped.slam is not None
    surveyed = {int(i): (x, y) for i, x, y in mapped.log.landmarks}
    true = np.array([surveyed[f.identity] for f in mapped.slam.features if f.identity is not None])
    found = np.array([f.mean for f in mapped.slam.features])
    motion = aligned(found, true)
    truth = np.array([record[:3] for record in mapped.log.records if isinstance(record, Pose)])
    path = np.column_stack([np.interp(mapped.trajectory[:, 0], truth[:, 0], truth[:, j]) for j in (1, 2)])
    return rms(motion(found) - true), rms(motion(mapped.trajectory[:, 1:3]) - path)


@pytest.mark.slow
def test_smoothing_makes_the_trajectory_better() -> None:
    before = [errors(filtered(seed)) for seed in trials(2, of=2)]
    after = [errors(smoothed(seed)) for seed in trials(2, of=2)]
    assert np.mean([t for _, t in after]) < 0.8 * np.mean([t for _, t in before])
    assert filtered().batch is None


@pytest.mark.slow
def test_noise_is_estimated_where_it_is_wrong_and_asked_for() -> None:
    wrong = MapSettings(range_bearing=RangeBearing(0.01, 0.004), velocity=MOTION, stated_sensor_noise=False)
    fits = {}
    for mode in ("auto", "on", "off"):
        mapped = map_log(log(rounds=1), replace(wrong, fit_noise=mode))
        assert mapped.batch is not None
        fits[mode] = mapped.batch.figures["fitted"], errors(mapped)[0]
    assert {mode: fitted for mode, (fitted, _) in fits.items()} == {"auto": True, "on": True, "off": False}
    right = map_log(log(rounds=1), RIGHT)
    assert right.batch is not None
    assert right.batch.figures["fitted"] is False
    assert fits["auto"][1] < 1.5 * errors(right)[0]


@pytest.mark.slow
def test_names_misread_at_first_sight() -> None:
    seen: set[int] = set()
    records = []
    for record in log().records:
        if isinstance(record, Detection) and record.identity is not None and record.identity not in seen:
            seen.add(record.identity)
            record = record._replace(z=record.z + np.array([2.0, 0.5]))
        records.append(record)
    mapped = map_log(log()._replace(records=tuple(records)), RIGHT)
    assert errors(mapped)[0] < 0.1
    assert mapped.slam is not None
    assert mapped.slam.counts.outliers == pytest.approx(len(POSTS), abs=3)


@pytest.mark.slow
def test_obstacles_are_as_uncertain_as_the_map_is_by_itself() -> None:
    mapped = smoothed()
    assert mapped.slam is not None
    assert mapped.batch is not None
    whole = np.mean([np.trace(f.covariance) for f in mapped.slam.features])
    by_itself = np.mean([np.trace(e.covariance) for e in mapped.world.estimates if e is not None])
    assert by_itself < 0.5 * whole


@pytest.mark.parametrize(
    ("z", "identity"),
    [
        *(([1e18, 0.0], identity) for identity in (0, 99, None)),
        *((z, 0) for z in ([1e308, 0.0], [5.0, 1e308], [np.inf, 0.0], [np.nan, 0.0])),
    ],
)
def test_a_reading_that_cannot_be_is_told_in_one_line(z: list[float], identity: int | None) -> None:
    records = [*log().records, Detection(log().records[-1].t, np.array(z), identity=identity)]
    with pytest.raises(EstimationError, match="expected z of at most") as caught:
        map_log(log()._replace(records=tuple(records)), RIGHT)
    assert "\n" not in str(caught.value)
