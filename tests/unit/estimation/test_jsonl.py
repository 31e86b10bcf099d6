"""trailmark's own log: exact round trips, and what is wrong with a line."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.helpers.trials import few

from trailmark.errors import FormatError, OutputError
from trailmark.estimation.readers import load_log, save_log
from trailmark.estimation.records import Detection, Increment, Log, Odometry, Pose, Record, Scan, with_own_times

numbers = st.floats(allow_nan=False, allow_infinity=False)
lengths = st.floats(0.0, allow_nan=False, allow_infinity=False)
triples = st.tuples(numbers, numbers, numbers)


@st.composite
def covariances(draw: st.DrawFn, size: int) -> np.ndarray[Any, Any]:
    root = np.array(draw(st.lists(st.floats(-10, 10), min_size=size * size, max_size=size * size))).reshape(size, size)
    product = root @ root.T
    return np.asarray(0.5 * (product + product.T) + 1e-6 * np.eye(size))


def detections(t: float) -> st.SearchStrategy[Detection]:
    covariance = st.none() | covariances(2)
    identity = st.none() | st.integers(-5, 10**12)
    near = st.builds(np.array, st.tuples(lengths, numbers))
    return st.builds(Detection, st.just(t), near, st.sampled_from(["range-bearing", "cartesian"]), identity, covariance)


def scans(t: float) -> st.SearchStrategy[Scan]:
    ranges = st.lists(lengths | st.sampled_from([math.nan, math.inf]), max_size=8)
    far = st.floats(1e-3, 1e6) | st.just(math.inf)
    values = ranges.map(lambda r: np.array(r, dtype=np.float64))
    return st.builds(Scan, st.just(t), values, numbers, numbers, far, triples, st.none() | triples)


def records(t: float) -> st.SearchStrategy[Record]:
    return st.one_of(
        st.builds(Odometry, st.just(t), numbers, numbers),
        st.builds(Increment, st.just(t), numbers, numbers, numbers, st.none() | covariances(3)),
        detections(t),
        scans(t),
        st.builds(Pose, st.just(t), numbers, numbers, numbers, st.booleans()),
    )


@st.composite
def logs(draw: st.DrawFn) -> Log:
    times = sorted(draw(st.lists(numbers, min_size=1, max_size=6)))
    marks = draw(st.lists(st.tuples(st.integers(-9, 9).map(float), numbers, numbers), max_size=3))
    name = draw(st.text(st.characters(codec="utf-8"), max_size=5))
    rows = np.array(marks, dtype=np.float64).reshape(-1, 3)
    cell = draw(st.none() | st.floats(1e-3, 10.0))
    return Log(name, tuple(draw(records(t)) for t in times), rows, cell=cell)


def same(a: Any, b: Any) -> bool:
    """Whether two values are equal to the bit, NaN to NaN, and arrays of the same kind."""
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and a.dtype == b.dtype and np.array_equal(a, b, equal_nan=True)
    if isinstance(a, tuple):
        return type(a) is type(b) and len(a) == len(b) and all(map(same, a, b))
    return type(a) is type(b) and bool(a == b)


@pytest.mark.slow
@settings(max_examples=few(25, of=2))  # each writes a file
@given(log=logs(), suffix=st.sampled_from(["jsonl", "jsonl.gz"]))
def test_a_round_trip_is_exact(tmp_path_factory: pytest.TempPathFactory, log: Log, suffix: str) -> None:
    path = tmp_path_factory.getbasetemp() / f"round.{suffix}"
    save_log(log, path)
    assert same(load_log(path), log)


def write(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(['{"trailmark_log": 1, "name": "a"}', *lines]) + "\n", encoding="utf-8")
    return path


GOOD = '{"type": "pose", "t": 1, "x": 0, "y": 0, "theta": 0}'
SCAN = '"angle_min": 0, "angle_increment": 1, "range_max": 9'


@pytest.mark.parametrize(
    ("line", "problem"),
    [
        ("{", "not valid JSON: Expecting property name"),
        ("[1]", "expected a JSON object, got [1]"),
        ("{}", "type: expected detection, increment, landmark, odometry, pose, scan, got 'None'"),
        ('{"type": "odometri"}', "got 'odometri'"),
        ('{"type": "odometry", "t": NaN, "v": 1, "omega": 2}', "odometry: t: expected a finite number, got nan"),
        ('{"type": "odometry", "t": 1, "v": 1e999, "omega": 2}', "odometry: v: expected a finite number, got inf"),
        ('{"type": "odometry", "t": 1, "v": 1}', "odometry: expected a field 'omega', got none"),
        ('{"type": "odometry", "t": 1, "v": 1, "omga": 2}', "got 'omga'"),
        ('{"type": "odometry", "t": 0.5, "v": 1, "omega": 2}', "time: expected 1.0 or later, got 0.5"),
        (
            '{"type": "scan", "t": 1, "ranges": [1, -1], ' + SCAN + "}",
            "scan: ranges: expected a list of numbers of 0 or more, ",
        ),
        (
            '{"type": "scan", "t": 1, "ranges": [], ' + SCAN.replace("9", "0") + "}",
            "scan: range_max: expected a finite",
        ),
        ('{"type": "detection", "t": 1, "z": [1]}', "detection: z: expected finite numbers of shape (2,), got [1]"),
        ('{"type": "detection", "t": 1, "z": [-1, 2]}', "detection: range: expected 0 or more, got -1"),
        (
            '{"type": "detection", "t": 1, "z": [1, 2], "kind": "polar"}',
            "kind: expected cartesian, range-bearing, got 'polar'",
        ),
        ('{"type": "detection", "t": 1, "z": [1, 2], "identity": 1.5}', "identity: expected a whole number, got 1.5"),
        (
            '{"type": "detection", "t": 1, "z": [1, 2], "covariance": [[1, 0]]}',
            "covariance: expected 2 rows of 2 finite numbers, symmetric and not negative, got [[1, 0]]",
        ),
        (
            '{"type": "detection", "t": 1, "z": [1, 2], "covariance": [[1, 2], [2, 1]]}',
            "symmetric and not negative, got [[",
        ),
        ('{"type": "pose", "t": 1, "x": 1, "y": 2, "theta": 0, "truth": 1}', "truth: expected True or False, got 1"),
    ],
)
def test_bad_lines(tmp_path: Path, line: str, problem: str) -> None:
    path = write(tmp_path / "a.jsonl", GOOD, "", line, GOOD)
    with pytest.raises(FormatError) as caught:
        load_log(path)
    assert str(caught.value).startswith(f"{path}:4: ")
    assert problem in str(caught.value)
    log = load_log(path, skip_bad=True)
    assert (len(log.records), log.dropped) == (2, 1)


@pytest.mark.parametrize(
    ("line", "problem"),
    [
        ('{"trailmark_log": 2}', "header: trailmark_log: expected 1 (the schema version), got 2"),
        ('{"trailmark_log": true}', "header: trailmark_log: expected 1 (the schema version), got True"),
        ('{"trailmark_log": 1, "nam": "a"}', "got 'nam'"),
        ('{"name": "a"}', "header: expected a field 'trailmark_log', got none"),
        ('{"trailmark_log": 1, "cell": 0}', "header: cell: expected"),
        (GOOD, "header: field: expected cell, name, trailmark_log, whole, got"),
        ("{", "not valid JSON"),
    ],
)
def test_bad_headers(tmp_path: Path, line: str, problem: str) -> None:
    path = tmp_path / "a.jsonl"
    path.write_text(line + "\n" + GOOD + "\n")
    for skip_bad in (False, True):  # without its header the file is no such log
        with pytest.raises(FormatError) as caught:
            load_log(path, skip_bad=skip_bad)
        assert str(caught.value).startswith(f"{path}:1: ")
        assert problem in str(caught.value)


def test_optional_fields_may_be_null(tmp_path: Path) -> None:
    nulls = '{"type": "detection", "t": 1, "z": [1, 2], "identity": null, "covariance": null}'
    scan = '{"type": "scan", "t": 1, "ranges": [null, "inf"], "mount": null, "pose": null, ' + SCAN + "}"
    log = load_log(write(tmp_path / "a.jsonl", nulls, scan))
    assert isinstance(log.records[0], Detection)
    assert log.records[0][2:] == ("range-bearing", None, None)
    assert isinstance(log.records[1], Scan)
    assert log.records[1][5:] == ((0.0, 0.0, 0.0), None)
    assert str(log.records[1].ranges.tolist()) == "[nan, inf]"


@pytest.mark.parametrize(
    "record",
    [
        Odometry(math.nan, 0.0, 0.0),
        Odometry(9.0, math.inf, 0.0),
        Odometry(-1.0, 0.0, 0.0),
        Scan(9.0, np.array([-1.0]), 0.0, 0.1, 9.0),
        Scan(9.0, np.array([-math.inf]), 0.0, 0.1, 9.0),
        Detection(9.0, np.array([1.0, 2.0, 3.0])),
        Detection(9.0, np.array([1.0, math.nan])),
        Increment(9.0, 0.0, 0.0, 0.0, -np.eye(3)),
    ],
)
def test_what_could_not_be_read_is_not_written(tmp_path: Path, record: Record) -> None:
    path = tmp_path / "a.jsonl"
    path.write_text("as it was")
    with pytest.raises(OutputError, match=r"a.jsonl: cannot be written: records\[1\]: "):
        save_log(Log("a", (Odometry(0.0, 0.0, 0.0), record), np.empty((0, 3))), path)
    assert path.read_text() == "as it was"
    assert [file.name for file in tmp_path.iterdir()] == ["a.jsonl"]


def a_drive(clock: float, offset: float = 0.0) -> list[Record]:
    """Ten instants a second, at each a motion and a reading of feature 7, stamped by a clock of these ticks."""
    records: list[Record] = []
    for k in range(40):
        t = math.floor((0.1 * k + offset) / clock + 1e-9) * clock
        records += [Odometry(t, 1.0 + 0.01 * k, 0.0), Detection(t, np.array([9.0 - 0.1 * k, 0.0]), identity=7)]
    return records


@pytest.mark.parametrize("clock", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("offset", [0.0, 0.7])
def test_a_coarse_clocks_records_keep_their_order_and_get_times_of_their_own(
    tmp_path: Path, clock: float, offset: float
) -> None:
    drive = a_drive(clock, offset)
    save_log(Log("coarse", tuple(drive), np.empty((0, 3))), tmp_path / "log.jsonl")
    log = load_log(tmp_path / "log.jsonl")
    times = [record.t for record in log.records]
    assert times == pytest.approx([0.1 * (k // 2) + offset for k in range(80)])
    assert [r._replace(t=0.0) for r in log.records if isinstance(r, Odometry)] == [
        r._replace(t=0.0) for r in drive if isinstance(r, Odometry)
    ]
    assert len(log.notes) == 1
    assert with_own_times(log) is log


def test_equal_motions_of_one_stamp_are_kept_where_other_things_were_read_after_each() -> None:
    motion = Increment(1.0, 0.1, 0.0, 0.0)
    first, second = (Detection(1.0, np.array([r, 0.0]), identity=7) for r in (2.0, 1.9))
    records = (Pose(0.0, 0.0, 0.0, 0.0), motion, first, motion, second, motion._replace(t=2.0))
    log = with_own_times(Log("log", records, np.empty((0, 3))))
    assert [record.t for record in log.records] == [0.0, 1.0, 1.0, 1.5, 1.5, 2.0]
    # The same part of a log twice is no second motion.
    twice = Log("log", (records[0], motion, first, motion, first), np.empty((0, 3)))
    assert with_own_times(twice) is twice


def test_stamps_of_a_fine_clock_stay() -> None:
    a, b = a_drive(0.1), a_drive(0.1)
    # A recorder that wrote the velocity after the reading, and one that wrote a row twice, with another digit.
    swapped = [record for pair in zip(a[1::2], a[::2], strict=True) for record in pair]
    for records in (swapped, [b[0], b[0]._replace(v=9.0), *b[1:]]):  # type: ignore[call-arg]  # both are velocities
        log = Log("log", tuple(records), np.empty((0, 3)))
        assert with_own_times(log) is log


def test_velocities_without_a_clock(tmp_path: Path) -> None:
    rows = [{"type": "odometry", "t": 0.0, "v": k, "omega": 0.0} for k in range(5)]
    path = write(tmp_path / "log.jsonl", *map(json.dumps, rows))
    with pytest.raises(FormatError, match="expected velocities with times of their own, got 0 s for all"):
        load_log(path)
