"""Suite: worlds, planners and limits as data, in a YAML file."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from trailmark.errors import FormatError
from trailmark.formats.files import read_text
from trailmark.formats.schema import Count, Positive, Text, validate
from trailmark.formats.yaml_data import parse_yaml
from trailmark.world import Query
from trailmark.world.world_file import query_from_data

__all__ = ["Entry", "Suite", "read_suite"]

DATA = "data:"
"""Begins the name of a world that lies in the folder of real data."""


class Entry(NamedTuple):
    """A world of a suite.

    Attributes:
        world: a shipped world's name, or a file.
        optional: whether the suite goes on without it where the file is not there: the real data is not everywhere.
        robot: instead of the world's own, as ``--robot`` takes it.
        names: of its queries; all if both are empty.
        queries: further ones.
    """

    world: str
    optional: bool
    robot: str | None
    names: tuple[str, ...]
    queries: tuple[Query, ...]

    @property
    def missing(self) -> bool:
        """Whether to go on without it."""
        return self.optional and not Path(self.world).exists()


class Suite(NamedTuple):
    """What to benchmark: worlds, planners as for ``-p``; seconds and MB a run; None where the suite says nothing."""

    entries: tuple[Entry, ...]
    planners: tuple[str, ...]
    runs: int | None = None
    time_limit: float | None = None
    memory_limit: int | None = None


def _or_name(key: str) -> BeforeValidator:
    """Return what takes a text for a mapping with this key alone."""
    return BeforeValidator(lambda value: {key: value} if isinstance(value, str) else value)


class _World(BaseModel):
    model_config = ConfigDict(extra="forbid")

    world: Text
    robot: Text | None = None
    queries: list[Annotated[dict[str, Any], _or_name("name")]] = []


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid")

    planners: list[Text] = []
    runs: Count | None = None
    time_limit: Positive | None = None
    memory_limit: Count | None = None
    data: Text = "."
    worlds: Annotated[list[Annotated[_World, _or_name("world")]], Field(min_length=1)]


def read_suite(path: Path) -> Suite:
    """Return the suite that a file describes.

    ``worlds`` is a list of names or of mappings with ``world``, ``robot`` and ``queries``; the queries are names, or
    what a world file has. A world ``data:FILE`` lies in the folder TRAILMARK_DATA, else in the one that ``data`` names
    (relative to the suite), and is left out where it is not there.

    Raises:
        FormatError: the file cannot be read, is no YAML, or does not describe a suite.
    """
    content = parse_yaml(read_text(path), path)
    if not isinstance(content, dict):
        raise FormatError(path, f"expected a mapping with {', '.join(_File.model_fields)}, got {content!r}")
    file = validate(_File, content, path)
    folder = Path(os.environ.get("TRAILMARK_DATA", path.parent / file.data))
    entries = tuple(_entry(item, f"{path}: worlds[{i}]", path.parent, folder) for i, item in enumerate(file.worlds))
    return Suite(entries, tuple(file.planners), file.runs, file.time_limit, file.memory_limit)


def _entry(item: _World, where: str, here: Path, folder: Path) -> Entry:
    world, optional = item.world, item.world.startswith(DATA)
    if optional:
        world = str(folder / world.removeprefix(DATA))
    else:
        with suppress(OSError):  # no file can have that name: it is too long
            world = str(here / world) if (here / world).is_file() else world
    names = tuple(str(query["name"]) for query in item.queries if [*query] == ["name"])
    queries = tuple(query_from_data(query, f"{where}: queries") for query in item.queries if [*query] != ["name"])
    return Entry(world, optional, item.robot, names, queries)
