"""The cache of compiled kernels: found everywhere, never stale, never a reason to fail."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.support.forks import Forks, complaints

import trailmark

SOURCE = Path(trailmark.__file__).resolve().parent
Run = Callable[..., tuple[str, str]]

INNER = """
from trailmark.compiled import njit

SHIFT = {shift}

@njit(cache=True)
def inner(x):
    return {inner}
"""
OUTER = """
from probe import inner as module
from probe.inner import SHIFT, inner
from trailmark.compiled import njit

@njit(cache=True)
def by_name(x):
    return inner(x)

@njit(cache=True)
def by_module(x):
    return module.inner(x)

@njit(cache=True)
def by_constant(x):
    return x + SHIFT

@njit(cache=True)
def far(x):
    return by_name(x)
"""
PROGRAM = """
import sys
from probe.outer import by_constant, by_module, by_name, far
kernels = (by_name, by_module, by_constant, far)
print([kernel(1) for kernel in kernels], [sum(kernel.stats.cache_hits.values()) for kernel in kernels])
"""

SHORT = """
from probe.outer import by_constant
print(by_constant(1), sum(by_constant.stats.cache_hits.values()))
"""
"""For what concerns the place alone: one kernel, compiled or found."""


@pytest.fixture
def probe(tmp_path: Path) -> Path:
    """A package of four small kernels, called trailmark so that its own code counts."""
    folder = tmp_path / "trailmark_probe"
    write(folder, shift=10, inner="x + 1")
    return folder


def write(folder: Path, shift: int, inner: str) -> None:
    folder.mkdir(exist_ok=True)
    (folder / "__init__.py").touch()
    (folder / "inner.py").write_text(INNER.format(shift=shift, inner=inner).replace("probe", folder.name))
    (folder / "outer.py").write_text(OUTER.replace("probe", folder.name))


@pytest.fixture
def run(probe: Path, forks: Forks) -> Run:
    """Run a program in a process that has not compiled the kernels of the probe nor asked for its cache's place.

    What it prints on stdout and stderr is returned, but for the line that says that it compiles.
    """

    def started(program: str = PROGRAM, **environment: str) -> tuple[str, str]:
        # Python takes what it compiled of a file that was as long in the same second: that is not our cache's fault.
        begin = (
            f"import sys, tempfile; sys.path.insert(0, {os.fspath(probe.parent)!r}); "
            "tempfile.tempdir, sys.dont_write_bytecode = None, True\n"
        )
        known = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA")} | environment
        done = forks.run(["-c", begin + program.replace("probe", probe.name)], timeout=120.0, env=known)
        assert done.returncode == 0, done.stderr
        lines = [line for line in complaints(done).splitlines(keepends=True) if ": compiling " not in line]
        return done.stdout.strip(), "".join(lines)

    return started


def fresh(folder: Path, program: str, **environment: str) -> tuple[str, str]:
    """Return what a program prints on stdout and stderr in an interpreter that has imported nothing before."""
    path = os.pathsep.join([str(folder.parent), str(SOURCE.parent)])
    known = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA")} | {"PYTHONPATH": path} | environment
    words = [sys.executable, "-c", program.replace("probe", folder.name)]
    done = subprocess.run(words, capture_output=True, text=True, check=True, timeout=120, env=known)
    return done.stdout.strip(), done.stderr


def nowhere(folder: Path) -> dict[str, str]:
    """Take the places where numba would write away, from root too: a file stands in the folder's place."""
    (folder / "__pycache__").touch()
    return {"HOME": "/dev/null/none", "XDG_CACHE_HOME": "/dev/null/none"}


@pytest.mark.slow
def test_code_is_kept_and_found_again(probe: Path, run: Run) -> None:
    assert run() == ("[2, 2, 11, 2] [0, 0, 0, 0]", "")
    assert run() == ("[2, 2, 11, 2] [1, 1, 1, 1]", "")


CONTENTS = """
import time
since = time.time()
from trailmark.compiled.cache import cache_contents
before = cache_contents(0.0)
print(before.folder, before.files)
from probe.outer import by_constant, by_name
by_constant(1), by_name(1)
found = cache_contents(since)
print(found.folder, found.files, found.written, found.size > 1000, found.free > 0)
"""


@pytest.mark.slow
def test_the_cache_says_where_it_is_and_what_it_holds(probe: Path, run: Run) -> None:
    assert fresh(probe, CONTENTS)[0].splitlines() == ["None 0", f"{probe / '__pycache__'} 2 2 True True"]
    # The second time nothing is written; in a fork other places are known before.
    forget = "from trailmark.compiled import cache\ncache._folders.clear()\n"
    assert run(forget + CONTENTS)[0].splitlines() == ["None 0", f"{probe / '__pycache__'} 2 0 True True"]


@pytest.mark.slow
def test_what_was_loaded_becomes_part_of_others_as_code_of_their_own(probe: Path, run: Run) -> None:
    # Allocates, fails and calls another: what code in a cache could want of what is not kept there.
    (probe / "inner.py").write_text(
        "import numpy as np\nfrom trailmark.compiled import njit\nSHIFT = 10\n"
        "@njit(cache=True)\ndef inner(x):\n"
        "    if x < 0:\n        raise ValueError('negative')\n    return np.full(x + 1, SHIFT)[-1] + x\n"
    )
    ask = "from probe.inner import inner; from probe.outer import by_module, far; "
    for calls, hits in (
        ("inner(2)", "[0, 0, 0]"),
        ("(inner(2), far(2))[1]", "[1, 0, 0]"),
        ("far(2)", "[0, 1, 0]"),
        ("(far(2), by_module(2), inner(2))[2]", "[1, 1, 0]"),
        ("by_module(2)", "[0, 0, 1]"),
    ):
        counted = "[sum(kernel.stats.cache_hits.values()) for kernel in (inner, far, by_module)]"
        assert run(f"{ask}print({calls}, {counted})") == (f"12 {hits}", ""), calls
    failing = "\ntry:\n    by_module(-1)\nexcept ValueError as error:\n    print(error)"
    assert run(ask + failing) == ("negative", "")


