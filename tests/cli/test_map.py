"""trailmark map: logs of all kinds to worlds that can be planned in; bad ones, and interrupts, leave one line."""

from __future__ import annotations

import gzip
import json
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.helpers.logs import POSTS, START, recorded, write_mrclam

from trailmark import Disc, Robot, World
from trailmark.estimation import Pose, regrow, save_log

Shell = Callable[..., Any]
Terminal = Callable[..., Any]


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp("saved") / "yard.jsonl"
    save_log(recorded(), file)
    return file.read_text()


@pytest.fixture
def log(tmp_path: Path, saved: str) -> Path:
    file = tmp_path / "yard.jsonl"
    file.write_text(saved)
    return file


@pytest.fixture
def mrclam(tmp_path: Path) -> Path:
    folder = tmp_path / "robots"
    write_mrclam(folder)
    return folder


def given(folder: Path, text: str) -> tuple[str, Path]:
    """Return the option that names a new file of these settings."""
    file = folder / "settings.yml"
    file.write_text(text)
    return "--settings", file


def record(shell: Shell, *words: object) -> dict[str, Any]:
    run = shell("map", *words, "--json")
    assert (run.status, run.err) == (0, "")
    found = json.loads(run.out)
    assert isinstance(found, dict)
    return found


@pytest.mark.slow
def test_a_simulated_log_becomes_a_world_to_plan_in(shell: Shell, log: Path, tmp_path: Path) -> None:
    file = tmp_path / "world.yaml"
    run = shell(
        "map", log, "--output", file, "--start", START, *given(tmp_path, "radius: 0.15"), "--robot", "disc:0.25"
    )
    assert (run.status, run.err) == (0, "")
    world = World.load(file)
    assert world.robot == Robot.disc(0.25)
    found = np.array([shape.center for shape in world.obstacles if isinstance(shape, Disc)])
    assert len(found) == len(world.obstacles) == len(POSTS)
    assert np.hypot(*(found[:, None] - POSTS).transpose(2, 0, 1)).min(axis=1).max() < 0.2
    assert world.risk is None
    assert all(estimate is not None for estimate in world.estimates)
    grown = regrow(world, 0.99)
    assert all(b.area > a.area for a, b in zip(world.obstacles, grown.obstacles, strict=True))
    # With an error of the heading, what is grown for one robot is not enough for one that reaches farther.
    regrow(world, 0.9, pose_covariance=np.diag([1e-4, 1e-4, 1e-4])).save(tmp_path / "grown.yaml")
    longer = shell("plan", tmp_path / "grown.yaml", "--robot", "rectangle:1x0.2", "--time-limit", "0.3")
    assert "grown anew for this one (rectangle 1 x 0.2 m), with confidence 0.9" in longer.err
    planned = shell("plan", file, "--time-limit", "0.3", "--json")
    assert planned.status == 0, planned.err
    assert json.loads(planned.out)["query"] == "driven"
    assert shell("plan", file, "--query", "farthest", "--time-limit", "0.3").status == 0


KEYS = (
    "log name records dropped poses association matching features nis batch counts obstacles bounds trajectory queries "
    "risk time not_certified warnings notes robot written"
)


@pytest.mark.slow
def test_the_figures(shell: Shell, log: Path, tmp_path: Path) -> None:
    file, picture = tmp_path / "world.yaml", tmp_path / "map.svg"
    found = record(shell, log, "--output", file, "--confidence", "0.99", "--plot", picture)
    assert list(found) == KEYS.split()
    assert found["records"]["all"] == len(recorded().records)
    assert (found["dropped"], found["poses"], found["association"]) == (0, "slam", "known")
    assert found["features"] == {"confirmed": 8, "tentative": 0, "dropped": 0}
    assert found["nis"]["low"] < found["nis"]["expected"] < found["nis"]["high"]
    assert found["risk"] == pytest.approx({"confidence": 0.99, "collision_at_most": 0.01})
    assert found["obstacles"]["discs"] == 8
    assert found["written"] == {"world": str(file), "plot": str(picture), "trajectory": None, "nav2": None}
    assert found["queries"] == [query.name for query in World.load(file).queries]
    assert 0.0 < found["time"]["per_update"] < found["time"]["total"]
    assert picture.read_bytes().startswith(b"<?xml")
    text = shell("map", log, "--output", file, "--confidence", "0.99", "--start", START, "--frame", "map").out
    assert {estimate.frame for estimate in World.load(file).estimates if estimate} == {"map"}
    assert text.startswith("yard: 8 obstacles\n")
    assert "with probability 0.01 at most" in text


@pytest.mark.slow
def test_scans_become_walls(shell: Shell, tmp_path: Path) -> None:
    log, file = tmp_path / "scans.jsonl.gz", tmp_path / "world.yaml"
    save_log(recorded(scanner=True), log)
    found = record(shell, log, "--output", file, "--start", START, "--plot", tmp_path / "map.png")
    assert (found["poses"], found["association"], found["nis"]) == ("match", None, None)
    assert found["matching"]["nodes"] > 10
    assert found["obstacles"]["walls"] >= 4
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    drifting = record(shell, log, "--output", file, "--start", START, "--poses", "odometry")
    assert any("drift" in note for note in drifting["notes"])
    assert len(World.load(file).obstacles) == drifting["obstacles"]["all"]
    chosen = given(tmp_path, "mapping: {unknown: free, cell: 0.1, scan: {max_range: 5}}")
    free = record(shell, log, "--output", file, *chosen)
    assert free["obstacles"]["unknown"] == 0


