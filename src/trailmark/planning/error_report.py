"""Reports of trailmark's own errors: what turned out wrong is not returned, but kept in a file that reproduces it."""

from __future__ import annotations

import json
import os
import tempfile
import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from trailmark.errors import InternalErrorWarning
from trailmark.formats.world_yaml import world_text
from trailmark.se2 import FloatArray
from trailmark.world import Query, Robot, World

__all__ = ["report_error"]


def report_error(problem: str, world: World, robot: Robot, start: FloatArray, goal: FloatArray, **details: Any) -> None:
    """Warn of an error of trailmark's own, and leave a world file in the temporary folder that reproduces it.

    The file holds the robot and the query ``failed``; ``trailmark plan FILE --seed N`` asks for it again.

    Args:
        problem: what is wrong, in one line.
        world: obstacles, bounds, boundary.
        robot: footprint.
        start: configuration, shape (3,).
        goal: configuration, shape (3,).
        details: plain values that belong to it, such as seed and states; they are written as comments.

    Warns:
        InternalErrorWarning: the problem, and where the file is.
    """
    where = _written(problem, world, robot, start, goal, details)
    warnings.warn(f"{problem}; not returned. To report it: {where}", InternalErrorWarning, stacklevel=2)


def _written(
    problem: str, world: World, robot: Robot, start: FloatArray, goal: FloatArray, details: Mapping[str, Any]
) -> str:
    """Return the name of the file that reproduces an error, or why there is none."""
    from trailmark import __version__

    failed = Query("failed", tuple(map(float, start)), tuple(map(float, goal)))  # type: ignore[arg-type]  # three each
    text = world_text(replace(world, robot=robot, queries=(failed,)))
    notes = {"trailmark": __version__, "problem": problem, **details}
    head = "".join(f"# {key}: {json.dumps(value)}\n" for key, value in notes.items())
    try:
        handle, name = tempfile.mkstemp(prefix="trailmark-internal-error-", suffix=".yaml")
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(head + text)
    except OSError as error:
        return f"no file ({error.strerror or error})"
    return name
