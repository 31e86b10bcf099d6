"""``trailmark benchmark``: planners on problems, run by run, into a results database."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from trailmark.cli import console, options
from trailmark.cli.options import UsageError, argument, flag, option

if TYPE_CHECKING:
    from trailmark.benchmark.problems import Problem
    from trailmark.benchmark.public.base import PublicSuite
    from trailmark.benchmark.results import Results
    from trailmark.benchmark.runner import Benchmark, Tally
    from trailmark.benchmark.suites import Suite
    from trailmark.world import Robot, World

__all__ = ["benchmark"]

DEFAULTS: dict[str, Any] = {"runs": 10, "time_limit": 1.0, "memory_limit": 4096}
MANY, MEGABYTES = options.Count(low=1, high=1_000_000), options.Count("MB", low=1, high=2**30)

Public = tuple["PublicSuite", Path]
"""A public suite and the folder with its files."""


def benchmark(
    worlds: Annotated[list[str] | None, argument("WORLD", "World files or names of shipped worlds.")] = None,
    planners: Annotated[
        list[str] | None,
        option(
            options.NAME,
            "landmark, roadmap, roadmap-uniform, lattice, paper, a planner of OMPL (PRM, RRTstar, …), PRM+certified "
            "(with certified motions), native:PRM (in C++), module:function (your own), or all. Parameters "
            "follow a colon: RRTConnect:range=2. Repeat it for several.",
            "-p",
            "--planner",
        ),
    ] = None,
    output: Annotated[
        Path | None, option(options.OutputFile(metavar="RESULTS.db"), "Results database to create or add to.")
    ] = None,
    runs: Annotated[int | None, option(MANY, "Runs of each planner on each problem; default: 10.")] = None,
    time_limit: Annotated[float | None, option(options.SECONDS, "Planning time of a run; default: 1.0.")] = None,
    memory_limit: Annotated[int | None, option(MEGABYTES, "Memory limit of a run; default: 4096.")] = None,
    seed: Annotated[
        int, option(options.Count(high=2**31 - 1), "Seed of the first run, plus 1 for each further run.")
    ] = 0,
    workers: Annotated[
        int | None, option(options.Count(low=1, high=1024), "Parallel runs on this machine; default: 1.")
    ] = None,
    scheduler: Annotated[
        str | None, option(options.Kind("ADDRESS"), "Run on the Dask cluster at this address.")
    ] = None,
    as_json: options.JsonOption = False,
    query: Annotated[
        list[str] | None,
        option(options.NAME, "Query of the worlds; default: all. Repeat it for several.", group="Problems"),
    ] = None,
    start: Annotated[
        options.Pose | None, option(options.POSE, "Start pose of one problem in each world.", group="Problems")
    ] = None,
    goal: Annotated[options.Pose | None, option(options.POSE, "Goal pose of that problem.", group="Problems")] = None,
    suite: Annotated[
        str | None,
        option(
            options.NAME, "Public suite (see --list-suites), or file of worlds, planners and limits.", group="Problems"
        ),
    ] = None,
    data: Annotated[
        str | None, option(options.Kind("DIR"), "Folder with the files of the public suite.", group="Problems")
    ] = None,
    count: Annotated[
        int | None,
        option(MANY, "Number of problems, spread evenly over the suite; default: all.", "--problems", group="Problems"),
    ] = None,
    list_suites: Annotated[
        bool, flag("--list-suites", "List the public suites and their sources.", "Problems")
    ] = False,
    robot: options.RobotOption = None,
    drive: options.DriveOption = None,
    turning_radius: options.TurningRadiusOption = None,
    forward_only: options.ForwardOnlyOption = False,
    clearance: Annotated[
        float,
        option(
            options.CLEARANCE,
            "Minimum clearance to obstacles and bounds: part of the problem, which every planner and the referee get. "
            "Not for native planners.",
            group="Robot",
        ),
    ] = 0.0,
    resolution: Annotated[
        float | None,
        option(
            options.METRES,
            "Spacing of the states that OMPL's discrete motion validation checks; default: 10 % of the robot's "
            "inscribed radius, native planners 5 %.",
            group="Robot",
        ),
    ] = None,
) -> None:
    """Run planners on problems and store every result in a database.

    Each run has its own process; only planning time counts, not set-up. The same command again makes the missing
    runs. Read the results with 'trailmark report' or Planner Arena.
    """
    from trailmark.benchmark.planners import NATIVE, read_planners
    from trailmark.benchmark.runner import Benchmark
    from trailmark.benchmark.store import Store
    from trailmark.benchmark.workers import cluster, local

    if list_suites:
        _print_suites()
        return
    if (start is None) != (goal is None) or (start is not None and (query or suite)):
        raise UsageError("expected --start and --goal together, without --query and --suite, got others")
    if workers is not None and scheduler is not None:
        raise UsageError("expected --workers or --scheduler, got both")
    if output is None:
        raise UsageError("--output is missing; expected --output RESULTS.db")
    given, public = _read_source(suite, data)
    with console.progress("loading worlds"):
        ends = None if start is None or goal is None else (start, goal)
        body = options.RobotOptions(robot, turning_radius, forward_only, drive)
        wanted = Wanted(body, tuple(query or ()), count, ends, clearance)
        problems = _posed_problems(worlds or [], given, public, wanted)
        chosen = read_planners(
            planners or (list(given.planners) if given else []),
            cars=any(problem.steering is not None for problem in problems),
        )
        if clearance and (native := [name for name in chosen if name.startswith(NATIVE)]):
            raise UsageError(f"--clearance given with {native[0]}, which keeps none; expected planners from Python")
        plan = Benchmark(
            problems=problems,
            planners=chosen,
            runs=_setting(runs, given, "runs", MANY),
            time_limit=_setting(time_limit, given, "time_limit", options.SECONDS),
            memory_limit=_setting(memory_limit, given, "memory_limit", MEGABYTES),
            seed=seed,
            resolution=resolution,
        )
    read = [source for problem in problems for source in problem.world.sources] + (
        [Path(suite)] if given and suite else []
    )
    options.protect_inputs(read, output)
    # The scheduler first: if it does not answer, no database is made.
    with local(workers or 1) if scheduler is None else cluster(scheduler) as pool, Store(output) as store:
        tally = _run(plan, store, pool, output)
    _print(tally, output, plan.planners, as_json=as_json)


def _setting(option: Any, suite: Suite | None, name: str, kind: options.Kind) -> Any:
    """Return what the option says, else the suite's file, else the default."""
    told = None if suite is None else getattr(suite, name)
    return option if option is not None else DEFAULTS[name] if told is None else kind(str(told), name)


