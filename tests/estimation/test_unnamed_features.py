"""Maps without identities: as many features as there are, each of its own readings, by the defaults."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest
from tests.helpers.alignment import aligned, rms

from trailmark.estimation import (
    Detection,
    Detector,
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
from trailmark.estimation.mapped_log import MappedLog
from trailmark.estimation.records import Record
from trailmark.shapes import Disc
from trailmark.world import World

# Pairs 0.4 m apart.
SINGLE = np.array([[2.0, 2.2], [5.0, 1.0], [9.5, 1.5], [10.5, 5.0], [7.0, 6.5], [3.0, 6.8]])
POSTS = np.vstack([SINGLE, SINGLE + np.array([0.4, 0.0])])
YARD = World("yard", (0.0, 0.0, 12.0, 8.0), tuple(Disc((float(x), float(y)), 0.1) for x, y in POSTS))
ROUND = [[1.0, 1.0], [8.0, 2.6], [9.0, 5.0], [4.5, 5.3], [2.2, 4.0]]


def log(rounds: int, turn: float = 1.0, depth: bool = False) -> Log:
    """A drive whose odometry states its turns too large, and whose camera reads depth, right on average."""
    detector = Detector(RangeBearing(0.05, 0.01), 6.0, period=0.5 if depth else 1.0)
    made = simulate(YARD, rounds * ROUND, Unicycle(0.02, 0.03, period=1.0), detector=detector, random_state=0).log
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
    assert found.slam is not None
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
    found, wrong, error = mapped(log(rounds, turn, depth))
    assert len(found.world.obstacles) == len(POSTS)
    assert wrong < 0.05
    # Posts that hide others are missed.
    assert depth or found.world.not_certified is None
    assert error < 0.15  # of that, 0.1 m by the scale, which is known to a percent or two


@pytest.mark.slow
def test_a_robot_that_was_carried_gets_no_confidence() -> None:
    """It goes on at once where it was set down; without identities all that it sees there is new, or taken for else."""
    whole = log(2)
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
