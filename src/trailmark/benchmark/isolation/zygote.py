"""The zygote: a process with everything imported and warm, which forks a fresh child for each run.

``python -m trailmark.benchmark.isolation.zygote`` reads one job a line from stdin and writes one answer a line to
stdout, both JSON. A child inherits imports, compiled kernels and the problem, and nothing of any run before it; the
start of a process is part of no planner's time. The zygote kills a child that does not end, and ends with its parent.
"""

from __future__ import annotations

import contextlib
import gc
import json
import os
import resource
import select
import signal
import sys
import tempfile
from collections import OrderedDict
from time import perf_counter
from typing import IO, Any, NoReturn

from trailmark.benchmark.isolation.child import PREPARING, WAIT, answers
from trailmark.benchmark.isolation.memory import address_space
from trailmark.benchmark.isolation.prepared import Prepared
from trailmark.benchmark.measures import measured
from trailmark.benchmark.status import Status
from trailmark.errors import TrailmarkError

__all__ = ["Zygote", "main"]

CLOCKS = 1e-3
"""Seconds by which a child's clock may be ahead of the one here."""

MAX_PROBLEMS = 4
"""Problems that are kept prepared; the one used longest ago goes first."""

GRACE = (3.0, 0.5)
"""Seconds, and share of the time limit, that a child gets beyond it before it is killed; then as much again for what
comes after planning."""

NATIVE_GRACE = (30.0, 2.0)
"""The same for a native program, which has to prepare first and is itself watched by its child."""

READ = 1 << 16

Answer = dict[str, Any]


class Zygote:
    """Runs jobs one after another, each in a child of its own.

    Args:
        alive: a file descriptor that becomes readable when the parent is gone; None for a parent that never goes.
    """

    def __init__(self, alive: int | None = None) -> None:
        self._alive = alive
        self._problems: OrderedDict[str, Prepared] = OrderedDict()

    def run(self, job: dict[str, Any]) -> Answer:
        """Return a job's answer: fields of a :class:`~trailmark.benchmark.record.RunRecord`."""
        begin = perf_counter()
        try:
            prepared = self._prepared(job)
        except TrailmarkError as error:
            return {"status": int(Status.ABORT), "seed": job["seed"], "failure": str(error)}
        answer: Answer = {"setup_time": prepared.setup_time, "preparing": perf_counter() - begin}
        answer |= self._fork(prepared, job)
        if answer["setup_time"] != prepared.setup_time:
            answer["preparing"] += answer["setup_time"]  # a native program prepares for each run
        answer["seed"] = job["seed"]
        answer.setdefault("time", 0.0)
        self._referee(prepared, answer)
        return answer

    def _prepared(self, job: dict[str, Any]) -> Prepared:
        key = str(job["problem"])
        if key not in self._problems:
            if "text" not in job:
                raise TrailmarkError("a problem that is not known, without its text")
            while len(self._problems) >= MAX_PROBLEMS:
                self._problems.popitem(last=False)
            self._problems[key] = Prepared(job["text"])
            gc.collect()
            gc.freeze()  # what is here already need not be copied when a child's garbage collector visits it
        self._problems.move_to_end(key)
        return self._problems[key]

    def _fork(self, prepared: Prepared, job: dict[str, Any]) -> Answer:
        with tempfile.TemporaryFile() as stderr_file:
            reader, writer = os.pipe()
            begin = perf_counter()
            child = os.fork()
            if child == 0:
                os.close(reader)
                _be_child(prepared, job, writer, stderr_file)
            os.close(writer)
            try:
                answer, hung = self._collect(reader, child, begin, _limits_of(job))
                answer["wrong time"] = _wrong_time(answer)
            finally:
                os.close(reader)
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(child, signal.SIGKILL)
                _, status, _ = os.wait4(child, 0)
            if hung:
                status = 0
            elapsed = perf_counter() - begin
            stderr_file.seek(0)
            stderr = stderr_file.read()[-4000:].decode(errors="replace")
        return _completed(answer, status, stderr, hung=hung, elapsed=elapsed, memory_limit=float(job["memory_limit"]))

    def _collect(self, reader: int, child: int, begin: float, limits: tuple[float, float]) -> tuple[Answer, bool]:
        """Return the parts that a child wrote, as one, and whether it had to be stopped."""
        first, following = limits
        deadline = begin + first
        answer: Answer = {}
        pending, waits = b"", 0
        while True:
            waiting = [reader] if self._alive is None else [reader, self._alive]
            ready, _, _ = select.select(waiting, [], [], max(0.0, deadline - perf_counter()))
            if self._alive in ready:
                # The parent is gone: the answer has no reader.
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(child, signal.SIGKILL)
                os._exit(0)
            if not ready:
                return answer, True
            chunk = os.read(reader, READ)
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

    def _referee(self, prepared: Prepared, answer: Answer) -> None:
        """Have the paths judged; what a planner calls a solution and is none is a failure."""
        answer["correct_solution"] = False
        wrong = answer.pop("wrong time", None)
        if wrong is not None:
            # None of the times that it reports is used.
            answer |= {"time": answer["answered"], "curve": [], "time_to_first_solution": None}
            answer |= {"first_solution_length": None, "failure": f"refused: {wrong}"}
        if not answer.get("solved") or wrong is not None:
            return
        fault = prepared.referee.fault(answer["path"], *prepared.ends)
        answer["correct_solution"] = fault is None
        if fault is not None:
            answer["failure"] = f"refused: {fault}"
            return
        scale = prepared.problem.robot.inscribed_disc.radius
        answer |= measured(prepared.referee, answer["path"], scale)._asdict()
        if answer.get("simplified_path"):
            fault = prepared.referee.fault(answer["simplified_path"], *prepared.ends)
            if fault is not None:
                answer["simplified_solution_length"] = None
                answer["failure"] = f"simplified path refused: {fault}"


