"""Kernels: functions that numba compiles, kept in one folder for each state of their sources.

Numba's cache looks at a kernel's own file alone, although code of the kernels that it calls is part of it. Here the
folder's name is a digest of all files that kernels are made of, so that code of another state is never used. It lies
beside the package, else in the user's cache, else among the temporary files; ``NUMBA_CACHE_DIR`` names another place.
"""

from __future__ import annotations

import fcntl
import gc
import hashlib
import os
import shutil
import signal
import stat
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, partial
from pathlib import Path
from time import perf_counter
from typing import IO, Any, Literal, ParamSpec, TypeVar, cast, overload

import numba
import numpy as np
from numba.core import event

__all__ = ["array_callee", "callee", "compiling", "compiling_for", "kernel_digest", "kernel_folder", "njit"]

P = ParamSpec("P")
R = TypeVar("R")
N = TypeVar("N", bound=float | np.integer[Any] | tuple[float, ...] | None)

PACKAGE = Path(__file__).resolve().parent
SPACE = 300_000_000
"""Bytes that all kernels take at most: a disk with less left is as one that cannot be written to."""

REPORT_AFTER, PAUSE = 1.0, 30.0
"""Seconds of compiling before it is reported, and without compiling before it is reported again."""

RAISING = "INT", "TERM", "HUP", "ALRM", "VTALRM", "PROF", "USR1", "USR2"
SIGNALS = [getattr(signal, f"SIG{name}") for name in RAISING if hasattr(signal, f"SIG{name}")]
"""Those of which handlers raise exceptions."""

_deciding = threading.Lock()


def report(line: str) -> None:
    """Print one line on stderr."""
    if sys.stderr is not None:
        print(f"trailmark: {line}", file=sys.stderr, flush=True)  # noqa: T201  # a library reaches its user in no other way


def kernel_digest(package: Path = PACKAGE) -> str:
    """Return a digest of all files of a package that name this module: of kernels, and of what kernels read."""
    digest = hashlib.sha256()
    for file, text in ((file, file.read_bytes()) for file in sorted(package.rglob("*.py"))):
        if b"trailmark.jit" in text:
            digest.update(f"{file.relative_to(package)} {len(text)} ".encode() + text)
    return digest.hexdigest()[:16]


@cache
def kernel_folder() -> Path | None:
    """Return the folder that compiled kernels are kept in; None, which is said in one line, if there is none."""
    own = f"trailmark-{hashlib.sha256(os.fsencode(PACKAGE)).hexdigest()[:8]}"
    chosen = getattr(numba.config, "CACHE_DIR", "")
    user = os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()
    places = [*([Path(chosen, own)] if chosen else []), PACKAGE / "__pycache__" / "kernels", Path(user, own)]
    digest = kernel_digest()
    for place in places:
        if _usable(place / digest):
            return place / digest
    private = _private_folder()
    if private is not None and _usable(private / own / digest):
        report(f"no cache folder for compiled kernels can be written to, they are cached in {private}")
        return private / own / digest
    report("no folder can be written to: the kernels are compiled anew by each process (NUMBA_CACHE_DIR names one)")
    return None


def _usable(folder: Path) -> bool:
    """Return whether kernels can be kept in a folder; removes those of other states of the same sources beside it."""
    try:
        if not folder.is_dir():
            folder.mkdir(parents=True)
            for other in set(folder.parent.iterdir()) - {folder}:
                shutil.rmtree(other, ignore_errors=True)
        tempfile.TemporaryFile(dir=folder).close()
        return shutil.disk_usage(folder).free > SPACE
    except OSError:
        return False


def _private_folder() -> Path | None:
    """Return a temporary folder that only this user can write to, or None: who writes there decides what runs here."""
    try:
        folder = Path(tempfile.gettempdir()) / f"trailmark-{os.getuid()}"
        with suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        facts = folder.lstat()
        mine = stat.S_ISDIR(facts.st_mode) and facts.st_uid == os.getuid() and not facts.st_mode & 0o022
        return folder if mine else Path(tempfile.mkdtemp(prefix="trailmark-"))
    except OSError:
        return None


def _compiled(function: Callable[P, R], **options: Any) -> Callable[P, R]:
    folder, kernel = kernel_folder(), partial(numba.njit, no_cfunc_wrapper=True, **options)
    if folder is not None:
        with _deciding:
            before = numba.config.CACHE_DIR  # type: ignore[attr-defined,unused-ignore]  # numba makes it when imported
            numba.config.CACHE_DIR = str(folder)  # type: ignore[attr-defined,unused-ignore]
            try:
                return cast(Callable[P, R], kernel(cache=True)(function))
            except RuntimeError:  # the function is of no file, or the folder has gone
                pass
            finally:
                numba.config.CACHE_DIR = before  # type: ignore[attr-defined,unused-ignore]
    return cast(Callable[P, R], kernel()(function))


