"""Output of the shell: results on stdout, errors on stderr, messages and progress on stderr if it is a terminal."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from rich.console import RenderableType

__all__ = [
    "Progress",
    "fail",
    "json_text",
    "not_written",
    "note",
    "open_closed_streams",
    "plural",
    "print_table",
    "progress",
    "say",
    "show",
    "silence_stdout",
    "tell",
    "warn",
]

_PATIENCE = 0.3  # seconds of work before a display appears
_BAR = 24  # characters


def say(text: str, **style: Any) -> None:
    """Print lines of a result on stdout; ``style`` as for ``typer.style``, seen on a terminal only."""
    typer.echo(_styled(_printable(text, sys.stdout.encoding), **style))


def json_text(record: Mapping[str, object]) -> str:
    """Return a JSON object with one member a line; it is strict JSON (no NaN) and ASCII, whatever the terminal."""
    members = (f"  {json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in record.items())
    return "{\n" + ",\n".join(members) + "\n}"


def print_table(rows: Sequence[Sequence[str]], indent: str = "") -> None:
    """Print rows in aligned columns, never cut to a terminal's width: they may go through a pipe."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        say((indent + "  ".join(cells)).rstrip())


def show(title: str, facts: Sequence[tuple[str, str]], written: Sequence[Path | None] = (), colour: str = "") -> None:
    """Print a result: a title, facts by their names, and the files that were written."""
    say(title, bold=True, **({"fg": colour} if colour else {}))
    print_table([*facts, *(("written", str(file)) for file in written if file is not None)], indent="  ")


def plural(n: int, noun: str) -> str:
    """Return a count with its noun."""
    return f"{n:,} {noun}{'' if n == 1 else 's'}"


def tell(text: str) -> None:
    """Print a message as one line on stderr, terminal or not."""
    typer.echo(_one_line(f"trailmark: {text}"), err=True)


def note(text: str) -> None:
    """Print a message as one line on stderr if that is a terminal."""
    if sys.stderr.isatty():
        typer.echo(_one_line(text), err=True)


def not_written(file: Path, reason: str) -> None:
    """Tell that a file is not written, and that an older one is kept."""
    tell(f"{file}: not written: {reason}" + ("; the older file is kept" if file.exists() else ""))


def fail(problem: str) -> None:
    """Print a problem as one line on stderr."""
    typer.echo(f"{_styled('trailmark: error:', fg='red', bold=True)} {_one_line(problem)}", err=True)


def warn(problem: str) -> None:
    """Print a warning as one line on stderr."""
    typer.echo(f"{_styled('trailmark: warning:', fg='yellow', bold=True)} {_one_line(problem)}", err=True)


def open_closed_streams() -> None:
    """Point standard streams that were closed (a daemon, ``>&-``) nowhere, so that no other file gets their numbers."""
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        if getattr(sys, name) is None:
            nowhere = os.open(os.devnull, os.O_RDWR)  # the least free number: this stream's own
            os.set_inheritable(nowhere, nowhere == number)  # also for the processes of a benchmark
            setattr(sys, name, os.fdopen(nowhere, mode, encoding="utf-8"))


def silence_stdout() -> None:
    """Point stdout nowhere: its reader is gone, and buffered output must not fail at exit."""
    with Path(os.devnull).open("wb") as nowhere:
        os.dup2(nowhere.fileno(), sys.stdout.fileno())


class Progress:
    """The present activity of a long command, set by the command and shown by the display.

    Attributes:
        phase: a word or two.
        details: further facts, such as ``312 landmarks``.
        done: how many pieces of work of how many are done, for a bar; None without one.
        unit: what the pieces are, such as `` records``.
    """

    unit = ""

    def __init__(self, phase: str) -> None:
        self._begun = time.perf_counter()
        self.stage(phase)

    def stage(self, phase: str, limit: float | None = None) -> None:
        """Begin another piece of work, whose clock starts at zero and may run to ``limit`` seconds."""
        self.phase = phase
        self.done: tuple[int, int] | None = None
        self.details: Sequence[str] = ()
        self._limit = "" if limit is None else f" of {limit:g}"
        self._stage_begun = time.perf_counter()

    def render(self) -> str:
        """Return the display's line; empty while the command is still young."""
        now, bar = time.perf_counter(), []
        if now - self._begun < _PATIENCE:
            return ""
        if self.done is not None:
            done, pieces = self.done
            full = _BAR * done // max(1, pieces)
            bar = [f"{'━' * full}{'╌' * (_BAR - full)} {done:,} of {pieces:,}{self.unit}"]
        clock = f"{now - self._stage_begun:.1f}{self._limit} s"
        return " · ".join([*bar, self.phase, clock, *self.details])


@contextmanager
def progress(phase: str) -> Iterator[Progress]:
    """Show a spinner with the :class:`Progress` while the block runs: on a terminal, after 0.3 s, then gone again."""
    state = Progress(phase)
    if not sys.stderr.isatty():
        yield state
        return
    from rich.console import Console
    from rich.live import Live
    from rich.spinner import Spinner
    from rich.text import Text

    spinner = Spinner("dots", style="cyan")

    def display() -> RenderableType:
        line = state.render()
        spinner.update(text=Text(line))
        return spinner if line else Text()

    with Live(get_renderable=display, console=Console(stderr=True), transient=True, refresh_per_second=12.5):
        yield state


def _styled(text: str, **style: Any) -> str:
    return text if "NO_COLOR" in os.environ or not style else typer.style(text, **style)


def _one_line(text: str) -> str:
    return _printable(" ".join(text.splitlines()), sys.stderr.encoding)


def _printable(text: str, encoding: str | None) -> str:
    """Return the text with escapes for control characters, and characters that the terminal cannot show.

    A file name may hold either.
    """
    shown = "".join(c if c.isprintable() or c == "\n" else c.encode("unicode_escape").decode() for c in text)
    return shown.encode(encoding or "utf-8", "backslashreplace").decode(encoding or "utf-8")
