"""trailmark's own world file as text, YAML that people write and read; its content: trailmark.world.world_file."""

from __future__ import annotations

import re
from typing import Any

from trailmark.errors import OutputError

__all__ = ["HEADER", "yaml_text"]

HEADER = "# A trailmark world. Metres and radians; y up, theta counter-clockwise; configurations are [x, y, theta].\n"
_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*(?: [A-Za-z0-9_.-]+)*")
_LISTS = frozenset(("obstacles", "zones", "queries"))  # one line for each entry
# Words that YAML readers of any version take for something other than text.
_RESERVED = frozenset(("null", "true", "false", "yes", "no", "on", "off", "y", "n"))


def yaml_text(data: dict[str, Any]) -> str:
    """Return a world file's content (mappings, lists, texts and numbers) as its text.

    Raises:
        OutputError: a name that UTF-8 cannot hold.
    """
    lines = list[str]()
    for key, value in data.items():
        if key in _LISTS:
            lines += [f"{key}:", *(f"  - {_flow(entry)}" for entry in value)]
        else:
            lines.append(f"{key}: {_flow(value)}")
    return HEADER + "\n".join(lines) + "\n"


def _flow(value: Any) -> str:
    """Return plain data in YAML's flow style."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key}: {_flow(part)}' for key, part in value.items())}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_flow, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return _text(value)
    return str(value) if isinstance(value, int) else _number(value)


def _number(value: float) -> str:
    digits = repr(float(value))
    mantissa, e, exponent = digits.partition("e")
    # Readers of YAML 1.1 take 1e-05 for a text, but 1.0e-05 for a number.
    return f"{mantissa}.0e{exponent}" if e and "." not in mantissa else digits


def _text(text: str) -> str:
    if _PLAIN.fullmatch(text) and text.lower() not in _RESERVED:
        return text
    import yaml

    try:
        text.encode()
    except UnicodeEncodeError:
        raise OutputError(f"name: expected a text that UTF-8 can hold, got {text!r}") from None
    quoted: str = yaml.safe_dump(text, default_style='"', width=1 << 30, allow_unicode=True)
    return quoted.rstrip("\n")
