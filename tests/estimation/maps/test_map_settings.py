"""Settings of maps: what is allowed, and one line for what is not."""

from __future__ import annotations

import math

import pytest

from trailmark.estimation.errors import EstimationError
from trailmark.estimation.maps.map_settings import MappingSettings
from trailmark.estimation.scans.scan_settings import ScanSettings
from trailmark.estimation.slam.slam_settings import SlamSettings


def test_the_defaults_hold() -> None:
    settings = MappingSettings()
    # Safe without knowledge of the log: errors of poses never average out, what nobody saw is blocked.
    assert settings.pose_memory == math.inf
    assert settings.unknown == "blocked"
    assert settings.shapes == "fitted"


def test_what_never_ends_is_infinite() -> None:
    assert MappingSettings(clear_range=math.inf).clear_range == math.inf
    assert SlamSettings(timeout=math.inf).timeout == math.inf
    assert ScanSettings(disc_radii=(0.1, math.inf)).disc_radii[1] == math.inf


@pytest.mark.parametrize(
    ("settings", "problem"),
    [
        ({"cell": 0.0}, "cell"),
        ({"unknown": "maybe"}, "got 'maybe'"),
        ({"pose_sigma": (-1.0, 0.0)}, "pose_sigma"),
        ({"gate": 1.0}, "gate"),
        ({"shapes": "boxs"}, "got 'boxs'"),
        ({"pose_memory": 0.0}, "pose_memory"),
        ({"pose_memory": math.nan}, "pose_memory"),
        ({"confirm": 0}, "confirm"),
    ],
)
def test_settings_that_are_not_allowed(settings: dict[str, object], problem: str) -> None:
    with pytest.raises(EstimationError, match=problem) as caught:
        MappingSettings(**settings)  # type: ignore[arg-type]  # the test's point
    assert "\n" not in str(caught.value)
