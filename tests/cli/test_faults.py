"""What goes wrong while files are read and written: outputs are whole or absent, and memory is bounded."""

from __future__ import annotations

import errno
import gzip
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from tests.helpers.logs import recorded
from tests.helpers.made_results import random_results
from tests.helpers.runs import experiment, solved
from tests.helpers.trials import trials

from trailmark.benchmark.errors import StoreError
from trailmark.benchmark.store import Store
from trailmark.estimation import save_log

Shell = Callable[..., Any]
FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
ENDS: list[tuple[BaseException, int]] = [(FULL, 2), (KeyboardInterrupt(), 130)]
BEFORE = ["nothing there", "older files there"]
PAIRS = [(*end, before) for end, before in zip(ENDS, BEFORE, strict=True)]


@contextmanager
def fault(monkeypatch: pytest.MonkeyPatch, at: int, what: BaseException) -> Iterator[list[str]]:
    """Raise ``what`` at the ``at``-th step of writing files, counted over all of them; yields the steps taken."""
    steps: list[str] = []

    def step(name: str, real: Callable[..., Any]) -> Callable[..., Any]:
        def called(*words: Any, **more: Any) -> Any:
            steps.append(name)
            if len(steps) == at:
                raise what
            return real(*words, **more)

        return called

    class File:
        """A file whose writes may fail; half of the content is there then."""

        def __init__(self, file: Any) -> None:
            self.file = file

        def __enter__(self) -> File:
            return self

        def __exit__(self, *_: object) -> None:
            self.file.close()

        def write(self, data: bytes) -> None:
            self.file.write(data[: len(data) // 2])
            step("write", lambda: None)()
            self.file.write(data[len(data) // 2 :])

        def __getattr__(self, name: str) -> Any:
            return getattr(self.file, name)

    fdopen, os_open = os.fdopen, os.open

    def opened(path: Any, flags: int, *rest: Any, **more: Any) -> int:
        made = step("open", os_open) if str(path).endswith(".tmp") else os_open
        return int(made(path, flags, *rest, **more))

    with monkeypatch.context() as patch:
        patch.setattr(os, "open", opened)
        patch.setattr(os, "fdopen", lambda handle, mode, *rest: File(fdopen(handle, mode, *rest)))
        patch.setattr(os, "fsync", step("fsync", os.fsync))
        patch.setattr(Path, "replace", step("replace", Path.replace))
        yield steps


def contents(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir() if file.is_file()}


@pytest.fixture
def commands(tmp_path: Path, yard: Path, planner: Any) -> dict[str, list[object]]:
    """Commands that write, with their inputs in one folder and their outputs in another."""
    (tmp_path / "out").mkdir()
    log = tmp_path / "drive.jsonl"
    save_log(recorded(), log)
    results = random_results(tmp_path / "results.db", ["landmark", "PRM"], problems=1, runs=3)
    out = tmp_path / "out"
    return {
        "plan": ["plan", yard, "--output", out / "path.json", "--plot", out / "path.png"],
        "csv": ["plan", yard, "--output", out / "path.csv"],
        "convert": ["worlds", "convert", yard, out / "world.yaml"],
        "map": ["map", log, "--output", out / "map.yaml"],
        "report": ["report", results, "--html", out / "report.html"],
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "faults"),
    [
        *(("convert", [(*end, before)]) for end in ENDS for before in BEFORE),
        # All write by one function, of which a quick command shows all: for the others each step has one of two.
        *((name, PAIRS) for name in ("plan", "csv", "map", "report")),
    ],
)
def test_at_every_step_outputs_are_whole_or_absent(
    shell: Shell,
    tmp_path: Path,
    commands: dict[str, list[object]],
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    faults: list[tuple[BaseException, int, str]],
) -> None:
    out = tmp_path / "out"
    assert shell(*commands[name]).status == 0
    whole = contents(out)
    # Other files that trailmark could have written: a table with one row more, the rest with an empty line more.
    more = {file: content.splitlines()[-1] if file.endswith(".csv") else b"" for file, content in whole.items()}
    others = {file: content + more[file] + b"\n" for file, content in whole.items()}
    for at in range(1, 50):
        # A file has four steps: the two take turns at them, and change places with each file.
        what, status, before = faults[(at + (at - 1) // 4) % len(faults)]
        older = others if before == "older files there" else {}
        shutil.rmtree(out)
        out.mkdir()
        for file, content in older.items():
            (out / file).write_bytes(content)
        with fault(monkeypatch, at, what) as steps:
            run = shell(*commands[name])
        for file, content in contents(out).items():
            # Times in records differ from run to run; whether a file is whole tells its end.
            assert content == older.get(file) or content[-4:] == whole[file][-4:], (at, file)
        assert set(older) <= set(contents(out)) <= set(whole), at
        if run.status == 0:
            break
        assert (run.status, run.err.count("\n")) == (status, 1), (at, run)
    else:
        pytest.fail("it never ended well")
    assert len(steps) == 4 * len(whole)  # each of them was made to fail
    assert at == len(steps) + 1


WRITER = """
import sys
from pathlib import Path
from trailmark.formats.files import write_atomically
print("begun", flush=True)
for i in range(10**6):
    write_atomically(Path(sys.argv[1]), str(i % 10) * 2_000_000)
"""


@pytest.mark.slow
def test_kills_leave_whole_files(tmp_path: Path) -> None:
    file = tmp_path / "out.txt"
    file.write_text("x" * 2_000_000)
    for moment in trials(8):
        with subprocess.Popen([sys.executable, "-c", WRITER, file], stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout.readline() == "begun\n"
            time.sleep(0.013 * (3 * moment % 8 + 1))
            process.send_signal(signal.SIGKILL)
        text = file.read_text()
        assert len(text) == 2_000_000
        assert text == text[0] * len(text)


def test_a_full_disk_under_the_results_keeps_those_that_are_there(tmp_path: Path) -> None:
    file = tmp_path / "results.db"
    with Store(file) as store:
        row, planner = store.experiment(**experiment()), store.planner("good", "")
        assert store.add(row, planner, solved(0))
        pages = store._db.execute("PRAGMA page_count").fetchone()[0]
        store._db.execute(f"PRAGMA max_page_count = {pages + 2}")
        kept, problem = 1, ""
        while not problem:
            try:
                kept += store.add(row, planner, solved(kept, failure="because " * 100))
            except StoreError as error:
                problem = str(error)
    assert "full" in problem
    with Store(file) as store:
        assert len(store.finished(row)) == kept
        assert store._db.execute("PRAGMA integrity_check").fetchone() == ("ok",)


# ru_maxrss would begin with the memory of the process that starts this one.
PROGRAM = """
import re, sys
from pathlib import Path
from trailmark.cli import main
output, *bombs = sys.argv[1:]
for bomb in bombs:
    status = main(["map", bomb, "--output", output])
    print(status, int(re.search(r"VmHWM:\\s*(\\d+)", Path("/proc/self/status").read_text())[1]) // 1024)
"""
HEADS = {
    "jsonl": b'{"trailmark_log": 1, "name": "bomb"}\n',
    "carmen": b"ODOM 0 0 0 0 0 0 0 host 0\n",
    "victoria": b"ODOMETRY 0 1 1 0 0 1 0 0 1 0 1\n",
}


@pytest.mark.slow
def test_gzip_bombs_of_three_gigabytes(tmp_path: Path) -> None:
    piece = gzip.compress(bytes(2**24), 1)
    bombs = [tmp_path / f"{kind}.gz" for kind in HEADS]
    for bomb, head in zip(bombs, HEADS.values(), strict=True):
        bomb.write_bytes(gzip.compress(head) + 192 * piece)  # 3 GiB in 192 members
    words = list(map(str, (tmp_path / "world.yaml", *bombs)))
    done = subprocess.run([sys.executable, "-c", PROGRAM, *words], capture_output=True, text=True, timeout=120)
    said = [f"trailmark: error: {bomb}:2: expected at most 4,194,304 bytes in a line, got more" for bomb in bombs]
    assert done.stderr.splitlines() == said
    for line in done.stdout.splitlines():
        status, megabytes = map(int, line.split())
        assert status == 2
        assert megabytes < 200
    assert done.stdout.count("\n") == len(HEADS)
    assert not (tmp_path / "world.yaml").exists()
