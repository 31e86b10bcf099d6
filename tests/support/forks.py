"""Processes that start at once: forked from one that has everything imported and the kernels loaded.

A program that plans spends its first second on imports and kernels, and the tests start hundreds. Each still runs in a
process of its own, which may crash or hang as it likes. At its end what it made goes, but not all that was imported,
which takes a tenth of a second, unless the test is about the interpreter's end.

``python -m tests.support.forks`` reads a job a line from stdin, JSON; it answers with the child's number, and when that
has ended with its status. It ends with its parent.
"""

from __future__ import annotations

import atexit
import gc
import importlib
import json
import os
import runpy
import select
import signal
import subprocess
import sys
import tempfile
import threading
import time
import types
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numba

__all__ = ["Forks", "complaints"]

ROOT = Path(__file__).resolve().parents[2]
SILENT = {"MPLBACKEND": "Agg", "OMP_NUM_THREADS": "1"}
"""Nothing is shown on a screen; a pool of threads would not survive a fork."""
IMPORTED = (
    "filterpy.kalman",
    "gtsam",
    "networkx",
    "ompl.geometric",
    "ompl.util",
    "scipy.stats",
    "sklearn.cluster",
    "trailmark.verify",
    "trailmark.benchmark.isolation.child",
    "trailmark.benchmark.report",
    "trailmark.cli",
    "trailmark.estimation.mapping",
    "trailmark.exploration.explorer",
    "trailmark.exploration.warmup",
    "trailmark.formats.schema",
    "trailmark.ompl_bridge",
    "trailmark.plotting",
    "trailmark.trajectories",
)
"""What the children need sooner or later."""


