"""Questions to the library whose answers can be judged; those with a wrong answer are kept as files, and become tests.

A case is a folder with ``world.yaml``, robot included, and ``question.json``.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.soundness.reference import REFUSED, Reference, deepest, least_room, moves, short_turn
from trailmark.collision import StateChecker
from trailmark.motion import CurveMotion
from trailmark.planning import LandmarkPlanner, PlanResult
from trailmark.proofs import LowerBound, enclosed
from trailmark.trajectories import CurvePath
from trailmark.trajectories.path import Path as Way
from trailmark.world import Robot, World

__all__ = ["Question", "ask", "judge_path", "judge_result", "load", "save"]

FloatArray = NDArray[np.float64]

HALF_TURN = 1e-9
"""Radians from half a turn in which either direction may be taken: the path itself then says which."""

CLEARANCE = 1e-3
"""Metres by which a path's least clearance may be wrong."""

ROUNDING = 1e-9
"""Relative error that costs may have."""


@dataclass(frozen=True)
class Question:
    """What is asked of the library in a world.

    Attributes:
        what: ``state``, ``motion``, ``plan``, ``clearance``, ``many``, ``bound``, ``enclosed``.
        states: configurations, rows x, y, theta: the states; starts and goals by turns.
        cost: of a way that is known from the first to the last, metres; None if none is.
        seconds: time limit for each plan.
        seed: of the planner.
        found: what was wrong when it was found, and with which version.
    """

    what: str
    states: tuple[tuple[float, float, float], ...]
    cost: float | None = None
    seconds: float = 1.0
    seed: int = 0
    found: str = ""


def question(what: str, states: FloatArray, **more: Any) -> Question:
    """Return a question about configurations of shape (n, 3)."""
    rows = tuple((float(x), float(y), float(t)) for x, y, t in states)
    return Question(what, rows, **more)


def save(folder: Path, kind: str, world: World, asked: Question) -> Path:
    """Write a case into a folder of its own, named after its kind and content; return that folder."""
    # A world's file holds no clearance that its robot keeps.
    kept = {} if world.robot is None or world.robot.clearance == 0.0 else {"clearance": world.robot.clearance}
    text = json.dumps({**asdict(asked), **kept}, indent=1)
    name = hashlib.sha256((repr(world.bounds) + text).encode()).hexdigest()[:8]
    case = folder / f"{kind}-{name}"
    case.mkdir(parents=True, exist_ok=True)
    world.save(case / "world.yaml")
    (case / "question.json").write_text(text + "\n")
    return case


def load(case: Path) -> tuple[World, Question]:
    """Read a case."""
    data = json.loads((case / "question.json").read_text())
    data["states"] = tuple((row[0], row[1], row[2]) for row in data["states"])
    world = World.load(case / "world.yaml")
    if (kept := data.pop("clearance", 0.0)) and world.robot is not None:
        world = replace(world, robot=world.robot.keeping(kept))
    return world, Question(**data)


def ask(world: World, asked: Question) -> str | None:
    """Ask the library; return what is wrong with the answer, None if nothing is."""
    robot = world.robot
    assert robot is not None
    states = np.array(asked.states)
    if asked.what == "state":
        return _ask_state(world, robot, states)
    if asked.what == "motion":
        return _ask_motion(world, robot, states)
    if asked.what == "bound":
        return _bound_above(LowerBound(world, robot).of(*states).cost, asked.cost)
    if asked.what == "enclosed":
        claimed = enclosed(StateChecker(world, robot), *states, seconds=asked.seconds)
        return "an enclosure is claimed although a way is known" if claimed else None
    planner = LandmarkPlanner(world, robot, seed=asked.seed, objective="length")  # as known costs are
    if asked.what == "plan":
        return judge_result(
            world, robot, states, planner.plan(states[0], states[1], time_limit=asked.seconds), asked.cost
        )
    if asked.what == "clearance":
        return _judge_clearance(world, robot, planner.plan(states[0], states[1], time_limit=asked.seconds))
    results = planner.plan_many(states[::2], states[1::2], time_limit=asked.seconds)
    for i, result in enumerate(results):
        complaint = judge_result(world, robot, states[2 * i : 2 * i + 2], result, None)
        if complaint is not None:
            return f"query {i}: {complaint}"
    return None


