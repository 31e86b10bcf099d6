"""``trailmark benchmark``: planners on problems, run by run, into a results database."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trailmark.cli import console
from trailmark.cli.benchmark_problems import Wanted, posed_problems, print_suites, read_source
from trailmark.cli.options import (
    DriveOption,
    ForwardOnlyOption,
    JsonOption,
    RobotOption,
    TurningRadiusOption,
    UsageError,
    option,
    output_file,
    protect_inputs,
    read_count,
    read_duration,
    read_robot,
    read_turning_radius,
)

if TYPE_CHECKING:
    from trailmark.benchmark.resolution import Resolution
    from trailmark.benchmark.runner import Benchmark, Tally
    from trailmark.benchmark.suites import Suite

__all__ = ["benchmark"]

DEFAULTS = {"runs": "10", "time limit": "1.0", "memory limit": "4096"}


def benchmark(
    worlds: Annotated[
        list[str] | None,
        typer.Argument(metavar="WORLD", show_default=False, help="World files or names of shipped worlds."),
    ] = None,
    planners: Annotated[
        list[str] | None,
        option(
            "--planner",
            "NAME",
            "landmark, roadmap, roadmap-uniform, lattice, paper, one of OMPL's (PRM, RRTstar …), the same with "
            "certified motions (PRM+certified), native:NAME, module:function of your own, or all; parameters may "
            "follow (RRTConnect:range=2); repeat it for more.",
            "-p",
        ),
    ] = None,
    output: Annotated[str | None, option("--output", "RESULTS.db", "The results database; it is added to.")] = None,
    suite: Annotated[
        str | None,
        option("--suite", "NAME", "A public suite (see --list-suites), or a file with worlds, planners and limits."),
    ] = None,
    data: Annotated[str | None, option("--data", "DIR", "The folder with the public suite's files.")] = None,
    count: Annotated[
        str | None, option("--problems", "N", "So many problems, spread evenly over all; default: all.")
    ] = None,
    list_suites: Annotated[
        bool, typer.Option("--list-suites", help="List the public suites and where they are published, and do no more.")
    ] = False,
    runs: Annotated[str | None, option("--runs", "N", "Runs of each planner on each problem; default: 10.")] = None,
    time_limit: Annotated[
        str | None, option("--time-limit", "SECONDS", "Planning time of a run; default: 1.0.")
    ] = None,
    memory_limit: Annotated[
        str | None, option("--memory-limit", "MB", "Memory that a run may take; default: 4096.")
    ] = None,
    seed: Annotated[str | None, option("--seed", "N", "Seed of the first run; they count up; default: 0.")] = None,
    query: Annotated[list[str] | None, option("--query", "NAME", "A query of the worlds; default: all.")] = None,
    robot: RobotOption = None,
    turning_radius: TurningRadiusOption = None,
    forward_only: ForwardOnlyOption = False,
    drive: DriveOption = None,
    resolution: Annotated[
        str | None,
        option(
            "--resolution",
            "METRES|PERCENT%",
            "Distance between the states that OMPL's discrete motion validation checks, in metres or as a share of "
            "the robot's inscribed radius; default: 10%, native planners 5%.",
        ),
    ] = None,
    workers: Annotated[str | None, option("--workers", "N", "Runs at once on this machine; default: 1.")] = None,
    scheduler: Annotated[str | None, option("--scheduler", "ADDRESS", "Run on this Dask cluster instead.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Run planners on problems, each run in a process of its own, and keep every result.

    The same command again makes the runs that are missing. A run's time is planning alone: no start of a process, no
    set-up of world and checker.

    Read the results with 'trailmark report', Planner Arena or any SQLite program.
    """
    from trailmark.benchmark.planners import read_planners
    from trailmark.benchmark.runner import Benchmark
    from trailmark.benchmark.store import Store

    if list_suites:
        print_suites()
        return
    if workers is not None and scheduler is not None:
        raise UsageError(f"expected --workers or --scheduler, got both (--workers {workers!r})")
    if output is None:
        raise UsageError("--output is missing; expected --output RESULTS.db")
    given, public = read_source(suite, data)
    file = output_file(output, ())
    with console.progress("loading worlds"):
        wanted = Wanted(
            robot=read_robot(robot),
            turning_radius=read_turning_radius(turning_radius),
            forward_only=forward_only,
            drive=drive,
            queries=tuple(query or ()),
            count=None if count is None else read_count(count, "--problems", 1, 1_000_000),
        )
        problems = posed_problems(worlds or [], given, public, wanted)
        plan = Benchmark(
            problems=problems,
            planners=read_planners(
                planners or (list(given.planners) if given else []),
                cars=any(problem.steering is not None for problem in problems),
            ),
            runs=read_count(runs or _setting(given, "runs"), "--runs", 1, 1_000_000),
            time_limit=read_duration(time_limit or _setting(given, "time_limit"), "--time-limit"),
            memory_limit=read_count(memory_limit or _setting(given, "memory_limit"), "--memory-limit", 1, 2**30),
            seed=read_count(seed or "0", "--seed", 0, 2**31 - 1),
            resolution=None if resolution is None else _resolution(resolution),
        )
        slots = read_count(workers or "1", "--workers", 1, 1024)
    assert file is not None  # noqa: S101  # --output was given
    read = [source for problem in problems for source in problem.world.sources] + (
        [Path(suite)] if given and suite else []
    )
    protect_inputs(read, file)
    # The scheduler first: if it does not answer, no database is made.
    with _pool(slots, scheduler) as pool, Store(file) as store:
        tally = _run(plan, store, pool, file)
    _print(tally, file, plan.planners, as_json=as_json)


