"""Safe YAML: text to plain dicts, lists, strings, numbers, booleans and None, and nothing else.

Scalars follow YAML 1.2's core schema, so that ``1e-05`` is a number and ``no`` a text. Tags, anchors, aliases and
a second document are refused, repeated keys too; nesting is bounded. So the work is linear in the size of the text.
"""

from __future__ import annotations

import re
from pathlib import Path

from trailmark.errors import FormatError
from trailmark.formats.files import read_text

__all__ = ["MAX_DEPTH", "Data", "parse_yaml", "read_yaml"]

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


def read_yaml(path: Path, allowed: str = "expected UTF-8 text") -> Data:
    """Return what a YAML file says; arguments are those of :func:`trailmark.formats.files.read_text`.

    Raises:
        FormatError: as that, and :func:`parse_yaml`.
    """
    return parse_yaml(read_text(path, allowed), path)


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
