"""Kernels: kept where there is a place, never stale, and sound whatever arrives while they compile or run."""

from __future__ import annotations

import ast
import gc
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import FrameType, SimpleNamespace
from typing import Any

import numba
import numpy as np
import pytest
from numba.core import event
from tests.helpers.processes import run_python
from tests.helpers.trials import few

from trailmark import jit
from trailmark.jit import callee, compiling_for, kernel_digest, njit

PACKAGE = jit.PACKAGE
NUMBERS = r"(tuple\[)?((float|int|bool|np\.u?int64)(, |\]?$))+|None"
OPEN = "__pycache__"


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package of kernels, with a user's cache beside it and a folder for what is temporary."""
    folder = tmp_path / "package"
    folder.mkdir()
    (folder / "kernels.py").write_text("from trailmark.jit import njit\n")
    monkeypatch.setattr(jit, "PACKAGE", folder)
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.setattr(tempfile, "tempdir", os.fspath(tmp_path / "temporary"))
    monkeypatch.setenv("XDG_CACHE_HOME", os.fspath(tmp_path / "user"))
    (tmp_path / "temporary").mkdir()
    return folder


def place() -> Path | None:
    """Return the folder that is chosen anew, of the state in which the package is now."""
    jit.kernel_digest.__defaults__ = (jit.PACKAGE,)
    try:
        return jit.kernel_folder.__wrapped__()
    finally:
        jit.kernel_digest.__defaults__ = (PACKAGE,)


