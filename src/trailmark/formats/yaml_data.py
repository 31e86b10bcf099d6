"""Safe YAML: text to plain dicts, lists, strings, numbers, booleans and None, and nothing else.

Scalars follow YAML 1.2's core schema, so that ``1e-05`` is a number and ``no`` a text. Tags, anchors, aliases and
a second document are refused, repeated keys too; nesting is bounded. So the work is linear in the size of the text.

Long lists of obstacles, one a line as trailmark writes them, are read as JSON, in a tenth of YAML's time.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from trailmark.errors import FormatError

__all__ = ["MAX_DEPTH", "Data", "parse_yaml", "with_rows"]

Data = dict[str, "Data"] | list["Data"] | str | int | float | bool | None

MAX_DEPTH = 32
"""Deepest nesting of lists and mappings that is read."""

_INTEGER = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_WORDS: dict[str, Data] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **dict.fromkeys((".nan", ".NaN", ".NAN"), float("nan")),
    **{sign + word: float(sign + "inf") for sign in ("", "+", "-") for word in (".inf", ".Inf", ".INF")},
}


def parse_yaml(text: str, path: Path) -> Data:
    """Return what a YAML text says, as plain data; an empty text says None.

    Args:
        text: one YAML document.
        path: the file it came from, for messages.

    Raises:
        FormatError: text that is not YAML, or YAML with tags, anchors, aliases, repeated or compound keys, more
            than one document, or nesting deeper than :data:`MAX_DEPTH`.
    """
    import yaml
    from yaml import events

    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # the C one reads thousands of obstacles in time
    root: list[Data] = []
    stack: list[_Container] = [_Container(root)]
    try:
        for event in yaml.parse(text, Loader=loader):
            if isinstance(event, events.ScalarEvent):
                _check_plain(event, path)
                top = stack[-1]
                if top.wants_key:
                    _take_key(top, event, path)
                else:
                    top.put(_scalar(event.value) if event.implicit[0] else event.value)
            elif isinstance(event, events.CollectionStartEvent):
                _check_plain(event, path)
                _check_room(stack, event, path)
                child: dict[str, Data] | list[Data] = {} if isinstance(event, events.MappingStartEvent) else []
                stack[-1].put(child)
                stack.append(_Container(child))
            elif isinstance(event, events.CollectionEndEvent):
                stack.pop()
            elif isinstance(event, events.AliasEvent):
                raise FormatError(
                    path, f"expected no anchors and aliases, got alias *{str(event.anchor)[:60]}", _line(event)
                )
            elif isinstance(event, events.DocumentStartEvent) and root:
                raise FormatError(path, "expected one YAML document, got a second", _line(event))
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        problem = " ".join(str(getattr(error, "problem", None) or getattr(error, "reason", None) or error).split())
        raise FormatError(path, f"not valid YAML: {problem}", mark.line + 1 if mark else None) from None
    return root[0] if root else None


class _Container:
    """A list or mapping that is being filled."""

    __slots__ = ("content", "key", "wants_key")

    def __init__(self, content: dict[str, Data] | list[Data]) -> None:
        self.content = content
        self.key = ""
        self.wants_key = isinstance(content, dict)

    def put(self, value: Data) -> None:
        if isinstance(self.content, dict):
            self.content[self.key] = value
            self.wants_key = True
        else:
            self.content.append(value)


def _take_key(top: _Container, event: object, path: Path) -> None:
    key: str = event.value  # type: ignore[attr-defined]  # a ScalarEvent; yaml is imported late
    if key in top.content:
        raise FormatError(path, f"expected each key once, got {key[:60]!r} twice in one mapping", _line(event))
    top.key, top.wants_key = key, False


def _check_plain(event: object, path: Path) -> None:
    tag, anchor = event.tag, event.anchor  # type: ignore[attr-defined]  # a NodeEvent; yaml is imported late
    if tag is not None and tag != "!":
        raise FormatError(path, f"expected no tags, got tag {tag[:60]!r}", _line(event))
    if anchor is not None:
        raise FormatError(path, f"expected no anchors and aliases, got anchor &{anchor[:60]}", _line(event))


def _check_room(stack: list[_Container], event: object, path: Path) -> None:
    if stack[-1].wants_key:
        raise FormatError(path, "expected a text as a key, got a list or mapping", _line(event))
    if len(stack) > MAX_DEPTH:
        raise FormatError(path, f"expected at most {MAX_DEPTH} levels of nesting, got more", _line(event))


def _line(event: object) -> int:
    return int(event.start_mark.line) + 1  # type: ignore[attr-defined]  # any yaml event; yaml is imported late


def _scalar(text: str) -> Data:
    if _INTEGER.fullmatch(text):
        return int(text) if len(text) < 400 else float(text)  # float's range ends at 309 digits
    if _FLOAT.fullmatch(text):
        return float(text)
    return _WORDS.get(text, text)


FEWEST = 100
"""Lines from which on it is worth while."""

PLACE = "trailmark-rows-are-here"

_BLOCK = re.compile(r"^obstacles:[ ]*\n((?:  - \{[a-z0-9_:.,+\- \[\]eE]{1,4096}\}\n)+)", re.MULTILINE)
_NESTED = re.compile(r"\[ *\[ *\[ *\[ *\[ *\[ *\[ *\[")  # nesting, and numbers, that the two languages treat otherwise
_DIGITS = re.compile(r"[0-9]{300}")
_KEYS = ("shape", "center", "radius", "length", "width", "heading", "vertices", "holes", "id")  # no mappings inside
_WORD = re.compile(r'": (?!true\b|false\b|null\b)([a-z_][a-z0-9_-]*)(?=[,}])')


def with_rows(text: str, parse: Callable[[str], Data]) -> Data:
    """Return what ``parse`` makes of a YAML text, the rows of its obstacles read in a shorter way where that can be."""
    found = _BLOCK.search(text)
    if found is None or found[1].count("\n") < FEWEST or PLACE in text:
        return parse(text)
    rows = _rows(found[1])
    if rows is None:
        return parse(text)
    try:
        data: Any = parse(f"{text[: found.start(1)]}  - {PLACE}\n{text[found.end(1) :]}")
    except FormatError:
        # Once more, for the right number of the line.
        return parse(text)
    # It may be part of a text that only looks like a list.
    listed = data.get("obstacles") if isinstance(data, dict) else None
    if not (isinstance(listed, list) and listed and listed[0] == PLACE and PLACE not in listed[1:]):
        return parse(text)
    data["obstacles"] = rows + listed[1:]
    return data  # type: ignore[no-any-return]  # as parse returned it


def _rows(block: str) -> list[Data] | None:
    """Return the rows of lines ``  - {key: value, ...}``; None if they are no JSON but for their quotes."""
    if _NESTED.search(block) or (max(map(len, block.split("\n"))) >= 300 and _DIGITS.search(block)):
        return None
    lines = block.replace("\n  - {", ",\n{")[4:]
    # Each of these passes takes a hundredth of what one with a regular expression does.
    for key in [key for key in _KEYS if f"{key}: " in lines]:
        lines = lines.replace(f"{{{key}: ", f'{{"{key}": ').replace(f" {key}: ", f' "{key}": ')
    for shape in [shape for shape in ("disc", "rectangle", "polygon") if shape in lines]:
        lines = lines.replace(f'"shape": {shape}', f'"shape": "{shape}"')
    if '"id": ' in lines:
        lines = _WORD.sub(r'": "\1"', lines)
    try:
        rows: list[Any] = json.loads(f"[{lines}]")
    except (ValueError, RecursionError):
        return None
    # Repeated keys are YAML's to refuse.
    return rows if sum(map(len, rows)) == lines.count('": ') else None
