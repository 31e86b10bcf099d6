"""What the live page asks for beside the path: OMPL's planners on the same problem, and an exploration to watch."""

# Tested by tests/live/test_server.py.

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from threading import Event
from time import perf_counter
from typing import Any

import numpy as np

from trailmark.arguments import number, whole
from trailmark.errors import ConfigurationError
from trailmark.live.messages import Message
from trailmark.world import World

__all__ = ["ASIDES", "compare", "explore"]

Answer = dict[str, Any]
Tell = Callable[[Answer], None]

MEMORY = 4096.0
"""MB that another planner may take."""

MAX_CELLS = 250_000
"""Of the map that an exploration makes here."""

PERIOD = 0.05
"""Seconds between two looks at an exploration: more are not seen."""

_process = ThreadPoolExecutor(1, thread_name_prefix="trailmark-compare")
"""The one thread whose process runs other planners, for all clients: two at once would take each other's time."""


def compare(world: World, message: Message, tell: Tell, stop: Event) -> None:
    """Run one of the benchmark's planners on a query, in a process of its own, and tell its path and the verdict.

    Args:
        world: with the robot.
        message: ``planner``, ``start``, ``goal``, and perhaps ``time_limit``.
        tell: sends the answer: ``states``, ``cost``, seconds, and ``fault``, what the referee found wrong, or null.
        stop: not asked, for the run has a limit of its own.

    Raises:
        TrailmarkError: no such planner, or a goal that is no configuration.
    """
    from trailmark.benchmark.isolation.worker import run_job
    from trailmark.benchmark.planners import read_planners
    from trailmark.benchmark.problems import Job, Problem
    from trailmark.benchmark.record import RunRecord
    from trailmark.formats.world_yaml import query_from_data

    fields = message.fields
    if "/" in fields["planner"] or ("native" not in fields["planner"] and ":" in fields["planner"]):
        # A function of the user's own is code: no page may name one.
        raise ConfigurationError(f"compare.planner: expected one of trailmark's or OMPL's, got {fields['planner']!r}")
    assert world.robot is not None  # noqa: S101  # a session's world has one
    name = read_planners([fields["planner"]], cars=world.robot.turning_radius is not None)[0]
    entry = {"name": "live", "start": fields["start"], "goal": fields["goal"]}
    query = query_from_data(entry, message.type)
    query.pose()
    problem = Problem(replace(world, queries=(query,)))
    seconds = float(fields.get("time_limit", 1.0))
    job = Job(problem.key, problem.text, name, 0, seconds, MEMORY, problem.resolution())
    record = RunRecord.from_json(_process.submit(run_job, job.to_dict()).result())
    path = record.simplified_path if record.simplified_path and record.correct_solution else record.path
    states = [] if path is None or not record.solved else problem.path(path).states.tolist()
    tell(
        {
            "type": "compare",
            "id": message.id,
            "planner": name,
            "solved": record.solved,
            "correct": record.correct_solution,
            "fault": record.failure,
            "states": states,
            "cost": record.solution_length,
            "time": {"first_solution": record.time_to_first_solution, "total": record.time},
        }
    )


def explore(world: World, message: Message, tell: Tell, stop: Event) -> None:
    """Explore the world as if it were hidden, and tell how far the robot has come.

    Each answer is a :func:`~trailmark.live.recording.step_data` with the cells that changed since the last; at the end
    comes ``status``.

    Args:
        world: with the robot.
        message: perhaps ``start``, ``sensor_range``, ``strategy``, ``noise`` and ``seed``.
        tell: sends an answer.
        stop: set when it is to end.

    Raises:
        TrailmarkError: a field out of range, a start that is not free.
    """
    from trailmark.exploration import ExplorationSettings, Explorer
    from trailmark.live.recording import step_data

    fields = message.fields
    xmin, ymin, xmax, ymax = world.bounds
    reach = number(fields.get("sensor_range", 0.2 * max(xmax - xmin, ymax - ymin)), "explore.sensor_range:", above=0.0)
    noise = number(fields.get("noise", 0.0), "explore.noise:", minimum=0.0, maximum=10.0)
    explorer = Explorer(
        world,
        world.robot,
        strategy=fields.get("strategy", "tour"),
        sensor_range=reach,
        start=fields.get("start"),
        noise=noise,
        seed=whole(fields.get("seed", 0), "explore.seed:", 0),
        settings=ExplorationSettings(max_cells=MAX_CELLS, confidence=0.99 if noise > 0.0 else None),
    )
    known = explorer.mapper.known
    answer = {"type": "explore", "id": message.id}
    grid = {"rows": known.state.shape[0], "columns": known.state.shape[1], "size": known.cell}
    tell({**answer, "final": False, "grid": {**grid, "origin": list(known.origin)}, "sensor_range": reach})
    shown, told = np.zeros_like(known.state), -np.inf
    while explorer.ended is None and not stop.is_set():
        progress = explorer.step()
        if explorer.ended is None and perf_counter() - told < PERIOD:
            continue
        told, known = perf_counter(), explorer.mapper.known
        at = np.flatnonzero(known.state.ravel() != shown.ravel())
        shown = known.state.copy()
        tell({**answer, "final": False, **step_data(progress, at, shown.ravel()[at])})
    status, reason = explorer.ended or ("interrupted", "stopped")
    tell({**answer, "final": True, "status": status, "reason": reason})


ASIDES: dict[str, Callable[[World, Message, Tell, Event], None]] = {"compare": compare, "explore": explore}
"""By the type of the message that asks for them."""