@pytest.mark.slow
def test_without_certified_features_no_confidence_is_given(shell: Shell, log: Path, tmp_path: Path) -> None:
    """The robot is carried, and nothing that it sees has a name."""
    file, end = tmp_path / "world.yaml", recorded().records[-1].t
    kept = [r for r in recorded().records if not (0.4 * end < r.t < 0.5 * end or isinstance(r, Pose))]
    moved = [r._replace(t=r.t - 0.1 * end) if r.t > 0.45 * end else r for r in kept]
    save_log(recorded()._replace(records=tuple(moved)), log)
    words = ("map", log, "--output", file, *given(tmp_path, "slam: {association: joint}"))
    refused = shell(*words, "--confidence", "0.99")
    assert (refused.status, refused.out, file.exists()) == (3, "", False)
    assert "not certified" in refused.err
    assert "--force" in refused.err
    measured = shell(*words, "--json")
    assert measured.status == 0
    reason = json.loads(measured.out)["not_certified"]
    assert reason == World.load(file).not_certified
    assert reason in measured.err
    grown = shell(*words, "--confidence", "0.99", "--force")
    assert (grown.status, "not certified" in grown.out) == (0, True)
    world = World.load(file)
    assert world.risk is not None
    assert world.not_certified == reason


@pytest.mark.slow
def test_a_real_laser_log(shell: Shell, shared_data: Path, tmp_path: Path) -> None:
    lines = gzip.decompress((shared_data / "carmen" / "intel-corrected.log.gz").read_bytes()).splitlines()
    log, file = tmp_path / "intel.log.gz", tmp_path / "world.yaml"
    log.write_bytes(gzip.compress(b"\n".join(lines[:600]) + b"\n"))
    found = record(shell, log, "--output", file, "--confidence", "0.9")
    assert found["poses"] == "log"
    assert found["records"]["scans"] > 20
    assert found["obstacles"]["walls"] > 10
    assert found["risk"]["collision_at_most"] == pytest.approx(0.1)
    drifting = shell("map", log, "--output", file, "--poses", "odometry", "--json")
    assert (drifting.status, json.loads(drifting.out)["poses"]) == (0, "odometry")
    matched = record(shell, log, "--output", file, "--poses", "match")
    assert matched["not_certified"] is None
    assert matched["matching"]["nodes"] > 20
    assert shell("plan", file, "--query", "farthest", "--time-limit", "0.3").status == 0


@pytest.mark.slow
def test_trees(terminal: Terminal, shared_data: Path, tmp_path: Path) -> None:
    lines = (shared_data / "victoria" / "victoria_park.txt").read_text().splitlines()
    log, file = tmp_path / "park.txt", tmp_path / "world.yaml"
    log.write_text("\n".join(lines[:1000]) + "\n")
    words = ["map", log, "--output", file, *given(tmp_path, "radius: 0.3"), "--json"]
    run = terminal(sys.executable, "-m", "trailmark.cli", *words)
    assert run.status == 0, run.err
    found = json.loads(run.out)
    assert found["obstacles"]["discs"] == len(World.load(file).obstacles) > 20
    assert found["association"] == "known"
    assert "mapping" in run.err
    assert "of 1,000 records" in run.err
    assert "records" not in run.out.replace('"records"', "")


@pytest.mark.slow
def test_bags(shell: Shell, tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="the extra trailmark[ros] is not installed")
    from tests.helpers.bags import Bag

    bag, angles, file = Bag("sqlite3"), np.linspace(-1.5, 1.5, 121), tmp_path / "world.yaml"
    wall = np.where(angles > 0.3, 2.0 / np.sin(np.maximum(angles, 0.3)), 11.0).tolist()  # 2 m to the robot's left
    moves = [bag.odometry(100.0 + 0.5 * i, (0.3 * i, 0.0, 0.0)) for i in range(1, 13)]
    scans = [bag.scan(t, wall, angle_min=-1.5, angle_increment=0.025) for _, _, t, _ in moves]
    drive = bag.write(tmp_path, [message for pair in zip(moves, scans, strict=True) for message in pair])
    (tmp_path / "eyeless").mkdir()
    blind = bag.write(tmp_path / "eyeless", moves)
    found = record(shell, drive, "--output", file, "--confidence", "0.9")
    assert found["records"] | {"poses": 1} == found["records"] | {"scans": 12}
    assert found["poses"] == "match"
    assert found["obstacles"]["walls"] >= 1
    World.load(file)
    settings = tmp_path / "settings.yaml"
    settings.write_text("log: {scan_topic: /scan, odometry_topic: /odom}")
    words = ["--settings", settings]
    assert record(shell, drive, "--output", file, *words)["records"]["scans"] == 12
    settings.write_text("log: {scan_topic: /scann}")
    run = shell("map", drive, "--output", file, *words)
    assert "got '/scann'" in run.problem
    file.unlink()
    run = shell("map", blind, "--output", file)
    assert run.status == 2
    assert run.problem.startswith(f"{blind}: no topic of type sensor_msgs/LaserScan in the bag; it has: /odom")
    assert not file.exists()


