from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark import FormatError, Query, World
from trailmark.formats.movingai import parse_grid, read_scenarios

FILE = Path("a.map")


def map_text(*rows: str) -> str:
    return f"type octile\nheight {len(rows)}\nwidth {len(rows[0])}\nmap\n" + "\n".join(rows) + "\n"


@given(
    st.integers(1, 9).flatmap(lambda n: st.lists(st.text(".GS@OTW", min_size=n, max_size=n), min_size=1, max_size=9))
)
def test_free_and_blocked_cells(rows: list[str]) -> None:
    free = parse_grid(map_text(*rows), FILE)
    assert free.tolist() == [[cell in {".", "G", "S"} for cell in row] for row in rows]


def test_world(tmp_path: Path) -> None:
    (tmp_path / "a.map").write_text(map_text("@..", "...").replace("\n", "\r\n"))
    (tmp_path / "a.map.scen").write_text("version 1\n0\ta.map\t3\t2\t1\t0\t2\t1\t1.41421356\n\n7 a.map 3 2 2 1 0 1 2\n")
    world = World.load(tmp_path / "a.map")
    assert world.name == "a"
    assert world.bounds == (0.0, 0.0, 3.0, 2.0)
    assert [shape.bounding_box() for shape in world.obstacles] == [(0.0, 1.0, 1.0, 2.0)]
    assert world.queries == (Query("0", (1.5, 1.5, 0.0), (2.5, 0.5, 0.0)), Query("1", (2.5, 0.5, 0.0), (0.5, 0.5, 0.0)))
    assert world.robot is None


def test_the_other_scenario_name_and_none(tmp_path: Path) -> None:
    (tmp_path / "a.map").write_text(map_text(".."))
    assert World.load(tmp_path / "a.map").queries == ()
    (tmp_path / "a.scen").write_text("1\ta b.map\t2\t1\t0\t0\t1\t0\t1\n")
    assert [query.name for query in World.load(tmp_path / "a.map").queries] == ["0"]
    assert read_scenarios(tmp_path / "a.scen")[0] == (1, "a b.map", 2, 1, (0, 0), (1, 0), 1.0)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (map_text("..", ".x"), "a.map:6: column 2: expected . G S @ O T W, got 'x'"),
        (map_text("..", ".é"), "a.map:6: column 2: expected . G S @ O T W, got 'é'"),
        (map_text("..", "..."), "a.map:6: expected a row of 2 cells, got 3"),
        (map_text("..", "."), "a.map:6: expected a row of 2 cells, got 1"),
        ("type octile\nheight 3\nwidth 2\nmap\n..\n..\n", "a.map:6: expected 3 rows, got 2"),
        ("type octile\nheight 1\nwidth 2\nmap\n..\n..\n", "a.map:6: expected 1 rows, got 2"),
        ("type octile\nheight 1\nmap\n..\n", "a.map:3: no width before the line 'map'"),
        ("type octile\nmap\n", "a.map:2: no height and width before the line 'map'"),
        ("type octile\nheight 1\nwidth 2\n..\n", "a.map:4: expected height, map, type, width, got '..'"),
        ("type octile\nheigth 1\n", "a.map:2: expected height, map, type, width, got 'heigth' (did you mean"),
        ("type octile\n", "a.map: no line 'map' ends the header"),
        ("type tile\nheight 1\n", "a.map:1: type: expected octile, got 'tile'"),
        ("type octile\nheight -1\nwidth 1\nmap\n", "a.map:2: expected a whole number above 0, got height '-1'"),
        ("type octile\nheight 1.5\nwidth 1\nmap\n", "a.map:2: expected a whole number above 0, got height '1.5'"),
        ("type octile\nheight 0\nwidth 1\nmap\n", "a.map: expected 1 to 64,000,000 cells, got 1 x 0"),
        ("type octile\nheight 99999\nwidth 99999\nmap\n", "a.map: expected 1 to 64,000,000 cells, got 99999 x"),
        ("type octile\nheight 9999999999\nwidth 1\nmap\n", "a.map:2: expected a whole number above 0, got height"),
    ],
)
def test_bad_maps(tmp_path: Path, text: str, problem: str) -> None:
    (tmp_path / "a.map").write_text(text, encoding="utf-8")
    with pytest.raises(FormatError) as caught:
        World.load(tmp_path / "a.map")
    assert f"{tmp_path}/{problem}" in str(caught.value)


@pytest.mark.parametrize(
    ("row", "problem"),
    [
        ("0 a.map 2 1 0 0 1 0", "expected 9 columns (bucket, map, width, height, start x, "),
        ("0 a.map 2 1 0 0 1 0 1 1", "expected 9 columns (bucket, "),
        ("zero a.map 2 1 0 0 1 0 1", "expected a whole number, got bucket 'zero'"),
        ("0 a.map 2 1 0.5 0 1 0 1", "expected a whole number, got start x '0.5'"),
        ("0 a.map 2 1 0 0 1 0 nan", "expected a finite number, 0 or more, got optimal length 'nan'"),
        ("0 a.map 2 1 0 0 1 0 -1", "expected a finite number, 0 or more, got optimal length '-1'"),
        ("0 a.map 2 1 0 0 1 0 far", "expected a finite number, 0 or more, got optimal length 'far'"),
        ("0 a.map 2 1 0 0 2 0 1", "expected x in 0..1, y in 0..0, got goal cell (2, 0)"),
        ("0 a.map 2 1 0 -1 1 0 1", "expected x in 0..1, y in 0..0, got start cell (0, -1)"),
        ("0 a.map 4 2 0 0 1 0 1", "expected the map's 2 x 1, got map of 4 x 2 cells"),
    ],
)
def test_bad_scenarios_name_file_and_line(tmp_path: Path, row: str, problem: str) -> None:
    (tmp_path / "a.map").write_text(map_text(".."))
    (tmp_path / "a.map.scen").write_text(f"version 1\n0 a.map 2 1 0 0 1 0 1\n{row}\n")
    with pytest.raises(FormatError) as caught:
        World.load(tmp_path / "a.map")
    assert str(caught.value).startswith(f"{tmp_path}/a.map.scen:3: {problem}")


def test_a_missing_scenario_file(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="cannot be read"):
        read_scenarios(tmp_path / "a.scen")
