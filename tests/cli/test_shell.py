"""The whole command as a process of its own: start-up, exit status, signals, pipes, terminals."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import trailmark

Shell = Callable[..., Any]
Terminal = Callable[..., Any]
COMMAND = [sys.executable, "-m", "trailmark.cli"]


def python(program: str, **how: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, **how)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("typed", "offered"), [("trailmark wo", ["worlds"]), ("trailmark plan --turn", ["--turning-radius"])]
)
def test_words_are_completed(typed: str, offered: list[str]) -> None:
    asked = {"_TRAILMARK_COMPLETE": "complete_bash", "COMP_WORDS": typed, "COMP_CWORD": str(typed.count(" "))}
    done = subprocess.run(COMMAND, capture_output=True, text=True, check=False, env=os.environ | asked)
    assert (done.returncode, done.stdout.split(), done.stderr) == (0, offered, "")


def test_version(shell: Shell) -> None:
    assert shell("--version") == (0, f"trailmark {trailmark.__version__}\n", "")


@pytest.mark.slow
def test_help_and_version_import_nothing_heavy() -> None:
    heavy = ["fcl", "matplotlib", "networkx", "numba", "numpy", "ompl", "PIL", "scipy", "shapely", "sklearn", "yaml"]
    for word in ("--help", "--version"):
        program = (
            "import sys; from trailmark.cli import main; main([sys.argv[1]]);"
            f"print([m for m in {heavy} if m in sys.modules], file=sys.stderr)"
        )
        done = subprocess.run([sys.executable, "-c", program, word], capture_output=True, text=True, check=True)
        assert done.stderr == "[]\n"


@pytest.mark.slow
@pytest.mark.parametrize("words", [["--help"], ["--version"], ["worlds", "schema"]])
def test_a_reader_that_goes_away_is_no_error(words: list[str]) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run([*COMMAND, *words], stdout=writer, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writer)
    assert done.stderr == ""
    assert done.returncode == 128 + signal.SIGPIPE


@pytest.mark.slow
@pytest.mark.parametrize("closed", [(1,), (0, 1, 2)], ids=["stdout", "all"])
def test_closed_streams_change_neither_files_nor_status(yard: Path, tmp_path: Path, closed: tuple[int, ...]) -> None:
    file = tmp_path / "path.csv"

    def status(*words: object) -> int:
        program = "import os, sys; [os.close(int(n)) for n in sys.argv[1]]; os.execv(sys.argv[2], sys.argv[2:])"
        numbers = "".join(map(str, closed))
        command = [sys.executable, "-c", program, numbers, *COMMAND, *map(str, words)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert (done.stdout, done.stderr) == ("", "")
        return done.returncode

    assert status("plan", yard, "--max-iterations", "1", "--output", file) == 0
    assert file.read_text().startswith("x,y,theta\n")
    assert status("check", yard, file) == 0
    assert status("check", yard, file, "--robot", "disc:2") == 5


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs the device /dev/full")
def test_a_full_disk_is_one_line() -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run([*COMMAND, "--version"], stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == "trailmark: error: output: No space left on device\n"


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


@pytest.mark.slow
def test_a_process_ends_as_its_signal_says(yard: Path) -> None:
    # What Ctrl-C does to a process is tested with ``trailmark map`` and ``trailmark benchmark``.
    program = f"""
import os, signal, sys, threading, time, trailmark
from trailmark.cli import main
class Slow:
    def __init__(self, *args, **named): pass
    def plan(self, *args, **named):
        threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGTERM)).start()
        time.sleep(30)
trailmark.LandmarkPlanner = Slow
sys.exit(main(["plan", {str(yard)!r}, "--output", {str(yard.parent / "path.json")!r}]))
"""
    done = python(program, timeout=120.0)
    assert (done.returncode, done.stdout, done.stderr) == (143, "", "trailmark: error: terminated\n")
    assert list(yard.parent.iterdir()) == [yard]


WAIT = """
import time
from trailmark.cli import console
with console.progress("loading") as progress:
    progress.stage("planning", limit=5.0)
    progress.details = ["312 landmarks", "cost 19.5"]
    time.sleep({seconds})
