"""The shell command ``trailmark``: one file per command, heavy imports inside the commands.

A new command is a new file here and one line below. Exit status: 0 done, 2 bad input or usage (one line on
stderr), 3 no path found within the time limit, 4 proven infeasible, 5 a checked path collides or cannot be driven, 130
interrupted, 141 stdout closed by its reader, 143 terminated.
"""

from __future__ import annotations

import atexit
import gc
import os
import signal
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

import trailmark
from trailmark.cli import (
    benchmark,
    check,
    console,
    explore,
    landmarks,
    live,
    map,  # noqa: A004 # a command's file has its name
    plan,
    report,
    roadmap,
    ros,
    warmup,
    worlds,
)
from trailmark.cli.options import UsageError
from trailmark.errors import InputWarning, InternalErrorWarning, TrailmarkError, expected_name

__all__ = ["app", "main"]


class Command(TyperCommand):
    """A command whose help shows the most common options first, and others in groups."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the arguments and the options."""
        groups: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        for parameter in self.get_params(ctx):
            if (shown := parameter.get_help_record(ctx)) is not None:
                kind = "Arguments" if parameter.param_type_name == "argument" else "Options"
                # Newer typer adds the type.
                name = shown[0].partition(" <")[0] if kind == "Arguments" else shown[0]
                text = shown[1].replace("[default: inf]", "[default: no limit]")
                groups.setdefault(getattr(parameter, "rich_help_panel", None) or kind, []).append((name, text))
        for group, rows in groups.items():
            if rows:
                with formatter.section(group):
                    formatter.write_dl(rows)


app = typer.Typer(
    name="trailmark",
    help="Plan and check collision-free paths for mobile robots in 2D maps.",
    rich_markup_mode=None,  # plain help: rich takes half of its time, and would read brackets as markup
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
COMMANDS: dict[str, Callable[..., None]] = {
    "plan": plan.plan,
    "check": check.check,
    "landmarks": landmarks.landmarks,
    "map": map.map_log,
    "explore": explore.explore,
    "live": live.live,
    "roadmap": roadmap.roadmap,
    "benchmark": benchmark.benchmark,
    "report": report.report,
}
for _name, _command in COMMANDS.items():
    app.command(_name, cls=Command)(_command)
app.add_typer(worlds.app, name="worlds")
app.command("ros", context_settings={"allow_extra_args": True, "ignore_unknown_options": True})(ros.ros)
app.command("warmup", cls=Command)(warmup.warmup)
worlds.app.command("show", cls=Command)(worlds.show)
worlds.app.command("convert", cls=Command)(worlds.convert)
worlds.app.command("schema", cls=Command)(worlds.schema)

_COMPLETE = "_TRAILMARK_COMPLETE"
"""Set by the shell's completion script, which asks for the words that may come next."""


def _print_version(asked: bool) -> None:
    if asked:
        console.say(f"trailmark {trailmark.__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass  # the callback of --version does it all


def main(args: Sequence[str] | None = None) -> int:
    """Run one command and return the exit status.

    Misuse and bad input become one line on stderr; a programming error keeps its traceback.

    Args:
        args: the words after ``trailmark``; default: those of this process.
    """
    atexit.register(_end_quickly)
    console.open_closed_streams()
    words = sys.argv[1:] if args is None else args
    with _signals() as received:
        try:
            return _run(words)
        except UsageError as error:
            console.fail(_usage(error, words))
        except TrailmarkError as error:
            console.fail(str(error))
        except BrokenPipeError:
            console.silence_stdout()
            return 128 + signal.SIGPIPE
        except OSError as error:
            console.silence_stdout()
            console.fail(f"{error.filename or 'output'}: {error.strerror or error}")
        except KeyboardInterrupt:
            return _ended(received)
        except Exception:
            # Compiled code may replace the KeyboardInterrupt of a signal by an error of its own.
            if not received:
                raise
            return _ended(received)
    return 2


def _run(words: Sequence[str]) -> int:
    """Run one command; return its exit status or raise what stopped it."""
    command = typer.main.get_command(app)
    _keep_summaries(command)
    if _COMPLETE in os.environ:
        return int(command.main(list(words), "trailmark", _COMPLETE, standalone_mode=False) or 0)
    status = 0
    with warnings.catch_warnings():
        # Other libraries' advice to programmers; -W and PYTHONWARNINGS still show it.
        if not sys.warnoptions:
            warnings.simplefilter("ignore")
        # But trailmark's own are shown to every user, in one line.
        own = (InputWarning, InternalErrorWarning)
        for category in own:
            warnings.filterwarnings("always", category=category)
        shown = warnings.showwarning
        warnings.showwarning = lambda message, category, *rest: (
            console.warn(str(message)) if category in own else shown(message, category, *rest)
        )
        try:
            with command.make_context("trailmark", list(words)) as context:
                command.invoke(context)
        except typer.Exit as done:
            status = done.exit_code
    # Here and not while the interpreter shuts down, where an error could no longer be reported.
    sys.stdout.flush()
    return status


def _keep_summaries(group: Any) -> None:
    """Give commands their help's first paragraph as summary: it is wrapped then, and not cut."""
    for command in group.commands.values():
        command.short_help = (command.help or "").partition("\n\n")[0]
        if hasattr(command, "commands"):
            _keep_summaries(command)


def _end_quickly() -> None:
    """Skip the last garbage collection, which takes a fifth of a second and frees nothing that the process keeps."""
    # OMPL's bindings complain about each of their objects that is not collected.
    if "ompl" not in sys.modules:
        gc.freeze()


@contextmanager
def _signals() -> Iterator[list[int]]:
    """Let SIGTERM end a command as Ctrl-C does, by an exception: temporary files go, the cursor comes back.

    Yields the signals received so far.
    """
    received: list[int] = []

    def leave(number: int, frame: object) -> None:
        received.append(number)
        raise KeyboardInterrupt

    # A signal that the parent process had ignored (nohup) stays ignored.
    before = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)}
    for number, handler in before.items():
        if handler is not signal.SIG_IGN:
            signal.signal(number, leave)
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler or signal.SIG_DFL)  # None: not set from Python


def _ended(received: list[int]) -> int:
    console.fail("terminated" if signal.SIGTERM in received else "interrupted")
    return 128 + (received[0] if received else signal.SIGINT)


def _usage(error: Any, words: Sequence[str]) -> str:
    """Return a usage error as one sentence that names the commands there are, or where the options are described."""
    if type(error) is typer.BadParameter and error.param is not None:
        name = error.param.metavar if error.param.param_type_name == "argument" else max(error.param.opts, key=len)
        return f"{name}: {error.message}"
    path, command = "trailmark", typer.main.get_command(app)
    commands: dict[str, Any] = {}
    for word in words:
        commands = getattr(command, "commands", {})
        if word not in commands:
            if commands and not word.startswith("-"):
                return f"{path.partition(' ')[2] or 'command'}: {expected_name(word, commands)}"
            break
        command, path = commands[word], f"{path} {word}"
    problem = error.format_message().rstrip(".")
    if problem == "Missing command":
        return f"expected a command: {', '.join(getattr(command, 'commands', {}))}, got nothing"
    return problem if " expected " in f" {problem}" else f"{problem} (see '{path} --help')"
