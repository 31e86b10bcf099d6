"""The examples run as they stand or, where that takes long, on less, each in a process of its own with a time limit."""

from __future__ import annotations

import os
import re
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import pytest
from PIL import Image
from tests.helpers.processes import run_python
from tests.helpers.trials import briefly

ROOT = Path(__file__).resolve().parents[3]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
Run = Callable[..., str]
PLANNING = 0.3
"""Seconds that an example may plan; it says more."""
LESS = {
    "many_queries.py": {'"warehouse"': '"office"', "checker, 400": "checker, 100"},
    "changing_warehouse.py": {
        "moments, planner": "moments[::8], planner",  # each frame is drawn for itself
        "improvement=0.05": "improvement=0.005",
    },
    "benchmark_planners.py": {'"--runs", "3"': '"--runs", "1"'},
    "map_from_log.py": {"max_range=12.0": "max_range=5.0"},
    "ompl_benchmark.py": {"= 1.0, 4000.0": "= 0.3, 4000.0"},
}
"""What those that take long say, and what they are run with instead."""


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    (tmp_path / "worlds").symlink_to(ROOT / "worlds")
    return tmp_path


@pytest.fixture
def run(checkout: Path) -> Run:
    """Return a function that runs an example with some arguments and returns what it prints."""

    def started(name: str, *words: str) -> str:
        whole, shorter = ROOT / "examples" / name, checkout / name
        text = briefly(whole.read_text(), PLANNING)
        for said, instead in LESS.get(name, {}).items():
            assert text.count(said) == 1
            text = text.replace(said, instead)
        shorter.write_text(text)
        for file in (shorter, whole):  # on a busy machine a shorter time may not do
            done = run_python([str(file), *words], cwd=checkout, timeout=180.0)
            if done.returncode == 0:
                break
        assert done.returncode == 0, done.stderr
        return done.stdout

    return started


SAID = {
    "plan_path.py": r"solved 2\d\.\d\d m, at least 2",
    "nav2_map.py": r"solved Path\((.*\n)+header: ",
    "many_queries.py": "50 of 50 solved",
    "park_car.py": r"bay: 1\d\.\d\d m, 1 changes(.*\n)*parallel: .*, \d changes",
    "objectives_and_goals.py": r"length: 10\.06(.*\n)*clearance: .*\ntime: .*\ngoal \d at ",
    "map_from_log.py": r"\d\d obstacles, NIS (.*\n)*PlanResult\(solved",
    "published_method.py": r"\[1\d\d, 1\d\d, 1\d\d\] forbidden points, \[12, 12, 12\](.*\n)*\d+\.\d m over 14",
    "benchmark_planners.py": r"4 runs made(.*\n)* +landmark +1/1(.*\n)* +benchmark_planners:plan +\d/1",
}
"""What those print that take no arguments."""


@pytest.mark.parametrize("name", SAID)
def test_a_tutorial_prints_what_it_promises(name: str, checkout: Path, run: Run) -> None:
    found = run(name)
    assert re.search(SAID[name], found), found


def test_a_nav2_map_of_ones_own(checkout: Path, run: Run) -> None:
    Image.new("L", (60, 40), 255).save(checkout / "free.png")
    text = "image: free.png\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n"
    (checkout / "free.yaml").write_text(text)
    assert "solved" in run("nav2_map.py", "free.yaml")


def test_an_ompl_program_with_trailmarks_checks(checkout: Path, run: Run) -> None:
    found = run("ompl_checker.py")
    assert "Exact solution" in found
    assert " m in " in found
    assert "solution" in run("ompl_checker.py", "worlds/corridor.yaml", "PRM")


def test_prm_with_landmarks(checkout: Path, run: Run) -> None:
    found = run("ompl_landmark_sampler.py")
    assert "PRM, its own sampler" in found
    assert "PRM, with landmarks: Exact solution" in found