def main() -> None:
    """Answer the jobs on stdin until it ends."""
    from trailmark.planning.warmup import warm_up

    jobs = os.fdopen(os.dup(0), "rb", buffering=0)
    replies = os.fdopen(os.dup(1), "w", encoding="utf-8")
    # What a library prints must not come between the answers; what a child reads must not be a job.
    nowhere = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nowhere, 0)
    os.dup2(2, 1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the program that started this one
    warm_up()
    _import_all()
    zygote = Zygote(alive=jobs.fileno())
    _reply(replies, {"ready": os.getpid()})
    pending = b""
    while True:
        chunk = os.read(jobs.fileno(), READ)
        if not chunk:
            return
        *lines, pending = (pending + chunk).split(b"\n")
        for line in lines:
            _reply(replies, zygote.run(json.loads(line)))


def _wrong_time(answer: Answer) -> str | None:
    """Return what is wrong with the times that a child states, or None."""
    times = [answer.get("time"), answer.get("time_to_first_solution"), *(t for t, _ in answer.get("curve", ()))]
    elapsed = float(answer.get("answered", 0.0))
    for t in times:
        if t is not None and not 0.0 <= t <= elapsed + CLOCKS:
            return f"expected a time from 0 to the {elapsed:.3f} s that passed until the answer, got {t:g} s"
    return None


def _limits_of(job: dict[str, Any]) -> tuple[float, float]:
    """Return the seconds that a child gets until its first answer, and from one part of the answer to the next."""
    fixed, share = NATIVE_GRACE if str(job["planner"]).startswith("native:") else GRACE
    limit = float(job["time_limit"])
    return limit + fixed + share * limit, fixed + share * limit


def _reply(replies: IO[str], answer: Answer) -> None:
    replies.write(json.dumps(answer) + "\n")
    replies.flush()


def _import_all() -> None:
    """Load what children need, and compile what they call: OMPL's own random numbers stay untouched."""
    import numpy as np

    from trailmark.collision import StateChecker
    from trailmark.motion.pointwise import PointwiseChecker
    from trailmark.ompl_bridge import measured  # noqa: F401  # loaded for the children
    from trailmark.world import Robot, World

    checker = StateChecker(World("warm-up", (0.0, 0.0, 4.0, 4.0)), Robot.rectangle(0.6, 0.4))
    single = PointwiseChecker(checker)
    single.valid(1.0, 1.0, 0.0)
    single.clearance(1.0, 1.0, 0.0)
    single.step_valid(1.0, 1.0, 0.0, 2.0, 2.0, 0.5)
    single.motion_valid((1.0, 1.0, 0.0), (2.0, 2.0, 0.5))
    checker.motions_by_field(np.ones((1, 3)), np.full((1, 3), 2.0))


def _be_child(prepared: Prepared, job: dict[str, Any], writer: int, stderr_file: IO[bytes]) -> NoReturn:
    """Do the run and end, without any of the cleaning up that belongs to the parent."""
    status = 1
    try:
        os.setpgid(0, 0)  # so that it can be killed with all that it starts
        os.dup2(stderr_file.fileno(), 1)
        os.dup2(stderr_file.fileno(), 2)
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        _limit(float(job["time_limit"]), float(job["memory_limit"]))
        for part in answers(prepared, job):
            _write_all(writer, (json.dumps(part) + "\n").encode())
        status = 0
    except BaseException as error:  # whatever it is becomes the run's result
        with contextlib.suppress(BaseException):
            what = "out of memory" if isinstance(error, MemoryError) else f"{type(error).__name__}: {error}"
            _write_all(writer, (json.dumps({"error": " ".join(what.split())[:500]}) + "\n").encode())
            status = 0
    finally:
        os._exit(status)


def _limit(time_limit: float, memory_limit: float) -> None:
    space = address_space() + int(memory_limit * 2**20)
    resource.setrlimit(resource.RLIMIT_AS, (space, space))
    # Should the zygote itself be killed, a child that hangs does not live for ever.
    seconds = int(4.0 * time_limit + 60.0)
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _write_all(writer: int, data: bytes) -> None:
    while data:
        data = data[os.write(writer, data) :]


def _completed(answer: Answer, status: int, stderr: str, *, hung: bool, elapsed: float, memory_limit: float) -> Answer:
    """Return an answer completed by how the child ended."""
    error = answer.pop("error", None)
    planned = "status" in answer
    if hung:
        ended, why = Status.TIMEOUT, f"did not end by itself: killed after {elapsed:.1f} s"
    elif error is not None:
        ended, why = Status.ABORT, error
    elif os.WIFSIGNALED(status):
        name = signal.Signals(os.WTERMSIG(status)).name
        last = stderr.strip().splitlines()[-1:] or [""]
        ended = Status.ABORT if name == "SIGABRT" else Status.CRASH
        why = f"{name} {last[0].strip()}".strip()[:500]
    elif os.WEXITSTATUS(status) != 0 or not planned:
        ended, why = Status.CRASH, f"ended with status {os.WEXITSTATUS(status)} and no answer"
    else:
        return answer
    if "out of memory" in why or "bad_alloc" in stderr:
        why = f"out of memory (limit {memory_limit:g} MB): {why}"
    if planned:
        return answer | {"failure": f"after planning: {why}"}
    return answer | {"status": int(ended), "failure": why, "time": elapsed, "solved": False}


if __name__ == "__main__":
    main()
    # Without the interpreter's own tidying up, in which nanobind complains about what OMPL's bindings leak.
    sys.stdout.flush()
    os._exit(0)