def closed(path: Path) -> None:
    """Let no folder be made at a path, from root too: a file stands there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()


def test_kernels_lie_beside_the_package_else_in_the_users_cache(package: Path, tmp_path: Path) -> None:
    beside = place()
    assert beside.parent == package / OPEN / "kernels"
    shutil.rmtree(package / OPEN)
    closed(package / OPEN)
    of_user = place()
    assert of_user.is_relative_to(tmp_path / "user")
    assert of_user.name == beside.name == kernel_digest(package)


def test_the_place_that_is_named_comes_first(package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", os.fspath(tmp_path / "named"))
    found = place()
    assert found.is_relative_to(tmp_path / "named")


def test_without_a_place_a_temporary_folder_of_ones_own_serves(
    package: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    closed(package / OPEN)
    closed(tmp_path / "user")
    found, kept = place(), tmp_path / "temporary" / f"trailmark-{os.getuid()}"
    assert found.is_relative_to(kept)
    assert kept.stat().st_mode & 0o777 == 0o700
    line = f"trailmark: no cache folder for compiled kernels can be written to, they are cached in {kept}\n"
    assert capsys.readouterr().err == line


@pytest.mark.parametrize("trap", ["open to all", "a link", "a file"])
def test_a_folder_that_others_may_have_made_is_not_trusted(package: Path, tmp_path: Path, trap: str) -> None:
    closed(package / OPEN)
    closed(tmp_path / "user")
    kept = tmp_path / "temporary" / f"trailmark-{os.getuid()}"
    if trap == "open to all":
        kept.mkdir()
        kept.chmod(0o777)
    elif trap == "a link":
        (tmp_path / "theirs").mkdir()
        kept.symlink_to(tmp_path / "theirs")
    else:
        kept.touch()
    found = place()
    assert not found.is_relative_to(kept)
    assert not list(kept.iterdir() if kept.is_dir() else ())


@pytest.mark.parametrize("disk", ["closed", "full"])
def test_without_any_place_there_is_no_cache_which_one_line_says(
    package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], disk: str
) -> None:
    if disk == "closed":
        closed(package / OPEN)
        closed(tmp_path / "user")
        monkeypatch.setattr(tempfile, "tempdir", "/dev/null/none")
    else:
        monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(free=1_000_000))
    assert place() is None
    said = capsys.readouterr().err
    assert said.startswith("trailmark: no folder can be written to")
    assert said.count("\n") == 1


def test_another_state_of_the_sources_has_another_folder_and_the_old_one_goes(package: Path) -> None:
    first = place()
    (package / "python.py").write_text("a module without kernels\n")
    assert place() == first
    (package / "constants.py").write_text("SHIFT = 1  # trailmark.jit counts this file\n")
    second = place()
    assert second != first
    (package / "constants.py").write_text("SHIFT = 2  # trailmark.jit counts this file\n")
    third = place()
    assert third not in (first, second)
    assert list(third.parent.iterdir()) == [third]


class _Source:
    """A module of the package: its kernels, and the names that it takes from others."""

    def __init__(self, file: Path) -> None:
        self.file, self.text = file, file.read_text(encoding="utf-8")
        tree = ast.parse(self.text)
        functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
        self.kernels = [(f, kind) for f in functions for kind in map(_decorator, f.decorator_list) if kind]
        self.taken = {
            alias.asname or alias.name: (node.module, alias.name)
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("trailmark")
            for alias in node.names
        }
        values = [a.value for a in tree.body if isinstance(a, ast.Assign | ast.AnnAssign) and a.value is not None]
        read = [*(f for f, _ in self.kernels), *(values if self.kernels else ())]
        self.read = {name.id for part in read for name in ast.walk(part) if isinstance(name, ast.Name)}
        inside = {id(node) for f, _ in self.kernels for part in f.body for node in ast.walk(part)}
        self.in_python = {n.id for n in ast.walk(tree) if isinstance(n, ast.Name) and id(n) not in inside}


def _decorator(node: ast.expr) -> str | None:
    name = node.func if isinstance(node, ast.Call) else node
    if not isinstance(name, ast.Name) or name.id not in ("njit", "callee", "array_callee"):
        return None
    counting = not any(keyword.arg == "numbers" for keyword in getattr(node, "keywords", ()))
    return name.id if counting else "njit of numbers"


def _file_of(module: str) -> Path:
    path = PACKAGE.parent.joinpath(*module.split("."))
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


@pytest.fixture(scope="module")
def sources() -> dict[Path, _Source]:
    return {file: _Source(file) for file in PACKAGE.rglob("*.py")}


@pytest.mark.slow
def test_all_that_kernels_read_counts_in_the_digest(sources: dict[Path, _Source]) -> None:
    assert sum(len(source.kernels) for source in sources.values()) > 200
    for source in sources.values():
        waiting = [source.taken[name] for name in source.read & set(source.taken)] if source.kernels else []
        for module, name in waiting:  # grows by where a module has it from
            file = _file_of(f"{module}.{name}") if _file_of(f"{module}.{name}").exists() else _file_of(module)
            assert "trailmark.jit" in sources[file].text, f"{source.file}: {name} of {module}"
            if name in sources[file].taken:
                waiting.append(sources[file].taken[name])


@pytest.mark.slow
def test_no_python_calls_what_only_kernels_call(sources: dict[Path, _Source]) -> None:
    inner = {(source.file, f.name) for source in sources.values() for f, kind in source.kernels if "callee" in kind}
    tests = {file: _Source(file) for file in Path(__file__).parents[1].rglob("*.py") if file != Path(__file__)}
    for source in (sources | tests).values():
        known = {name: (_file_of(module), name_there) for name, (module, name_there) in source.taken.items()}
        known |= {f.name: (source.file, f.name) for f, _ in source.kernels}
        wrong = [name for name, what in known.items() if what in inner and name in source.in_python]
        assert not wrong, f"{source.file}: {wrong}"


@pytest.mark.slow
def test_every_kernel_is_made_here_and_gives_python_what_is_made_without_it(sources: dict[Path, _Source]) -> None:
    named = {
        node.name
        for source in sources.values()
        for node in ast.walk(ast.parse(source.text))
        if isinstance(node, ast.ClassDef) and any(ast.unparse(base) == "NamedTuple" for base in node.bases)
    } - {"Window"}  # one of the kernels' is a plain tuple
    for source in sources.values():
        lines = [line for line in source.text.splitlines() if line.startswith(("from numba import", "import numba"))]
        assert source.file.name == "jit.py" or not any("njit" in line for line in lines), source.file
        for f, kind in source.kernels:
            assert not any(isinstance(node, ast.Raise | ast.Assert) for node in ast.walk(f)), f.name
            given = {n.id for n in ast.walk(f.returns) if isinstance(n, ast.Name)} if f.returns else set()
            assert "callee" in kind or not given & named, f"{source.file}: {f.name}"


@pytest.mark.slow
def test_what_counts_no_references_gives_back_no_arrays_and_takes_none(sources: dict[Path, _Source]) -> None:
    counting = ("njit", "array_callee")
    # What is not said to give numbers may give arrays; of new_scratch each kind of motion has its own.
    givers = {
        (source.file, f.name)
        for source in sources.values()
        for f, kind in source.kernels
        if kind in counting and not (f.returns and re.fullmatch(NUMBERS, ast.unparse(f.returns)))
    }
    for source in sources.values():
        here = {name: (_file_of(module), there) for name, (module, there) in source.taken.items()}
        here |= {f.name: (source.file, f.name) for f, _ in source.kernels}
        for f in (f for f, kind in source.kernels if kind not in counting):
            called = {node.func.id for node in ast.walk(f) if isinstance(node, ast.Call) and hasattr(node.func, "id")}
            assert not any(here.get(name) in givers or name == "new_scratch" for name in called), f.name
            assert f.returns is None or "Array" not in ast.unparse(f.returns), f.name


KEPT = """
import sys
sys.path.insert(0, FOLDER)
from probe import outer
print(outer(1), sum(outer.stats.cache_hits.values()))
"""
PROBE = """
from trailmark.jit import callee, njit

