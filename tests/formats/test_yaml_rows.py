"""Rows of obstacles read in a shorter way: what YAML says of them, or YAML itself."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from trailmark.errors import FormatError
from trailmark.formats.world_yaml import world_text
from trailmark.formats.yaml_data import FEWEST, Data, parse_yaml, with_rows
from trailmark.shapes import Disc, Polygon, Rectangle
from trailmark.world import World

ROW = "  - {shape: disc, center: [1.0, 2.5], radius: 1.0e-05}\n"
HEAD = "trailmark: 1\nobstacles:\n"
PATH = Path("world.yaml")


def parsed(text: str) -> tuple[Data, int]:
    """What is read, and how many characters YAML had to read for it."""
    read = list[int]()

    def parse(part: str) -> Data:
        read.append(len(part))
        return parse_yaml(part, PATH)

    return with_rows(text, parse), sum(read)


def said(read: Callable[[], Data]) -> str:
    """What is read, told apart by type, or the error."""
    try:
        return repr(read())
    except FormatError as error:
        return str(error)


def test_worlds_are_read_as_yaml_reads_them_from_a_few_characters() -> None:
    rng = np.random.default_rng(0)
    shapes = [Disc((float(x), float(y)), float(r)) for x, y, r in rng.uniform(1e-7, 9.0, (60, 3))]
    boxes = [Rectangle((float(x), float(y)), 1.0, 2.0, float(r)) for x, y, r in rng.uniform(1.0, 9.0, (60, 3))]
    triangles = [Polygon(rng.uniform(0.0, 9.0, (3, 2))) for _ in range(60)]
    text = world_text(World("w", (0.0, 0.0, 9.0, 9.0), (*shapes, *boxes, *triangles)))
    data, read = parsed(text)
    assert data == parse_yaml(text, PATH)
    assert read < 300 < len(text)


@pytest.mark.slow
@pytest.mark.parametrize(
    "row",
    [
        "  - {shape: disc, center: [1.0, 2.5], radius: .5}\n",
        "  - {shape: disc, center: [1.0, 2.5], radius: 012}\n",
        "  - {shape: disc, center: [1.0, 2.5], radius: -.inf}\n",
        "  - {shape: disc, shape: disc, radius: 1}\n",
        "  - {shape: disc, center: [1.0, 2.5,], radius: 1}\n",
        "  - {shape: a b, center: [x, 2.5], radius: 1}\n",
        "  - {shape: true, id: null, radius: false, center: nan}\n",
        "  - {id: e5, radius: 1e400, other: -0, third: 1e5}\n",
        f"  - {{radius: {'9' * 350}}}\n",
        f"  - {{radius: {'[' * 9}1{']' * 9}}}\n",
        f"  - {{radius: {'[' * 40}1{']' * 40}}}\n",
        "  - {shape:disc, radius: 1}\n",
        "  - { }\n",
        "  - {}\n",
        "  - {shape: disc}}\n",
        "  - {shape: disc\n",
        "    more\n",
        "    , more\n",
        "  - &a {radius: 1}\n",
        "  - other\n",
        "- other\n",
        "name: trailmark-rows-are-here\n",
    ],
)
@pytest.mark.parametrize("after", ["", "name: x\n", ROW, "name: 'x\n"])
def test_what_is_not_simple_is_left_to_yaml(row: str, after: str) -> None:
    text = HEAD + FEWEST * ROW + row + after
    assert said(lambda: parsed(text)[0]) == said(lambda: parse_yaml(text, PATH))


@pytest.mark.parametrize(
    "head", ["name: '\nobstacles:\n", 'name: "\nobstacles:\n', "a: {b: '\nobstacles:\n", "x: |\nobstacles:\n"]
)
@pytest.mark.parametrize("end", ["'\n", '"\n', "'}\n", ""])
def test_lines_within_a_text_are_no_rows(head: str, end: str) -> None:
    text = head + FEWEST * ROW + end
    assert said(lambda: parsed(text)[0]) == said(lambda: parse_yaml(text, PATH))
