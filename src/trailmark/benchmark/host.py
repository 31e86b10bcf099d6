"""The host: a process with everything imported and warm, which forks a child for each run, limits it, and judges it.

A child inherits imports, compiled kernels and the prepared problem, and nothing of any run before it; the start of a
process is part of no planner's time. A host ends with its parent, and a child with its host, whatever becomes of them.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import json
import multiprocessing
import os
import resource
import signal
import sys
import tempfile
from collections.abc import Sequence
from functools import lru_cache
from multiprocessing.connection import Connection, wait
from pathlib import Path
from time import perf_counter
from typing import IO, Any

from trailmark.benchmark.problems import Job
from trailmark.benchmark.record import Status
from trailmark.benchmark.run import PREPARING, WAIT, Prepared, answers, load_all
from trailmark.errors import TrailmarkError

__all__ = ["serve"]

MAX_PROBLEMS = 4
"""Problems that are kept prepared."""

CLOCKS = 1e-3
"""Seconds by which a child's clock may be ahead of the one here."""

GRACE = (3.0, 0.5)
"""Seconds, and share of the time limit, that a child gets beyond it before it is killed; then as much again for what
comes after planning."""

NATIVE_GRACE = (30.0, 2.0)
"""The same for a native program, which has to prepare first and is itself watched by its child."""

DIES_WITH_PARENT = 1
"""``PR_SET_PDEATHSIG`` of Linux's prctl.h."""

Answer = dict[str, Any]


def serve(jobs: Connection, replies: Connection) -> None:
    """Be a host: answer jobs until there are no more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    load_all()
    replies.send("ready")
    with contextlib.suppress(EOFError, BrokenPipeError):
        while True:
            replies.send(_answer(jobs.recv(), jobs, replies))


@lru_cache(MAX_PROBLEMS)
def _prepared(text: str) -> Prepared:
    made = Prepared(text)
    gc.collect()
    gc.freeze()  # what is here already need not be copied when a child's garbage collector visits it
    return made


def _answer(job: Job, *ours: Connection) -> Answer:
    """Run a job in a child and return its answer, judged."""
    begin = perf_counter()
    try:
        prepared = _prepared(job["text"])
    except TrailmarkError as error:
        return {"status": int(Status.ABORT), "seed": job["seed"], "failure": str(error), "preparing": 0.0}
    preparing = perf_counter() - begin
    found, wrong = _run_in_child(prepared, job, *ours)
    answer: Answer = {"setup_time": prepared.setup_time, "time": 0.0, "correct_solution": False} | found
    if answer["setup_time"] != prepared.setup_time:
        preparing += answer["setup_time"]  # a native program prepares for each run
    answer |= {"seed": job["seed"], "preparing": preparing}
    if wrong is not None:
        # None of the times that it reports is used.
        answer |= {"time": answer["answered"], "curve": [], "time_to_first_solution": None}
        return answer | {"first_solution_length": None, "failure": f"refused: {wrong}"}
    return answer | (prepared.judged(answer) if answer.get("solved") else {})


def _run_in_child(prepared: Prepared, job: Job, *ours: Connection) -> tuple[Answer, str | None]:
    """Return a child's answer, completed by how the child ended, and what is wrong with its times."""
    reader, writer = os.pipe()
    with tempfile.TemporaryFile() as printed, os.fdopen(reader, "rb", buffering=0) as parts:
        child = multiprocessing.get_context("fork").Process(
            target=_be_child, args=(prepared, job, writer, printed, (parts, *ours))
        )
        begin = perf_counter()
        child.start()
        os.close(writer)
        try:
            answer, hung = _collected(parts, ours[0], begin, job)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(child.pid, signal.SIGKILL)  # type: ignore[arg-type]  # it has started
            child.kill()  # should it have no group of its own yet
            child.join()
        elapsed = perf_counter() - begin
        printed.seek(0)
        said = printed.read()[-4000:].decode(errors="replace")
    wrong, planned = _wrong_time(answer), "status" in answer
    ended, why = _end(answer.pop("error", None), child.exitcode or 0, said, elapsed if hung else None, planned=planned)
    if ended is None:
        return answer, wrong
    if "out of memory" in why or "bad_alloc" in said:
        why = f"out of memory (limit {float(job['memory_limit']):g} MB): {why}"
    if planned:
        return answer | {"failure": f"after planning: {why}"}, wrong
    return answer | {"status": int(ended), "failure": why, "time": elapsed, "solved": False}, wrong