def _run(plan: Benchmark, store: Any, pool: Any, file: Path) -> Tally:
    last: list[Tally] = []
    with console.progress("starting workers") as progress:

        def follow(tally: Tally) -> None:
            last[:] = [tally]
            progress.phase, progress.done = tally.latest or progress.phase, (tally.done, tally.total)
            progress.details = [f"{tally.left:.0f} s left"] if tally.made and tally.left is not None else []
            progress.details += [f"{tally.failed} unsolved"] if tally.failed else []

        try:
            return plan.run(store, pool, follow)
        except KeyboardInterrupt:
            if last:
                typer.echo(
                    f"{last[0].done} of {last[0].total} runs are in {file}; the same command makes the others", err=True
                )
            raise


def _print(tally: Tally, file: Path, planners: Sequence[str], *, as_json: bool) -> None:
    from trailmark.benchmark.results import load_results

    if as_json:
        record = {"database": str(file), "runs": tally.total, "made": tally.made, "without_solution": tally.failed}
        console.say(console.json_text(record))
        return
    before = tally.total - tally.made
    there = f", {before:,} already there" if before else ""
    console.say(f"{tally.made:,} runs made, {tally.failed:,} of them without a correct solution{there}")
    print_results(load_results(file), planners)
    console.say(f"written: {file}")


def print_results(results: Results, planners: Sequence[str]) -> None:
    """Print a row for each planner, and why its runs failed."""
    from trailmark.benchmark.report import failures, summary

    console.print_table(summary(results, planners), indent="  ")
    for name, endings, reasons in failures(results, planners):
        console.say(f"{name}: {endings}: {reasons}".removesuffix(": –"))


