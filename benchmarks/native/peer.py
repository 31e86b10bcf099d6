"""The native peer: OMPL's C++ planners with FCL in C++, a program of its own that is built here.

It is what a user would choose who finds Python too slow. Its planners are named ``native:PRM`` and so on, and
``native:PRM+certified`` with certified motions. It reads problems as JSON of flat triangles, discs and numbers; the
obstacles are what :mod:`trailmark.collision.fcl_scene` gives to FCL, for the same reasons.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from trailmark.benchmark.errors import BenchmarkError
from trailmark.benchmark.planners import CERTIFIED, NATIVE, PlannerName
from trailmark.benchmark.record import Status
from trailmark.errors import expected_name
from trailmark.shapes import Disc, Polygon, triangulate
from trailmark.touching import TOUCHING_TOLERANCE, overlap_core
from trailmark.world import Query, Robot, World, with_keep_outs

if TYPE_CHECKING:
    from trailmark.benchmark.problems import Job, Problem

__all__ = [
    "NativeError",
    "native_parameters",
    "native_planners",
    "native_program",
    "native_versions",
    "problem_text",
    "run_native",
]

VERSION = 2
"""Of the problems' format: the program refuses others."""

MARGIN = 1.0
"""Metres that the obstacle around a boundary reaches beyond the bounds, which no robot leaves by more than 1e-7 m."""

VARIABLE = "TRAILMARK_NATIVE"
"""The environment variable that may name the built program."""

SIMPLIFY_LIMIT = 0.5
"""Seconds that the program's simplifier gets at most, as for the other planners."""

GRACE = (5.0, 2.0)
"""Seconds, and share of the time limit, that the program gets beyond planning and simplifying before it is ended."""

Answer = dict[str, Any]


class NativeError(BenchmarkError):
    """The native program is not built, or cannot be used."""


def native_program() -> Path | None:
    """Return the built program: what TRAILMARK_NATIVE names, else the project's own build; None if there is none."""
    named = os.environ.get(VARIABLE)
    here = Path(__file__).resolve().parent / "build" / "trailmark_native"
    file = Path(named) if named else here
    return file if os.access(file, os.X_OK) and file.is_file() else None


def native_planners() -> list[str]:
    """Return the names of the program's planners, such as ``native:PRM``; none where it is not built."""
    described = _described() if native_program() else {"planners": []}
    return [NATIVE + name + motions for name in described["planners"] for motions in ("", CERTIFIED)]


def native_parameters(name: str) -> list[str]:
    """Return the names of the parameters of one of the program's planners, such as ``native:PRM``."""
    return [str(word) for word in _described()["parameters"][name.removeprefix(NATIVE).removesuffix(CERTIFIED)]]


def native_versions() -> dict[str, str]:
    """Return the versions of the libraries that the program was built with; empty where it is not built."""
    return {f"native {name}": str(_described()[name]) for name in ("ompl", "fcl")} if native_program() else {}


def run_native(problem: Problem, job: Job) -> Answer:
    """Run one of the program's planners on a problem, in a process of its own.

    Args:
        problem: world, robot and query.
        job: the run, of a planner with ``native:`` and perhaps parameters.

    Returns:
        Fields of :class:`trailmark.benchmark.record.RunRecord`. ``setup_time`` is the program's own, for reading the
        problem and building its checker. A program that crashes or does not end is an answer too.

    Raises:
        NativeError: the program is not built, has no such planner, or refuses the problem.
    """
    file = _require_program()
    (name, parameters), limit = PlannerName.parse(job["planner"]), job["time_limit"]
    names = native_planners()
    if name not in names:
        raise NativeError(f"planner: {expected_name(name, names)}")
    command = [str(file), "plan", name.removeprefix(NATIVE)]
    # OMPL takes no seed 0.
    command += ["--seed", str(job["seed"] + 1), "--resolution", repr(float(job["resolution"]))]
    command += ["--time-limit", repr(limit), "--memory-limit", repr(float(job["memory_limit"]))]
    command += ["--simplify-limit", repr(SIMPLIFY_LIMIT)]
    for parameter, value in parameters.items():
        command += ["--parameter", f"{parameter}={value}"]
    text = problem_text(problem.world, problem.robot, problem.query)
    allowed = limit + SIMPLIFY_LIMIT + GRACE[0] + GRACE[1] * limit
    try:
        done = subprocess.run(command, input=text, capture_output=True, text=True, timeout=allowed, check=False)
    except subprocess.TimeoutExpired:
        failure = f"did not end by itself: killed after {allowed:.1f} s"
        return {"status": int(Status.TIMEOUT), "seed": job["seed"], "solved": False, "failure": failure}
    except OSError as error:
        raise NativeError(f"{file.name}: cannot be run: {error.strerror}") from None
    return _answer(done, file) | {"seed": job["seed"]}


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


