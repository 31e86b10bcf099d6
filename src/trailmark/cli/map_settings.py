"""The file that ``trailmark map --settings`` takes: a YAML mapping of the settings that have no option."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from trailmark.estimation.map_settings import MapSettings

__all__ = ["MapFile", "read_map_settings"]

LOG_SETTINGS = ("corrected", "scan_topic", "odometry_topic")
"""What a reader of logs may be told under ``log``; see :func:`trailmark.estimation.load_log`."""


class MapFile(NamedTuple):
    """What a settings file says."""

    settings: MapSettings
    log: dict[str, Any]
    """How the log is read, by the names of :func:`trailmark.estimation.load_log`."""


def read_map_settings(file: str | None) -> MapFile:
    """Return the settings in a YAML file: nested mappings by the names of :class:`trailmark.estimation.MapSettings`.

    What the file leaves out keeps its default. Under ``log`` it may say how the log is read.

    Raises:
        FormatError: a file that cannot be read, an unknown name, a value that is not allowed.
    """
    from trailmark.errors import FormatError
    from trailmark.estimation.errors import EstimationError
    from trailmark.estimation.map_settings import MapSettings

    if file is None:
        return MapFile(MapSettings(), {})
    import yaml

    from trailmark.formats.files import read_text

    path = Path(file)
    text = read_text(path)
    try:
        given: Any = yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise FormatError(path, f"expected YAML, got {' '.join(str(error).split())}") from None
    try:
        log = _mapping(given, "").pop("log", None)
        log = {} if log is None else _known(_mapping(log, "log."), LOG_SETTINGS, "log.")
        return MapFile(_changed(MapSettings(), {name: given[name] for name in given if name != "log"}, "", "log"), log)
    except EstimationError as error:
        raise FormatError(path, str(error)) from None


def _changed(settings: Any, given: Any, place: str, *more: str) -> Any:
    """Return settings, or a part of them, with the values of a mapping; ``more`` names what else may be there."""
    names = [field.name for field in fields(settings) if field.init]
    values = _known(_mapping(given, place), (*names, *more), place)
    for name, value in values.items():
        part = getattr(settings, name)
        if is_dataclass(part):
            values[name] = _changed(part, value, f"{place}{name}.")
    return replace(settings, **values)


def _mapping(given: Any, place: str) -> dict[Any, Any]:
    from trailmark.estimation.errors import EstimationError

    if not isinstance(given, dict):
        what = f"{place.rstrip('.')}: " if place else ""
        raise EstimationError(f"{what}expected lines 'name: value', got {type(given).__name__}")
    return dict(given)


def _known(given: dict[Any, Any], names: tuple[str, ...], place: str) -> dict[str, Any]:
    from trailmark.errors import expected_name
    from trailmark.estimation.errors import EstimationError

    for name in given:
        if name not in names:
            raise EstimationError(f"setting {place}{name}: {expected_name(str(name), names)}")
    return given
