"""Bad input of every command: status 2, one line on stderr that says what is wrong, and no file written."""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st
from tests.helpers.logs import write_mrclam

from trailmark import TrailmarkError, plotting
from trailmark.cli import options
from trailmark.cli.options import Kind
from trailmark.formats import path_files

Shell = Callable[..., Any]

MAP_SETTINGS = [
    ("radius", "map0.yaml: expected lines 'name: value', got str"),
    ("radius: [", "map1.yaml:2: not valid YAML"),
    ("raduis: 1", "map2.yaml: setting raduis: expected "),
    ("slam: {gates: 1}", "setting slam.gates: expected association, "),
    ("log: {robot: 1}", "setting log.robot: expected "),
    ("mapping: {scan: 3}", "mapping.scan: expected lines 'name: value', got int"),
    ("radius: 0", "MapSettings: radius: expected a finite number above 0, got 0"),
    ("slam: {association: nearst}", "SlamSettings: association: expected auto, joint, known, got 'nearst'"),
    ("mapping: {unknown: maybe}", "MappingSettings: unknown: expected blocked, free, got 'maybe'"),
    ("log: {scan_topic: [1]}", "load_log: scan_topic: expected "),
]
"""Bad settings of ``map``, and what is said of them."""

BARE = "trailmark: 1\nname: bare\nbounds: [0, 0, 4, 4]\n"
CASES = {
    "": [
        ("", "expected a command: plan, check, "),
        ("paln", "command: expected benchmark, check, "),
        ("paln", "did you mean 'plan'"),
        ("--verison", "--verison"),
        ("worlds shw", "worlds: expected convert, schema, show, got 'shw'"),
    ],
    "plan": [
        ("", "Missing argument 'WORLD' (see 'trailmark plan --help')"),
        ("yard.yaml --frobnicate", "(see 'trailmark plan --help')"),
        ("yard.yaml more", "(see 'trailmark plan --help')"),
        ("none.yaml", "none.yaml"),
        ("ofice", "did you mean 'office'"),
        ("broken.yaml", "broken.yaml"),
        ("bare.yaml", "--robot"),
        ("none.yaml --output none/path.json", "path.json"),
        ("yard.yaml --time-limit 0", "--time-limit: expected a finite number of seconds above 0, got '0'"),
        ("yard.yaml --seed 1.5", "--seed: expected an integer from 0 to 4294967295, got '1.5'"),
        ("yard.yaml --landmarks 200001", "--landmarks: expected an integer from 1 to 200000, got '200001'"),
        ("yard.yaml --query bakc", "did you mean 'back'"),
        ("yard.yaml --start 1,2,3", "both or neither"),
        ("yard.yaml --start 1,2 --goal 1,2,3", "--start: expected X,Y,T, finite numbers"),
        ("yard.yaml --start 1,2,90degrees --goal 1,2,3", "degrees such as 90deg"),
        ("yard.yaml --start 1,2,3 --goal 1,inf", "--goal: expected X,Y or X,Y,T, finite numbers"),
        ("yard.yaml --start 1,2,3 --goal 1,2,3 --query back", "expected --query or --start and --goal,"),
        ("yard.yaml --start 1,1,0 --goal 2,2 --goal-tolerance 0.1,0.2", "expected a goal X,Y,T"),
        ("yard.yaml --goal-tolerance -0.1", "0 or more"),
        ("yard.yaml --goal-tolerance 0.1,x", "METRES,RADIANS"),
        ("yard.yaml --start -3,1,0 --goal 1,1,0", "out of bounds by 3 m"),
        ("yard.yaml --robot square:1", "disc:RADIUS, rectangle:LENGTHxWIDTH, polygon:x,y;x,y;x,y or [["),
        ("yard.yaml --robot none.yaml", "none.yaml: cannot be read"),
        ("yard.yaml --robot bare.yaml", "bare.yaml: no robot"),
        ("yard.yaml --clearance wide", "metres, from 0"),
        ("yard.yaml --relax", "--clearance"),
        ("yard.yaml --drive tracks", "expected car, differential, omnidirectional"),
        ("yard.yaml --drive car", "turning radius"),
        ("yard.yaml --turning-radius inf", "--turning-radius: expected a number above 0 and at most 10000"),
        ("yard.yaml --forward-only", "expected --turning-radius too"),
        ("yard.yaml --objective shortest", "'shortest'"),
        ("yard.yaml --objective length=x", "expected a number"),
        ("yard.yaml --objective length=1,reverse=0.5", "reverse: expected"),
        ("yard.yaml --output path.xml", "--output: path.xml: suffix: expected .csv, .geojson, .json, .nav2.json"),
        ("yard.yaml --plot nowhere/path.png", "nowhere"),
        ("yard.yaml --limits 1", "expected --timed, --animate or --objective time too"),
        ("yard.yaml --trajectory a.csv --limits 1,0", "--limits: expected up to four numbers from 1e-06 to 1e+06"),
        ("yard.yaml --trajectory a.csv --output a.csv", "two outputs name the file 'a.csv'"),
        ("yard.yaml --animate a.mp4", "suffix"),
        ("yard.yaml --step 0.1", "expected --output too"),
        ("yard.yaml --output a.csv --step 1e-12", "(1,000,000 states at most), got 1e-12"),
        ("yard.yaml --settings none.yaml", "none.yaml: cannot be read"),
        ("yard.yaml --settings empty.txt", "expected lines 'name: value', got NoneType"),
        ("yard.yaml --settings frame.yaml", "frame_id: expected a name without blanks"),
        ("yard.yaml --settings gap.yaml", "gap: expected"),
        ("yard.yaml --settings step.yaml", "step: expected a finite number of metres above 0, got '0'"),
        ("yard.yaml --settings limits.yaml", "limits: expected up to four numbers from 1e-06 to 1e+06"),
        ("yard.yaml --settings patient.yaml", "setting patient: expected build_share, drives, "),
        ("yard.yaml --settings patience.yaml", "patience.yaml: "),
        ("yard.yaml --settings frame.yaml --output frame.yaml", "is the same file as the input"),
    ],
    "check": [
        ("yard.yaml", "Missing argument 'PATH'"),
        ("yard.yaml none.csv", "none.csv"),
        ("none.yaml path.csv", "none.yaml"),
        ("yard.yaml empty.txt", "empty path"),
        ("yard.yaml two.txt", "two.txt: expected headings, for the robot"),
        ("yard.yaml far.txt", "at most 1e+07 m, got 1e+20"),
        ("yard.yaml curve.json", "expected dubins or reeds-shepp"),
        ("yard.yaml path.csv --repair path.csv", "path.csv"),
        ("yard.yaml path.csv --repair yard.yaml", "yard.yaml"),
        ("yard.yaml path.csv --plot a.gif", ".png"),
        ("yard.yaml path.csv --time-limit soon", "--time-limit: expected"),
    ],
    "roadmap": [
        ("yard.yaml", "Missing option '--output'"),
        ("yard.yaml --output a.json", "expected .geojson, .graphml, .npz, got '.json'"),
        ("yard.yaml --output none/a.npz", "'none' does not exist"),
        ("yard.yaml --output a.npz -k 0", "-k: expected an integer from 1 to 200000, got '0'"),
        ("yard.yaml --output a.npz --frame-id 'my map'", "name without blanks"),
        ("yard.yaml --output a.npz --robot disc:9", "no free place for the robot was found"),
    ],
    "landmarks": [
        ("yard.yaml -k many", "-k: expected an integer from 1 to 20000, got 'many'"),
        ("yard.yaml -k 300 -n 200", "k: expected 1 to "),
        ("yard.yaml --method papper", "expected paper, se2"),
        ("yard.yaml --init random", "expected forgy, k-means++, random-partition"),
        ("yard.yaml --init k-means++ --method se2", "expected forgy"),
        ("yard.yaml --grow-boxes --method se2", "which has no boxes"),
        ("yard.yaml --sensor-range inf", "metres above 0"),
        ("yard.yaml -k 3 --robot disc:9", "empty free space: no place for the robot was found"),
        ("yard.yaml -k 3 --robot disc:9 --method se2", "empty free space: 0 of 1000 samples"),
    ],
    "explore": [
        ("--output run", "WORLD is missing"),
        ("yard.yaml", "--output is missing"),
        ("yard.yaml --output ''", "expected a folder's name"),
        ("yard.yaml --output yard.yaml", "expected a folder, got a file"),
        ("yard.yaml --output no/run", "the directory 'no' does not exist"),
        ("yard.yaml --output run --sensor radar", "--sensor: expected detections, laser"),
        ("yard.yaml --output run --sensor-range 0", "metres above 0"),
        ("yard.yaml --output run --cell 0", "metres above 0"),
        ("yard.yaml --output run --strategy tours", "did you mean 'tour'"),
        ("yard.yaml --output run --confidence 1", "--confidence: expected a probability above 0 and below 1, got '1'"),
        ("yard.yaml --output run --noise -1", "0 or more"),
        ("bare.yaml --output run --robot disc:0.2", "expected --start X,Y,T"),
        ("--resume run", "a folder that trailmark explore wrote"),
        ("--resume a --output b", "expected --output or --resume, got both"),
        ("--resume a --seed 1", "--seed '1' given with --resume"),
    ],
    "map": [
        ("drive.jsonl", "Missing option '--output'"),
        ("drive.jsonl --output no/w.yaml", "'no' does not exist"),
        ("drive.jsonl --output w.json", "suffix: expected .yaml, .yml, got '.json'"),
        ("none.jsonl --output w.yaml", "none.jsonl: cannot be read"),
        (". --output w.yaml", ".: a folder that holds"),
        ("robots:4 --output w.yaml", "robots: robot: expected 1 (with a file RobotN_Odometry.dat), got 4"),
        ("drive.jsonl --output w.yaml --confidence 1", "a probability above 0 and below 1, got '1'"),
        ("drive.jsonl --output w.yaml --robot disc", "--robot: expected disc:RADIUS, "),
        ("drive.jsonl --output w.yaml --format carmn", "expected carmen, g2o, jsonl, mrclam, rosbag, victoria"),
        ("drive.jsonl --output w.yaml --format victoria", "drive.jsonl:1: expected a line with ODOMETRY"),
        ("drive.jsonl --output w.yaml --poses odometry", "expected what the log holds for detections (none)"),
        ("drive.jsonl --output w.yaml --start 1,2", "--start: expected X,Y,T, finite numbers"),
        ("drive.jsonl --output w.yaml --plot a.gif", "--plot: a.gif: suffix: expected .pdf, .png, .svg"),
        ("drive.jsonl --output w.yaml --settings no.yaml", "no.yaml: cannot be read"),
        ("drive.jsonl --output w.yaml --settings robot.yaml", "settings: robot_sigma given without --confidence"),
        ("drive.jsonl --output robot.yaml --settings robot.yaml", "is the same file as the input"),
        *((f"drive.jsonl --output w.yaml --settings map{i}.yaml", said) for i, (_, said) in enumerate(MAP_SETTINGS)),
    ],
    "live": [("yard.yaml --port 99999", "--port"), ("yard.yaml --token x", "8 to 200"), ("none.yaml --port 0", "none")],
    "benchmark": [
        ("yard.yaml -p PRM", "--output is missing"),
        ("yard.yaml -p PMR --output r.db", "planner: expected"),
        ("yard.yaml --output r.db", "no planner given; expected landmark, "),
        ("-p PRM --output r.db", "no world given; expected files, or bugtrap, "),
        ("yard.yaml -p PRM --output r.db --query acros", "did you mean 'across'"),
        ("yard.yaml -p PRM --output r.db --runs 0", "--runs: expected an integer from 1 to 1000000, got '0'"),
        ("yard.yaml -p PRM --output r.db --memory-limit x", "--memory-limit: expected an integer from 1"),
        ("yard.yaml -p PRM --output r.db --resolution 0", "a finite number of metres above 0"),
        ("yard.yaml -p PRM --output r.db --clearance -1", "--clearance: expected metres, from 0 to 1e7, got '-1'"),
        ("yard.yaml -p PRM --output r.db --workers 2 --scheduler a", "expected --workers or --scheduler"),
        ("yard.yaml -p PRM --output r.db --scheduler nowhere", "scheduler 'nowhere' does not answer"),
        ("-p PRM --output r.db --suite nowhere.yaml", "nowhere.yaml: cannot be read"),
        ("-p PRM --output r.db --suite brn", "--suite: expected barn, bench-mr"),
        ("-p PRM --output r.db --suite barn", "--data is missing; expected a folder with BARN's"),
        ("-p PRM --output r.db --suite barn --data .", "expected BARN's .world files"),
        ("-p PRM --output r.db --suite clutter --data .", "expected no --data"),
        ("-p PRM --output r.db --data .", "expected --suite"),
        ("-p PRM --output r.db --suite passages --query x", "expected a query of suite passages, got x"),
    ],
    "report": [
        ("", "Missing argument 'RESULTS.db'"),
        ("none.db --html r.html", "none.db"),
        ("yard.yaml --html r.html", "yard.yaml"),
        ("yard.yaml --html r.pdf", "expected .htm, .html, got '.pdf'"),
    ],
    "worlds": [
        ("show", "(see 'trailmark worlds show --help')"),
        ("show yard.yaml --plot a.bmp", ".png"),
        ("show yard.yaml --robot disc", "disc:RADIUS"),
        ("convert yard.yaml", "OUT"),
        ("convert yard.yaml a.json", "OUT: a.json: suffix: expected .yaml, .yml"),
        ("convert yard.yaml yard.yaml", "yard.yaml"),
        ("convert missing.map a.yaml", "missing.map"),
        ("convert yard.yaml a.yaml --keepout bare.yaml", "bare.yaml"),
    ],
}
FILES = {
    "bare.yaml": BARE,
    "broken.yaml": "trailmark: 1\nbounds: [0, 0, 1, .nan]\n",
    "path.csv": "1,1,0\n2,1,0\n",
    "empty.txt": "",
    "two.txt": "1 1\n2 1\n",
    "far.txt": "1 1 0\n1e20 1 0\n",
    "curve.json": '{"states": [[1, 1, 0], [2, 1, 0]], "curve": {"kind": "spline"}}',
    "frame.yaml": "frame_id: my map",
    "gap.yaml": "gap: -1",
    "step.yaml": "step: 0",
    "limits.yaml": "limits: [1, 2]",
    "patient.yaml": "patient: 3",
    "patience.yaml": "patience: 0",
    "robot.yaml": "robot_sigma: [0.1, 0.1]",
    "drive.jsonl": '{"trailmark_log": 1}\n{"type": "detection", "t": 0, "z": [1, 0]}\n',
    **{f"map{i}.yaml": text for i, (text, _) in enumerate(MAP_SETTINGS)},
}