def _resolution(text: str) -> Resolution:
    from trailmark.benchmark.errors import SuiteError
    from trailmark.benchmark.resolution import Resolution

    try:
        return Resolution.parse(text)
    except SuiteError as error:
        raise UsageError(f"--resolution: {error}") from None


def _setting(suite: Suite | None, name: str) -> str:
    given = None if suite is None else getattr(suite, name)
    return DEFAULTS[name.replace("_", " ")] if given is None else str(given)


@contextmanager
def _pool(workers: int, scheduler: str | None) -> Iterator[Any]:
    from trailmark.benchmark.isolation.executors import cluster, local

    with ExitStack() as stack:
        yield stack.enter_context(local(workers) if scheduler is None else cluster(scheduler))


def _run(plan: Benchmark, store: Any, pool: Any, file: Path) -> Tally:
    last: list[Tally] = []
    with _bar() as show:

        def follow(tally: Tally) -> None:
            last[:] = [tally]
            show(tally)

        try:
            return plan.run(store, pool, follow)
        except KeyboardInterrupt:
            if last:
                typer.echo(
                    f"{last[0].done} of {last[0].total} runs are in {file}; the same command makes the others", err=True
                )
            raise


@contextmanager
def _bar() -> Iterator[Callable[[Tally], None]]:
    """Show a bar with the time left while the block runs, if stderr is a terminal."""
    import sys

    if not sys.stderr.isatty():
        yield lambda tally: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    columns = (BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("starting workers")

        def show(tally: Tally) -> None:
            words = [tally.latest or "starting workers"]
            if tally.made and tally.left is not None:
                words.append(f"{_clock(tally.left)} left")
            if tally.failed:
                words.append(f"{tally.failed} without a solution")
            progress.update(task, total=tally.total, completed=tally.done, description=" · ".join(words))

        yield show


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def _print(tally: Tally, file: Path, planners: Sequence[str], *, as_json: bool) -> None:
    from trailmark.benchmark.results import load_results
    from trailmark.benchmark.summary import failure_lines, summary_rows

    if as_json:
        record = {"database": str(file), "runs": tally.total, "made": tally.made, "without_solution": tally.failed}
        console.say(console.json_text(record))
        return
    before = tally.total - tally.made
    there = f", {before:,} were there already" if before else ""
    console.say(f"{tally.made:,} runs made, {tally.failed:,} of them without a correct solution{there}")
    results = load_results(file)
    console.print_table(summary_rows(results, planners), indent="  ")
    for line in failure_lines(results, planners):
        console.say(line)
    console.say(f"written: {file}")
