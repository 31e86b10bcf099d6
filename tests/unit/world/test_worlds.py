"""The shipped worlds: sound, and each query as feasible as its name says.

Nothing here uses trailmark's own collision checks: regions are built with shapely from the fields of the shapes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.helpers.oracles import Oracle

from trailmark import Disc, FormatError, Polygon, Rectangle, World
from trailmark.world.library import find_world, shipped_worlds

NAMES = list(shipped_worlds())


@pytest.fixture(scope="module", params=NAMES)
def world(request: pytest.FixtureRequest) -> World:
    return World.load(shipped_worlds()[request.param])


def test_shipped_worlds_cover_what_they_should() -> None:
    loaded = {name: World.load(file) for name, file in shipped_worlds().items()}
    assert len(loaded) >= 10
    assert len(loaded["clutter"].obstacles) == 200
    assert {type(shape) for shape in loaded["field2000"].obstacles} == {Disc, Rectangle, Polygon}
    assert len(loaded["field2000"].obstacles) == 2000
    assert loaded["lake"].boundary is not None
    assert any(isinstance(shape, Polygon) and shape.holes for shape in loaded["gate"].obstacles)
    assert {type(each.robot.footprint) for each in loaded.values() if each.robot} == {Disc, Rectangle, Polygon}
    assert shipped_worlds()["field2000"].stat().st_size < 400_000


def test_name_and_queries(world: World) -> None:
    assert world.name in NAMES
    assert world.robot is not None
    assert 1 <= len(world.queries) <= 4
    assert all(query.name.startswith("infeasible") == (world.name == "enclosed") for query in world.queries)


def test_starts_and_goals_keep_clear(world: World) -> None:
    assert world.robot is not None
    ends = np.array([end for query in world.queries for end in (query.start, query.goal)])
    assert Oracle(world, world.robot).clearance(ends).min() > 0.09


def test_file_wins_over_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("office").write_text("mine")
    assert find_world("office").read_text() == "mine"
    assert find_world(tmp_path / "office") == tmp_path / "office"


def test_folder_does_not_win_over_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("office").mkdir()
    assert find_world("office") == shipped_worlds()["office"]


@pytest.mark.parametrize("name", ["ofice", "ofice.yaml", "nowhere/ofice.yaml"])
def test_unknown_name_gets_suggestion(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(
        FormatError, match=rf"^{name}: no such file or shipped world; expected .*'office'\?\)$"
    ) as caught:
        find_world(name)
    assert "expected bugtrap, clutter" in str(caught.value)
    assert "\n" not in str(caught.value)
