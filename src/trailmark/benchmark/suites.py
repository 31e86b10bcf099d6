"""Suite: worlds, planners and limits as data, in a YAML file."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trailmark.benchmark.errors import SuiteError
from trailmark.errors import TrailmarkError, expected_name
from trailmark.formats.files import read_text
from trailmark.formats.yaml_data import parse_yaml
from trailmark.world import Query

__all__ = ["Entry", "Suite", "read_suite"]

DATA = "data:"
"""Begins the name of a world that lies in the folder of real data."""

FIELDS = ("planners", "runs", "time_limit", "memory_limit", "data", "worlds")
ENTRY_FIELDS = ("world", "robot", "queries")


@dataclass(frozen=True)
class Entry:
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


@dataclass(frozen=True)
class Suite:
    """What to benchmark; the limits are None where the suite says nothing.

    Attributes:
        entries: worlds with their queries.
        planners: names as for ``-p``.
        runs: of each planner on each problem.
        time_limit: seconds a run.
        memory_limit: MB a run.
    """

    entries: tuple[Entry, ...]
    planners: tuple[str, ...]
    runs: int | float | None = None
    time_limit: int | float | None = None
    memory_limit: int | float | None = None


def read_suite(path: Path) -> Suite:
    """Return the suite that a file describes.

    ``worlds`` is a list of names or of mappings with ``world``, ``robot`` and ``queries``; the queries are names or
    mappings with ``name``, ``start`` and ``goal``. A world ``data:FILE`` lies in the folder TRAILMARK_DATA, else in
    the one that ``data`` names (relative to the suite), and is left out where it is not there.

    Raises:
        FormatError: the file cannot be read, or is no YAML.
        SuiteError: it does not describe a suite.
    """
    content = parse_yaml(read_text(path), path)
    data: dict[str, Any] = _mapping(content, FIELDS, str(path))
    if not isinstance(data.get("worlds"), list) or not data["worlds"]:
        raise SuiteError(f"{path}: worlds: expected a list of worlds, got {data.get('worlds')!r}")
    folder = Path(os.environ.get("TRAILMARK_DATA", path.parent / str(data.get("data", "."))))
    for name in ("runs", "time_limit", "memory_limit"):
        value = data.get(name)
        if value is not None and (isinstance(value, bool) or not isinstance(value, int | float)):
            raise SuiteError(f"{path}: {name}: expected a number, got {value!r}")
    return Suite(
        entries=tuple(
            _entry(item, f"{path}: worlds[{i}]", path.parent, folder) for i, item in enumerate(data["worlds"])
        ),
        planners=_texts(data.get("planners", []), f"{path}: planners"),
        runs=data.get("runs"),
        time_limit=data.get("time_limit"),
        memory_limit=data.get("memory_limit"),
    )


def _entry(item: Any, where: str, here: Path, folder: Path) -> Entry:
    given: dict[str, Any] = {"world": item} if isinstance(item, str) else _mapping(item, ENTRY_FIELDS, where)
    world, robot, wanted = given.get("world"), given.get("robot"), given.get("queries", [])
    if not isinstance(world, str):
        raise SuiteError(f"{where}: world: expected a file or a shipped world's name, got {world!r}")
    if robot is not None and not isinstance(robot, str):
        raise SuiteError(f"{where}: robot: expected text such as disc:0.2, got {robot!r}")
    if not isinstance(wanted, list):
        raise SuiteError(f"{where}: queries: expected a list of names or of name, start, goal, got {wanted!r}")
    optional = world.startswith(DATA)
    if optional:
        world = str(folder / world.removeprefix(DATA))
    else:
        with suppress(OSError):  # no file can have that name: it is too long
            world = str(here / world) if (here / world).is_file() else world
    return Entry(
        world=world,
        optional=optional,
        robot=robot,
        names=_texts([q for q in wanted if not isinstance(q, dict)], f"{where}: queries"),
        queries=tuple(_query(q, f"{where}: queries") for q in wanted if isinstance(q, dict)),
    )


def _query(item: dict[str, Any], where: str) -> Query:
    given = _mapping(item, ("name", "start", "goal"), where)
    try:
        return Query(str(given["name"]), given["start"], given["goal"])
    except KeyError as error:
        raise SuiteError(f"{where}: {error.args[0]} is missing; expected name, start, goal") from None
    except TrailmarkError as error:
        raise SuiteError(f"{where}: {error}") from None


def _mapping(item: Any, allowed: tuple[str, ...], where: str) -> dict[str, Any]:
    if not isinstance(item, dict):
        raise SuiteError(f"{where}: expected a mapping with {', '.join(allowed)}, got {item!r}")
    for name in item:
        if name not in allowed:
            raise SuiteError(f"{where}: {expected_name(str(name), allowed)}")
    return item


def _texts(items: Any, where: str) -> tuple[str, ...]:
    if not isinstance(items, list) or not all(isinstance(item, str) for item in items):
        raise SuiteError(f"{where}: expected a list of names, got {items!r}")
    return tuple(items)