@callee
def inner(x):
    return x + 1

@njit
def outer(x):
    return inner(x)
"""


@pytest.mark.slow
def test_code_is_kept_and_found_again_and_kernels_run_as_python_too(tmp_path: Path) -> None:
    (tmp_path / "probe.py").write_text(PROBE)
    program = KEPT.replace("FOLDER", repr(os.fspath(tmp_path)))
    assert [run_python(["-c", program], timeout=120.0).stdout.strip() for _ in range(2)] == ["2 0", "2 1"]
    plain = program.replace("sum(outer.stats.cache_hits.values())", "''")
    words = [sys.executable, "-c", plain]
    known = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": os.fspath(PACKAGE.parent)}
    done = subprocess.run(words, capture_output=True, text=True, check=True, timeout=120, env=known)
    assert done.stdout.strip() == "2"


def test_compiling_is_told_once_in_a_row_and_not_at_all_where_it_takes_no_time() -> None:
    clock, said = [0.0], list[str]()
    compiling = jit._Compiling(said.append, lambda: clock[0])
    compiling._depth = 100  # of numba's lock, which is not taken here

    def compile_at(begin: float, end: float, module: str = "trailmark.search.heap") -> None:
        function = SimpleNamespace(py_func=SimpleNamespace(__module__=module))
        what: Any = SimpleNamespace(kind="numba:compile", data={"dispatcher": function})
        clock[0] = begin
        compiling.on_start(what)
        clock[0] = end
        compiling.on_end(what)
        compiling.on_end(SimpleNamespace(kind="numba:compiler_lock"))

    compile_at(10.0, 10.6)
    assert said == []
    for begin in (10.7, 11.5, 20.1):
        compile_at(begin, begin + 0.75)
    compile_at(60.0, 65.0, "somebody.else")
    assert len(said) == 1
    compile_at(100.0, 101.5)
    compile_at(101.6, 103.0)
    assert len(said) == 2


def test_what_is_compiled_for_is_said_while_it_is() -> None:
    with compiling_for("tests"):
        assert jit.compiling.uses[-1:] == ["tests"]
    assert jit.compiling.uses[-1:] != ["tests"]


@pytest.fixture
def called() -> Iterator[list[int]]:
    """The signals for which this test's handler of SIGUSR1 and SIGUSR2 was called, which raises KeyboardInterrupt."""
    numbers: list[int] = []

    def handler(number: int, frame: FrameType | None) -> None:
        numbers.append(number)
        raise KeyboardInterrupt

    before = {number: signal.signal(number, handler) for number in (signal.SIGUSR1, signal.SIGUSR2)}
    yield numbers
    for number, old in before.items():
        signal.signal(number, old)


