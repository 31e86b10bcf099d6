"""The cache of compiled kernels: found everywhere, never stale, never a reason to fail."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import trailmark

SOURCE = Path(trailmark.__file__).resolve().parent

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


def run(folder: Path, program: str = PROGRAM, **environment: str) -> tuple[str, str]:
    """Return what a program prints on stdout and stderr, but for the line that says that it compiles."""
    path = os.pathsep.join([str(folder.parent), str(SOURCE.parent)])
    done = subprocess.run(
        [sys.executable, "-c", program.replace("probe", folder.name)],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
        env={k: v for k, v in os.environ.items() if not k.startswith("NUMBA")} | {"PYTHONPATH": path} | environment,
    )
    lines = [line for line in done.stderr.splitlines(keepends=True) if ": compiling " not in line]
    return done.stdout.strip(), "".join(lines)


def nowhere(folder: Path) -> dict[str, str]:
    """Take the places where numba would write away, from root too: a file stands in the folder's place."""
    (folder / "__pycache__").touch()
    return {"HOME": "/dev/null/none", "XDG_CACHE_HOME": "/dev/null/none"}


def test_code_is_kept_and_found_again(probe: Path) -> None:
    assert run(probe) == ("[2, 2, 11, 2] [0, 0, 0, 0]", "")
    assert run(probe) == ("[2, 2, 11, 2] [1, 1, 1, 1]", "")


CONTENTS = """
import time
since = time.time()
from probe.outer import by_constant, by_name
from trailmark.compiled.cache import cache_contents
by_constant(1), by_name(1)
found = cache_contents(since)
print(found.folder, found.files, found.written, found.size > 1000, found.free > 0)
"""


def test_the_cache_says_where_it_is_and_what_it_holds(probe: Path) -> None:
    assert run(probe, CONTENTS)[0] == f"{probe / '__pycache__'} 2 2 True True"
    assert run(probe, CONTENTS)[0] == f"{probe / '__pycache__'} 2 0 True True"
    program = "from trailmark.compiled.cache import cache_contents; print(cache_contents(0.0))"
    assert "folder=None, files=0" in run(probe, program)[0]