MEASURED, DRIVEN = "Robot1_Measurement.dat", "Robot1_Odometry.dat"
BAD_LINES = [
    (DRIVEN, 5, "0.3 0.2", "expected 3 finite numbers t, v, omega, got 2 columns"),
    (DRIVEN, 5, "0.1 0.2 0.0", "time: expected 0.2 or later, got 0.1"),
    (MEASURED, 3, "1.05 99 2.0 0.4", "barcode: expected one of Barcodes.dat: 5, 25, 63, got 99"),
]


@pytest.mark.parametrize(("name", "line", "text", "problem"), BAD_LINES)
def test_bad_lines(shell: Shell, mrclam: Path, tmp_path: Path, name: str, line: int, text: str, problem: str) -> None:
    lines = (mrclam / name).read_text().splitlines()
    lines[line - 1] = text
    (mrclam / name).write_text("\n".join(lines))
    before = sorted(tmp_path.rglob("*"))
    file = tmp_path / "world.yaml"
    run = shell("map", mrclam, "--output", file, "--plot", tmp_path / "map.png")
    assert (run.status, run.out) == (2, "")
    assert run.problem.startswith(f"{mrclam / name}:{line}: ")
    assert problem in run.problem
    assert sorted(tmp_path.rglob("*")) == before
    run = shell("map", mrclam, "--output", file, "--skip-bad", "--json")
    assert run.status == 0
    assert json.loads(run.out)["dropped"] == 1
    assert run.err == f"trailmark: 1 bad record left out of {mrclam}\n"
    assert len(World.load(file).obstacles) == 2
    assert "1 bad record left out" in shell("map", mrclam, "--output", file, "--skip-bad").out


@pytest.mark.parametrize(
    ("records", "problem"),
    [
        (
            [
                {"type": "odometry", "t": 0, "v": 1e300, "omega": 0},
                {"type": "detection", "t": 1e9, "z": [2, 0.1], "identity": 3},
            ],
            "expected values that a robot can have, got Detection at 1e+09 s, which cannot be used (",
        ),
        (
            [
                {"type": "increment", "t": 0, "dx": 5e7, "dy": 0, "dtheta": 0},
                {"type": "detection", "t": 1, "z": [2, 0.1], "identity": 3},
            ],
            "bounds: ",
        ),
        (
            [
                {"type": "pose", "t": 0, "x": 0, "y": 0, "theta": 0},
                {"type": "scan", "t": 0, "ranges": [2, 2e6], "angle_min": 0, "angle_increment": 0.5, "range_max": 9e9},
            ],
            "expected a grid of 1 to 64,000,000 cells, got [",
        ),
    ],
)
def test_values_that_no_robot_can_have(shell: Shell, tmp_path: Path, records: list[Any], problem: str) -> None:
    log, file = tmp_path / "log.jsonl", tmp_path / "world.yaml"
    log.write_text("\n".join(map(json.dumps, [{"trailmark_log": 1}, *records])))
    run = shell("map", log, "--output", file)
    assert run.status == 2
    assert run.problem.startswith(f"{log}: {problem}")
    assert not file.exists()


@pytest.mark.slow
@pytest.mark.parametrize("ranges", [[2, 2, 2, "inf", None], ["inf", None]])
def test_a_log_of_one_scan(shell: Shell, tmp_path: Path, ranges: list[Any]) -> None:
    log, file = tmp_path / "log.jsonl", tmp_path / "world.yaml"
    scan = {"type": "scan", "t": 0, "ranges": ranges, "angle_min": -1, "angle_increment": 0.5, "range_max": 8}
    log.write_text("\n".join(map(json.dumps, [{"trailmark_log": 1}, scan | {"pose": [1, 1, 0]}])))
    run = shell("map", log, "--output", file, "--plot", tmp_path / "map.png", "--confidence", "0.9", "--json")
    assert (run.status, "met nothing" in run.err) == (0, 2 not in ranges)
    found = json.loads(run.out)
    assert found["obstacles"] == {"all": 1, "discs": 0, "walls": 0, "heaps": 0, "unknown": 1}
    assert World.load(file).queries == ()


@pytest.mark.slow
def test_interruption_while_mapping_leaves_nothing(log: Path) -> None:
    program = f"""
import signal, sys, time
import trailmark.estimation.mapping as module
from trailmark.cli import main
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job would ignore it
def slow(*args, **named):
    print("mapping", flush=True)
    time.sleep(30)
module.map_log = slow
sys.exit(main(["map", {str(log)!r}, "--output", {str(log.parent / "world.yaml")!r}]))
"""
    with subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "mapping\n"
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=120)
    assert process.returncode == 130
    assert err == "trailmark: error: interrupted\n"
    assert list(log.parent.iterdir()) == [log]
