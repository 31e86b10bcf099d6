"""plan --confidence: the risk is spent along the path; draws of the tests' own say whether it is kept."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from trailmark.estimation import regrow
from trailmark.shapes import Disc
from trailmark.world import ObstacleEstimate, Query, Robot, World

Shell = Callable[..., Any]


@pytest.mark.slow
def test_risk_is_spent_along_the_path_where_obstacles_are_estimates(shell: Shell, tmp_path: Path) -> None:
    posts = [Disc((10.0, y), 0.5) for y in (1.4, 2.6, 3.8, 5.0, 6.2, 7.4)]
    estimates = [ObstacleEstimate(post, 0.0225 * np.eye(2)) for post in posts]
    bounds, query = (0.0, 0.0, 20.0, 10.0), Query("across", (2.0, 5.0, 0.0), (18.0, 5.0, 0.0))
    world = World("posts", bounds, tuple(posts), Robot.disc(0.3), None, (query,), tuple(estimates))
    world.save(tmp_path / "posts.yaml")
    regrow(world, 0.95).save(tmp_path / "grown.yaml")

    def record(*words: object) -> dict[str, Any]:
        run = shell("plan", *words, "--json")
        assert run.status == 0, run.err
        found: dict[str, Any] = json.loads(run.out)
        return found

    measured, even = record(tmp_path / "posts.yaml"), record(tmp_path / "grown.yaml")
    spent = record(tmp_path / "posts.yaml", "--confidence", "0.95", "--time-limit", 3)
    assert measured["cost"] < spent["cost"] < even["cost"]
    assert spent["risk"]["confidence"] == 0.95
    assert 0.005 < spent["risk"]["probability"] <= spent["risk"]["upper_bound"] <= 0.05
    assert spent["lower_bound"] is None
    assert "risk" not in measured
    # Draws of its own, judged at every centimetre of the path.
    rng, states = np.random.default_rng(3), np.array(spent["states"])
    line, hits = shapely.LineString(states[:, :2]), 0
    for post in posts:
        centres = rng.multivariate_normal(post.center, 0.0225 * np.eye(2), 20_000)
        hits += int((shapely.distance(line, shapely.points(centres)) < 0.8).sum())
    assert hits / 20_000 <= 0.05
    assert (
        "meets a true obstacle with probability" in shell("plan", tmp_path / "posts.yaml", "--confidence", "0.95").out
    )
    refused = shell("plan", "office", "--confidence", "0.95")
    assert refused.status == 2
    assert "world without estimates" in refused.err
    assert shell("plan", tmp_path / "posts.yaml", "--confidence", "1").status == 2


@pytest.mark.slow
def test_where_every_path_risks_too_much_none_is_returned(shell: Shell, tmp_path: Path) -> None:
    # A gap 0.1 m wider than the robot, between posts that err by 0.15 m; walls on either side.
    posts = [Disc((10.0, y), 0.5) for y in (0.4, 1.4, 2.4, 3.4, 5.1, 6.1, 7.1, 8.1, 9.1, 9.8)]
    estimates = tuple(ObstacleEstimate(post, 0.0225 * np.eye(2)) for post in posts)
    bounds, query = (0.0, 0.0, 20.0, 10.0), Query("across", (2.0, 4.25, 0.0), (18.0, 4.25, 0.0))
    World("gap", bounds, tuple(posts), Robot.disc(0.3), None, (query,), estimates).save(tmp_path / "gap.yaml")
    assert shell("plan", tmp_path / "gap.yaml").status == 0
    run = shell("plan", tmp_path / "gap.yaml", "--confidence", "0.99", "--json")
    found = json.loads(run.out)
    assert (run.status, found["status"], found["states"]) == (3, "timeout", [])
    assert found["risk"]["upper_bound"] is None
    assert (found["cost"], found["min_clearance"], found["first_cost"]) == (None, None, None)
