"""Two processes do the same jobs, one in each order; the block does all of them, whatever the second does."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.support.forks import Forks, complaints

JOBS = """
import os
from functools import partial
from pathlib import Path
from trailmark.compiled import njit

@njit(cache=True)
def first(x):
    return x + 1

@njit(cache=True)
def second(x):
    return x + 2

@njit(cache=True)
def third(x):
    return x + 3

def do(n, folder):
    (first, second, third)[n](1)
    Path(folder, f"{n} by {os.getpid()}").touch()
"""
PROGRAM = """
import time
from functools import partial
from pathlib import Path
from trailmark.compiled.side_by_side import compiled_side_by_side
import jobs
todo = [partial(jobs.do, n, FOLDER) for n in (0, 1, 2)]
with compiled_side_by_side(todo):
    todo[0]()
    while len(list(Path(FOLDER).iterdir())) < FILES:
        time.sleep(0.05)
    for job in todo[1:]:
        job()
kernels = (jobs.first, jobs.second, jobs.third)
print([sum(kernel.stats.cache_hits.values()) for kernel in kernels])
"""


Run = Callable[[str], str]


@pytest.fixture
def run(tmp_path: Path, forks: Forks) -> Run:
    (tmp_path / "jobs.py").write_text(JOBS)

    def started(program: str) -> str:
        begin = f"import sys; sys.path.insert(0, {os.fspath(tmp_path)!r})\n"
        done = forks.run(["-c", begin + program], timeout=120.0)
        assert (done.returncode, complaints(done)) == (0, "")
        return done.stdout.strip()

    return started


@pytest.mark.slow
@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="one processor: one process")
def test_a_second_process_compiles_from_the_end(tmp_path: Path, run: Run) -> None:
    done = tmp_path / "done"
    done.mkdir()
    program = PROGRAM.replace("FOLDER", repr(os.fspath(done))).replace("FILES", "4")
    assert run(program) == "[0, 1, 1]"
    by: dict[str, list[str]] = {}
    for name in sorted(file.name for file in done.iterdir()):
        number, process = name.split(" by ")
        by.setdefault(process, []).append(number)
    assert list(by.values()) == [["0", "1", "2"]] * 2


@pytest.mark.slow
def test_what_is_compiled_already_starts_no_process(tmp_path: Path, run: Run) -> None:
    done = tmp_path / "done"
    done.mkdir()
    program = PROGRAM.replace("FOLDER", repr(os.fspath(done))).replace("FILES", "1")
    run(program)
    for file in done.iterdir():
        file.unlink()
    assert run(program) == "[1, 1, 1]"
    assert len({file.name.split(" by ")[1] for file in done.iterdir()}) == 1


@pytest.mark.slow
def test_a_second_process_that_cannot_work_changes_nothing(tmp_path: Path, run: Run) -> None:
    done = tmp_path / "done"
    done.mkdir()
    program = PROGRAM.replace("FOLDER", repr(os.fspath(done))).replace("FILES", "1")
    broken = "import sys; sys.executable = '/dev/null/none'\n"
    assert run(broken + program) == "[0, 0, 0]"
