"""Polygons in SVG drawings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from trailmark.errors import FormatError
from trailmark.formats.svg_polygons import read_svg_polygons

SVG = '<svg xmlns="http://www.w3.org/2000/svg"><g transform="translate(5,5)">{}</g></svg>'


def drawn(tmp_path: Path, *lines: str) -> Path:
    file = tmp_path / "maze.svg"
    file.write_text(SVG.format("".join(f'<path id="p" d="{line}"/>' for line in lines)))
    return file


@pytest.mark.parametrize(
    "line",
    [
        pytest.param("m 1,2 3,0 0,4 -3,0 z", id="relative-pairs"),
        pytest.param("M1 2L4,2 4,6 1,6Z", id="absolute"),
        pytest.param("M 1 2 h 3 v 4 h -3 z", id="relative-sides"),
        pytest.param("m 1,2 H 4 V 6 l -3,0", id="mixed"),
        pytest.param("m 1e0,2.0 l 3,0 0,4 -3.,0", id="forms-of-numbers"),
    ],
)
def test_straight_commands(line: str, tmp_path: Path) -> None:
    (vertices,) = read_svg_polygons(drawn(tmp_path, line))
    np.testing.assert_array_equal(vertices, [[1, -2], [4, -2], [4, -6], [1, -6]])


@pytest.mark.parametrize(
    ("lines", "problem"),
    [
        pytest.param(["m 0,0 c 1,1 2,2 3,3"], "expected the commands M, L, H, V, Z, got 'c'", id="curve"),
        pytest.param(["m 0,0 1,1"], "expected 3 or more finite vertices, got 2", id="two-vertices"),
        pytest.param(["m 0,0 1,1 2 z"], "expected whole points, got 1 number more", id="half-a-point"),
        pytest.param(["1,1 2,2 3,3"], "expected a command before the number 1", id="no-command"),
        pytest.param([], "expected one <path> or more, got none", id="empty"),
    ],
)
def test_what_cannot_be_read_is_told_in_one_line(lines: list[str], problem: str, tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=problem):
        read_svg_polygons(drawn(tmp_path, *lines))