def kernels(during: Callable[[], object]) -> tuple[Any, Any]:
    """Return a kernel and one that it calls, and do something once numba compiles that one."""

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(jit, "kernel_folder", lambda: None)  # they are compiled, and not found

        @njit
        def inner(x: float) -> float:
            return 2.0 * x

        @njit
        def outer(x: float) -> float:
            return float(inner(x) + 1.0)

    class Doing(event.Listener):  # type: ignore[misc,unused-ignore]  # numba ships types in part
        def on_start(self, event: Any) -> None:
            if event.data["dispatcher"] is inner:
                during()

        def on_end(self, event: Any) -> None:
            pass

    event.register("numba:compile", Doing())  # type: ignore[no-untyped-call,unused-ignore]  # numba ships types in part
    return outer, inner


def test_a_signal_waits_until_a_kernel_and_those_that_it_calls_are_compiled(called: list[int]) -> None:
    handlers = [signal.getsignal(number) for number in sorted(signal.valid_signals())]
    outer, _ = kernels(lambda: signal.raise_signal(signal.SIGUSR1))
    with pytest.raises(KeyboardInterrupt):
        outer(3.0)
    assert called == [signal.SIGUSR1]
    assert [signal.getsignal(number) for number in sorted(signal.valid_signals())] == handlers
    assert len(outer.signatures) == 1
    assert outer(3.0) == 7.0
    assert len(outer.signatures) == 1


def test_a_second_signal_of_a_kind_does_not_wait(called: list[int]) -> None:
    seen = []

    def twice() -> None:
        signal.raise_signal(signal.SIGUSR1)
        signal.raise_signal(signal.SIGUSR2)
        assert called == []
        try:
            signal.raise_signal(signal.SIGUSR1)
        except KeyboardInterrupt:
            seen.append(list(called))

    outer, _ = kernels(twice)
    with pytest.raises(KeyboardInterrupt):
        outer(3.0)
    assert seen == [[signal.SIGUSR1]]


def test_no_garbage_is_collected_while_a_kernel_is_compiled() -> None:
    collecting: list[bool] = []
    gc.enable()
    outer, _ = kernels(lambda: collecting.append(gc.isenabled()))
    assert outer(1.0) == 3.0
    assert collecting == [False]
    assert gc.isenabled()


def test_what_cannot_be_compiled_says_so_and_harms_nothing() -> None:
    @njit
    def wrong(x: Any) -> Any:
        return x.there_is_no_such_thing

    with pytest.raises(Exception, match="there_is_no_such_thing"):
        wrong(1.0)
    assert gc.isenabled()
    assert callable(signal.getsignal(signal.SIGINT))
    assert signal.getsignal(signal.SIGINT) != jit.compiling._wait
    assert kernels(int)[0](1.0) == 3.0


@pytest.mark.slow
def test_threads_may_compile_at_the_same_time() -> None:
    pairs = [kernels(int) for _ in range(4)]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda pair: (pair[0](4.0), pair[1](2.0)), pairs))
    assert found == [(9.0, 4.0)] * 4
    assert threading.current_thread() is threading.main_thread()
    assert gc.isenabled()


@pytest.mark.slow
def test_a_callee_serves_kernels() -> None:
    @callee
    def inner(values: Any, n: int) -> float:
        return float(values[n] + n)

    @njit(nogil=True)
    def outer(values: Any) -> float:
        total = 0.0
        for i in range(len(values)):
            total += inner(values, i)
        return total

    assert outer(np.arange(5.0)) == outer(np.arange(5)) == 20.0


