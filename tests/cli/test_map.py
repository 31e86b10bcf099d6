"""trailmark map: logs of all kinds to worlds that can be planned in, figures, pictures, bad logs, interruption."""

from __future__ import annotations

import gzip
import json
import math
import signal
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trailmark.estimation import Detector, RangeBearing, Scanner, Unicycle, regrow, save_log, simulate
from trailmark.shapes import Disc
from trailmark.world import Robot, World

Shell = Callable[..., Any]
Terminal = Callable[..., Any]

POSTS = [(2.0, 2.2), (5.0, 1.0), (9.5, 1.5), (10.5, 5.0), (7.0, 6.5), (3.0, 6.8), (1.0, 5.0), (6.0, 3.8)]
WAY = [[1.0, 1.0], [8.0, 2.6], [9.0, 5.0], [4.5, 5.3], [2.2, 4.0], [1.2, 1.6], [8.0, 2.4]]
START = f"1,1,{math.atan2(1.6, 7.0)}"

ODOMETRY = [f"{0.1 * i:.1f} 0.2 {0.1 * math.sin(0.05 * i):.4f}" for i in range(200)]
MEASUREMENTS = [
    f"{0.5 * i + 0.05:.2f} {(25, 63)[i % 2]} {(2.0, 3.0)[i % 2]:.1f} {(0.4, -0.6)[i % 2]:.1f}" for i in range(6)
]
BARCODES = ["6 25", "7 63", "1 5"]


@cache
def recorded(scanner: bool = False) -> Any:
    world = World("yard", (0.0, 0.0, 12.0, 8.0), tuple(Disc(centre, 0.15) for centre in POSTS))
    detector = None if scanner else Detector(RangeBearing(0.03, 0.01), 7.0)
    eyes = Scanner(beams=121, max_range=9.0, period=2.0) if scanner else None
    return simulate(world, WAY, Unicycle(0.01, 0.002, period=1.0), detector=detector, scanner=eyes, random_state=3).log


@pytest.fixture
def log(tmp_path: Path) -> Path:
    file = tmp_path / "yard.jsonl"
    save_log(recorded(), file)
    return file


@pytest.fixture
def mrclam(tmp_path: Path) -> Path:
    folder = tmp_path / "robots"
    folder.mkdir()
    for name, lines in (
        ("Robot1_Odometry.dat", ["# t v omega", *ODOMETRY]),
        ("Robot1_Measurement.dat", MEASUREMENTS),
        ("Barcodes.dat", BARCODES),
    ):
        (folder / name).write_text("\n".join(lines) + "\n")
    return folder


def record(shell: Shell, *words: object) -> dict[str, Any]:
    run = shell("map", *words, "--json")
    assert (run.status, run.err) == (0, "")
    found = json.loads(run.out)
    assert isinstance(found, dict)
    return found


def test_a_simulated_log_becomes_a_world_to_plan_in(shell: Shell, log: Path, tmp_path: Path) -> None:
    file = tmp_path / "world.yaml"
    run = shell("map", log, "--output", file, "--start", START, "--radius", "0.15", "--robot", "disc:0.25")
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
    planned = shell("plan", file, "--time-limit", "0.5", "--json")
    assert planned.status == 0, planned.err
    assert json.loads(planned.out)["query"] == "driven"
    assert shell("plan", file, "--query", "farthest", "--time-limit", "0.5").status == 0


def test_the_figures(shell: Shell, log: Path, tmp_path: Path) -> None:
    run = shell("map", log, "--output", tmp_path / "world.yaml", "--confidence", "0.99")
    title, *rows = run.out.splitlines()
    assert title == "yard: 8 obstacles"
    facts = {row.split()[0]: " ".join(row.split()[1:]) for row in rows}
    assert f"{len(recorded().records):,} (" in facts["records"]
    assert facts["features"] == "8 confirmed, 0 dropped"
    assert "95 % χ² band" in facts["NIS"]
    assert "ms per update" in facts["time"]
    assert facts["obstacles"] == "8 discs"
    assert facts["risk"] == "a valid path meets an obstacle with probability 0.01 at most"
    assert "radius of 0.1 m" in facts["note"]
    assert facts["written"].endswith("world.yaml")
    plain = shell("map", log, "--output", tmp_path / "plain.yaml", "--radius", "0.2,0.05").out
    assert "none stated" in plain
    assert "note" not in plain


