"""Labels that distinguish experiments of one name by what they differ in."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any

__all__ = ["differences"]

_WORDS = {"time_limit": "limit {} s", "memory_limit": "{} MB", "resolution": "resolution {} m", "problem": "problem {}"}


def differences(experiments: Iterable[tuple[int, str, str | None]]) -> dict[int, str]:
    """Return for each experiment what sets it apart from others of its name; empty where the name alone does.

    Args:
        experiments: id, name, and the column ``setup``, whose ``identity`` tells problem and limits.
    """
    rows = [(key, name, _identity(setup)) for key, name, setup in experiments]
    alike: dict[str, list[Mapping[str, Any]]] = {}
    for _, name, own in rows:
        alike.setdefault(name, []).append(own)
    found: dict[int, str] = {}
    for key, name, own in rows:
        fields = [f for f in _WORDS if len({json.dumps(identity.get(f)) for identity in alike[name]}) > 1]
        words = ", ".join(_WORDS[f].format(_value(own.get(f))) for f in fields)
        same = sum(all(identity.get(f) == own.get(f) for f in _WORDS) for identity in alike[name])
        number = f"no. {key}" if same > 1 else ""
        found[key] = ", ".join(filter(None, [words, number]))
    return found


def _identity(setup: str | None) -> Mapping[str, Any]:
    try:
        data = json.loads(setup or "")["identity"]
    except (ValueError, KeyError, TypeError):
        return {}
    return data if isinstance(data, dict) else {}


def _value(value: object) -> str:
    return value[:8] if isinstance(value, str) else f"{value:g}" if isinstance(value, int | float) else "unknown"
