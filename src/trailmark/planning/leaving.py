"""Queries that start in keep-out zones, which the robot may leave.

Its path is clear of everything else all along, of other keep-out zones too; and from some place on up to its end it is
clear of these zones as well: it does not come back into one that it left.

It is planned in the world without these zones, in which a path that is allowed is one too: lower bounds and proofs that
there is none hold. Where that path comes back, the rest is planned anew in the whole world, from where it left first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.keep_out import keep_outs
from trailmark.motion import Motion
from trailmark.motion.base import interpolate, new_scratch
from trailmark.planning.followed import vertices_of
from trailmark.planning.incumbent import Incumbent
from trailmark.planning.query import OnProgress
from trailmark.planning.result import PlanProgress, PlanResult, Status
from trailmark.planning.world_model import WorldModel
from trailmark.se2 import FloatArray
from trailmark.world import World

__all__ = ["leave", "zones_at"]

FIRST_SHARE = 0.5
"""Of the time, for the path in the world without the zones; the rest of it, if it is used, needs the other half."""

MIN_SECONDS = 1e-3
"""That planning the rest has at least."""

STEPS = 4.0
"""For each inscribed radius: places along a path at which it is looked whether it has left the zones."""


def leave(
    model: WorldModel,
    zones: tuple[str, ...],
    start: ArrayLike,
    goal: Any,
    time_limit: float,
    plan: Callable[..., PlanResult],
    on_progress: OnProgress | None = None,
    **options: Any,
) -> PlanResult:
    """Return the answer to a query that starts in keep-out zones; whoever calls holds the lock of the model's roadmap.

    Args:
        model: of the world.
        zones: the names of those that the start lies in (:func:`zones_at`).
        start: configuration, shape (3,).
        goal: what ``plan`` takes for one; in no keep-out zone, if it is one configuration.
        time_limit: seconds, above 0.
        plan: answers a query that starts in no zone: a model, start, goal, time limit and options.
        on_progress: called after every step.
        options: of ``plan``.

    Raises:
        ConfigurationError: the start is not valid, these zones left aside.
    """
    begin, without = perf_counter(), model.without(zones)
    state = without.checker.require_valid(start, "start")
    watched = None if on_progress is None else _without_paths(on_progress)
    found = last = plan(without, state, goal, FIRST_SHARE * time_limit, on_progress=watched, **options)
    if found.path is None:
        return found
    leaving, rest = _split(without.motion, model.checker, vertices_of(without.motion, found.path))
    if len(rest) and not model.motion.motions_valid(rest[:-1], rest[1:]).all():
        left = max(time_limit - (perf_counter() - begin), MIN_SECONDS)
        last = plan(model, rest[0], goal, left, on_progress=watched, **options)
        rest = rest[:0] if last.path is None else vertices_of(model.motion, last.path)
    if last.path is None or len(rest) == 0:
        return replace(found, status="timeout", path=None, first_cost=None, min_clearance=None, history=(), goal=None)
    ends = np.array([state, last.path.states[-1]])
    incumbent = Incumbent(without.motion, ends[0], ends[1], begin)
    incumbent.offer(np.vstack([leaving[:-1], rest]))
    path = incumbent.path()
    if path is not None:
        # Clear of all but these zones, and after the first part of these too.
        certified = without.verification.certified(path, ends)
        if not certified or not model.verification.certified(model.motion.path(rest), rest[[0, -1]]):
            path = None
    status: Status = "timeout" if path is None else "solved"
    answer = without.verification.result(incumbent, status, path, model.shared.roadmap, found.time["build"] or 0.0)
    if answer.path is not None:
        answer = replace(answer, path=model.verification.followed_by_lines(answer.path, leaves=True), goal=last.goal)
    return replace(answer, lower_bound=found.lower_bound)


def zones_at(checker: StateChecker, q: ArrayLike) -> tuple[str, ...]:
    """Return the names of the keep-out zones that the robot would overlap in a configuration, shape (3,).

    Raises:
        ConfigurationError: no configuration.
    """
    world, state = checker.world, se2.configurations(q, name="start")
    if state.ndim != 1 or not keep_outs(world) or checker.valid(state):
        return ()
    (x, y), reach = state[:2].tolist(), 4.0 * checker.robot.circumradius
    around = x - reach, y - reach, x + reach, y + reach
    alone = {name: World("", around, (region,)) for name, region in keep_outs(world).items()}
    return tuple(name for name, world in alone.items() if not StateChecker(world, checker.robot).valid(state))


def _split(motion: Motion, outside: StateChecker, vertices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the part of a path up to where the robot is first seen outside, and the rest, which begins there.

    Args:
        motion: that leads from each of the vertices to the next one.
        outside: tells whether a configuration is out of the zones.
        vertices: shape (n, 3).

    Returns:
        Shapes (k, 3) and (m, 3); the rest is empty if the robot is never seen outside.
    """
    scratch, step = new_scratch(motion.kind), outside.robot.inscribed_disc.radius / STEPS
    for i in range(len(vertices) - 1):
        a, b = vertices[i], vertices[i + 1]
        cost = float(motion.costs(a, b)[0])
        states = np.empty((int(np.ceil(cost / step)) + 1, 3))
        for k, along in enumerate(np.linspace(0.0, cost, len(states))):
            interpolate(motion.kind, scratch, a, b, along, states[k])
        states[-1] = b
        free = outside.states_free(states)
        if free.any():
            here = states[int(np.argmax(free))]
            behind = vertices[i + 1 :] if not np.array_equal(here, b) else vertices[i + 2 :]
            return np.vstack([vertices[: i + 1], here]), np.vstack([here, behind])
    return vertices, vertices[:0]


def _without_paths(on_progress: OnProgress) -> OnProgress:
    """Return a callback that hands on how far planning is, but no path, which may come back into a zone."""

    def hand_on(progress: PlanProgress) -> None:
        on_progress(replace(progress, path=None, cost=None, nearest=None))

    return hand_on
