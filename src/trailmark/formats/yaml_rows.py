"""Long lists of obstacles in world files, one a line as trailmark writes them, read as JSON: a tenth of YAML's time.

Lines that are simple enough for both languages to say the same are taken out before the rest is read as YAML, and put
back where a word in their place says. Anything else is left to YAML.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from typing import Any

from trailmark.errors import FormatError
from trailmark.formats.yaml_data import Data

__all__ = ["with_rows"]

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
