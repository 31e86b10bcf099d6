"""trailmark landmarks: the table, its JSON, the number of landmarks, pictures, bad input."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from tests.cli.conftest import MAIN

from trailmark.library import shipped_worlds
from trailmark.world import World

Shell = Callable[..., Any]


def record(shell: Shell, *words: object) -> dict[str, Any]:
    run = shell("landmarks", *words, "--json")
    assert (run.status, run.err) == (0, "")
    found = json.loads(run.out)
    assert isinstance(found, dict)
    return found


@pytest.mark.slow
def test_environment_1_as_published(shell: Shell) -> None:
    found = record(shell, "environment1", "-k", 12)
    assert (found["world"], found["method"], found["init"], found["n"], found["k"]) == (
        *("environment1", "paper", "forgy"),
        *(1000, 12),
    )
    assert found["rectangle"] == [5.5001, 10.5481, 46.6007, 117.5]
    assert [(run["forbidden"], run["valid"]) for run in found["published"]] == [(169, 831), (165, 835), (171, 829)]
    assert [run["run"] for run in found["runs"]] == [0, 1, 2]
    for run in found["runs"]:
        assert run["forbidden"] + run["valid"] == 1000
        assert 120 <= run["forbidden"] <= 216  # 168 on average, within four standard deviations
        assert len(run["centres"]) == len(run["repaired"]) == run["repaired_valid"] == 12
        assert run["in_obstacle"] == sum(run["centre_in_obstacle"])
        assert run["invalid"] == sum(run["centre_invalid"])
        assert run["inertia"] > 0.0
        assert run["boxes"] == 23  # every obstacle was seen
        assert run["iterations"] > 1
        assert not run["mini_batches"]
    world = World.load(shipped_worlds()["environment1"])
    solid = shapely.union_all([shape.polygon(1e-3).shapely() for shape in world.obstacles])
    points = shapely.points([centre for run in found["runs"] for centre in run["centres"]])
    flags = [flag for run in found["runs"] for flag in run["centre_in_obstacle"]]
    assert np.array_equal(shapely.intersects(solid, points), flags)
    pairs = found["spread"]["pairs"]
    assert [pair["runs"] for pair in pairs] == [[0, 1], [0, 2], [1, 2]]
    assert found["spread"]["mean"] == pytest.approx(np.mean([pair["rms"] for pair in pairs]))
    assert found["spread"]["worst"] == max(pair["rms"] for pair in pairs)


@pytest.mark.slow
def test_the_table(shell: Shell) -> None:
    run = shell("landmarks", "environment1", "-k", 12, "--init", "random-partition")
    assert (run.status, run.err) == (0, "")
    title, head, *rows = run.out.splitlines()
    assert title == "environment1 · paper: 12 landmarks from 1,000 points"
    assert head.split("  ")[1] == "RUN"
    assert head.rstrip().endswith("PUBLISHED")
    assert [row.split()[0] for row in rows[:3]] == ["1", "2", "3"]
    assert [row.rpartition("  ")[2].strip() for row in rows[:3]] == ["169 / 831", "165 / 835", "171 / 829"]
    assert "12 valid" in rows[0]
    assert rows[3].split()[0] == "spread"


@pytest.mark.slow
def test_other_counts_have_no_published_figures(shell: Shell, yard: Path) -> None:
    assert record(shell, "environment1", "-k", 12, "-n", 500, "--runs", 1)["published"] == []
    run = shell("landmarks", yard, "-k", 3, "--runs", 1)
    assert "PUBLISHED" not in run.out
    assert "spread" not in run.out


@pytest.mark.slow
def test_the_seed_decides(shell: Shell, yard: Path) -> None:
    def centres(seed: int) -> Any:
        return [run["centres"] for run in record(shell, yard, "-k", 4, "--seed", seed)["runs"]]

    assert centres(1) == centres(1)
    assert centres(1) != centres(2)
    assert len({str(run) for run in centres(1)}) == 3


@pytest.mark.slow
def test_boxes_are_grown_where_the_published_runs_have_them_so_and_where_asked(shell: Shell, yard: Path) -> None:
    few = ("-k", 8, "--runs", 1)
    grown, plain = record(shell, "environment2", *few), record(shell, "environment2", *few, "--no-grow-boxes")
    assert (grown["grown"], plain["grown"]) == (True, False)
    assert grown["runs"][0]["forbidden"] > 1.3 * plain["runs"][0]["forbidden"]
    assert not record(shell, yard, *few)["grown"]
    assert record(shell, yard, *few, "--grow-boxes")["grown"]
    refused = shell("landmarks", yard, "--method", "se2", "--grow-boxes")
    assert refused.status == 2
    assert "--grow-boxes given with --method se2, which has no boxes" in refused.err


@pytest.mark.slow
def test_paths_lead_over_the_landmarks_or_it_says_that_they_do_not(shell: Shell, yard: Path) -> None:
    found = record(shell, "environment1", "-k", 12, "--runs", 1)
    world = World.load(shipped_worlds()["environment1"])
    assert [path["query"] for path in found["paths"]] == [query.name for query in world.queries[:4]]
    few = (yard, "-k", 1, "-n", 300, "--runs", 1)
    assert any(path["cost"] is None for path in record(shell, *few)["paths"])
    text = shell("landmarks", *few)
    assert "the landmarks do not connect it" in text.out


@pytest.mark.slow
def test_trailmarks_own_method(shell: Shell, yard: Path) -> None:
    found = record(shell, yard, "--method", "se2", "-k", 6, "--runs", 2)
    for run in found["runs"]:
        assert (run["in_obstacle"], run["invalid"]) == (0, 0)
        assert run["iterations"] is None
        assert all(len(centre) == 3 for centre in run["centres"])
    assert "6 landmarks" in shell("landmarks", yard, "--method", "se2", "-k", 6).out


@pytest.mark.slow
def test_the_sensors_range_says_how_many(shell: Shell, yard: Path) -> None:
    counts = [record(shell, yard, "--sensor-range", reach, "--runs", 1)["k"] for reach in (20, 4, 2)]
    assert counts[0] == 1
    assert counts[0] < counts[1] < counts[2]


def test_another_robot(shell: Shell, yard: Path) -> None:
    assert record(shell, yard, "-k", 3, "--runs", 1, "--robot", "disc:0.3")["robot"] == "disc 0.3 m"


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["-k", "0"], "expected an integer from 1 to 20000, got -k '0'"),
        (["-k", "many"], "expected an integer from 1 to 20000, got -k 'many'"),
        (["-k", "300", "-n", "200"], "k: expected 1 to "),
        (["-k", "3", "-n", "0"], "expected an integer from 1 to 10000000, got -n '0'"),
        (["-k", "3", "-n", "-5"], "expected an integer from 1 to 10000000, got -n '-5'"),
        (["--runs", "0"], "expected an integer from 1 to 10000, got --runs '0'"),
        (["--method", "papper"], "expected paper, se2, got --method 'papper'"),
        (["--init", "random"], "expected forgy, random-partition, k-means++, got --init 'random'"),
        (["--init", "k-means++", "--method", "se2"], "--init 'k-means++' given with --method se2; expected forgy"),
        (["--sensor-range", "0"], "expected a finite number of metres above 0, got --sensor-range '0'"),
        (["--sensor-range", "inf"], "expected a finite number of metres above 0, got --sensor-range 'inf'"),
        (["--plot", "yard.gif"], "yard.gif: suffix: expected .pdf, .png, .svg, got '.gif'"),
        (["-k", "3", "--robot", "disc:9"], "world 'yard': empty free space: no place for the robot was found"),
        (["-k", "3", "--robot", "disc:9", "--method", "se2"], "k: empty free space: 0 of 1000 samples"),
    ],
)
def test_bad_input_is_one_line(shell: Shell, yard: Path, words: list[str], problem: str) -> None:
    run = shell("landmarks", yard, *words)
    assert run.status == 2
    assert run.problem.startswith(problem)


@pytest.mark.parametrize(
    ("bounds", "problem"),
    [
        ("[0.0, 0.0, 0.0, 6.0]", "expected xmin < xmax and ymin < ymax"),
        ("[0.0, 0.0, 10.0, .nan]", "bounds"),
    ],
)
def test_a_degenerate_rectangle(shell: Shell, tmp_path: Path, bounds: str, problem: str) -> None:
    file = tmp_path / "flat.yaml"
    file.write_text(f"trailmark: 1\nname: flat\nbounds: {bounds}\nrobot: {{shape: disc, radius: 0.2}}\n")
    run = shell("landmarks", file, "-k", 3)
    assert run.status == 2
    assert problem in run.problem


@pytest.mark.slow
@pytest.mark.parametrize(("suffix", "magic"), [(".svg", b"<?xml"), (".pdf", b"%PDF")])
def test_pictures(shell: Shell, yard: Path, tmp_path: Path, suffix: str, magic: bytes) -> None:
    picture = tmp_path / f"landmarks{suffix}"
    if suffix == ".pdf":  # of runs alone: each path has a panel, too
        yard.write_text(yard.read_text().partition("queries:")[0])
    words = ("-k", 4, "-n", 200, "--runs", 1, "--seed", 5)
    run = shell("landmarks", yard, *words, "--plot", picture)
    assert run.status == 0
    assert str(picture) in run.out
    assert picture.read_bytes().startswith(magic)


@pytest.mark.slow
def test_a_robot_that_does_not_fit_a_query_gets_its_picture_without_that_path(
    shell: Shell, yard: Path, tmp_path: Path
) -> None:
    picture = tmp_path / "wide.png"
    run = shell("landmarks", yard, "-k", 2, "-n", 200, "--runs", 1, "--robot", "disc:1.1", "--plot", picture)
    assert (run.status, run.err) == (0, "")
    assert picture.stat().st_size > 10_000
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_many_points_show_their_progress(forked_terminal: Callable[..., Any], yard: Path) -> None:
    run = forked_terminal(MAIN, "landmarks", yard, "-n", 110_000, "-k", 200, "--runs", 1)
    assert run.status == 0
    assert "batches" in run.out
    assert " points" in run.err