@pytest.fixture
def folder(yard: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make a folder with a world and some bad files, and go there."""
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    write_mrclam(tmp_path / "robots")
    return tmp_path


@pytest.mark.parametrize("command", CASES)
def test_bad_input_is_one_line_with_status_2_and_changes_no_file(
    shell: Shell, folder: Path, planner: Any, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    if command == "roadmap":
        monkeypatch.undo()
        monkeypatch.chdir(folder)
    monkeypatch.setattr("trailmark.benchmark.workers.ANSWER_LIMIT", 0.2)
    before = contents(folder)
    for words, problem in CASES[command]:
        run = shell(*command.split(), *shlex.split(words))
        assert run.status == 2, words
        assert problem in run.problem, words
        assert contents(folder) == before, words


def contents(folder: Path) -> dict[Path, bytes]:
    return {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}


@pytest.mark.parametrize(
    "words",
    [
        "plan yard.yaml --output a.csv",
        "check yard.yaml path.csv --plot a.png",
        "roadmap yard.yaml --output a.npz",
        "landmarks yard.yaml",
        "explore yard.yaml --output run",
        "live yard.yaml --port 0",
        "benchmark yard.yaml -p PRM --output r.db",
        "worlds show yard.yaml",
        "worlds convert yard.yaml a.yaml",
        "map path.csv --output a.yaml",
        "report r.db",
    ],
)
def test_any_error_of_trailmark_is_one_line_with_status_2(
    shell: Shell, folder: Path, monkeypatch: pytest.MonkeyPatch, words: str
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise TrailmarkError("first\nsecond \x1b[31mred")

    for name in ("cli.options.load_world", "estimation.readers.load_log", "benchmark.results.load_results"):
        monkeypatch.setattr(f"trailmark.{name}", fail)
    run = shell(*words.split())
    assert run.status == 2
    assert run.problem == r"first second \x1b[31mred"
    assert {file.name for file in folder.iterdir()} == {"yard.yaml", "robots", *FILES}


finite = st.floats(allow_nan=False, allow_infinity=False)


@given(finite, finite, st.floats(-6.28, 6.28), st.floats(-360.0, 360.0))
def test_any_finite_pose_is_read_as_written(x: float, y: float, theta: float, degrees: float) -> None:
    assert options.POSE(f"{x!r},{y!r},{theta!r}") == options.GOAL(f"{x!r},{y!r},{theta!r}") == (x, y, theta)
    assert options.GOAL(f"{x!r},{y!r}") == (x, y)
    for text in (f"{degrees!r}deg", f" {degrees!r} deg "):
        assert options.POSE(f"{x!r},1,{text}") == (x, 1.0, math.radians(degrees))


@pytest.mark.parametrize(
    ("kind", "good", "value", "bad"),
    [
        (options.SECONDS, "1e-3", 0.001, ["0", "-1", "nan", "inf", "1e999", "", "1s"]),
        (options.SEED, "4294967295", 4294967295, ["-1", "4294967296", "1.5", ""]),
        (options.PROBABILITY, "0.99", 0.99, ["0", "1", "high"]),
        (options.CLEARANCE, "0", 0.0, ["-0.1", "1e8"]),
        (options.TOLERANCE, "0.2,180deg", (0.2, math.pi), ["0.2,nan", "inf", "1,2,3"]),
        (options.LIMITS, "0.5,0.3", (0.5, 0.3, 1.0, None), ["", "1,2,3,4,5", "1,nan", "1,,2"]),
        (options.POSE, "1,2,3", (1.0, 2.0, 3.0), ["1,2", "1,2,3,4", "1,2,", "a,b,c", "nan,0,0"]),
    ],
)
def test_each_kind_reads_what_is_allowed_and_nothing_else(kind: Kind, good: str, value: Any, bad: list[str]) -> None:
    assert kind(good) == value
    for text in bad:
        with pytest.raises(typer.BadParameter) as caught:
            kind(text)
        assert caught.value.message == f"expected {kind.allowed}, got {text!r}"


def test_files_that_can_be_written_are_those_that_are_written() -> None:
    assert options.PICTURE.allowed == ", ".join(plotting.PICTURE_SUFFIXES)
    assert options.PATH_FILE.allowed == ", ".join(path_files.SUFFIXES)
