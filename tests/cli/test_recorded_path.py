"""What a path file holds, as the path to audit."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from trailmark.cli.check import recorded_path
from trailmark.curves import CurvePath, Steering
from trailmark.errors import FormatError
from trailmark.formats.any_path import PathFile
from trailmark.path import Path

FILE = FilePath("path.json")
CURVES = CurvePath(np.array([[0.0, 0.0, 0.0], [4.0, 3.0, 1.0], [6.0, 1.0, -1.0]]), Steering(1.5, reverse=False))


def test_recorded_curves_are_rebuilt() -> None:
    found = recorded_path(PathFile(CURVES.states, 1.0, CURVES.record()), FILE)
    assert found == CURVES
    # Files of versions that did not write down where the states are.
    record = {key: value for key, value in CURVES.record().items() if key != "places"}
    assert recorded_path(PathFile(CURVES.states, 1.0, record), FILE) == CURVES


def test_recorded_curves_are_rebuilt_with_the_states_that_were_added() -> None:
    fine = CURVES.refined(lambda a, b: np.hypot(*(b - a)[:, :2].T) < 0.05)
    assert len(fine) > len(CURVES)
    assert isinstance(recorded_path(PathFile(fine.states, 1.0, fine.record()), FILE), CurvePath)


def test_states_that_are_not_the_curves_own_count_themselves() -> None:
    states = CURVES.states.copy()
    states[3, 0] += 1e-3
    for path in (Path(states), Path(states[:-1])):
        assert recorded_path(PathFile(path.states, 1.0, CURVES.record()), FILE) == path
    assert recorded_path(PathFile(states, 1.0), FILE) == Path(states)


@pytest.mark.parametrize(
    ("curve", "problem"),
    [
        ({"kind": "spline"}, "curve: kind: expected dubins or reeds-shepp, got 'spline'"),
        ("dubins", "curve: kind: expected"),
        ({"kind": "dubins", "turning_radius": 0, "knots": [[0, 0, 0]]}, "curve: turning radius"),
        ({"kind": "dubins", "turning_radius": 1e-320, "knots": [[0, 0, 0]]}, "curve: turning radius"),
        ({"kind": "dubins", "turning_radius": 1e300, "knots": [[0, 0, 0]]}, "curve: turning radius"),
        ({"kind": "dubins", "turning_radius": 1}, "curve: path"),
        ({"kind": "dubins", "turning_radius": 1, "knots": [[0, 0]]}, "curve: path: expected shape"),
        ({"kind": "dubins", "turning_radius": 1, "knots": [[0, 0, 0]], "places": "all"}, "curve: path: places"),
    ],
)
def test_curves_that_are_none_are_told_in_one_line(curve: Any, problem: str) -> None:
    with pytest.raises(FormatError, match=r"path\.json: ") as caught:
        recorded_path(PathFile(CURVES.states, 1.0, curve), FILE)
    assert problem in str(caught.value)
