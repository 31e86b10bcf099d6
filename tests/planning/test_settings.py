"""PlannerSettings: defaults, files, and what is refused in one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from trailmark.errors import ConfigurationError, FormatError
from trailmark.planning.settings import PlannerSettings


def test_what_a_file_says_counts_and_the_rest_keeps_its_default(tmp_path: Path) -> None:
    file = tmp_path / "settings.yaml"
    file.write_text("first_landmarks: 40\nleast_gain: 0.01\n")
    assert PlannerSettings.load(file) == PlannerSettings(first_landmarks=40, least_gain=0.01)
    assert PlannerSettings.load(file).to_dict()["patience"] == PlannerSettings().patience


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("first_landmark: 40", "setting first_landmark: expected .*first_landmarks.*, got 'first_landmark'"),
        ("first_landmarks: 0", "first_landmarks"),
        ("first_landmarks: many", "first_landmarks"),
        ("landmark_growth: 0.5", "landmark_growth"),
        ("- 1", "expected lines 'name: value', got list"),
        ("a: [", "not valid YAML"),
    ],
)
def test_wrong_files_are_refused_in_one_line(tmp_path: Path, text: str, match: str) -> None:
    file = tmp_path / "settings.yaml"
    file.write_text(text)
    with pytest.raises(FormatError, match=match) as error:
        PlannerSettings.load(file)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("wrong", [{"sweeps": 1.5}, {"landmark_growth": 0.9}, {"least_gain": float("nan")}])
def test_wrong_values_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError):
        PlannerSettings(**wrong)
