from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from trailmark.errors import FormatError
from trailmark.formats.yaml_data import FEWEST, MAX_DEPTH, Data, parse_yaml, with_rows
from trailmark.shapes import Disc, Polygon, Rectangle
from trailmark.world import World
from trailmark.world.world_file import world_text

FILE = Path("a.yaml")

# PyYAML follows YAML 1.1, for which numbers such as 0E0 and 08 are texts that need no quotes.
NUMBER = re.compile(r"[-+]?(\.\d+|\d+(\.\d*)?)([eE][-+]?\d+)?")
texts = st.text(st.characters(codec="ascii", exclude_categories=["Cc"])).filter(lambda text: not NUMBER.fullmatch(text))
plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | texts,
    lambda inner: st.lists(inner) | st.dictionaries(texts, inner),
    max_leaves=20,
)


@pytest.mark.slow
@given(plain)
def test_reads_what_json_writes(data: Any) -> None:
    assert parse_yaml(json.dumps(data), FILE) == data


@pytest.mark.slow
@given(plain)
def test_reads_what_pyyaml_writes(data: Any) -> None:
    assert parse_yaml(yaml.safe_dump(data), FILE) == data


@pytest.fixture(params=["C", "Python"])
def either_loader(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.param == "Python":
        monkeypatch.delattr(yaml, "CSafeLoader")
    elif not hasattr(yaml, "CSafeLoader"):
        pytest.skip("this PyYAML has no C loader")


@pytest.mark.usefixtures("either_loader")
@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("", None),
        ("# nothing\n", None),
        ("~", None),
        ("12", 12),
        ("-012", -12),
        ("1e-05", 1e-5),
        (".5", 0.5),
        ("5.", 5.0),
        ("+1E+3", 1000.0),
        ("1e999", math.inf),
        ("-.inf", -math.inf),
        ("9" * 5000, math.inf),
        ("true", True),
        ("no", "no"),
        ("1_000", "1_000"),
        ("1:30", "1:30"),
        ("0x10", "0x10"),
        ("2024-01-01", "2024-01-01"),
        ("nan", "nan"),
        ("'1'", "1"),
        ('"true"', "true"),
        ("! 5", 5),
        ("a: {b: [1, {c: d}], e: }", {"a": {"b": [1, {"c": "d"}], "e": None}}),
        ("1: a\ntrue: b", {"1": "a", "true": "b"}),
        ("- - 1\n  - 2\n- []\n- {}", [[1, 2], [], {}]),
        ("|\n  two\n  lines\n", "two\nlines\n"),
    ],
)
def test_scalars_and_containers(text: str, value: Any) -> None:
    given_back = parse_yaml(text, FILE)
    assert given_back == value
    assert type(given_back) is type(value)


def test_nan() -> None:
    value = parse_yaml(".nan", FILE)
    assert isinstance(value, float)
    assert math.isnan(value)


BOMB = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12)
)


@pytest.mark.usefixtures("either_loader")
@pytest.mark.parametrize(
    ("text", "message"),
    [
        (BOMB, "a.yaml:1: expected no anchors and aliases, got anchor &a0"),
        ("a: *b", "a.yaml:1: expected no anchors and aliases, got alias *b"),
        ("\na: !!python/object/apply:os.system [ls]", "expected no tags, got tag"),
        ("!!float 1", "expected no tags"),
        ("a: 1\nb: 2\na: 3", "a.yaml:3: expected each key once, got 'a' twice in one mapping"),
        ("- {a: 1, b: 2, 'a': 3}", "expected each key once, got 'a' twice in one mapping"),
        ("[" * 100_000, f"a.yaml:1: expected at most {MAX_DEPTH} levels of nesting, got more"),
        ("\n".join(" " * i + "-" for i in range(100)), f"expected at most {MAX_DEPTH} levels of nesting, got more"),
        ("? [1, 2]\n: 3", "expected a text as a key, got a list or mapping"),
        ("{{a: b}: c}", "expected a text as a key, got a list or mapping"),
        ("a: 1\n---\nb: 2", "a.yaml:2: expected one YAML document, got a second"),
        ("a: [1, 2", "not valid YAML"),
        ("a: b: c", "a.yaml:1: not valid YAML: mapping values are not allowed"),
        ("a: 1\n\tb: 2", "a.yaml:2: not valid YAML"),
        ("a: '", "not valid YAML"),
        ("a: \x01", "not valid YAML"),
        ("%YAML 9.9\n---\na", "not valid YAML"),
    ],
)
def test_refused_in_one_line(text: str, message: str) -> None:
    with pytest.raises(FormatError) as caught:
        parse_yaml(text, FILE)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_depth_up_to_the_limit_is_read() -> None:
    assert json.dumps(parse_yaml("[" * MAX_DEPTH + "]" * MAX_DEPTH, FILE)) == "[" * MAX_DEPTH + "]" * MAX_DEPTH


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