def judge_result(
    world: World,
    robot: Robot,
    ends: FloatArray,
    result: PlanResult,
    known: float | None,
    reference: Reference | None = None,
) -> str | None:
    """Return what is wrong with the answer to a query, ``known`` metres being the cost of a way; None if nothing is."""
    reference = reference or Reference(world, robot)
    if result.status == "infeasible":
        return "infeasible although a way is known" if known is not None else None
    if result.lower_bound is not None:
        complaint = _bound_above(result.lower_bound, known) or _bound_above(result.lower_bound, result.cost)
        if complaint is not None:
            return complaint
    if (result.status == "solved") != (result.path is not None):
        return f"status {result.status} and path {result.path}"
    complaint = None if result.path is None else _judge_answer(reference, robot, ends, result.path)
    if complaint is None and result.nearest is not None and len(result.nearest) > 1:
        complaint = _judge_answer(reference, robot, np.array([ends[0], result.nearest.states[-1]]), result.nearest)
        complaint = complaint and f"nearest: {complaint}"
    return complaint


def _judge_answer(reference: Reference, robot: Robot, ends: FloatArray, path: Way) -> str | None:
    """Judge a path that a planner returned; a car's also as a program drives it that joins states by straight lines."""
    complaint = judge_path(reference, robot, ends, path)
    if complaint is None and isinstance(path, CurvePath):
        complaint = _straight_collision(reference, path.states)
        complaint = complaint and f"states: {complaint}"
    return complaint


def judge_path(reference: Reference, robot: Robot, ends: FloatArray, path: Way) -> str | None:
    """Return what is wrong with a path: its ends, its steering, its cost, collisions; None if nothing is."""
    q = path.states
    if not (np.array_equal(q[0], ends[0]) and np.array_equal(q[-1], ends[-1])):
        return f"ends {q[0].tolist()}, {q[-1].tolist()} instead of {ends.tolist()}"
    if not ((q[:, 2] > -math.pi) & (q[:, 2] <= math.pi)).all():
        return "a heading beyond half a turn"
    places = [path.at(np.linspace(0.0, 1.0, 200)), path.resample(max(path.cost / 300.0, 1e-9)).states]
    if isinstance(path, CurvePath):
        complaint = _steered(robot, path)
    else:
        complaint = _cost_of(path) or _straight_collision(reference, q)
    if complaint is not None:
        return complaint
    # As it says itself where it leads.
    wrong, where = deepest(reference, lambda _, t: path.at(t), np.array([_moved(reference, path)]), 64 + 2 * len(q))
    if wrong[0] > reference.allowed and reference.collides(path.at(where[:1])).any():
        return f"collides by {wrong[0]:.3g} m at fraction {where[0]!r} of path.at"
    for name, states in zip(("at", "resample"), places, strict=True):
        if (hit := reference.collides(states)).any():
            return f"collides at {states[hit][0].tolist()} of path.{name}"
    return None


def _moved(reference: Reference, path: Way) -> float:
    """Return metres that a path moves any point of the robot at most."""
    if isinstance(path, CurvePath):
        return path.cost * (1.0 + reference.sweep / path.steering.radius) * (1.0 + ROUNDING)
    return path.cost * max(1.0, 2.0 * reference.sweep) * (1.0 + ROUNDING)


def _judge_clearance(world: World, robot: Robot, result: PlanResult) -> str | None:
    """Return what is wrong with the least clearance that a planner reports; None if nothing is."""
    if result.path is None or result.min_clearance is None:
        return None if result.path is None else "a path without a least clearance"
    reference = Reference(world, robot.keeping(0.0))
    true = max(0.0, least_room(reference, result.path.at, _moved(reference, result.path)))
    wrong = abs(result.min_clearance - true) > CLEARANCE
    return f"a least clearance of {result.min_clearance!r} m instead of {true!r} m" if wrong else None