def test_the_json_object(shell: Shell, log: Path, tmp_path: Path) -> None:
    file, picture = tmp_path / "world.yaml", tmp_path / "map.svg"
    found = record(shell, log, "--output", file, "--confidence", "0.95", "--plot", picture)
    assert set(found) == {
        *("log", "name", "records", "dropped", "poses", "association", "features", "nis", "counts", "obstacles"),
        *("bounds", "trajectory", "queries", "risk", "time", "notes", "robot", "written"),
    }
    assert found["records"]["all"] == len(recorded().records)
    assert (found["dropped"], found["poses"], found["association"]) == (0, "slam", "known")
    assert found["features"] == {"confirmed": 8, "tentative": 0, "dropped": 0}
    assert found["nis"]["low"] < found["nis"]["expected"] < found["nis"]["high"]
    assert found["risk"] == pytest.approx({"confidence": 0.95, "collision_at_most": 0.05})
    assert found["obstacles"]["discs"] == 8
    assert found["written"] == {"world": str(file), "plot": str(picture)}
    assert found["queries"] == [query.name for query in World.load(file).queries]
    assert 0.0 < found["time"]["per_update"] < found["time"]["total"]
    assert picture.read_bytes().startswith(b"<?xml")


def test_scans_become_walls(shell: Shell, tmp_path: Path) -> None:
    log, file = tmp_path / "scans.jsonl.gz", tmp_path / "world.yaml"
    save_log(recorded(scanner=True), log)
    found = record(shell, log, "--output", file, "--start", START, "--plot", tmp_path / "map.png")
    assert (found["poses"], found["association"], found["nis"]) == ("odometry", None, None)
    assert found["obstacles"]["walls"] >= 4
    assert any("drift" in note for note in found["notes"])
    assert len(World.load(file).obstacles) == found["obstacles"]["all"]
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    free = record(shell, log, "--output", file, "--unknown", "free", "--cell", "0.1", "--scan-range", "5")
    assert free["obstacles"]["unknown"] == 0


def test_settings_change_the_map(shell: Shell, log: Path, tmp_path: Path) -> None:
    def areas(*words: str) -> float:
        record(shell, log, "--output", tmp_path / "world.yaml", "--confidence", "0.99", *words)
        return sum(shape.area for shape in World.load(tmp_path / "world.yaml").obstacles)

    plain = areas()
    assert areas("--sensor-noise", "0.3,0.1") > 1.2 * plain
    assert areas("--odometry-noise", "0.1,0.1") > 1.05 * plain
    assert areas("--robot-noise", "0.2,0") > 1.2 * plain
    assert areas("--radius", "0.1,0.05") > 1.2 * plain
    assert areas("--association", "nearest", "--confirm", "3") > 0.0
    assert areas("--outlier-gate", "none") > 0.0


def test_mrclam_folders_in_all_their_names(shell: Shell, mrclam: Path, tmp_path: Path) -> None:
    file = tmp_path / "world.yaml"
    worlds = []
    for words in (
        [mrclam],
        [f"{mrclam}:1"],
        [mrclam, "--mrclam-robot", "1"],
        [mrclam / "Robot1_Odometry.dat"],
        [mrclam, "--format", "mrclam"],
    ):
        assert record(shell, *words, "--output", file)["name"] == "robots-robot1"
        worlds.append(file.read_text())
    assert len(set(worlds)) == 1


def test_real_robots(shell: Shell, shared_data: Path, tmp_path: Path) -> None:
    folder, file = tmp_path / "cut", tmp_path / "world.yaml"
    folder.mkdir()
    for name in ("Robot3_Odometry.dat", "Robot3_Measurement.dat", "Barcodes.dat"):
        lines = (shared_data / "mrclam6" / name).read_text().splitlines()
        begin = next(float(line.split()[0]) for line in lines if not line.startswith("#"))
        early = [x for x in lines if name == "Barcodes.dat" or x.startswith("#") or float(x.split()[0]) < begin + 120.0]
        (folder / name).write_text("\n".join(early) + "\n")
    run = shell("map", folder, "--output", file, "--plot", tmp_path / "map.png", "--skip-bad")
    assert run.status == 0
    assert "EKF-SLAM, association known" in run.out
    assert len(World.load(file).obstacles) >= 5
    assert shell("plan", file, "--time-limit", "0.5").status == 0