@pytest.mark.slow
def test_no_kernel_runs_old_code_of_another_file(probe: Path, run: Run) -> None:
    run()
    for shift, inner, answers in ((10, "x + 2", "[3, 3, 11, 3]"), (20, "x + 2", "[3, 3, 21, 3]")):
        write(probe, shift, inner)
        assert run()[0].startswith(answers)


@pytest.mark.slow
def test_without_a_place_the_temporary_folder_serves(probe: Path, run: Run, tmp_path: Path) -> None:
    environment = nowhere(probe) | {"TMPDIR": str(tmp_path)}
    kept = tmp_path / f"trailmark-{os.getuid()}"
    for hits in (0, 1):
        out, err = run(SHORT, **environment)
        assert out == f"11 {hits}"
        assert err == f"trailmark: no cache folder for compiled kernels can be written to, they are cached in {kept}\n"
    assert kept.stat().st_mode & 0o777 == 0o700


@pytest.mark.slow
@pytest.mark.parametrize("trap", ["open to all", "a link", "a file"])
def test_a_folder_that_others_may_have_made_is_not_trusted(probe: Path, run: Run, tmp_path: Path, trap: str) -> None:
    kept = tmp_path / f"trailmark-{os.getuid()}"
    if trap == "open to all":
        kept.mkdir()
        kept.chmod(0o777)
    elif trap == "a link":
        (tmp_path / "theirs").mkdir()
        kept.symlink_to(tmp_path / "theirs")
    else:
        kept.touch()
    out, err = run(SHORT, **nowhere(probe), TMPDIR=str(tmp_path))
    assert out == "11 0"
    assert err.count("\n") == 1
    assert f"{kept}\n" not in err
    assert not list(kept.iterdir() if kept.is_dir() else ())


@pytest.mark.slow
def test_without_any_place_there_is_no_cache(probe: Path, run: Run) -> None:
    out, err = run("import tempfile; tempfile.tempdir = '/dev/null/none'\n" + SHORT, **nowhere(probe))
    assert out == "11 0"
    assert err.startswith("trailmark: no folder can be written to")
    assert err.count("\n") == 1


@pytest.mark.slow
def test_damaged_files_are_compiled_anew(probe: Path, run: Run) -> None:
    run()
    for kind in ("nbi", "nbc"):
        files = list(probe.rglob(f"*.{kind}"))
        assert len(files) == 4
        for file, content in zip(files, (b"", b"\x80\x05", b"not a pickle", files[3].read_bytes()[:40]), strict=True):
            file.write_bytes(content)
        assert run() == ("[2, 2, 11, 2] [0, 0, 0, 0]", "")
    assert run() == ("[2, 2, 11, 2] [1, 1, 1, 1]", "")


@pytest.mark.slow
def test_a_full_disk_is_one_line(probe: Path, run: Run) -> None:
    full = """
import errno, os, numba.core.caching as caching
def replace(*_):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
caching.os = type("Full", (), {**{n: getattr(os, n) for n in dir(os)}, "replace": staticmethod(replace)})
"""
    out, err = run(full + SHORT)
    assert out == "11 0"
    assert err == "trailmark: compiled kernels cannot be cached: No space left on device\n"
    assert not list(probe.rglob("*.nb[ic]*"))


@pytest.mark.slow
def test_kernels_run_as_python_too(probe: Path) -> None:
    """In an interpreter of its own: numba looks at this once, when it is imported."""
    plain = PROGRAM.replace("[sum(kernel.stats.cache_hits.values()) for kernel in kernels]", "''")
    assert fresh(probe, plain, NUMBA_DISABLE_JIT="1") == ("[2, 2, 11, 2]", "")


TWO_TYPES = """
import sys
from probe.outer import by_constant
print(by_constant(int(sys.argv[1])), by_constant(float(sys.argv[1])), sum(by_constant.stats.cache_hits.values()))
"""


@pytest.mark.slow
def test_each_set_of_types_has_files_of_its_own(probe: Path, run: Run) -> None:
    program = TWO_TYPES.replace("sys.argv[1]", "1")
    assert run(program)[0] == "11 11.0 0"
    files = sorted(probe.rglob("*by_constant*.nbc"))
    assert len(files) == 2
    files[0].unlink()
    assert run(program)[0] == "11 11.0 1"


@pytest.mark.slow
def test_of_two_processes_one_compiles_and_the_other_waits_for_it(run: Run) -> None:
    program = """
import os, sys, time
child = os.fork()
import numba.core.compiler as compiler
begun = compiler.Compiler.compile_extra
def slow(self, function):
    time.sleep(1.0)
    return begun(self, function)
compiler.Compiler.compile_extra = slow
from probe.outer import by_constant
print(by_constant(1), sum(by_constant.stats.cache_hits.values()), flush=True)
if child and os.waitpid(child, 0)[1]:
    sys.exit("the other one failed")
"""
    assert sorted(run(program)[0].splitlines()) == ["11 0", "11 1"]


def test_every_kernel_is_made_here() -> None:
    files = list(SOURCE.rglob("*.py"))
    assert len(files) > 100
    for file in files:
        text = file.read_text(encoding="utf-8")
        imported = [line for line in text.splitlines() if line.startswith(("from numba import", "import numba"))]
        assert file.parent.name == "compiled" or not any("njit" in line for line in imported), file
