from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.errors import FormatError, TrailmarkError
from trailmark.world import World
from trailmark.world.world_file import read_world

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
    assert "\n" not in str(caught.value)


def test_missing_files_and_directories(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"none\.yaml: cannot be read: No such file or directory$"):
        read_world(tmp_path / "none.yaml")
    with pytest.raises(FormatError, match=r": cannot be read: Is a directory$"):
        read_world(tmp_path)


SEEDS = (YAML, GRID, INI + "robot = a.dae\nworld = b.dae\nstart.x = 1\n", "image: a.png\nresolution: 0.1\n")


@given(
    st.sampled_from(SEEDS), st.lists(st.tuples(st.integers(0, 80), st.integers(0, 5), st.text(max_size=5)), max_size=4)
)
def test_damaged_files_give_a_world_or_one_line(
    tmp_path_factory: pytest.TempPathFactory, text: str, edits: list[tuple[int, int, str]]
) -> None:
    for at, cut, put in edits:
        text = text[:at] + put + text[at + cut :]
    file = tmp_path_factory.getbasetemp() / "damaged"
    file.write_bytes(text.encode("utf-8", "surrogatepass"))
    message = "a world"
    try:
        World.load(file)
    except TrailmarkError as error:
        message = str(error)
    assert len(message.splitlines()) == 1