def test_a_real_laser_log(shell: Shell, shared_data: Path, tmp_path: Path) -> None:
    lines = gzip.decompress((shared_data / "carmen" / "intel-corrected.log.gz").read_bytes()).splitlines()
    log, file = tmp_path / "intel.log.gz", tmp_path / "world.yaml"
    log.write_bytes(gzip.compress(b"\n".join(lines[:1500]) + b"\n"))
    found = record(shell, log, "--output", file, "--confidence", "0.9")
    assert found["poses"] == "log"
    assert found["records"]["scans"] > 50
    assert found["obstacles"]["walls"] > 20
    assert found["risk"]["collision_at_most"] == pytest.approx(0.1)
    raw = record(shell, log, "--output", file, "--poses", "odometry")
    assert raw["poses"] == "odometry"
    assert shell("plan", file, "--query", "farthest", "--time-limit", "1").status == 0


def test_trees(terminal: Terminal, shared_data: Path, tmp_path: Path) -> None:
    lines = (shared_data / "victoria" / "victoria_park.txt").read_text().splitlines()
    log, file = tmp_path / "park.txt", tmp_path / "world.yaml"
    log.write_text("\n".join(lines[:3000]) + "\n")
    words = ["map", log, "--output", file, "--radius", "0.3", "--json"]
    run = terminal(sys.executable, "-m", "trailmark.cli", *words)
    assert run.status == 0, run.err
    found = json.loads(run.out)
    assert found["obstacles"]["discs"] == len(World.load(file).obstacles) > 20
    assert found["association"] == "known"
    assert "mapping" in run.err
    assert "of 3,000 records" in run.err
    assert " %" in run.err
    assert "records" not in run.out.replace('"records"', "")


MEASURED, DRIVEN = "Robot1_Measurement.dat", "Robot1_Odometry.dat"
BAD_LINES = [
    (DRIVEN, 5, "0.3 0.2", "2 columns given, allowed: 3 finite numbers"),
    (DRIVEN, 5, "0.3 0.2 0.0 1.0", "4 columns given"),
    (DRIVEN, 5, "0.3 nan 0.0", "'0.3 nan 0.0' given, allowed: 3 finite numbers"),
    (DRIVEN, 5, "0.3 inf 0.0", "given, allowed: 3 finite numbers"),
    (DRIVEN, 5, "0.3 zwei 0.0", "given, allowed: 3 finite numbers"),
    (DRIVEN, 5, "0.1 0.2 0.0", "time 0.1 given after 0.2"),
    (MEASURED, 3, "1.05 99 2.0 0.4", "unknown barcode 99 given, allowed: those of Barcodes.dat: 5, 25, 63"),
    (MEASURED, 3, "1.05 25 -2.0 0.4", "range -2 given"),
    (MEASURED, 3, "0.02 25 2.0 0.4", "time 0.02 given after 0.55"),
    (MEASURED, 6, "2.55 63 3", "3 columns given"),
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
    run = shell("map", mrclam, "--output", file, "--skip-bad")
    assert "1 bad record left out" in run.out
    assert len(World.load(file).obstacles) == 2


def test_bad_lines_of_other_formats(shell: Shell, log: Path, tmp_path: Path) -> None:
    lines = log.read_text().splitlines()
    file = tmp_path / "world.yaml"
    for cut, line in (("\n".join([*lines[:50], lines[50][:20]]), 51), ("\n".join([*lines[:5], "x", *lines[5:]]), 6)):
        log.write_text(cut)
        run = shell("map", log, "--output", file)
        assert run.status == 2
        assert run.problem.startswith(f"{log}:{line}: ")
    assert not file.exists()
    good = lines[1:]
    log.write_text("\n".join([lines[0], *good[:40], "{}", *good[40:], '{"type": "odometry", "t": NaN}']))
    found = json.loads(shell("map", log, "--output", file, "--skip-bad", "--json").out)
    assert found["dropped"] == 2
    assert found["records"]["all"] == len(recorded().records)


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (b"", "an empty log"),
        (b"\n\n", "an empty log"),
        (b"hello\n", "no log of a known format"),
        (b'{"trailmark_log": 1}\n', "no records given"),
        (b'{"trailmark_log": 1}\n{"type": "odometry", "t": 0, "v": 1, "omega": 0}\n', "neither scans nor detections"),
        (b'{"trailmark_log": 1}\n{"type": "detection", "t": 0, "z": [1, 0]}\n', "neither odometry nor poses given"),
    ],
)
def test_logs_that_show_nothing(shell: Shell, tmp_path: Path, content: bytes, problem: str) -> None:
    log, file = tmp_path / "log.txt", tmp_path / "world.yaml"
    log.write_bytes(content)
    for more in ([], ["--skip-bad"]):
        run = shell("map", log, "--output", file, *more)
        assert run.status == 2
        assert run.problem.startswith(f"{log}: ")
        assert problem in run.problem
    assert not file.exists()


