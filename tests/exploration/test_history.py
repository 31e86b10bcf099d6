"""An exploration's history as arrays, and back."""

from __future__ import annotations

import numpy as np
from tests.exploration.made_exploration import STOPS, made_exploration

from trailmark.exploration.history import History
from trailmark.exploration.result import ExplorationProgress


def same(a: ExplorationProgress, b: ExplorationProgress) -> bool:
    return all(repr(x) == repr(y) for x, y in zip(a, b, strict=True))


def test_arrays_hold_the_whole_history() -> None:
    history = made_exploration().history
    again = History.of(history).progress()
    assert len(again) == len(history)
    assert all(same(a, b) for a, b in zip(history, again, strict=True))
    assert [type(value) for value in again[5]] == [type(value) for value in history[5]]


def test_a_history_without_any_path() -> None:
    row = ExplorationProgress(0.0, 0.0, 1.0, 0, 0.0, np.zeros(3), None, None, "the sensor is silent")
    arrays = History.of([row, row])
    assert arrays.paths.shape == (0, 3)
    assert all(same(row, again) for again in arrays.progress())
    assert History.of([]).progress() == ()


def test_what_is_left_of_a_path_is_not_kept_anew() -> None:
    path = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    row = ExplorationProgress(0.0, 0.0, 1.0, 0, 0.0, np.zeros(3), path[1], path, "")
    other, none = row._replace(path=path + 1.0), row._replace(path=None)
    rows = [row, row, row._replace(path=path[1:]), other, none, other._replace(path=path[2:] + 1.0), row]
    arrays = History.of(rows)
    assert arrays.spans.tolist() == [[0, 3], [0, 3], [1, 3], [3, 6], [-1, -1], [5, 6], [6, 9]]
    assert all(same(a, b) for a, b in zip(rows, arrays.progress(), strict=True))


def test_landmarks_are_those_that_were_counted() -> None:
    assert np.allclose(History.of(made_exploration().history).landmarks()[:, :2], STOPS[1:])
    row = ExplorationProgress(0.0, 0.0, 1.0, 1, 0.0, np.zeros(3), np.ones(3), None, "")
    chosen = [row, row, row._replace(landmarks=2, target=2.0 * np.ones(3))]
    assert History.of(chosen).landmarks().tolist() == [[1.0] * 3, [2.0] * 3]