def _straight_collision(reference: Reference, q: FloatArray) -> str | None:
    """Return where straight motions between states collide, taken anew from the states alone."""
    turn = np.abs(short_turn(q[:-1, 2], q[1:, 2]))
    clear = np.flatnonzero(turn < math.pi - HALF_TURN)
    a, b = q[:-1][clear], q[1:][clear]
    bounds = np.hypot(*(b - a)[:, :2].T) + reference.sweep * turn[clear]
    place = moves(a, b)
    worst, where = deepest(reference, place, bounds * (1.0 + ROUNDING), 4)
    for i in np.flatnonzero(worst > reference.allowed):
        if reference.collides(place(np.array([i]), where[i : i + 1])).any():
            return f"motion {clear[i]} collides by {worst[i]:.3g} m at {where[i]!r}"
    return None


def _cost_of(path: Way) -> str | None:
    q = path.states
    way, turn = np.hypot(*np.diff(q[:, :2], axis=0).T).sum(), np.abs(short_turn(q[:-1, 2], q[1:, 2])).sum()
    right = abs(path.cost - (way + 0.5 * turn)) <= ROUNDING * (1.0 + path.cost)
    return None if right else f"cost {path.cost!r} instead of {way + 0.5 * turn!r}"


def _steered(robot: Robot, path: CurvePath) -> str | None:
    """Return where a car's path cannot be driven: turns that are too sharp, leaps, slips to the side, wrong length."""
    radius = robot.turning_radius
    assert radius is not None
    length = path.length
    if length == 0.0:
        return None
    n = int(min(20_000, max(200, 50 * length / radius)))
    q = path.at(np.linspace(0.0, 1.0, n + 1))
    step = length / n
    turn = np.angle(np.exp(1j * np.diff(q[:, 2])))
    far = float(np.abs(q[:, :2]).max())
    slack = 1e-7 * (length + radius) + 64.0 * np.finfo(float).eps * far
    middle = q[:-1, 2] + 0.5 * turn
    dx, dy = np.diff(q[:, :2], axis=0).T
    along, across = dx * np.cos(middle) + dy * np.sin(middle), dy * np.cos(middle) - dx * np.sin(middle)
    if (np.abs(turn) > step / radius + slack / radius).any():
        return f"turns by {np.abs(turn).max():.3g} within {step:.3g} m at a radius of {radius:.3g} m"
    if (np.abs(across) > step * step / radius + slack).any():
        return f"slips {np.abs(across).max():.3g} m to the side"
    if (np.abs(along) > step + slack).any() or (not robot.reverse and (along < -slack).any()):
        return f"goes {along.min():.3g} to {along.max():.3g} m ahead within {step:.3g} m"
    return None


def _ask_state(world: World, robot: Robot, states: FloatArray) -> str | None:
    checker, reference = StateChecker(world, robot), Reference(world, robot)
    valid = np.asarray(checker.valid(states))
    for i in np.flatnonzero(valid & reference.collides(states)):
        return f"valid although it overlaps by {reference.depth(states[i : i + 1])[0]:.3g} m"
    for i in np.flatnonzero(~valid):
        room = reference.clearance(states[i : i + 1])[0]
        if room > REFUSED + reference.allowed:
            return f"not valid although there is {room:.3g} m of room"
    return None


def _ask_motion(world: World, robot: Robot, states: FloatArray) -> str | None:
    checker, reference = StateChecker(world, robot), Reference(world, robot)
    a, b = states[::2], states[1::2]
    ways: list[Way]
    if robot.turning_radius is not None:
        curves = CurveMotion(checker)
        free = curves.motions_valid(a, b)
        ways = [CurvePath(np.array([p, q]), curves.steering) for p, q in zip(a[free], b[free], strict=True)]
    else:
        free = checker.motions_valid(a, b)
        ways = [Way(np.array([p, q])) for p, q in zip(a[free], b[free], strict=True)]
    for way in ways:
        complaint = judge_path(reference, robot, way.states[[0, -1]], way)
        if complaint is not None:
            return f"certified, but {complaint}"
    return None


def _bound_above(bound: float, cost: float | None) -> str | None:
    if cost is None or bound <= cost + ROUNDING * (1.0 + cost):
        return None
    return f"lower bound {bound!r} above the cost {cost!r} of a way that is known"


def rows_of(pairs: Sequence[tuple[FloatArray, FloatArray]]) -> FloatArray:
    """Return starts and goals by turns, shape (2 n, 3)."""
    return np.array([q for pair in pairs for q in pair])