def _end(error: str | None, code: int, said: str, hung: float | None, *, planned: bool) -> tuple[Status | None, str]:
    """Return how a child ended and why, None if it ended well: its error, exit code, words, seconds until killed."""
    if hung is not None:
        return Status.TIMEOUT, f"did not end by itself: killed after {hung:.1f} s"
    if error is not None:
        return Status.ABORT, error
    if code < 0:
        name = signal.Signals(-code).name
        words = " ".join([name, *said.strip().splitlines()[-1:]]).strip()[:500]
        return (Status.ABORT if name == "SIGABRT" else Status.CRASH), words
    return (None, "") if code == 0 and planned else (Status.CRASH, f"ended with status {code} and no answer")


def _collected(parts: IO[bytes], alive: Connection, begin: float, job: Job) -> tuple[Answer, bool]:
    """Return the parts that a child wrote, as one, and whether it has to be stopped."""
    fixed, share = NATIVE_GRACE if job["planner"].startswith("native:") else GRACE
    following = fixed + share * job["time_limit"]
    first = job["time_limit"] + following
    answer: Answer = {}
    deadline, waits, pending = begin + first, 0, b""
    while True:
        ready = wait([parts, alive], max(0.0, deadline - perf_counter()))  # type: ignore[list-item]  # any with fileno
        if alive in ready:
            raise EOFError  # the parent is gone: the answer has no reader
        if not ready:
            return answer, True
        chunk = parts.read(1 << 16)
        if not chunk:
            return answer, False
        *lines, pending = (pending + chunk).split(b"\n")
        for line in lines:
            part = json.loads(line)
            if WAIT in part:
                # Before preparing and after it; whoever asks again has no more time by that.
                waits += 1
                if waits <= 2:
                    deadline = perf_counter() + min(part[WAIT], PREPARING) + first
                continue
            # Times that a child reports are compared with this clock, which no message read late sets back.
            answer.setdefault("answered", perf_counter() - begin)
            answer |= part
            deadline = perf_counter() + following


def _wrong_time(answer: Answer) -> str | None:
    """Return what is wrong with the times that a child states, or None."""
    elapsed = float(answer.get("answered", 0.0))
    for t in (answer.get("time"), answer.get("time_to_first_solution"), *(t for t, _ in answer.get("curve", ()))):
        if t is not None and not 0.0 <= t <= elapsed + CLOCKS:
            return f"expected a time from 0 to the {elapsed:.3f} s that passed until the answer, got {t:g} s"
    return None


def _be_child(prepared: Prepared, job: Job, writer: int, printed: IO[bytes], ours: Sequence[Any]) -> None:
    """Do the run and end, without any of the cleaning up that belongs to the host."""
    out, status = os.fdopen(writer, "wb", closefd=False), 1

    def tell(part: Answer) -> None:
        out.write(json.dumps(part).encode() + b"\n")
        out.flush()

    try:
        os.setpgid(0, 0)  # so that it can be killed with all that it starts
        ctypes.CDLL(None).prctl(DIES_WITH_PARENT, signal.SIGKILL)
        for end in ours:
            end.close()
        os.dup2(printed.fileno(), 1)
        os.dup2(printed.fileno(), 2)
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        space = pages * resource.getpagesize() + int(job["memory_limit"] * 2**20)
        resource.setrlimit(resource.RLIMIT_AS, (space, space))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        for part in answers(prepared, job):
            tell(part)
        status = 0
    except BaseException as error:  # whatever it is becomes the run's result
        with contextlib.suppress(BaseException):
            what = "out of memory" if isinstance(error, MemoryError) else f"{type(error).__name__}: {error}"
            tell({"error": " ".join(what.split())[:500]})
            status = 0
    finally:
        os._exit(status)


if __name__ == "__main__":
    serve(*(Connection(int(word)) for word in sys.argv[1:]))
    os._exit(0)  # without the interpreter's own tidying up, in which nanobind complains about what OMPL's bindings leak
