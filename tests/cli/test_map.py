"""trailmark map: logs of all kinds to worlds that can be planned in, figures, pictures, progress."""

from __future__ import annotations

import gzip
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.cli.logs import POSTS, START, recorded, write_mrclam

from trailmark.estimation import Pose, regrow, save_log
from trailmark.shapes import Disc
from trailmark.world import Robot, World

Shell = Callable[..., Any]
Terminal = Callable[..., Any]


@pytest.fixture
def log(tmp_path: Path) -> Path:
    file = tmp_path / "yard.jsonl"
    save_log(recorded(), file)
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


@pytest.mark.slow
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
    assert "radius of 0.1 m" in run.out
    assert facts["written"].endswith("world.yaml")
    plain = shell(
        "map", log, "--output", tmp_path / "plain.yaml", *given(tmp_path, "{radius: 0.2, radius_sigma: 0.05}")
    ).out
    assert "none stated" in plain
    assert "note" not in plain


@pytest.mark.slow
def test_the_json_object(shell: Shell, log: Path, tmp_path: Path) -> None:
    file, picture = tmp_path / "world.yaml", tmp_path / "map.svg"
    found = record(shell, log, "--output", file, "--confidence", "0.95", "--plot", picture)
    assert set(found) == {
        *(
            "log",
            "name",
            "records",
            "dropped",
            "poses",
            "association",
            "matching",
            "features",
            "nis",
            "batch",
            "counts",
            "obstacles",
        ),
        *("bounds", "trajectory", "queries", "risk", "time", "not_certified", "warnings", "notes", "robot", "written"),
    }
    assert found["records"]["all"] == len(recorded().records)
    assert (found["dropped"], found["poses"], found["association"]) == (0, "slam", "known")
    assert found["features"] == {"confirmed": 8, "tentative": 0, "dropped": 0}
    assert found["nis"]["low"] < found["nis"]["expected"] < found["nis"]["high"]
    assert found["risk"] == pytest.approx({"confidence": 0.95, "collision_at_most": 0.05})
    assert found["obstacles"]["discs"] == 8
    assert found["written"] == {
        **dict.fromkeys(("trajectory", "nav2")),
        "world": str(file),
        "plot": str(picture),
    }
    assert found["queries"] == [query.name for query in World.load(file).queries]
    assert 0.0 < found["time"]["per_update"] < found["time"]["total"]
    assert picture.read_bytes().startswith(b"<?xml")


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
    assert "--even-if-uncertain" in refused.err
    measured = shell(*words, "--json")
    assert measured.status == 0
    reason = json.loads(measured.out)["not_certified"]
    assert reason == World.load(file).not_certified
    assert reason in measured.err
    grown = shell(*words, "--confidence", "0.99", "--even-if-uncertain")
    assert (grown.status, "not certified" in grown.out) == (0, True)
    world = World.load(file)
    assert world.risk is not None
    assert world.not_certified == reason


@pytest.mark.slow
def test_settings_change_the_map(shell: Shell, log: Path, tmp_path: Path) -> None:
    log.write_text("".join(log.read_text().splitlines(keepends=True)[:130]))  # in which all posts are seen

    def areas(*words: object) -> float:
        assert shell("map", log, "--output", tmp_path / "world.yaml", "--confidence", "0.99", *words).status == 0
        return sum(shape.area for shape in World.load(tmp_path / "world.yaml").obstacles)

    plain = areas()
    counts = "stated_noise: false, fit_noise: off"
    assert (
        areas(*given(tmp_path, f"{{range_bearing: {{sigma_range: 0.3, sigma_bearing: 0.1}}, {counts}}}")) > 1.2 * plain
    )
    velocity = given(tmp_path, f"{{velocity: {{sigma_v: 0.1, sigma_omega: 0.1}}, {counts}}}")
    assert areas(*velocity) > plain  # but little, since obstacles are relative to the map
    assert areas(*given(tmp_path, "robot_sigma: [0.2, 0]")) > 1.2 * plain
    assert areas("--start", START) > 1.2 * plain
    assert {estimate.frame for estimate in World.load(tmp_path / "world.yaml").estimates if estimate} == {"start"}
    assert areas("--start", START, "--frame", "map") == pytest.approx(plain, rel=1e-3)
    assert {estimate.frame for estimate in World.load(tmp_path / "world.yaml").estimates if estimate} == {"map"}
    assert areas(*given(tmp_path, "radius_sigma: 0.05")) > 1.2 * plain
    assert areas(*given(tmp_path, "slam: {association: joint, confirm: 3}")) > 0.0


@pytest.mark.slow
def test_mrclam_folders_in_all_their_names(shell: Shell, mrclam: Path, tmp_path: Path) -> None:
    file = tmp_path / "world.yaml"
    worlds = []
    for words in (
        [mrclam],
        [f"{mrclam}:1"],
        [mrclam / "Robot1_Odometry.dat"],
        [mrclam, "--format", "mrclam"],
    ):
        assert record(shell, *words, "--output", file)["name"] == "robots-robot1"
        worlds.append(file.read_text())
    assert len(set(worlds)) == 1


def test_what_was_written_into_the_logs_folder_is_written_again(shell: Shell, mrclam: Path) -> None:
    for _ in range(2):
        assert shell("map", f"{mrclam}:1", "--output", mrclam / "map.yaml").status == 0


@pytest.mark.slow
def test_real_robots(shell: Shell, shared_data: Path, tmp_path: Path) -> None:
    folder, file = tmp_path / "cut", tmp_path / "world.yaml"
    folder.mkdir()
    for name in ("Robot3_Odometry.dat", "Robot3_Measurement.dat", "Barcodes.dat"):
        lines = (shared_data / "mrclam6" / name).read_text().splitlines()
        begin = next(float(line.split()[0]) for line in lines if not line.startswith("#"))
        early = [x for x in lines if name == "Barcodes.dat" or x.startswith("#") or float(x.split()[0]) < begin + 60.0]
        (folder / name).write_text("\n".join(early) + "\n")
    run = shell("map", folder, "--output", file, "--skip-bad")
    assert run.status == 0
    assert "EKF-SLAM, association known" in run.out
    assert len(World.load(file).obstacles) >= 5
    assert shell("plan", file, "--time-limit", "0.3").status == 0


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