class Forks:
    """Runs Python programs in forked processes, as ``subprocess.run`` does in new ones."""

    def __init__(self) -> None:
        path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
        self._server = subprocess.Popen(
            [sys.executable, "-X", "faulthandler", "-m", "tests.support.forks"],
            env=os.environ | SILENT | {"PYTHONPATH": path},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        self._ready = False

    def run(
        self,
        words: Sequence[str],
        *,
        timeout: float,
        cwd: Path | None = None,
        env: Mapping[str, str] | None = None,
        whole: bool = False,
    ) -> subprocess.CompletedProcess[str]:
        """Run a program to its end and return what it printed.

        Args:
            words: as after ``python``: ``-c`` and a program, ``-m`` and a module, or a script; then its arguments.
            timeout: seconds after which it is killed.
            cwd: its folder; that of the tests if it is None.
            env: its environment; that of the tests if it is None.
            whole: whether the interpreter comes to its own end, at which libraries may crash.

        Raises:
            subprocess.TimeoutExpired: it had to be killed.
        """
        if not self._ready:
            assert self._line(600.0) == "ready"
            self._ready = True
        with tempfile.TemporaryDirectory() as folder:
            files = [Path(folder) / name for name in ("stdout", "stderr")]
            job = {
                "words": list(words),
                "cwd": str(cwd or Path.cwd()),
                "env": dict(os.environ if env is None else env) | SILENT,
                "files": list(map(str, files)),
                "whole": whole,
            }
            assert self._server.stdin is not None
            self._server.stdin.write(json.dumps(job).encode() + b"\n")
            self._server.stdin.flush()
            child = int(self._line(60.0))
            try:
                status = int(self._line(timeout))
            except TimeoutError:
                os.kill(child, signal.SIGKILL)
                self._line(60.0)
                raise subprocess.TimeoutExpired(list(words), timeout) from None
            out, err = (file.read_text(errors="replace") for file in files)
            return subprocess.CompletedProcess(list(words), status, out, err)

    def close(self) -> None:
        """End the process that forks."""
        assert self._server.stdin is not None
        assert self._server.stdout is not None
        self._server.stdin.close()
        self._server.wait(60.0)
        self._server.stdout.close()

    def _line(self, seconds: float) -> str:
        assert self._server.stdout is not None
        end, line = time.monotonic() + seconds, b""
        while not line.endswith(b"\n"):
            if not select.select([self._server.stdout], [], [], max(0.0, end - time.monotonic()))[0]:
                raise TimeoutError
            byte = os.read(self._server.stdout.fileno(), 1)
            assert byte, "the process that forks has ended"
            line += byte
        return line.decode().strip()


def complaints(done: subprocess.CompletedProcess[str]) -> str:
    """Return what a program wrote on stderr but for the end of OMPL's bindings, which it had loaded before it began."""
    return done.stderr.partition("nanobind: leaked")[0]


def main() -> None:
    """Fork for each job until stdin ends."""
    job = _serve()
    if job is None:
        os._exit(0)  # without what OMPL's bindings say at their end
    if job["whole"]:
        _become(job)
    else:
        _leave(_status_of(job))


def _serve() -> dict[str, Any] | None:
    """Return None once stdin has ended, and in each child its job."""
    for module in IMPORTED:
        importlib.import_module(module)
    from trailmark import World
    from trailmark.library import find_world
    from trailmark.planning.warmup import ROBOTS, warm_up

    World.load(find_world("office"))
    for kind in ROBOTS:
        for use in ("plan", "many", "changes", "moving"):
            warm_up(kind, use)
        warm_up(kind, weighted=True)
    numba.njit(lambda x: x + 1)(1)  # what numba makes once before it compiles
    end = time.monotonic() + 30.0
    while threading.active_count() > 1:  # that of deadlines ends by itself
        assert time.monotonic() < end, "a thread is lost in a fork"
        time.sleep(0.05)
    gc.collect()
    gc.freeze()  # else the first collection of a child copies all that it inherits
    answers = os.fdopen(os.dup(1), "w")
    print("ready", file=answers, flush=True)
    for line in sys.stdin.buffer:
        child = os.fork()
        if child == 0:
            answers.close()
            job: dict[str, Any] = json.loads(line)
            return job
        print(child, file=answers, flush=True)
        _, status = os.waitpid(child, 0)
        print(os.waitstatus_to_exitcode(status), file=answers, flush=True)
    return None


def _status_of(job: Mapping[str, Any]) -> int:
    """Run a job's program and return the exit status that an interpreter would have."""
    try:
        _become(job)
    except SystemExit as end:
        if end.code is None or isinstance(end.code, int):
            return end.code or 0
        sys.stderr.write(f"{end.code}\n")
        return 1
    except Exception:
        sys.excepthook(*sys.exc_info())
        return 1
    return 0


def _leave(status: int) -> None:
    """End this process: threads are waited for, what is to be done at the end is done, what the program made goes."""
    threading._shutdown()  # type: ignore[attr-defined]  # as the interpreter does
    atexit._run_exitfuncs()
    made = vars(sys.modules["__main__"])
    for name in [name for name in made if not name.startswith("__")]:
        del made[name]
    gc.collect()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


def _become(job: Mapping[str, Any]) -> None:
    """Run a job's program as the main one of this process."""
    for number, file in ((0, os.devnull), (1, job["files"][0]), (2, job["files"][1])):
        opened = os.open(file, os.O_RDWR | os.O_CREAT, 0o600)
        os.dup2(opened, number)
        os.close(opened)
    sys.stdin = open(0, closefd=False)  # noqa: SIM115  # for as long as the process lives
    os.chdir(job["cwd"])
    os.environ.clear()
    os.environ.update(job["env"])
    first, *rest = job["words"]
    sys.path[0] = "" if first.startswith("-") else str(Path(first).parent)
    module = types.ModuleType("__main__")
    sys.modules["__main__"] = module
    if first == "-m":
        sys.argv = rest
        runpy.run_module(rest[0], run_name="__main__", alter_sys=True)
        return
    sys.argv = [first, *(rest[1:] if first == "-c" else rest)]
    if first != "-c":
        runpy.run_path(first, run_name="__main__")
        return
    exec(compile(rest[0], "<string>", "exec"), module.__dict__)  # noqa: S102  # as ``python -c`` does


if __name__ == "__main__":
    main()
