"""What ``trailmark benchmark`` runs on: worlds by name, the worlds of a suite's file, or a public suite's."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from trailmark.cli import console
from trailmark.cli.options import UsageError, grown_for, load_world, read_robot, steered

if TYPE_CHECKING:
    from trailmark.benchmark.problems import Problem
    from trailmark.benchmark.public.base import PublicSuite
    from trailmark.benchmark.suites import Suite
    from trailmark.world import Robot, World

__all__ = ["Wanted", "posed_problems", "print_suites", "read_source"]

Public = tuple["PublicSuite", Path]
"""A public suite and the folder with its files."""


@dataclass(frozen=True)
class Wanted:
    """What the options say about problems.

    Attributes:
        robot: instead of the worlds' own.
        turning_radius: metres, instead of the robot's own.
        forward_only: whether a car, or a differential drive, only drives forwards.
        drive: instead of the robot's own.
        queries: their names; all if empty.
        count: how many problems, spread evenly; all if it is None.
    """

    robot: Robot | None = None
    turning_radius: float | None = None
    forward_only: bool = False
    drive: str | None = None
    queries: tuple[str, ...] = ()
    count: int | None = None

    def driven(self, robot: Robot) -> Robot:
        """Return the robot with the drive and turning radius that the options say."""
        return steered(robot, self.turning_radius, self.forward_only, self.drive)

    def posed(self, world: World, robot: Robot | None, queries: Sequence[str]) -> Iterator[Problem]:
        """Return a world's problems for a robot, or else the world's own."""
        from trailmark.benchmark.problems import problems_of

        if robot := robot or world.robot:
            robot = self.driven(robot)
            world = grown_for(world, robot)
        return problems_of(world, robot, queries)


def read_source(suite: str | None, data: str | None) -> tuple[Suite | None, Public | None]:
    """Return the suite that ``--suite`` and ``--data`` give: that of a file, or a public one; neither without them.

    Raises:
        UsageError: ``--data`` without a public suite.
        TrailmarkError: no such suite, file or folder.
    """
    from trailmark.benchmark.public.catalogue import PUBLIC, folder_of
    from trailmark.benchmark.suites import read_suite
    from trailmark.errors import expected_name

    if suite in PUBLIC:
        return None, (PUBLIC[suite], folder_of(PUBLIC[suite], data))
    if data is not None:
        raise UsageError(f"--data {data!r} given with --suite {suite!r}; expected --suite {', '.join(PUBLIC)}")
    if suite is None:
        return None, None
    if not Path(suite).suffix and not Path(suite).exists():
        raise UsageError(f"--suite: {expected_name(suite, PUBLIC)}, or a file")
    return read_suite(Path(suite)), None


def print_suites() -> None:
    """Print the public suites: what each holds, who plans in it, what its folder holds and where it is published."""
    from trailmark.benchmark.public.catalogue import PUBLIC

    for suite in PUBLIC.values():
        console.say(suite.name)
        console.say(f"  {suite.contents}")
        console.say(f"  robot: {suite.robot}")
        if suite.published:
            console.say(f"  --data: a folder with {suite.expected}")
            console.say(f"  published: {suite.published}")
        else:
            console.say("  made by trailmark from seeds, no --data")


def posed_problems(worlds: list[str], suite: Suite | None, public: Public | None, wanted: Wanted) -> list[Problem]:
    """Return the problems that the words and the suite name, each once.

    Args:
        worlds: files or names.
        suite: of a file.
        public: a public suite and its folder.
        wanted: what the options say.

    Raises:
        UsageError: no world is named.
    """
    from trailmark.benchmark.public.base import evenly
    from trailmark.library import shipped_worlds

    found = [problem for text in worlds for problem in wanted.posed(load_world(text), wanted.robot, wanted.queries)]
    for entry in suite.entries if suite is not None else ():
        if entry.missing:
            console.note(f"left out, for it is not there: {entry.world}")
            continue
        world = load_world(entry.world)
        names = [*entry.names, *(query.name for query in entry.queries)]
        world = replace(world, queries=(*entry.queries, *world.queries))
        found += wanted.posed(world, wanted.robot or read_robot(entry.robot), wanted.queries or names)
    if public is not None:
        found += _public(*public, wanted)
    if not found:
        raise UsageError(f"no world given; expected files, or {', '.join(shipped_worlds())}, or --suite NAME")
    return evenly(list({problem.key: problem for problem in found}.values()), wanted.count)


def _public(suite: PublicSuite, folder: Path, wanted: Wanted) -> list[Problem]:
    there = suite.find(folder)
    for line in there.left_out:
        console.note(f"left out: {line}")
    # Queries are chosen by name among all, for a name is no place in the spread.
    count = None if wanted.queries else wanted.count
    robot = None if wanted.robot is None else wanted.driven(wanted.robot)
    found: list[Problem] = []
    for world in suite.worlds(folder, there, count, robot):
        names = [query.name for query in world.queries if query.name in wanted.queries]
        if names or not wanted.queries:
            found += wanted.posed(world, robot, names)
    if not found:
        raise UsageError(f"--query: expected a query of suite {suite.name}, got {', '.join(wanted.queries)}")
    console.note(f"suite {suite.name}: {len(found):,} of {len(there.problems):,} problems")
    return found