ATTACK = """
import os, signal, sys, threading, time
import numpy as np
from trailmark.errors import as_raised
from trailmark.jit import callee, njit

@callee
def busy(values, beside):
    # Until it is told that the signal was sent; where it writes is not known beforehand, so that it reads again.
    while values[1] == 0.0:
        values[beside] += 1.0

@njit(nogil=True)
def number(values, beside):
    busy(values, beside)
    return 1.5

@njit(nogil=True)
def array(values, beside):
    busy(values, beside)
    return values.copy()

@njit(nogil=True)
def several(values, beside):
    busy(values, beside)
    return 1.0, True, (values.copy(), values), values[1:]

values = np.zeros(3)

def interrupt():
    time.sleep(0.05)
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(0.05)  # another thread may get it
    values[1] = 1.0

for kernel in (number, array, several):
    values[1] = 1.0
    expected = kernel(values, 0)
    for _ in range(ROUNDS):
        values[1] = 0.0
        thread = threading.Thread(target=interrupt)
        try:
            thread.start()
            as_raised(kernel)(values, 0)  # as all public functions do
            sys.exit("the kernel returned")
        except KeyboardInterrupt:
            pass
        thread.join()
    assert type(kernel(values, 0)) is type(expected)
    print(kernel.__name__, "sound", flush=True)
"""


@pytest.mark.slow
def test_ctrl_c_while_a_kernel_runs_is_raised_when_it_returns() -> None:
    run = run_python(["-c", ATTACK.replace("ROUNDS", str(few(3)))], timeout=120.0)
    said = [f"{kernel} sound" for kernel in ("number", "array", "several")]
    assert (run.returncode, run.stdout.splitlines()) == (0, said), run.stderr[-500:]


JOBS = """
import os
from pathlib import Path
from trailmark.jit import njit

@njit
def first(x):
    return x + 1

@njit
def second(x):
    return x + 2

@njit
def third(x):
    return x + 3

def do(n, folder):
    (first, second, third)[n](1)
    Path(folder, f"{n} by {os.getpid()}").touch()
"""
SIDE_BY_SIDE = """
import sys, time
from functools import partial
from pathlib import Path
sys.path.insert(0, FOLDER)
from trailmark.planning.warmup import side_by_side
import jobs
BROKEN
todo = [partial(jobs.do, n, DONE) for n in (0, 1, 2)]
with side_by_side(todo):
    todo[0]()
    while len(list(Path(DONE).iterdir())) < FILES:
        time.sleep(0.05)
    for job in todo[1:]:
        job()
kernels = (jobs.first, jobs.second, jobs.third)
print([sum(kernel.stats.cache_hits.values()) for kernel in kernels])
"""


@pytest.mark.slow
@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="one processor: one process")
def test_a_second_process_compiles_from_the_end(tmp_path: Path) -> None:
    (tmp_path / "jobs.py").write_text(JOBS)
    done = tmp_path / "done"
    done.mkdir()

    def run(files: int, broken: str = "") -> tuple[str, int]:
        program = SIDE_BY_SIDE.replace("FOLDER", repr(os.fspath(tmp_path))).replace("DONE", repr(os.fspath(done)))
        result = run_python(["-c", program.replace("FILES", str(files)).replace("BROKEN", broken)], timeout=120.0)
        assert result.returncode == 0, result.stderr
        by = {file.name.split(" by ")[1] for file in done.iterdir()}
        for file in done.iterdir():
            file.unlink()
        return result.stdout.strip(), len(by)

    assert run(1, "sys.executable = '/dev/null/none'") == ("[0, 0, 0]", 1)
    (tmp_path / "jobs.py").write_text(JOBS + "\n")  # another state: compiled anew
    assert run(4) == ("[0, 1, 1]", 2)
    assert run(1) == ("[1, 1, 1]", 1)  # what is compiled already starts no process
