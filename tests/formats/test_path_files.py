from __future__ import annotations

import csv
import json
import math
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.trials import THOROUGH, few

from trailmark import se2
from trailmark.errors import ConfigurationError, OutputError
from trailmark.formats.any_path import read_any_path
from trailmark.formats.files import check_writable
from trailmark.formats.path_files import SUFFIXES, write_path
from trailmark.path import Path

number = st.floats(-1e9, 1e9)
states = st.lists(st.tuples(number, number, st.floats(-math.pi, math.pi, exclude_min=True)), min_size=1, max_size=9)
MESSAGES = (".yaml", ".yml", ".nav2.json")
ROWS = [[0.1, -2.0, 0.0], [1e-7, 3.5, math.pi]]


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=few(THOROUGH, of=120))
@given(rows=states)
def test_round_trip_is_exact(tmp_path_factory: pytest.TempPathFactory, suffix: str, rows: list[Any]) -> None:
    file = tmp_path_factory.mktemp("paths") / f"a{suffix}"
    write_path(file, rows)
    found = read_any_path(file).path.states
    expected = Path(np.array(rows if len(rows) > 1 or suffix != ".geojson" else rows * 2)).states
    assert np.array_equal(found[:, :2], expected[:, :2])
    # Messages hold quaternions.
    np.testing.assert_allclose(se2.wrap(found[:, 2] - expected[:, 2]), 0.0, atol=1e-15 if suffix in MESSAGES else 0.0)


def test_csv(tmp_path: FilePath) -> None:
    write_path(tmp_path / "a.csv", ROWS)
    with (tmp_path / "a.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert [list(map(float, row.values())) for row in table] == ROWS
    assert list(table[0]) == ["x", "y", "theta"]


@pytest.mark.parametrize("name", ["a.path", "a.txt", "a.PATH"])
def test_plain_rows(tmp_path: FilePath, name: str) -> None:
    write_path(tmp_path / name, Path(np.array(ROWS)))
    assert np.loadtxt(tmp_path / name).tolist() == ROWS


def test_json_holds_the_record(tmp_path: FilePath) -> None:
    record = {"world": "öffice", "status": "solved", "states": "ignored", "seed": np.int64(3), "cost": np.float64(1.5)}
    write_path(tmp_path / "a.json", ROWS, {**record, "lower_bound": None, "time": {"total": 0.1}})
    data = json.loads((tmp_path / "a.json").read_text())
    assert data == {
        "world": "öffice",
        "status": "solved",
        "states": ROWS,
        "seed": 3,
        "cost": 1.5,
        "lower_bound": None,
        "time": {"total": 0.1},
    }
    assert list(data) == ["world", "status", "states", "seed", "cost", "lower_bound", "time"]


def test_json_without_a_record_measures_the_path(tmp_path: FilePath) -> None:
    write_path(tmp_path / "a.json", [[0, 0, 0], [3, 4, 1]])
    data = json.loads((tmp_path / "a.json").read_text())
    assert data == {"states": [[0, 0, 0], [3, 4, 1]], "cost": 5.5, "length": 5.0, "rotation": 1.0}


@pytest.mark.parametrize("value", [math.nan, math.inf, object(), {1, 2}])
def test_what_json_cannot_hold(tmp_path: FilePath, value: object) -> None:
    with pytest.raises(OutputError, match="the record holds what JSON cannot"):
        write_path(tmp_path / "a.json", ROWS, {"cost": value})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("rows", [[], [[1, 2]], [[1, 2, math.nan]]])
def test_bad_states_are_not_written(tmp_path: FilePath, rows: list[Any]) -> None:
    with pytest.raises(ConfigurationError):
        write_path(tmp_path / "a.csv", rows)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("a.cvs", r"suffix: expected \.csv, .*\.txt, \.yaml, \.yml, got '\.cvs' \(did you mean '\.csv'\?\)"),
        ("a", r"expected \.csv, \.geojson, \.json, .*, got ''"),
        ("none/a.csv", "the directory .* does not exist"),
        ("folder.csv", "is a directory; expected a file"),
    ],
)
def test_unwritable_paths_are_found_before_planning(tmp_path: FilePath, name: str, problem: str) -> None:
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(OutputError, match=problem):
        check_writable(tmp_path / name, SUFFIXES)
    with pytest.raises(OutputError):
        write_path(tmp_path / name, ROWS)
    assert [p.name for p in tmp_path.iterdir()] == ["folder.csv"]


def test_writable_paths_are_left_untouched(tmp_path: FilePath) -> None:
    (tmp_path / "b.csv").write_text("old")
    check_writable(tmp_path / "a.json", SUFFIXES)
    check_writable(tmp_path / "b.csv", SUFFIXES)
    assert (tmp_path / "b.csv").read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["b.csv"]


def test_published_rows(shared_data: FilePath) -> None:
    file = shared_data / "omplapp" / "Maze_planar.path"
    assert np.allclose(read_any_path(file).path.states, np.loadtxt(file), atol=1e-12)
