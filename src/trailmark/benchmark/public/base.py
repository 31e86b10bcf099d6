"""PublicSuite: what a public set has to tell, and how a part of it is chosen."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import NamedTuple, TypeVar

from trailmark.benchmark.errors import SuiteError
from trailmark.world import Robot, World

__all__ = ["Found", "PublicSuite", "evenly", "files_below", "in_order"]

T = TypeVar("T")


class Found(NamedTuple):
    """What lies in a folder: problems, each a file and a number within it, and lines that tell what is left out."""

    problems: Sequence[tuple[Path, int]]
    left_out: Sequence[str] = ()


@dataclass(frozen=True)
class PublicSuite:
    """A public set of problems.

    Attributes:
        name: as ``--suite`` takes it.
        contents: what it holds, in a line.
        published: where, in a line; empty for what is made by trailmark itself.
        robot: who plans by default, in words.
        expected: what its folder holds, for messages.
        find: returns the problems of a folder and of all folders below it.
        world: returns the world of a file that ``find`` named with its robot, and some of its problems as queries; it
            takes the folder, the file, the problems' numbers, and a robot instead of the set's own.
    """

    name: str
    contents: str
    published: str
    robot: str
    expected: str
    find: Callable[[Path], Found]
    world: Callable[[Path, Path, Sequence[int], Robot | None], World]

    def folder(self, given: str | None) -> Path:
        """Return the folder in which the data lies.

        Raises:
            SuiteError: none is given for a suite that needs one, one is given for a suite that is made, or it is none.
        """
        if not self.published:
            if given is not None:
                raise SuiteError(f"suite {self.name}: expected no --data, for its worlds are made, got {given!r}")
            return Path()
        if given is None:
            raise SuiteError(f"suite {self.name}: --data is missing; expected a folder with {self.expected}")
        with suppress(OSError):  # no folder can have that name
            if Path(given).is_dir():
                return Path(given)
        raise SuiteError(f"--data: expected a folder with {self.expected}, got {given!r}")

    def worlds(self, folder: Path, found: Found, count: int | None, robot: Robot | None) -> Iterator[World]:
        """Yield worlds with ``count`` of the problems, spread evenly over all; with every one if it is None.

        Raises:
            SuiteError: there is none.
            TrailmarkError: a file that cannot be read.
        """
        if not found.problems:
            raise SuiteError(f"{folder}: suite {self.name}: expected {self.expected}, got none of it")
        chosen = evenly(found.problems, count)
        for file, group in groupby(chosen, key=lambda problem: problem[0]):
            yield self.world(folder, file, [number for _, number in group], robot)


def evenly(items: Sequence[T], count: int | None) -> list[T]:
    """Return ``count`` of the items, spread evenly, in their order; all if there are no more, or for None."""
    if count is None or count >= len(items):
        return list(items)
    return [items[(2 * i + 1) * len(items) // (2 * count)] for i in range(count)]


def files_below(folder: Path, *suffixes: str) -> list[Path]:
    """Return the files of a folder and of all below it whose names end so, numbers in order of their value."""
    found = [file for file in folder.rglob("*") if file.name.lower().endswith(suffixes) and file.is_file()]
    return sorted(found, key=lambda file: in_order(file.relative_to(folder).as_posix()))


def in_order(name: str) -> list[tuple[int, str]]:
    """Return what sorts names so that 9 comes before 10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]