"""


@pytest.mark.slow
def test_long_work_shows_progress_on_a_terminal_and_wipes_it(terminal: Terminal) -> None:
    written = terminal(sys.executable, "-c", WAIT.format(seconds=0.5)).err
    assert "planning · 0." in written
    assert "of 5 s · 312 landmarks · cost 19.5" in written
    assert written.rstrip().endswith(("\x1b[2K", "\x1b[?25h")), "the line is erased and the cursor shown again"


@pytest.mark.slow
def test_no_progress_without_a_terminal() -> None:
    assert python(WAIT.format(seconds=0.5)).stderr == ""


@pytest.mark.slow
def test_colours_are_for_terminals_only(terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    program = "from trailmark.cli import console; console.fail('[b]no[/b]')"
    assert python(program).stderr == "trailmark: error: [b]no[/b]\n"
    assert "\x1b[" in terminal(sys.executable, "-c", program).err
    monkeypatch.setenv("NO_COLOR", "1")
    assert terminal(sys.executable, "-c", program).err == "trailmark: error: [b]no[/b]\r\n"


@pytest.mark.slow
def test_output_survives_a_terminal_that_knows_ascii_only() -> None:
    program = "from trailmark.cli import console; console.say('86° · \\ud800'); console.fail('θ')"
    done = python(program, env=os.environ | {"PYTHONIOENCODING": "ascii"})
    assert done.stdout == "86\\xb0 \\xb7 \\ud800\n"
    assert done.stderr == "trailmark: error: \\u03b8\n"


def test_json_text_is_strict() -> None:
    from trailmark.cli import console

    record = {"states": [[0.0, 1.0, 2.0]], "query": "θ", "cost": None}
    assert json.loads(console.json_text(record)) == record
    with pytest.raises(ValueError, match="JSON"):
        console.json_text({"cost": float("nan")})


@pytest.mark.slow
def test_a_process_ends_without_complaints() -> None:
    done = python("from trailmark.cli import main; import numba, ompl.base; main(['--version'])")
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.slow
def test_start_up_is_quick() -> None:
    def seconds() -> float:
        """Return processor time: that of the clock is the machine's, with all that runs beside."""
        before = os.times()
        subprocess.run([*COMMAND, "--version"], capture_output=True, check=True)
        after = os.times()
        return after.children_user + after.children_system - before.children_user - before.children_system

    assert any(seconds() < 0.4 for _ in range(3))


@pytest.mark.slow
def test_what_is_wrong_with_trailmark_itself_is_reported_in_one_line(
    shell: Shell, yard: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import warnings

    from trailmark.errors import InternalErrorWarning
    from trailmark.planning import LandmarkPlanner

    right = LandmarkPlanner.plan

    def plan(self: LandmarkPlanner, *arguments: Any, **options: Any) -> Any:
        warnings.warn("a path that was found is not free", InternalErrorWarning, stacklevel=1)
        warnings.warn("advice to programmers", DeprecationWarning, stacklevel=1)
        return right(self, *arguments, **options)

    monkeypatch.setattr(LandmarkPlanner, "plan", plan)
    run = shell("plan", str(yard), "--query", "across", "--time-limit", "0.3")
    assert run.status == 0
    # Once while kernels are warmed up, once in earnest.
    assert set(run.err.splitlines()) == {"trailmark: warning: a path that was found is not free"}


@pytest.mark.parametrize("columns", ["80", "120"])
def test_help_shows_brackets_and_whole_summaries(shell: Shell, monkeypatch: pytest.MonkeyPatch, columns: str) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    for words in ([], ["worlds"]):
        commands = shell(*words, "--help").out.partition("Commands:")[2]
        assert commands
        assert "..." not in commands
    assert "'[[x, y], ...]'" in " ".join(shell("plan", "--help").out.split())
