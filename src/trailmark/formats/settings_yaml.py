"""Settings as YAML: lines ``name: value`` by the names of a dataclass, nested where its fields are dataclasses."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from trailmark.errors import ConfigurationError, FormatError, TrailmarkError, expected_name
from trailmark.formats.yaml_data import Data, read_yaml

__all__ = ["read_settings"]

T = TypeVar("T")


def read_settings(path: Path, default: T, more: Mapping[str, Iterable[str]] | None = None) -> tuple[T, dict[str, Any]]:
    """Return settings with what a file says of them, and what it says of other things.

    Args:
        path: the file; what it leaves out keeps its default.
        default: a dataclass.
        more: other names that may be in the file, each with those that its mapping may hold, if that is what it is.

    Raises:
        FormatError: a file that cannot be read, an unknown name, a value that is not allowed.
    """
    others = more or {}
    try:
        given = _mapping(read_yaml(path), "")
        beside = {name: given.pop(name) for name in others if name in given}
        for name, names in others.items():
            if name in beside and (names := tuple(names)):
                beside[name] = _known(_mapping(beside[name], f"{name}."), names, f"{name}.")
        return _changed(default, given, "", *others), beside
    except FormatError:
        raise
    except TrailmarkError as error:
        raise FormatError(path, str(error)) from None


def _changed(settings: Any, given: Data, place: str, *more: str) -> Any:
    """Return settings, or a part of them, with the values of a mapping; ``more`` names what else may be there."""
    names = [field.name for field in fields(settings) if field.init]
    values: dict[str, Any] = _known(_mapping(given, place), (*names, *more), place)
    for name, value in values.items():
        if is_dataclass(part := getattr(settings, name)):
            values[name] = _changed(part, value, f"{place}{name}.")
    return replace(settings, **values)


def _mapping(given: Data, place: str) -> dict[str, Data]:
    if not isinstance(given, dict):
        what = f"{place.rstrip('.')}: " if place else ""
        raise ConfigurationError(f"{what}expected lines 'name: value', got {type(given).__name__}")
    return dict(given)


def _known(given: dict[str, Data], names: Iterable[str], place: str) -> dict[str, Data]:
    for name in given:
        if name not in names:
            raise ConfigurationError(f"setting {place}{name}: {expected_name(name, names)}")
    return given
