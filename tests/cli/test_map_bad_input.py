"""trailmark map: bad logs, bad options, and interruption leave one line and no file."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.cli.logs import recorded, write_mrclam

from trailmark.estimation import save_log
from trailmark.world import World

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


def record(shell: Shell, *words: object) -> dict[str, Any]:
    run = shell("map", *words, "--json")
    assert (run.status, run.err) == (0, "")
    found = json.loads(run.out)
    assert isinstance(found, dict)
    return found


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


def test_the_summary_tells_of_bad_lines(shell: Shell, mrclam: Path, tmp_path: Path) -> None:
    name, line, text, _ = BAD_LINES[0]
    lines = (mrclam / name).read_text().splitlines()
    lines[line - 1] = text
    (mrclam / name).write_text("\n".join(lines))
    run = shell("map", mrclam, "--output", tmp_path / "world.yaml", "--skip-bad")
    assert "1 bad record left out" in run.out


@pytest.mark.slow
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
        (b'{"trailmark_log": 1}\n', "expected a log of one record or more, got none"),
        (b'{"trailmark_log": 1}\n{"type": "odometry", "t": 0, "v": 1, "omega": 0}\n', "neither scans nor detections"),
        (b'{"trailmark_log": 1}\n{"type": "detection", "t": 0, "z": [1, 0]}\n', "got neither odometry nor poses"),
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


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["--confidence", "1"], "--confidence: expected a probability above 0 and below 1, got '1'"),
        (["--confidence", "high"], "--confidence: expected a probability above 0 and below 1, got 'high'"),
        (["--robot", "disc"], "--robot: expected disc:RADIUS, "),
        (
            ["--format", "carmn"],
            "yard.jsonl: format: expected carmen, g2o, jsonl, mrclam, rosbag, victoria, got 'carmn'",
        ),
        (["--format", "victoria"], "yard.jsonl:1: expected a line with ODOMETRY"),
        (
            ["--poses", "odometry"],
            "yard.jsonl: poses: expected what the log holds for detections (slam)",
        ),
        (["--start", "1,2"], "--start: expected X,Y,T, finite numbers"),
        (["--plot", "map.gif"], "--plot: map.gif: suffix: expected .pdf, .png, .svg, got '.gif'"),
    ],
)
def test_bad_options(shell: Shell, log: Path, tmp_path: Path, words: list[str], problem: str) -> None:
    log.write_text("".join(log.read_text().splitlines(keepends=True)[:30]))  # which is enough to tell what it is
    run = shell("map", log, "--output", tmp_path / "world.yaml", *words)
    assert run.status == 2
    assert run.problem.removeprefix(f"{tmp_path}/").startswith(problem)
    assert not (tmp_path / "world.yaml").exists()


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("radius", "expected lines 'name: value', got str"),
        ("radius: [", "expected YAML, got while parsing"),
        ("raduis: 1", "setting raduis: expected "),
        ("slam: {gates: 1}", "setting slam.gates: expected association, "),
        ("log: {robot: 1}", "setting log.robot: expected "),
        ("mapping: {scan: 3}", "mapping.scan: expected lines 'name: value', got int"),
        ("radius: 0", "MapSettings: radius: expected a finite number above 0, got 0"),
        ("slam: {association: nearest}", "SlamSettings: association: expected auto, joint, known, got 'nearest'"),
        ("range_bearing: {sigma_range: 0}", "RangeBearing: sigma_range: expected a finite number above 0, got 0"),
        ("mapping: {unknown: maybe}", "MappingSettings: unknown: expected blocked, free, got 'maybe'"),
        ("log: {scan_topic: [1]}", "load_log: scan_topic: expected "),
    ],
)
def test_bad_settings(shell: Shell, log: Path, tmp_path: Path, text: str, problem: str) -> None:
    file = tmp_path / "settings.yaml"
    file.write_text(text)
    run = shell("map", log, "--output", tmp_path / "world.yaml", "--settings", file)
    assert run.status == 2
    assert run.problem.removeprefix(f"{file}: ").startswith(problem)
    assert not (tmp_path / "world.yaml").exists()


def test_settings_are_an_input_and_errors_of_the_robot_need_a_confidence(
    shell: Shell, log: Path, tmp_path: Path
) -> None:
    file = tmp_path / "settings.yaml"
    file.write_text("robot_sigma: [0.1, 0.1]")
    run = shell("map", log, "--output", tmp_path / "world.yaml", "--settings", file)
    assert (run.status, run.problem[:20]) == (2, "settings: robot_sigma"[:20])
    assert shell("map", log, "--output", file, "--settings", file).status == 2
    assert shell("map", log, "--output", tmp_path / "w.yaml", "--settings", tmp_path / "no.yaml").status == 2
    assert file.read_text() == "robot_sigma: [0.1, 0.1]"


def test_the_output_is_checked_before_the_work(shell: Shell, tmp_path: Path) -> None:
    log = tmp_path / "missing.jsonl"
    assert "--output" in shell("map", log).problem
    assert "does not exist" in shell("map", log, "--output", tmp_path / "no" / "world.yaml").problem
    assert "suffix: expected .yaml, .yml, got '.json'" in shell("map", log, "--output", tmp_path / "world.json").problem
    assert shell("map", log, "--output", tmp_path / "world.yaml").problem.startswith(f"{log}: cannot be read")
    assert shell("map", tmp_path, "--output", tmp_path / "w.yaml").problem.startswith(
        f"{tmp_path}: a folder that holds"
    )


def test_a_robot_that_is_not_there(shell: Shell, mrclam: Path, tmp_path: Path) -> None:
    run = shell("map", f"{mrclam}:4", "--output", tmp_path / "world.yaml")
    assert (run.status, run.problem[:60]) == (2, f"{mrclam}: robot: expected 1, got 4"[:60])


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
        assert process.stdout is not None
        assert process.stdout.readline() == "mapping\n"
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=120)
    assert process.returncode == 130
    assert err == "trailmark: error: interrupted\n"
    assert list(log.parent.iterdir()) == [log]


@pytest.mark.slow
def test_interruption_while_writing_leaves_the_old_world(
    shell: Shell, log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "world.yaml"
    World("old", (0.0, 0.0, 1.0, 1.0)).save(file)
    old = file.read_bytes()

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("os.fsync", interrupt)
    run = shell("map", log, "--output", file)
    assert (run.status, run.problem) == (130, "interrupted")
    assert file.read_bytes() == old
    assert sorted(tmp_path.iterdir()) == sorted([log, file])
