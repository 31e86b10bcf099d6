"""The whole command as a process of its own: start-up, exit status, signals, pipes, terminals."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import trailmark
from trailmark.errors import InternalErrorWarning

Shell = Callable[..., Any]
Terminal = Callable[..., Any]
COMMAND = [sys.executable, "-m", "trailmark.cli"]
COMPLETE = {"_TRAILMARK_COMPLETE": "complete_bash", "COMP_WORDS": "trailmark plan --turn", "COMP_CWORD": "2"}


def python(program: str, *words: str, **how: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", program, *words], capture_output=True, text=True, check=False, **how)


@pytest.mark.slow
def test_help_version_and_completion_are_quick_and_import_nothing_heavy() -> None:
    heavy = ["fcl", "matplotlib", "networkx", "numba", "numpy", "ompl", "PIL", "scipy", "shapely", "sklearn", "yaml"]
    program = (
        "import os, sys; from trailmark.cli import main; main(['--help']); main(['--version']); print('', flush=True)\n"
        f"print([m for m in {heavy} if m in sys.modules], file=sys.stderr); os.environ |= {COMPLETE}; main([])"
    )
    done = python(program)
    assert (done.returncode, done.stderr) == (0, "[]\n")
    shown, _, completed = done.stdout.rpartition(f"\ntrailmark {trailmark.__version__}\n")
    assert "Commands:" in shown
    assert completed.split() == ["--turning-radius"]


@pytest.mark.slow
def test_a_reader_that_goes_away_is_no_error_and_a_full_disk_is_one_line() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run([*COMMAND, "worlds", "schema"], stdout=writer, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writer)
    assert (done.returncode, done.stderr) == (128 + signal.SIGPIPE, "")
    if Path("/dev/full").exists():
        with Path("/dev/full").open("w") as full:
            done = subprocess.run([*COMMAND, "--version"], stdout=full, stderr=subprocess.PIPE, text=True, check=False)
        assert (done.returncode, done.stderr) == (2, "trailmark: error: output: No space left on device\n")


@pytest.mark.slow
def test_closed_streams_change_neither_files_nor_status(yard: Path, tmp_path: Path) -> None:
    file, settings = tmp_path / "path.csv", tmp_path / "settings.yaml"
    settings.write_text("max_iterations: 1")

    def status(*words: object) -> int:
        program = "import os, sys; [os.close(n) for n in (0, 1, 2)]; os.execv(sys.argv[1], sys.argv[1:])"
        done = python(program, *COMMAND, *map(str, words))
        assert (done.stdout, done.stderr) == ("", "")
        return done.returncode

    assert status("plan", yard, "--settings", settings, "--output", file) == 0
    assert file.read_text().startswith("x,y,theta\n")
    assert status("check", yard, file, "--robot", "disc:2") == 5


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
@pytest.mark.parametrize("disguised", [False, True])
def test_signals_end_in_one_line(
    number: signal.Signals, status: int, disguised: bool, shell: Shell, yard: Path, planner: Any
) -> None:
    def action() -> None:
        assert signal.getsignal(number) is not before, "the signal would end the tests"
        if number == signal.SIGINT:
            # The first only asks planning to end.
            signal.raise_signal(number)
        try:
            signal.raise_signal(number)
        except KeyboardInterrupt:
            if disguised:
                raise SystemError("returned a result with an exception set") from None  # as compiled code does
            raise

    before, planner.action = signal.getsignal(number), staticmethod(action)
    run = shell("plan", yard, "--output", yard.parent / "path.json")
    assert run.status == status
    assert run.problem == ("interrupted" if number == signal.SIGINT else "terminated")
    assert len(planner.calls) == 1
    assert list(yard.parent.iterdir()) == [yard]
    assert signal.getsignal(number) is before


SHOW = """
import time
import numba, ompl.base
from trailmark.cli import console
with console.progress("loading") as progress:
    progress.stage("planning", limit=5.0)
    progress.done, progress.unit, progress.details = (3, 1000), " records", ["312 landmarks", "cost 19.5"]
    time.sleep(0.5)
console.say("86° · \\ud800")
console.fail("[b]θ[/b]")
"""


@pytest.mark.slow
def test_progress_and_colours_are_for_terminals(terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    written = terminal(sys.executable, "-c", SHOW).err
    assert " 3 of 1,000 records · planning · 0." in written
    assert "of 5 s · 312 landmarks · cost 19.5" in written
    after, _, problem = written.rpartition("cost 19.5")[2].partition("trailmark: error:")
    assert "\x1b[2K" in after, "the line is erased"
    assert "\x1b[?25h" in after, "the cursor is shown again"
    assert "\x1b[31m" in after or "\x1b[" in problem
    monkeypatch.setenv("NO_COLOR", "1")
    assert terminal(sys.executable, "-c", SHOW).err.endswith("trailmark: error: [b]θ[/b]\r\n")


@pytest.mark.slow
def test_a_pipe_gets_results_and_problems_alone_in_what_its_encoding_has() -> None:
    done = python(SHOW, env=os.environ | {"PYTHONIOENCODING": "ascii"})
    assert (done.returncode, done.stdout) == (0, "86\\xb0 \\xb7 \\ud800\n")
    assert done.stderr == "trailmark: error: [b]\\u03b8[/b]\n"


def test_what_is_wrong_with_trailmark_itself_is_reported_in_one_line(shell: Shell, yard: Path, planner: Any) -> None:
    def warn() -> None:
        warnings.warn("a path that was found is not free", InternalErrorWarning, stacklevel=1)
        warnings.warn("advice to programmers", DeprecationWarning, stacklevel=1)

    planner.action = staticmethod(warn)
    run = shell("plan", yard)
    assert (run.status, run.err) == (0, "trailmark: warning: a path that was found is not free\n")


@pytest.mark.parametrize("columns", ["80", "120"])
def test_help_shows_brackets_and_whole_summaries(shell: Shell, monkeypatch: pytest.MonkeyPatch, columns: str) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    for words in ([], ["worlds"]):
        commands = shell(*words, "--help").out.partition("Commands:")[2]
        assert commands
        assert "..." not in commands
    assert "'[[x, y], ...]'" in " ".join(shell("plan", "--help").out.split())
    assert "inf]" not in shell("explore", "--help").out