def test_ompls_benchmark_with_the_landmark_planner(checkout: Path, run: Run) -> None:
    assert "written" in run("ompl_benchmark.py", "office", ".")
    with sqlite3.connect(checkout / "office.db") as database:
        rows = database.execute(
            "SELECT p.name, COUNT(*), SUM(r.solved) FROM runs r JOIN plannerConfigs p ON p.id = r.plannerid "
            "GROUP BY p.id"
        ).fetchall()
    counts = {name.removeprefix("geometric_"): (runs, solved) for name, runs, solved in rows}
    assert counts["landmark"] == (3, 3)
    assert set(counts) == {"RRTConnect", "PRM", "landmark"}


def test_a_path_is_audited_and_repaired(checkout: Path, run: Run) -> None:
    found = run("check_path.py")
    assert "m deep" in found
    assert "free: False" in found
    assert "repaired: free: True" in found
    (checkout / "path.csv").write_text("1,1,0\n1.5,1,0\n")
    assert "deep" not in run("check_path.py", "worlds/office.yaml", "path.csv")


def test_a_path_becomes_a_trajectory(checkout: Path, run: Run) -> None:
    found = run("smooth_trajectory.py", "worlds/office.yaml", "drive.gif")
    before, after = (float(line.split(" m in ")[1].split(" s")[0]) for line in found.splitlines()[:2])
    assert after < before
    assert "drive.gif: written" in found
    assert (checkout / "drive.gif").read_bytes()[:3] == b"GIF"


def test_a_robot_of_ones_own_explores(checkout: Path, run: Run) -> None:
    found = run("explore_world.py", "worlds/office.yaml", "1", "map")
    assert "m² known at first" in found
    assert "time, the time limit of 1 s is used up" in found
    assert (checkout / "map" / "world.yaml").exists()


@pytest.mark.skipif(find_spec("rclpy") is None, reason="there is no ROS 2 here (rclpy)")
def test_a_node_of_ros_2_without_nav2(checkout: Path) -> None:
    """In a process of its own, as rclpy's threads would not survive a fork."""
    file, domain = ROOT / "examples" / "ros2_planner.py", str(os.getpid() % 100 + 1)
    own = {"ROS_DOMAIN_ID": domain, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_LOG_DIR": str(checkout)}
    done = subprocess.run(
        [sys.executable, file, "messages.png"],
        cwd=checkout,
        env=os.environ | own | {"MPLBACKEND": "Agg"},
        capture_output=True,
        text=True,
        timeout=600.0,
    )
    assert done.returncode == 0, done.stderr
    assert re.search(r"get_plan: \d{3} poses\ngoal: solved, cost \d\d\.", done.stdout), done.stdout
    assert len(re.findall(r"pallet \d: .*cost \d.* ms from message to path", done.stdout)) == 3
    with Image.open(checkout / "messages.png") as picture:
        assert picture.size == (900, 620)


def test_without_ros_2_its_example_says_so_in_one_line(checkout: Path) -> None:
    hidden = "import runpy, sys; sys.modules['rclpy'] = None; runpy.run_path(sys.argv[1], run_name='__main__')"
    done = run_python(["-c", hidden, str(ROOT / "examples" / "ros2_planner.py")], cwd=checkout, timeout=60.0)
    assert done.returncode == 1
    assert re.fullmatch(r"this example needs ROS 2 \(.*rclpy.*\): .*trailmark\[ros2\]'\n", done.stderr)


def test_all_examples_are_run() -> None:
    text = Path(__file__).read_text()
    assert len(EXAMPLES) >= 10
    assert all(f'"{file.name}"' in text for file in EXAMPLES)


def test_pallets_in_front_of_a_driving_robot(checkout: Path, run: Run) -> None:
    found = run("changing_warehouse.py", "2", "drive.gif")
    assert found.count("dropped, path") == 2
    assert "arrived after" in found
    assert (checkout / "drive.gif").read_bytes()[:4] == b"GIF8"
