"""Worlds by file, whose content tells the format, and by name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.helpers.oracles import Oracle

from trailmark import FormatError, World
from trailmark.world.library import find_world, shipped_worlds

KNOWN = (
    "expected trailmark YAML (key 'trailmark'), nav2 map YAML (key 'image'), MovingAI map "
    "(first line 'type octile'), OMPL.app cfg (section [problem]), PNG grid with a start"
)
YAML = "trailmark: 1\nname: a\nbounds: [0, 0, 1, 1]\nrobot: {shape: disc, radius: 0.1}\n"
GRID = "type octile\nheight 1\nwidth 2\nmap\n.@\n"
INI = "\n# OMPL.app\n[problem]\n"


@pytest.mark.parametrize("suffix", [".yaml", ".map", ".cfg", ".txt", ""])
def test_content_tells_the_format_not_the_name(tmp_path: Path, suffix: str) -> None:
    file = tmp_path / f"file{suffix}"
    file.write_text(YAML)
    assert World.load(file).name == "a"
    file.write_text(GRID)
    assert len(World.load(file).obstacles) == 1
    file.write_text(INI)
    with pytest.raises(FormatError, match=r"\[problem\]: missing robot"):
        World.load(file)
    file.write_text("image: none.png\nresolution: 1\norigin: [0, 0, 0]")
    with pytest.raises(FormatError, match="image cannot be read"):
        World.load(file)


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (b"", "no world: neither a YAML mapping nor another known format; " + KNOWN),
        (b"- a\n- b\n", "no world: neither a YAML mapping"),
        (b"a: 1\n", "no world: the YAML mapping has neither 'trailmark' nor 'image'; " + KNOWN),
        (b"bounds: [0, 0, 1, 1]\n", "add the line 'trailmark: 1'; " + KNOWN),
        (b"{", "not valid YAML"),
        (b"\x7fELF\x00\x01\x02", "not a text file; " + KNOWN),
        (b"[benchmark]\n", "expected an OMPL.app cfg with a section [problem], got none"),
        (b"type wall\n", "expected octile, got 'wall'"),
    ],
)
def test_unknown_content(tmp_path: Path, content: bytes, problem: str) -> None:
    file = tmp_path / "thing"
    file.write_bytes(content)
    with pytest.raises(FormatError) as caught:
        World.load(file)
    assert str(caught.value).startswith(str(file))
    assert problem in str(caught.value)


NAMES = list(shipped_worlds())


@pytest.fixture(scope="module", params=NAMES)
def world(request: pytest.FixtureRequest) -> World:
    return World.load(shipped_worlds()[request.param])


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
