"""The native peer: OMPL's C++ planners with FCL in C++, a program of its own, built from ``benchmarks/native``.

It is what a user would choose who finds Python too slow. Its planners are named ``native:PRM`` and so on, and
``native:PRM+certified`` with certified motions.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trailmark.benchmark.errors import BenchmarkError
from trailmark.benchmark.planner_name import CERTIFIED, PlannerName
from trailmark.benchmark.status import Status
from trailmark.errors import expected_name

if TYPE_CHECKING:
    from trailmark.benchmark.problems import Problem

__all__ = [
    "PREFIX",
    "NativeError",
    "native_parameters",
    "native_planners",
    "native_program",
    "native_versions",
    "run_native",
]

PREFIX = "native:"
"""Begins the names of the program's planners."""

VARIABLE = "TRAILMARK_NATIVE"
"""The environment variable that may name the built program."""

SIMPLIFY_LIMIT = 0.5
"""Seconds that the program's simplifier gets at most, as for the other planners."""

ANY_COST = 1e11
"""Metres; no path costs as much."""

GRACE = (5.0, 2.0)
"""Seconds, and share of the time limit, that the program gets beyond planning and simplifying before it is ended."""

Answer = dict[str, Any]


class NativeError(BenchmarkError):
    """The native program is not built, or cannot be used."""


def native_program() -> Path | None:
    """Return the built program: what TRAILMARK_NATIVE names, else the project's own build; None if there is none."""
    named = os.environ.get(VARIABLE)
    here = Path(__file__).resolve().parents[3] / "benchmarks" / "native" / "build" / "trailmark_native"
    file = Path(named) if named else here
    return file if os.access(file, os.X_OK) and file.is_file() else None


def native_planners() -> list[str]:
    """Return the names of the program's planners, such as ``native:PRM``; none where it is not built."""
    file = native_program()
    if file is None:
        return []
    described = _description(file, file.stat().st_mtime)["planners"]
    return [PREFIX + name + motions for name in described for motions in ("", CERTIFIED)]


def native_parameters(name: str) -> list[str]:
    """Return the names of the parameters of one of the program's planners, such as ``native:PRM``."""
    file = _require_program()
    described = _description(file, file.stat().st_mtime)
    return [str(parameter) for parameter in described["parameters"][name.removeprefix(PREFIX).removesuffix(CERTIFIED)]]


def native_versions() -> dict[str, str]:
    """Return the versions of the libraries that the program was built with; empty where it is not built."""
    file = native_program()
    if file is None:
        return {}
    described = _description(file, file.stat().st_mtime)
    return {f"native {name}": str(described[name]) for name in ("ompl", "fcl")}


def run_native(problem: Problem, job: Mapping[str, Any]) -> Answer:
    """Run one of the program's planners on a problem, in a process of its own.

    Args:
        problem: world, robot and query.
        job: planner (with ``native:``, and perhaps parameters), seed, time_limit (s), memory_limit (MB), resolution (m)
            and perhaps first, as :class:`trailmark.benchmark.problems.Job` holds them.

    Returns:
        Fields of :class:`trailmark.benchmark.record.RunRecord`. ``setup_time`` is the program's own, for reading the
        problem and building its checker. A program that crashes or does not end is an answer too.

    Raises:
        NativeError: the program is not built, has no such planner, or refuses the problem.
    """
    from trailmark.benchmark.export import problem_text

    file = _require_program()
    (name, parameters), limit = PlannerName.parse(str(job["planner"])), float(job["time_limit"])
    names = native_planners()
    if name not in names:
        raise NativeError(f"planner: {expected_name(name, names)}")
    command = [str(file), "plan", name.removeprefix(PREFIX)]
    # OMPL takes no seed 0.
    command += ["--seed", str(int(job["seed"]) + 1), "--resolution", repr(float(job["resolution"]))]
    command += ["--time-limit", repr(limit), "--memory-limit", repr(float(job["memory_limit"]))]
    command += ["--simplify-limit", repr(SIMPLIFY_LIMIT)]
    for parameter, value in parameters.items():
        command += ["--parameter", f"{parameter}={value}"]
    if job.get("first"):
        command += ["--cost-threshold", repr(ANY_COST)]
    text = problem_text(problem.world, problem.robot, problem.query)
    allowed = limit + SIMPLIFY_LIMIT + GRACE[0] + GRACE[1] * limit
    try:
        done = subprocess.run(command, input=text, capture_output=True, text=True, timeout=allowed, check=False)  # noqa: S603  # our own program, no shell
    except subprocess.TimeoutExpired:
        failure = f"did not end by itself: killed after {allowed:.1f} s"
        return {"status": int(Status.TIMEOUT), "seed": int(job["seed"]), "solved": False, "failure": failure}
    except OSError as error:
        raise NativeError(f"{file.name}: cannot be run: {error.strerror}") from None
    return _answer(done, file) | {"seed": int(job["seed"])}


def _answer(done: subprocess.CompletedProcess[str], file: Path) -> Answer:
    """Return the answer that the program printed, or how it ended."""
    message = (done.stderr.strip().splitlines() or [""])[-1]
    if done.returncode < 0:
        ended = signal.Signals(-done.returncode)
        status = Status.ABORT if ended == signal.SIGABRT else Status.CRASH
        why = "out of memory: " if "bad_alloc" in done.stderr else ""
        return {"status": int(status), "solved": False, "failure": f"{why}{ended.name} {message}".strip()[:500]}
    try:
        answer: Answer = json.loads(done.stdout)
    except ValueError:
        raise NativeError(f"{file.name}: {message or f'status {done.returncode} and no answer'}"[:500]) from None
    return answer


def _require_program() -> Path:
    file = native_program()
    if file is None:
        named = os.environ.get(VARIABLE)
        where = f"{VARIABLE} names {named!r}, which is no program" if named else "the native program is not built"
        raise NativeError(f"{where}; benchmarks/native/README.md says how it is built")
    return file


@lru_cache(maxsize=2)
def _description(file: Path, changed: float) -> Answer:
    """Return the program's planners and versions; ``changed`` makes a rebuilt program another one."""
    try:
        done = subprocess.run([str(file), "planners"], capture_output=True, text=True, timeout=20.0, check=True)  # noqa: S603  # our own program, no shell
        described: Answer = json.loads(done.stdout)
        described["planners"] = [str(name) for name in described["planners"]]
        described["parameters"] = dict(described["parameters"])
    except (OSError, subprocess.SubprocessError, ValueError, KeyError, TypeError):
        raise NativeError(f"{file.name}: does not name its planners, as the native program would") from None
    return described