def test_what_was_loaded_becomes_part_of_others_as_code_of_their_own(probe: Path) -> None:
    # Allocates, fails and calls another: what code in a cache could want of what is not kept there.
    (probe / "inner.py").write_text(
        "import numpy as np\nfrom trailmark.compiled import njit\nSHIFT = 10\n"
        "@njit(cache=True)\ndef inner(x):\n"
        "    if x < 0:\n        raise ValueError('negative')\n    return np.full(x + 1, SHIFT)[-1] + len([x] * x)\n"
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
        assert run(probe, f"{ask}print({calls}, {counted})") == (f"12 {hits}", ""), calls
    failing = "\ntry:\n    by_module(-1)\nexcept ValueError as error:\n    print(error)"
    assert run(probe, ask + failing) == ("negative", "")


@pytest.mark.parametrize(
    ("shift", "inner", "answers"), [(10, "x + 2", "[3, 3, 11, 3]"), (20, "x + 1", "[2, 2, 21, 2]")]
)
def test_no_kernel_runs_old_code_of_another_file(probe: Path, shift: int, inner: str, answers: str) -> None:
    run(probe)
    write(probe, shift, inner)
    assert run(probe)[0].startswith(answers)


def test_without_a_place_the_temporary_folder_serves(probe: Path, tmp_path: Path) -> None:
    environment = nowhere(probe) | {"TMPDIR": str(tmp_path)}
    kept = tmp_path / f"trailmark-{os.getuid()}"
    for hits in ("[0, 0, 0, 0]", "[1, 1, 1, 1]"):
        out, err = run(probe, **environment)
        assert out == f"[2, 2, 11, 2] {hits}"
        assert err == f"trailmark: no cache folder for compiled kernels can be written to, they are cached in {kept}\n"
    assert kept.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("trap", ["open to all", "a link", "a file"])
def test_a_folder_that_others_may_have_made_is_not_trusted(probe: Path, tmp_path: Path, trap: str) -> None:
    kept = tmp_path / f"trailmark-{os.getuid()}"
    if trap == "open to all":
        kept.mkdir()
        kept.chmod(0o777)
    elif trap == "a link":
        (tmp_path / "theirs").mkdir()
        kept.symlink_to(tmp_path / "theirs")
    else:
        kept.touch()
    out, err = run(probe, **nowhere(probe), TMPDIR=str(tmp_path))
    assert out == "[2, 2, 11, 2] [0, 0, 0, 0]"
    assert err.count("\n") == 1
    assert f"{kept}\n" not in err
    assert not list(kept.iterdir() if kept.is_dir() else ())


def test_without_any_place_there_is_no_cache(probe: Path) -> None:
    out, err = run(probe, "import tempfile; tempfile.tempdir = '/dev/null/none'\n" + PROGRAM, **nowhere(probe))
    assert out == "[2, 2, 11, 2] [0, 0, 0, 0]"
    assert err.startswith("trailmark: no folder can be written to")
    assert err.count("\n") == 1


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
def test_damaged_files_are_compiled_anew(probe: Path, kind: str) -> None:
    run(probe)
    files = list(probe.rglob(f"*.{kind}"))
    assert len(files) == 4
    for file, content in zip(files, (b"", b"\x80\x05", b"not a pickle", files[3].read_bytes()[:40]), strict=True):
        file.write_bytes(content)
    assert run(probe) == ("[2, 2, 11, 2] [0, 0, 0, 0]", "")
    assert run(probe) == ("[2, 2, 11, 2] [1, 1, 1, 1]", "")


def test_a_full_disk_is_one_line(probe: Path) -> None:
    full = """
import errno, os, numba.core.caching as caching
def replace(*_):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
caching.os = type("Full", (), {**{n: getattr(os, n) for n in dir(os)}, "replace": staticmethod(replace)})
"""
    out, err = run(probe, full + PROGRAM)
    assert out == "[2, 2, 11, 2] [0, 0, 0, 0]"
    assert err == "trailmark: compiled kernels cannot be cached: No space left on device\n"
    assert not list(probe.rglob("*.nb[ic]*"))


def test_kernels_run_as_python_too(probe: Path) -> None:
    plain = PROGRAM.replace("[sum(kernel.stats.cache_hits.values()) for kernel in kernels]", "''")
    assert run(probe, plain, NUMBA_DISABLE_JIT="1") == ("[2, 2, 11, 2]", "")


TWO_TYPES = """
import sys
from probe.outer import by_constant
print(by_constant(int(sys.argv[1])), by_constant(float(sys.argv[1])), sum(by_constant.stats.cache_hits.values()))
"""


def test_each_set_of_types_has_files_of_its_own(probe: Path) -> None:
    program = TWO_TYPES.replace("sys.argv[1]", "1")
    assert run(probe, program)[0] == "11 11.0 0"
    files = sorted(probe.rglob("*by_constant*.nbc"))
    assert len(files) == 2
    files[0].unlink()
    assert run(probe, program)[0] == "11 11.0 1"


def test_of_two_processes_one_compiles_and_the_other_waits_for_it(probe: Path) -> None:
    program = """
import sys, time
import numba.core.compiler as compiler
begun = compiler.Compiler.compile_extra
def slow(self, function):
    time.sleep(1.0)
    return begun(self, function)
compiler.Compiler.compile_extra = slow
from probe.outer import by_constant
print(by_constant(1), sum(by_constant.stats.cache_hits.values()))
"""
    words = [sys.executable, "-c", program.replace("probe", probe.name)]
    path = os.pathsep.join([str(probe.parent), str(SOURCE.parent)])
    environment = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA")} | {"PYTHONPATH": path}
    both = [subprocess.Popen(words, stdout=subprocess.PIPE, text=True, env=environment) for _ in range(2)]
    answers = sorted(process.communicate(timeout=120)[0].strip() for process in both)
    assert answers == ["11 0", "11 1"]


def test_every_kernel_is_made_here() -> None:
    files = list(SOURCE.rglob("*.py"))
    assert len(files) > 100
    for file in files:
        text = file.read_text(encoding="utf-8")
        imported = [line for line in text.splitlines() if line.startswith(("from numba import", "import numba"))]
        assert file.parent.name == "compiled" or not any("njit" in line for line in imported), file
