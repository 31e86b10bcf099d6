"""Path: cost, length and rotation; places along it; resampling; the way back."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path as FilePath

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark import ConfigurationError, OutputError, Path

coordinate = st.floats(-100.0, 100.0)
pose = st.tuples(coordinate, coordinate, st.floats(-math.pi, math.pi, exclude_min=True))
paths = st.lists(pose, min_size=1, max_size=6).map(lambda rows: Path(np.array(rows)))


def reference_cost(states: np.ndarray) -> tuple[float, float]:
    """Return length and rotation, one step at a time."""
    length = rotation = 0.0
    for a, b in pairwise(states):
        length += math.dist(a[:2], b[:2])
        rotation += abs(math.atan2(math.sin(b[2] - a[2]), math.cos(b[2] - a[2])))
    return length, rotation


@pytest.mark.slow
@given(paths)
def test_cost_is_length_plus_half_of_the_rotation(path: Path) -> None:
    length, rotation = reference_cost(path.states)
    assert path.length == pytest.approx(length, abs=1e-9)
    assert path.rotation == pytest.approx(rotation, abs=1e-9)
    assert path.cost == pytest.approx(length + 0.5 * rotation, abs=1e-9)


@pytest.mark.slow
@given(paths, st.floats(0.0, 1.0))
def test_a_fraction_of_the_way_is_a_fraction_of_the_cost(path: Path, fraction: float) -> None:
    q = path.at(fraction)
    assert q.shape == (3,)
    states, costs = path.states, [0.0]
    for i in range(len(states) - 1):
        costs.append(costs[-1] + Path(states[i : i + 2]).cost)
    step = max((i for i in range(len(states)) if costs[i] <= fraction * costs[-1] + 1e-12), default=0)
    before = Path(np.vstack([states[: step + 1], q])).cost
    assert before == pytest.approx(fraction * path.cost, abs=1e-6)


def test_places_along_a_path() -> None:
    path = Path(np.array([(0, 0, 0), (2, 0, 0), (2, 0, 2), (2, 3, 2)]))
    assert path.cost == pytest.approx(6.0)
    assert path.at(0.0).tolist() == [0, 0, 0]
    assert path.at(1.0) == pytest.approx((2, 3, 2))
    assert path.at([1 / 6, 2.5 / 6, 5 / 6]) == pytest.approx(np.array([[1, 0, 0], [2, 0, 1], [2, 2, 2]]))
    assert path.at([-1.0, 2.0]) == pytest.approx(np.array([[0, 0, 0], [2, 3, 2]]))
    assert path.at(np.empty(0)).shape == (0, 3)


@pytest.mark.slow
@given(paths, st.floats(0.5, 50.0))
def test_resampling_keeps_the_way_and_the_states(path: Path, step: float) -> None:
    fine = path.resample(step)
    assert fine.cost == pytest.approx(path.cost, abs=1e-6)
    assert {tuple(q) for q in path.states} <= {tuple(q) for q in fine.states}
    for i in range(len(fine) - 1):
        assert Path(fine.states[i : i + 2]).cost <= step * (1 + 1e-9)


@pytest.mark.parametrize("states", [[], [1, 2, 3], [[1, 2]], [[1, 2, math.nan]], np.empty((0, 3)), "here"])
def test_what_is_no_path_is_refused(states: object) -> None:
    with pytest.raises(ConfigurationError, match="path: "):
        Path(states)  # type: ignore[arg-type]  # that is what is tested


def test_paths_are_values() -> None:
    states = np.array([[0.0, 0.0, 4.0], [1.0, 0.0, 0.0]])
    path = Path(states)
    states[0] = 9.0
    assert path.states[0].tolist() == [0.0, 0.0, pytest.approx(4.0 - 2 * math.pi)]
    assert len(path) == 2
    assert path == Path(path.states.copy())
    assert path != path.reversed()
    assert path != "path"
    assert hash(Path(np.zeros((1, 3)))) == hash(Path(-np.zeros((1, 3))))
    with pytest.raises(ValueError, match="read-only"):
        path.states[0] = 1.0


@pytest.mark.parametrize("name", ["a.json", "a.csv", "a.yaml", "a.nav2.json", "a.geojson"])
def test_a_path_is_saved_and_loaded(tmp_path: FilePath, name: str) -> None:
    path = Path(np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0], [2.0, 0.0, -3.0]]))
    for _ in range(2):
        path.save(tmp_path / name, "odom")
        np.testing.assert_allclose(Path.load(str(tmp_path / name)).states, path.states, atol=1e-15)
    with pytest.raises(OutputError, match="suffix: expected"):
        path.save(str(tmp_path / "a.gpx"))