class Wanted(NamedTuple):
    """The options about problems: robot, names of queries (all if empty), number (all if None), ends, clearance."""

    robot: options.RobotOptions
    queries: tuple[str, ...]
    number: int | None
    ends: tuple[options.Pose, options.Pose] | None = None
    clearance: float = 0.0

    def load(self, text: str) -> World:
        """Return a world, with start and goal as its only query if they are given."""
        from trailmark.world import Query

        world = options.load_world(text)
        return world if self.ends is None else replace(world, queries=(Query("given", *self.ends),))

    def posed(self, world: World, robot: Robot | None, queries: Sequence[str]) -> Iterator[Problem]:
        """Return a world's problems for a robot, or else the world's own."""
        from trailmark.benchmark.problems import problems_of

        if robot := robot or world.robot:
            robot = self.robot.steered(robot)
            world, robot = options.grown_for(world, robot), robot.keeping(self.clearance)
        return problems_of(world, robot, queries)


def _read_source(suite: str | None, data: str | None) -> tuple[Suite | None, Public | None]:
    """Return the suite that ``--suite`` and ``--data`` give: that of a file, or a public one; neither without them."""
    from trailmark.benchmark.public import PUBLIC
    from trailmark.benchmark.suites import read_suite
    from trailmark.errors import expected_name

    if suite in PUBLIC:
        return None, (PUBLIC[suite], PUBLIC[suite].folder(data))
    if data is not None:
        raise UsageError(f"--data {data!r} given with --suite {suite!r}; expected --suite {', '.join(PUBLIC)}")
    if suite is None:
        return None, None
    if not Path(suite).suffix and not Path(suite).exists():
        raise UsageError(f"--suite: {expected_name(suite, PUBLIC)}, or a file")
    return read_suite(Path(suite)), None


def _print_suites() -> None:
    """Print each public suite with its contents, robot, expected folder and source."""
    from trailmark.benchmark.public import PUBLIC

    for suite in PUBLIC.values():
        console.say(suite.name)
        console.say(f"  {suite.contents}")
        console.say(f"  robot: {suite.robot}")
        if suite.published:
            console.say(f"  --data: a folder with {suite.expected}")
            console.say(f"  published: {suite.published}")
        else:
            console.say("  made by trailmark from seeds, no --data")


def _posed_problems(worlds: list[str], suite: Suite | None, public: Public | None, wanted: Wanted) -> list[Problem]:
    """Return the problems that the words and the suite name, each once.

    Args:
        worlds: files or names.
        suite: of a file.
        public: a public suite and its folder.
        wanted: the options.
    """
    from trailmark.benchmark.public.base import evenly
    from trailmark.world.library import shipped_worlds

    given = None if wanted.robot.spec is None else wanted.robot.spec.robot
    found = [problem for text in worlds for problem in wanted.posed(wanted.load(text), given, wanted.queries)]
    for entry in suite.entries if suite is not None else ():
        if entry.missing:
            console.note(f"skipped, not found: {entry.world}")
            continue
        world = options.load_world(entry.world)
        names = [*entry.names, *(query.name for query in entry.queries)]
        world = replace(world, queries=(*entry.queries, *world.queries))
        own = None if entry.robot is None else options.ROBOT(entry.robot, f"robot of {entry.world}").robot
        found += wanted.posed(world, given or own, wanted.queries or names)
    if public is not None:
        found += _public(*public, wanted)
    if not found:
        raise UsageError(f"no world given; expected files, or {', '.join(shipped_worlds())}, or --suite NAME")
    return evenly(list({problem.key: problem for problem in found}.values()), wanted.number)


def _public(suite: PublicSuite, folder: Path, wanted: Wanted) -> list[Problem]:
    there = suite.find(folder)
    for line in there.left_out:
        console.note(f"skipped: {line}")
    # Queries are chosen by name among all, for a name is no place in the spread.
    count = None if wanted.queries else wanted.number
    robot = None if wanted.robot.spec is None else wanted.robot.steered(wanted.robot.spec.robot)
    found: list[Problem] = []
    for world in suite.worlds(folder, there, count, robot):
        names = [query.name for query in world.queries if query.name in wanted.queries]
        if names or not wanted.queries:
            found += wanted.posed(world, robot, names)
    if not found:
        raise UsageError(f"--query: expected a query of suite {suite.name}, got {', '.join(wanted.queries)}")
    console.note(f"suite {suite.name}: {len(found):,} of {len(there.problems):,} problems")
    return found
