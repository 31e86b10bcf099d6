"""Settings of maps: what is allowed, and one line for what is not."""

from __future__ import annotations

import math

import pytest

from trailmark.estimation.errors import EstimationError
from trailmark.estimation.maps.map_settings import MappingSettings


def test_the_defaults_hold() -> None:
    settings = MappingSettings()
    # Safe without knowledge of the log: errors of poses never average out, what nobody saw is blocked.
    assert settings.pose_memory == math.inf
    assert settings.unknown == "blocked"
    assert settings.shapes == "fitted"


@pytest.mark.parametrize(
    ("settings", "problem"),
    [
        ({"cell": 0.0}, "cell"),
        ({"unknown": "maybe"}, "unknown 'maybe' given"),
        ({"pose_sigma": (-1.0, 0.0)}, "pose_sigma"),
        ({"gate": 1.0}, "gate"),
        ({"shapes": "boxs"}, "shapes 'boxs' given, did you mean 'boxes'"),
        ({"pose_memory": 0.0}, "pose_memory"),
        ({"pose_memory": math.nan}, "pose_memory"),
        ({"confirm": 0}, "confirm"),
    ],
)
def test_settings_that_are_not_allowed(settings: dict[str, object], problem: str) -> None:
    with pytest.raises(EstimationError, match=problem) as caught:
        MappingSettings(**settings)  # type: ignore[arg-type]  # the test's point
    assert "\n" not in str(caught.value)
