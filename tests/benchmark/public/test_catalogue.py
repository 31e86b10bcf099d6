"""What all public suites have in common: an even choice, folders, and ends that can be planned between."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.support.trials import few

from trailmark.benchmark.errors import SuiteError
from trailmark.benchmark.public import PUBLIC
from trailmark.benchmark.public.base import evenly, in_order
from trailmark.collision import StateChecker
from trailmark.world import World

FOLDERS = {"movingai": "movingai", "omplapp": "omplapp", "nav2": "nav2", "barn": "barn", "explore-bench": "explore"}
"""Of the suites whose data is at hand, in the folder of real data."""


@pytest.mark.parametrize(("size", "count"), [(10, 3), (300, 7), (5, 5), (4, 9), (1000, 999)])
def test_a_choice_is_spread_evenly(size: int, count: int) -> None:
    chosen = evenly(range(size), count)
    assert len(chosen) == min(size, count)
    assert sorted(set(chosen)) == chosen
    gaps = np.diff([-1 - chosen[0], *chosen, 2 * size - 1 - chosen[-1]])[1:-1]
    assert gaps.max(initial=0) - gaps.min(initial=size) <= 1
    assert evenly(range(size), None) == list(range(size))


def test_nine_comes_before_ten() -> None:
    assert sorted(["world_10", "world_9", "a", "world_9b"], key=in_order) == ["a", "world_9", "world_9b", "world_10"]


@pytest.mark.parametrize("name", PUBLIC)
def test_a_wrong_folder_is_told_in_one_line(name: str, tmp_path: Path) -> None:
    suite = PUBLIC[name]
    if not suite.published:
        with pytest.raises(SuiteError, match="expected no --data"):
            suite.folder(str(tmp_path))
        return
    with pytest.raises(SuiteError, match="--data is missing; expected a folder with"):
        suite.folder(None)
    with pytest.raises(SuiteError, match=r"--data: expected a folder with .*, got 'nowhere'"):
        suite.folder("nowhere")
    with pytest.raises(SuiteError, match=f"suite {name}: expected .*, got none of it"):
        list(suite.worlds(tmp_path, suite.find(tmp_path), None, None))


def posed(name: str, folder: Path | None, count: int) -> list[World]:
    suite = PUBLIC[name]
    at = suite.folder(None if folder is None else str(folder))
    return list(suite.worlds(at, suite.find(at), count, None))


@pytest.mark.slow
@pytest.mark.parametrize("name", PUBLIC)
def test_every_problem_has_valid_ends(name: str, shared_data: Path) -> None:
    suite, count = PUBLIC[name], few(12)
    if suite.published and name not in FOLDERS:
        pytest.skip("its data is not at hand; test_published.py makes some")
    made = posed(name, shared_data / FOLDERS[name] if suite.published else None, count)
    queries = 0
    for world in made:
        checker = StateChecker(world)
        ends = np.array([end for query in world.queries for end in (query.start, query.pose())])
        assert checker.valid(ends).all(), world.name
        queries += len(world.queries)
    # OMPL.app and BARN are there in part.
    assert queries == {"omplapp": 2, "barn": 3}.get(name, count)
    assert len({(world.name, query.name) for world in made for query in world.queries}) == queries
