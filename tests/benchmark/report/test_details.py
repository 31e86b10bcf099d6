"""Details of single problems: tables, pictures to scale, and what is left out to keep the page small."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from tests.helpers.made_results import GOAL, START, WORLD, random_results, run, write_results

import trailmark.benchmark.report.details as details_module
from trailmark.benchmark.report import load_results
from trailmark.benchmark.report.details import details
from trailmark.benchmark.report.worlds import Worlds, scene_of


def test_problems_in_one_world_share_its_picture(tmp_path: Path) -> None:
    planners = ["landmark", "PRM"]
    found = details(load_results(random_results(tmp_path / "r.db", planners, problems=3, runs=6)))
    assert len(found["worlds"]) == 1
    for shown in found["problems"]:
        assert shown["scene"]["world"] == 0
        assert shown["scene"]["paths"][0].startswith("M")
        assert {row[0] for row in shown["table"]["rows"]} == set(planners)
        assert dict(shown["facts"])["limit [s]"] == "1"
        assert len(shown["curves"]["cells"]) == 2


def test_a_world_is_read_once_for_all_its_queries() -> None:
    worlds = Worlds()
    other = WORLD.replace("start: [1.0, 1.0, 0.0]", "start: [1.0, 5.0, 0.0]").replace("across", "down")
    (first, a), (second, b) = worlds.scene(WORLD), worlds.scene(other)  # type: ignore[misc]  # both can be drawn
    assert a == b == 0
    assert len(first.problem.world.obstacles) == 3
    assert len(second.problem.world.obstacles) == 0, "the second time only what is not in the picture is read"
    whole = scene_of(other)
    assert whole is not None
    assert second.ends() == whole.ends()
    assert second.line(np.array([START, GOAL])) == whole.line(np.array([START, GOAL]))


def test_other_obstacles_are_another_world() -> None:
    worlds = Worlds()
    # Also where the queries are not the last, and where lists are written in one line.
    head, _, rest = WORLD.partition("obstacles:")
    obstacles, _, queries = rest.partition("queries:")
    turned = f"{head}queries:{queries}obstacles:{obstacles}"
    flow = f"{head}obstacles: [{{shape: disc, center: [5, 3], radius: 1}}]\nqueries:{queries}"
    texts = [WORLD, WORLD.replace("radius: 1.0", "radius: 0.5"), turned, turned.replace("radius: 1.0", "radius: 0.5")]
    texts += [flow, flow.replace("radius: 1}", "radius: 2}")]
    for text in [*texts, *texts]:
        found = worlds.scene(text)
        assert found is not None
        whole = scene_of(text)
        assert whole is not None
        assert worlds.pictures[found[1]] == whole.background()


def test_what_does_not_fit_is_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(details_module, "MAX_BYTES", 100)
    found = details(load_results(random_results(tmp_path / "r.db", ["landmark", "PRM"], problems=3, runs=2)))
    assert [shown is None for shown in found["problems"]] == [False, True, True]


def test_reasons_of_failures_are_taken_together(tmp_path: Path) -> None:
    rows = [run(k, None, failure="killed by signal 11") for k in range(3)]
    file = write_results(tmp_path / "r.db", {"yard": {"A": [*rows, run(3, 0.1, 9.0)]}})
    (shown,) = details(load_results(file))["problems"]
    assert shown["failures"]["rows"] == [["A", "3", "0", "killed by signal 11"]]


def test_without_a_path_or_a_world_there_is_no_picture(tmp_path: Path) -> None:
    (shown,) = details(load_results(write_results(tmp_path / "r.db", {"yard": {"A": [run(0, None)]}})))["problems"]
    assert shown["curves"] is None
    assert shown["scene"]["paths"] == [None]
    file = write_results(tmp_path / "s.db", {"yard": {"A": [run(0, 0.1, 9.0)]}}, text="no world")
    assert details(load_results(file))["problems"][0]["scene"] is None


def test_a_world_is_drawn_to_scale() -> None:
    scene = scene_of(WORLD)
    assert scene is not None
    for part in (scene.background(), scene.ends(), f'<path d="{scene.bodies(np.array([START, GOAL]))}"/>'):
        ET.fromstring(f"<g>{part}</g>")  # noqa: S314  # our own text
    # 10.4 m are 400 units wide: the way begins 1.2 m from the left and 5.2 m below the top.
    begun = re.match(r"M(\S+) (\S+?)l", scene.line(np.array([START, GOAL])))
    assert begun is not None
    assert (float(begun[1]), float(begun[2])) == pytest.approx((1.2 / 10.4 * 400.0, 5.2 / 10.4 * 400.0), abs=0.06)
    assert scene_of("trailmark: 1") is None