@pytest.mark.parametrize(
    ("records", "problem"),
    [
        (
            [
                {"type": "odometry", "t": 0, "v": 1e300, "omega": 0},
                {"type": "detection", "t": 1e9, "z": [2, 0.1], "identity": 3},
            ],
            "Detection at 1e+09 s cannot be used (",
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
            "grid over [",
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


@pytest.mark.parametrize("ranges", [[2, 2, 2, "inf", None], ["inf", None]])
def test_a_log_of_one_scan(shell: Shell, tmp_path: Path, ranges: list[Any]) -> None:
    log, file = tmp_path / "log.jsonl", tmp_path / "world.yaml"
    scan = {"type": "scan", "t": 0, "ranges": ranges, "angle_min": -1, "angle_increment": 0.5, "range_max": 8}
    log.write_text("\n".join(map(json.dumps, [{"trailmark_log": 1}, scan | {"pose": [1, 1, 0]}])))
    found = record(shell, log, "--output", file, "--plot", tmp_path / "map.png", "--confidence", "0.9")
    assert found["obstacles"] == {"all": 1, "discs": 0, "walls": 0, "heaps": 0, "unknown": 1}
    assert World.load(file).queries == ()


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["--confidence", "1"], "--confidence '1' given, allowed: a probability above 0 and below 1"),
        (["--confidence", "nan"], "--confidence 'nan' given"),
        (["--confidence", "high"], "--confidence 'high' given"),
        (["--robot", "disc"], "robot 'disc' given, allowed: disc:RADIUS"),
        (["--format", "carmn"], "yard.jsonl: format 'carmn' given, did you mean 'carmen'"),
        (["--format", "victoria"], "yard.jsonl:1: line "),
        (["--radius", "0"], "--radius '0' given, allowed: R or R,SIGMA"),
        (["--radius", "0.1,0.2,0.3"], "--radius '0.1,0.2,0.3' given"),
        (["--association", "nearst"], "association 'nearst' given, did you mean 'nearest'"),
        (["--poses", "odometry"], "yard.jsonl: poses 'odometry' given for detections"),
        (["--obstacles", "scans"], "yard.jsonl: no scans given"),
        (["--start", "1,2"], "--start '1,2' given, allowed: X,Y,T"),
        (["--sensor-noise", "0,0.1"], "--sensor-noise '0,0.1' given, allowed: A,B, two numbers above 0"),
        (["--odometry-noise", "0.1"], "--odometry-noise '0.1' given, allowed: A,B, two numbers of 0 or more"),
        (["--robot-noise", "0.1,0.1"], "--robot-noise '0.1,0.1' given without --confidence"),
        (["--confirm", "0"], "--confirm '0' given, allowed: an integer from 1"),
        (
            ["--outlier-gate", "2"],
            "--outlier-gate '2' given, allowed: a probability above 0 and below 1 (or none, auto)",
        ),
        (["--unknown", "maybe"], "unknown 'maybe' given, allowed: blocked, free"),
        (["--cell", "0"], "--cell '0' given, allowed: a finite number of metres above 0"),
        (["--mrclam-robot", "x"], "--mrclam-robot 'x' given"),
        (["--plot", "map.gif"], "map.gif: suffix '.gif' given"),
    ],
)
def test_bad_options(shell: Shell, log: Path, tmp_path: Path, words: list[str], problem: str) -> None:
    run = shell("map", log, "--output", tmp_path / "world.yaml", *words)
    assert run.status == 2
    assert run.problem.removeprefix(f"{tmp_path}/").startswith(problem)
    assert not (tmp_path / "world.yaml").exists()


def test_the_output_is_checked_before_the_work(shell: Shell, tmp_path: Path) -> None:
    log = tmp_path / "missing.jsonl"
    assert "--output" in shell("map", log).problem
    assert "does not exist" in shell("map", log, "--output", tmp_path / "no" / "world.yaml").problem
    assert "suffix '.json' given" in shell("map", log, "--output", tmp_path / "world.json").problem
    assert shell("map", log, "--output", tmp_path / "world.yaml").problem.startswith(f"{log}: cannot be read")
    assert shell("map", tmp_path, "--output", tmp_path / "w.yaml").problem.startswith(
        f"{tmp_path}: a folder that holds"
    )