def _described() -> Answer:
    file = _require_program()
    return _description(file, file.stat().st_mtime)


@lru_cache(maxsize=2)
def _description(file: Path, changed: float) -> Answer:
    """Return the program's planners and versions; ``changed`` makes a rebuilt program another one."""
    try:
        done = subprocess.run([str(file), "planners"], capture_output=True, text=True, timeout=20.0, check=True)
        described: Answer = json.loads(done.stdout)
        described["planners"] = [str(name) for name in described["planners"]]
        described["parameters"] = dict(described["parameters"])
    except (OSError, subprocess.SubprocessError, ValueError, KeyError, TypeError):
        raise NativeError(f"{file.name}: does not name its planners, as the native program would") from None
    return described


def problem_text(world: World, robot: Robot, query: Query) -> str:
    """Return a problem as one JSON object.

    Fields: ``trailmark_native`` (the format's version); ``bounds`` (xmin, ymin, xmax, ymax, metres) and
    ``tolerance`` (metres that the robot may reach beyond them); ``triangles`` (rows x1, y1, x2, y2, x3, y3,
    counter-clockwise) and ``discs`` (rows x, y, radius); ``robot`` in its own frame: ``shape`` (disc or polygon),
    ``radius`` or ``triangles`` and ``hull`` (the corners of its convex hull), ``circumradius``, ``inscribed`` (x, y,
    radius), ``turning_radius`` (metres; 0 if it is no car) and ``reverse``; ``start`` and ``goal`` (x, y, theta).
    """
    ends = {"start": list(query.start), "goal": list(query.pose())}
    # The obstacles' part is cached as text: queries of one world differ in their last two fields only.
    return (
        _scene(world.bounds, world.boundary, with_keep_outs(world).obstacles, robot)[:-1] + ", " + json.dumps(ends)[1:]
    )


@lru_cache(maxsize=4)
def _scene(
    bounds: tuple[float, float, float, float], boundary: Polygon | None, obstacles: tuple[Any, ...], robot: Robot
) -> str:
    polygons = [shape.polygon() for shape in obstacles if not isinstance(shape, Disc)]
    scene = {
        "trailmark_native": VERSION,
        "bounds": list(bounds),
        "tolerance": TOUCHING_TOLERANCE,
        "triangles": _triangles(polygons + _outside(bounds, boundary)),
        "discs": [[*shape.center, shape.radius] for shape in obstacles if isinstance(shape, Disc)],
        "robot": _robot(robot),
    }
    return json.dumps(scene)


def _robot(robot: Robot) -> Answer:
    inscribed = robot.inscribed_disc
    common = {
        "circumradius": robot.circumradius,
        "inscribed": [*inscribed.center, _less_touching(inscribed.radius)],
        "turning_radius": robot.turning_radius or 0.0,
        "reverse": robot.reverse,
    }
    if isinstance(robot.footprint, Disc):
        return {"shape": "disc", "radius": _less_touching(robot.footprint.radius), **common}
    region = robot.outline.shapely()
    parts = [_polygon(part) for part in overlap_core(robot.outline.rings()[0])]
    hull = shapely.get_coordinates(shapely.convex_hull(region))[:-1]
    return {"shape": "polygon", "triangles": _triangles(parts or [robot.outline]), "hull": hull.tolist(), **common}


def _less_touching(radius: float) -> float:
    """Return a disc's radius (metres) less what counts as touching; something is left of any disc."""
    return max(radius - TOUCHING_TOLERANCE, 0.5 * radius)


def _outside(bounds: tuple[float, float, float, float], boundary: Polygon | None) -> list[Polygon]:
    """Return the part of a frame around the bounds that lies outside the boundary."""
    if boundary is None:
        return []
    xmin, ymin, xmax, ymax = bounds
    frame = shapely.box(xmin - MARGIN, ymin - MARGIN, xmax + MARGIN, ymax + MARGIN)
    outside = shapely.difference(frame, boundary.shapely())
    return [_polygon(part) for part in shapely.get_parts(outside) if part.area > 0.0]


def _polygon(region: shapely.Polygon) -> Polygon:
    return Polygon(
        shapely.get_coordinates(region.exterior), tuple(shapely.get_coordinates(ring) for ring in region.interiors)
    )


def _triangles(polygons: list[Polygon]) -> list[list[float]]:
    """Return rows x1, y1, x2, y2, x3, y3 of triangles that fill the polygons; none without area."""
    if not polygons:
        return []
    corners = np.concatenate([triangulate(polygon) for polygon in polygons])
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    rows: list[list[float]] = corners[u[:, 0] * v[:, 1] > u[:, 1] * v[:, 0]].reshape(-1, 6).tolist()
    return rows
