"""trailmark landmarks: the table, its JSON, the number of landmarks, pictures, bad input."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from trailmark.world import World
from trailmark.world.library import shipped_worlds

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
def test_seed_range_and_method_decide_and_paths_are_told(shell: Shell, yard: Path, tmp_path: Path) -> None:
    def centres(seed: int) -> Any:
        return [run["centres"] for run in record(shell, yard, "-k", 4, "--seed", seed)["runs"]]

    assert centres(1) == centres(1) != centres(2)
    counts = [record(shell, yard, "--sensor-range", reach, "--runs", 1)["k"] for reach in (20, 4, 2)]
    assert 1 == counts[0] < counts[1] < counts[2]
    for run in record(shell, yard, "--method", "se2", "-k", 6, "--runs", 2)["runs"]:
        assert (run["in_obstacle"], run["invalid"], run["iterations"]) == (0, 0, None)
        assert all(len(centre) == 3 for centre in run["centres"])
    few = (yard, "-k", 1, "-n", 300, "--runs", 1)
    assert [path["query"] for path in record(shell, *few)["paths"]] == ["across", "back"]
    assert "the landmarks do not connect it" in shell("landmarks", *few).out
    # A robot that does not fit a query gets its picture without that path.
    picture = tmp_path / "wide.png"
    run = shell("landmarks", yard, "-k", 2, "-n", 200, "--runs", 1, "--robot", "disc:1.1", "--plot", picture)
    assert (run.status, run.err, str(picture) in run.out) == (0, "", True)
    assert picture.stat().st_size > 10_000
