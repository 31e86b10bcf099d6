from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from trailmark.errors import FormatError
from trailmark.formats.yaml_data import MAX_DEPTH, parse_yaml

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
def test_reads_what_json_and_pyyaml_write(data: Any) -> None:
    assert parse_yaml(json.dumps(data), FILE) == data
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
        (".nan", math.nan),
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
    assert repr(given_back) == repr(value)


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


def test_depth_up_to_the_limit_is_read() -> None:
    assert json.dumps(parse_yaml("[" * MAX_DEPTH + "]" * MAX_DEPTH, FILE)) == "[" * MAX_DEPTH + "]" * MAX_DEPTH
