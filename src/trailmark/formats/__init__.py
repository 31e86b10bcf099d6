"""File formats: worlds in trailmark YAML, nav2, MovingAI, OMPL.app and ARiADNE form; paths as JSON, CSV and plain rows.

A world file's format is recognised by its content, never by its name. Only the modules that a file needs are imported.
"""

from __future__ import annotations

import re
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from trailmark.errors import ConfigurationError, FormatError, ShapeError, WorldError

if TYPE_CHECKING:
    from trailmark.world import Robot, World

__all__ = ["load_world", "save_world", "world_json_schema"]

FORMATS = (
    "expected trailmark YAML (key 'trailmark'), nav2 map YAML (key 'image'), MovingAI map "
    "(first line 'type octile'), OMPL.app cfg (section [problem]), PNG grid with a start"
)


def load_world(path: FilePath, robot: Robot | None = None) -> World:
    """Read a world from a file.

    Args:
        path: trailmark YAML (schema version 1), nav2 map YAML, MovingAI ``.map`` (its ``.scen`` beside it gives
            the queries), OMPL.app ``.cfg``, or a PNG grid in which a block marks the start of an exploration.
        robot: the robot to plan for, in place of the one that the file names.

    Raises:
        FormatError: the file is missing, unreadable, too large (see :mod:`trailmark.formats.files` and
            :mod:`trailmark.formats.grid` for the limits), of no known format, or breaks its format's rules.
    """
    from trailmark.formats.files import read_bytes

    data = read_bytes(path)
    try:
        world = _read(data, path)
    except (ShapeError, WorldError, ConfigurationError) as error:
        raise FormatError(path, str(error)) from None
    return world if robot is None else world.with_robot(robot)


def save_world(world: World, path: FilePath) -> None:
    """Write a world as trailmark YAML (schema version 1), whole or not at all.

    Loading the file gives an equal world: every number is written with all its digits.

    Raises:
        OutputError: the path cannot be written, or is a file in another format that the world was read from.
    """
    from trailmark.formats.files import require_not_an_input, write_atomically
    from trailmark.formats.world_yaml import world_text

    require_not_an_input(path, (source for source in world.sources if not _is_world_file(source)))
    write_atomically(path, world_text(world))


def world_json_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of the world file, with which editors complete and check it."""
    from trailmark.formats.schema import WorldFile

    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **WorldFile.model_json_schema()}


def _is_world_file(path: FilePath) -> bool:
    """Return whether a file is a trailmark world file, as far as its keys tell."""
    try:
        with path.open("rb") as file:
            return re.search(rb"^trailmark[ \t]*:[ \t]*1[ \t]*(?:#.*)?\r?$", file.read(2**16), re.MULTILINE) is not None
    except (OSError, ValueError):
        return False


def _read(data: bytes, path: FilePath) -> World:
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        from trailmark.formats.png_grid import read_png_grid

        return read_png_grid(path)

    from trailmark.formats.files import text_of

    text = text_of(data, path, FORMATS)
    if re.match(r"\s*type[ \t]", text):
        from trailmark.formats.movingai import read_movingai

        return read_movingai(text, path)
    if re.match(r"(?:[ \t]*(?:[#;].*)?\r?\n)*[ \t]*\[[\w. -]+\][ \t]*(?:[#;].*)?\r?(?:\n|$)", text):
        from trailmark.formats.omplapp import read_cfg

        return read_cfg(text, path)

    from trailmark.formats.yaml_data import parse_yaml, with_rows

    fields = with_rows(text, lambda part: parse_yaml(part, path))
    if not isinstance(fields, dict):
        raise FormatError(path, f"no world: neither a YAML mapping nor another known format; {FORMATS}")
    if "trailmark" in fields:
        from trailmark.formats.world_yaml import world_from_data

        return world_from_data(fields, path)
    if "image" in fields:
        from trailmark.formats.nav2_map import read_nav2_map

        return read_nav2_map(fields, path)
    hint = "add the line 'trailmark: 1'; " if "bounds" in fields else ""
    raise FormatError(path, f"no world: the YAML mapping has neither 'trailmark' nor 'image'; {hint}{FORMATS}")
