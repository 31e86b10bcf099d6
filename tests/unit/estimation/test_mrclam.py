"""MRCLAM folders: merging, identities, other robots, and what is wrong with a row."""

from __future__ import annotations

from pathlib import Path

import pytest

from trailmark.errors import FormatError
from trailmark.estimation.readers import load_log
from trailmark.estimation.records import Detection, Odometry, Pose

FILES = {
    "Barcodes.dat": "# Subject #    Barcode #\n  1 \t   5\n  2 \t  14\n  6 \t  63\n  7 \t  81\n",
    "Landmark_Groundtruth.dat": "# a comment\n  6 \t 0.5 \t -4.25 \t 0.0001 \t 0.0002\n7 1.5 2.0 0.0001 0.0002\n",
    "Robot1_Odometry.dat": "# Time [s]\n10.0 \t 0.1 \t 0.0\n11.0 0.2 -0.5\n11.0 0.3 0.5\n12.0 \t 0.0 \t 0.0\n",
    "Robot1_Measurement.dat": "# Time [s]\n10.5 \t 63 \t 3.787 \t -0.257\n11.0 14 1.0 0.5\n11.0 81 2.5 0.25\n",
    "Robot1_Groundtruth.dat": "9.0 \t 1.0 \t 2.0 \t 0.5\n11.0 \t 1.5 \t 2.5 \t 0.75\n",
}


def folder(where: Path, **changes: str) -> Path:
    """A folder of these files; a change goes by the file's name without ``.dat``."""
    path = where / "set"
    path.mkdir(exist_ok=True)
    for name, text in FILES.items():
        (path / name).write_text(changes.get(name.removesuffix(".dat"), text))
    return path


def test_a_small_log(tmp_path: Path) -> None:
    log = load_log(folder(tmp_path))
    assert log.name == "set-robot1"
    # At equal times the odometry comes first, then detections, then truth; rows of one file keep their order.
    kinds = [Pose, Odometry, Detection, Odometry, Odometry, Detection, Pose, Odometry]
    assert [type(r) for r in log.records] == kinds
    assert [r.t for r in log.records] == [9.0, 10.0, 10.5, 11.0, 11.0, 11.0, 11.0, 12.0]
    assert log.records[0] == Pose(9.0, 1.0, 2.0, 0.5, truth=True)
    assert log.records[3:5] == (Odometry(11.0, 0.2, -0.5), Odometry(11.0, 0.3, 0.5))
    first, second = log.records[2], log.records[5]
    assert isinstance(first, Detection)
    assert isinstance(second, Detection)
    assert first.z.tolist() == [3.787, -0.257]
    assert (first.identity, second.identity) == (6, 7)
    assert (first.kind, first.covariance) == ("range-bearing", None)
    assert log.landmarks.tolist() == [[6.0, 0.5, -4.25], [7.0, 1.5, 2.0]]
    assert log.notes == ("1 sightings of other robots left out",)
    assert log.dropped == 0


def test_truth_and_landmarks_are_optional_and_nothing_else_is(tmp_path: Path) -> None:
    path = folder(tmp_path)
    (path / "Robot1_Groundtruth.dat").unlink()
    (path / "Landmark_Groundtruth.dat").unlink()
    log = load_log(path)
    assert not any(isinstance(r, Pose) for r in log.records)
    assert log.landmarks.shape == (0, 3)
    for name in ("Barcodes.dat", "Robot1_Measurement.dat"):
        (folder(tmp_path) / name).unlink()
        with pytest.raises(FormatError, match=f"{name}: cannot be read: No such file or directory"):
            load_log(path)


def test_which_robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = folder(tmp_path)
    (path / "Robot12_Odometry.dat").write_text("1 2 3\n")
    (path / "Robot12_Measurement.dat").write_text("")
    (path / "RobotX_Odometry.dat").write_text("")
    monkeypatch.chdir(path)
    files = path / "Robot12_Measurement.dat", path / "Robot12_Odometry.dat"
    for given in (f"{path}:12", f"{path}/:12", ".:12", "../set:12", *files):
        assert load_log(given).records == (Odometry(1.0, 2.0, 3.0),)
    assert load_log(path, robot=12).name == load_log(path, "mrclam", robot=12).name == "set-robot12"
    with pytest.raises(FormatError, match=r"set: a folder of robots 1, 12: say which, as set:1"):
        load_log(path)
    with pytest.raises(FormatError, match=r"set: robot: expected 1, 12 \(with a file RobotN_Odometry.dat\), got 3"):
        load_log(f"{path}:3")
    assert load_log(f"{path}:12", robot=12).name == "set-robot12"
    with pytest.raises(FormatError, match=r"set:1: robot: expected 1, which the name says, or none, got 12"):
        load_log(f"{path}:1", robot=12)


MEASUREMENT, ODOMETRY = FILES["Robot1_Measurement.dat"], FILES["Robot1_Odometry.dat"]


@pytest.mark.parametrize(
    ("name", "text", "problem"),
    [
        ("Robot1_Odometry", ODOMETRY[:-5], ":5: expected 3 finite numbers t, v, omega, got 2 columns"),
        ("Robot1_Odometry", ODOMETRY + "13 1 nan\n", ":6: expected 3 finite numbers"),
        ("Robot1_Odometry", ODOMETRY + "13 1_0 0\n", ":6: expected 3 finite numbers"),
        ("Robot1_Odometry", ODOMETRY + "11.5 1 0\n", ":6: time: expected 12.0 or later, got 11.5"),
        ("Robot1_Measurement", MEASUREMENT + "12 43 1 0\n", ":5: barcode: expected one of Barcodes.dat"),
        ("Robot1_Measurement", MEASUREMENT + "12 63 -1 0\n", ":5: range: expected 0 or more, got -1"),
        ("Robot1_Groundtruth", FILES["Robot1_Groundtruth.dat"] + "8 1 1 0\n", ":3: time: expected 11.0 or later, got"),
        ("Landmark_Groundtruth", FILES["Landmark_Groundtruth.dat"] + "8 1\n", ":4: expected 5 finite"),
        ("Barcodes", FILES["Barcodes.dat"] + "1e300 8\n", ":6: subject: expected 1 to 999, got 1e+300"),
        ("Barcodes", FILES["Barcodes.dat"] + "8\n", ":6: expected 2 finite numbers subject, barcode, got 1 columns"),
    ],
)
def test_bad_rows(tmp_path: Path, name: str, text: str, problem: str) -> None:
    path = folder(tmp_path, **{name: text})
    with pytest.raises(FormatError) as caught:
        load_log(path)
    assert str(caught.value).startswith(f"{path / name}.dat{problem}")
    log = load_log(path, skip_bad=True)
    assert log.dropped == 1
    # The truncated row of the first case was one of the good ones.
    assert len(log.records) == 8 - text.startswith(ODOMETRY[:-5]) * (not text.startswith(ODOMETRY))


def test_whole_second_stamps_are_refused(tmp_path: Path) -> None:
    rows = "".join(f"{10 + k // 5} 0.{k} 0\n" for k in range(30))
    with pytest.raises(FormatError, match=r"expected a stamp for each velocity, got 10.0 for several"):
        load_log(folder(tmp_path, Robot1_Odometry=rows))