@overload
def njit(function: Callable[P, R], /) -> Callable[P, R]: ...
@overload
def njit(*, nogil: bool = ...) -> Callable[[Callable[P, R]], Callable[P, R]]: ...
@overload
def njit(*, numbers: Literal[True], nogil: bool = ...) -> Callable[[Callable[P, N]], Callable[P, N]]: ...
def njit(function: Any = None, /, *, nogil: bool = False, numbers: bool = False) -> Any:
    """Compile a kernel that Python calls, at its first call.

    With ``nogil`` it runs beside Python's other threads, as those must that are given a deadline. Of ``numbers`` are
    those that kernels call too, as a :func:`callee`.
    """
    if function is None:
        return partial(_compiled, nogil=nogil, _nrt=not numbers)
    return _compiled(function, _nrt=True)


def callee(function: Callable[P, N]) -> Callable[P, N]:
    """Compile a kernel that only kernels call, which makes no arrays and gives none back.

    Nothing is made for calls from Python, which would end the process. By ``_nrt=False`` no references to arrays are
    counted, which takes a third of the time where tuples of many arrays are handed on. So it may not call what gives
    back arrays either: nobody would free them.
    """
    return _compiled(function, no_cpython_wrapper=True, _nrt=False)


def array_callee(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a kernel that only kernels call, and that makes arrays or gives some back."""
    return _compiled(function, no_cpython_wrapper=True, _nrt=True)


class _Compiling(event.Listener):
    """What happens around numba's work: signals wait, garbage stays, one process writes, and one line tells of it.

    An exception between two lines of numba's, as Ctrl-C raises it, would leave its tables broken.
    """

    def __init__(self, say: Callable[[str], None] = report, clock: Callable[[], float] = perf_counter) -> None:
        self.alone = True  # no second process compiles for this one, nor this one for another
        self.uses: list[str] = []  # what kernels are compiled for, the innermost last
        self.begin: Callable[[], None] | None = None  # called when the next kernel is compiled
        self._say, self._clock = say, clock
        self._begun = self._last = -PAUSE
        self._said = self._said_before = self._collecting = False
        self._depth = 0
        self._handlers: dict[int, Any] = {}
        self._waiting: list[int] = []
        self._writing: IO[bytes] | None = None

    def on_start(self, event: Any) -> None:
        """Numba takes its lock, to find or compile a kernel; or begins to compile one."""
        if event.kind == "numba:compile":
            self._tell(event.data["dispatcher"].py_func.__module__)
            begin, self.begin = self.begin, None
            if begin is not None:
                begin()
        elif threading.current_thread() is threading.main_thread():  # Python runs handlers in no other
            self._depth += 1
            if self._depth == 1:
                self._hold()

    def on_end(self, event: Any) -> None:
        """Numba has compiled a kernel, and writes it to the cache next; or gives its lock back."""
        if event.kind == "numba:compile":
            self._last = self._clock()
            # Numba's index of a kernel must not be written by two processes at the same time.
            folder = kernel_folder()
            if folder is not None and self._writing is None:
                with suppress(OSError):
                    self._writing = (folder / "lock").open("wb")
                    fcntl.lockf(self._writing, fcntl.LOCK_EX)
            return
        if self._writing is not None:
            self._writing.close()  # gives the lock back
            self._writing = None
        if threading.current_thread() is threading.main_thread():
            self._depth -= 1
            if self._depth == 0:
                self._release()

    def _tell(self, module: str) -> None:
        if not module.startswith("trailmark"):
            return
        now = self._clock()
        if now - self._last > PAUSE:
            self._begun, self._said = now, False
        self._last = now
        if not self._said and now - self._begun > REPORT_AFTER:
            line = f"compiling the kernels{f' for {self.uses[-1]}' if self.uses else ''}: up to a minute or two"
            if not self._said_before:
                line += ", once on this machine ('trailmark warmup' compiles all of them)"
            self._said = self._said_before = True
            self._say(line)

    def _hold(self) -> None:
        # Garbage collection looks at millions of numba's objects again and again: a tenth of the time.
        self._collecting = gc.isenabled()
        gc.disable()
        self._handlers, self._waiting = {}, []
        for number in (number for number in SIGNALS if callable(signal.getsignal(number))):
            self._handlers[number] = signal.signal(number, self._wait)

    def _wait(self, number: int, frame: Any) -> None:
        if number in self._waiting:  # for the second time
            self._handlers[number](number, frame)
        else:
            self._waiting.append(number)

    def _release(self) -> None:
        if self._collecting:
            gc.enable()
        for number in reversed(self._handlers):  # of Ctrl-C, which may arrive right here, last
            signal.signal(number, self._handlers[number])
        for number in self._waiting:
            self._handlers[number](number, sys._getframe())


compiling = _Compiling()
event.register("numba:compile", compiling)
event.register("numba:compiler_lock", compiling)


@contextmanager
def compiling_for(use: str) -> Iterator[None]:
    """Let the line that says that kernels are compiled say what for."""
    compiling.uses.append(use)
    try:
        yield
    finally:
        compiling.uses.pop()