def test_a_robot_that_is_not_there(shell: Shell, mrclam: Path, tmp_path: Path) -> None:
    run = shell("map", mrclam, "--output", tmp_path / "world.yaml", "--mrclam-robot", "4")
    assert (run.status, run.problem[:60]) == (2, f"{mrclam}: robot 4 given, allowed: 1"[:60])


def test_bags(shell: Shell, tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="the extra trailmark[ros] is not installed")
    write_bag(tmp_path / "drive", scans=True)
    write_bag(tmp_path / "blind", scans=False)
    file = tmp_path / "world.yaml"
    found = record(shell, tmp_path / "drive", "--output", file, "--confidence", "0.9")
    assert found["records"] | {"poses": 1} == found["records"] | {"scans": 12}
    assert found["poses"] == "odometry"
    assert found["obstacles"]["walls"] >= 1
    World.load(file)
    words = ["--scan-topic", "/scan", "--odometry-topic", "/odom"]
    assert record(shell, tmp_path / "drive", "--output", file, *words)["records"]["scans"] == 12
    run = shell("map", tmp_path / "drive", "--output", file, "--scan-topic", "/scann")
    assert "scan topic '/scann' given, did you mean '/scan'" in run.problem
    file.unlink()
    run = shell("map", tmp_path / "blind", "--output", file)
    assert run.status == 2
    assert run.problem.startswith(
        f"{tmp_path / 'blind'}: no topic of type sensor_msgs/LaserScan in the bag; it has: /odom"
    )
    assert not file.exists()


def write_bag(path: Path, scans: bool) -> None:
    """Write a ROS 2 bag of a robot that drives along a wall 2 m to its left."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)

    def make(name: str, **fields: Any) -> Any:
        return store.types[name](**fields)

    def header(t: float, frame: str) -> Any:
        stamp = make("builtin_interfaces/msg/Time", sec=int(t), nanosec=round((t - int(t)) * 1e9))
        return make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def odometry(t: float, x: float) -> Any:
        zero = make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        point = make("geometry_msgs/msg/Point", x=x, y=0.0, z=0.0)
        ahead = make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
        pose = make("geometry_msgs/msg/Pose", position=point, orientation=ahead)
        twist = make("geometry_msgs/msg/Twist", linear=zero, angular=zero)
        return make(
            "nav_msgs/msg/Odometry",
            header=header(t, "odom"),
            child_frame_id="base_link",
            pose=make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36)),
            twist=make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
        )

    def scan(t: float) -> Any:
        angles = np.linspace(-1.5, 1.5, 121)
        ranges = np.where(angles > 0.3, 2.0 / np.sin(np.maximum(angles, 0.3)), 11.0)
        return make(
            "sensor_msgs/msg/LaserScan",
            header=header(t, "base_link"),
            ranges=ranges.astype(np.float32),
            intensities=np.zeros(0, dtype=np.float32),
            angle_min=-1.5,
            angle_max=1.5,
            angle_increment=0.025,
            time_increment=0.0,
            scan_time=0.1,
            range_min=0.1,
            range_max=10.0,
        )

    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        odom = writer.add_connection("/odom", "nav_msgs/msg/Odometry", typestore=store)
        laser = writer.add_connection("/scan", "sensor_msgs/msg/LaserScan", typestore=store) if scans else None
        for i in range(1, 13):
            t, x = 100.0 + 0.5 * i, 0.3 * i
            nanoseconds = round(1e9 * t)
            writer.write(odom, nanoseconds, store.serialize_cdr(odometry(t, x), "nav_msgs/msg/Odometry"))
            if laser is not None:
                writer.write(laser, nanoseconds, store.serialize_cdr(scan(t), "sensor_msgs/msg/LaserScan"))


def test_interruption_while_mapping_leaves_nothing(log: Path) -> None:
    program = f"""
import signal, sys, time
import trailmark.estimation.world_from_log as module
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
        assert process.stdout is not None
        assert process.stdout.readline() == "mapping\n"
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=20)
    assert process.returncode == 130
    assert err == "trailmark: error: interrupted\n"
    assert list(log.parent.iterdir()) == [log]


def test_interruption_while_writing_leaves_the_old_world(
    shell: Shell, log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "world.yaml"
    file.write_text("old")

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("os.fsync", interrupt)
    run = shell("map", log, "--output", file)
    assert (run.status, run.problem) == (130, "interrupted")
    assert file.read_text() == "old"
    assert sorted(tmp_path.iterdir()) == sorted([log, file])
