"""Replanning: the path being followed is kept while it holds in the changed world, repaired where it does not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.curves import CurvePath
from trailmark.motion import Motion
from trailmark.path import Path
from trailmark.planning.lattice.cost_to_go import CostToGo
from trailmark.planning.lattice.schedule import LatticeSchedule
from trailmark.planning.model import Passed, WorldModel
from trailmark.planning.pipeline import WORTH_SHORTENING, known_path, plan_single
from trailmark.planning.query import Budget, Incumbent, vertices_of
from trailmark.planning.reasons import explained
from trailmark.planning.result import PlanResult, ReplanResult
from trailmark.planning.shortening import shorten
from trailmark.roadmap.revalidation import edges_near
from trailmark.roadmap.search import without_repetitions
from trailmark.se2 import FloatArray

__all__ = ["MIN_SECONDS", "ReplanOptions", "Replanner", "Rest", "as_replan", "located", "rest_of"]

LEVELS, NEAR_LEVELS = 3, 2
"""Lattices that a path is sought on before the whole query is planned anew, and for a way around close by."""

PLACES, CAR_PLACES = 32, 256
"""Places along a motion that is blocked at which it is looked where; and along a car's path, to find where it is."""

BACK_OFF, NEAR = 2.0, 1.0
"""Circumradii from where a motion is blocked to where a way around may begin; and times the distance from there to
where it ends that it may lead off to the sides."""

GUIDE_CELLS, OVER = 1 << 14, 1.09
"""Cells of the inscribed disc's grid that tells whether a better path may lead through freed space, and the times by
which a way along its eight directions is longer than a straight one, at most."""

SWEEPS, SHORTENING = 40, 0.001
"""Of shortening at most; mostly its time ends it, the seconds that a robot is kept waiting for it."""

SLIGHTLY = 1.01
"""Times as much a path may cost by being led around what came before paths that lead elsewhere are looked at."""

FAR_ABOVE, LOOK_SECONDS = 1.2, 0.1
"""Times the length that no path falls below, from which on a car's query is planned anew after obstacles went, and the
seconds that this may take."""

MIN_SECONDS = 1e-3
"""That planning anew has at least."""


@dataclass(frozen=True)
class ReplanOptions:
    """How to replan.

    Attributes:
        deadline: reading of ``time.perf_counter`` by which a path should be found.
        min_gain: share by which another path must be better to take the place of one that is free.
        improvement: seconds to go on bettering a path.
        escape: whether to lead a robot out of an obstacle that it stands in.
        speed: of the robot, metres of cost per second, to pass moving obstacles in time; None avoids what they sweep.
    """

    deadline: float
    min_gain: float
    improvement: float
    escape: bool
    speed: float | None = None

    def seconds_left(self) -> float:
        """Return the seconds left to find a path."""
        return self.deadline - perf_counter()


def as_replan(result: PlanResult, reason: str) -> ReplanResult:
    """Return a result with why the path is not the rest of the one that was given."""
    if result.path is None:
        reason += ", and no other was found" if result.status == "timeout" else ", and there is no other"
        reason += f": {result.reason}" if result.reason else ""
    values = {field.name: getattr(result, field.name) for field in fields(PlanResult)}
    return ReplanResult(**values | {"reason": reason})


class Rest(NamedTuple):
    """What is left of a path from where the robot is.

    Attributes:
        vertices: states that motions join, shape (n, 3); the first is the robot's own.
        free: which motions are certified in the world as it is, shape (n - 1,).
        checked: which motions were looked at now, shape (n - 1,).
        freed: boxes xmin, ymin, xmax, ymax (metres) that hold what was removed since the path passed the final check,
            shape (f, 4).
        before: the checker of the world that it passed it in; None if that is not known.
    """

    vertices: FloatArray
    free: NDArray[np.bool_]
    checked: NDArray[np.bool_]
    freed: FloatArray
    before: StateChecker | None


def rest_of(motion: Motion, path: Path, start: FloatArray, passed: Passed | None) -> Rest:
    """Return what is left of a path, and where it is blocked.

    Motions that passed the final check in a world, and that nothing came near since, are free without being looked at.
    """
    vertices, checker = vertices_of(motion, path), motion.checker
    before, unknown, freed = None, np.ones(len(vertices) - 1, np.bool_), np.array([checker.world.bounds])
    if passed is not None and np.array_equal(passed.vertices, vertices):
        before, (freed, added) = passed.checker, passed.changes
        pairs = np.column_stack([np.arange(len(unknown)), np.arange(1, len(vertices))]).astype(np.int32)
        lengths = motion.longest(motion.costs(vertices[:-1], vertices[1:]))
        unknown = edges_near(vertices, pairs, lengths, float(checker.robot.circumradius), added, unknown)
    here = start if motion.turns else start * np.array([1.0, 1.0, 0.0])
    if len(vertices) > 1:
        nearest = located(motion, path, vertices, start)
        # The first motion is another one, unless the robot stands exactly at a state of the path.
        same = bool(np.array_equal(here, vertices[nearest]))
        vertices, unknown = np.vstack([here, vertices[nearest + 1 :]]), unknown[nearest:].copy()
        unknown[0] |= not same
    else:
        vertices, unknown = np.vstack([here, vertices]), np.ones(1, np.bool_)
    # Where the robot stands at the path's next state, or at its end, there is no motion to it.
    moves = (vertices[1:] != vertices[:-1]).any(axis=1)
    moves[-1] |= not moves.any()
    vertices, unknown = vertices[np.append(True, moves)], unknown[moves]
    free = ~unknown
    free[unknown] = motion.motions_valid(vertices[:-1][unknown], vertices[1:][unknown])
    return Rest(vertices, free, unknown, freed, before)


def located(motion: Motion, path: Path, vertices: FloatArray, q: FloatArray) -> int:
    """Return the motion of a path over vertices (n, 3), an index below n - 1, on or nearest to which q, (3,), lies."""
    if isinstance(path, CurvePath):
        fractions = np.linspace(0.0, 1.0, CAR_PLACES)
        nearest = int(np.argmin(se2.distance(path.at(fractions), q)))
        ends = np.cumsum(path.curves.lengths)
        return int(np.clip(np.searchsorted(ends, fractions[nearest] * ends[-1], side="right"), 0, len(vertices) - 2))
    a, b = vertices[:-1], vertices[1:]
    move = se2.difference(a, b)
    from_a = se2.difference(a, np.broadcast_to(q, a.shape))
    if not motion.turns:
        move[:, 2] = from_a[:, 2] = 0.0
    weight = np.array([1.0, 1.0, se2.ROTATION_WEIGHT])
    square = ((move * weight) ** 2).sum(axis=1)
    share = np.clip(((move * weight) * (from_a * weight)).sum(axis=1) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    off = np.abs(from_a - share[:, None] * move) @ weight
    # The last of those that are as near: a path may pass a place twice, and its vertices belong to two motions.
    return int(len(off) - 1 - np.argmin(off[::-1] - 1e-9 * np.arange(len(off))[::-1]))


class Replanner:
    """Answers one query for which there is a path already."""

    def __init__(self, model: WorldModel, start: FloatArray, goal: FloatArray, options: ReplanOptions) -> None:
        self.model, self.motion, self.start, self.goal = model, model.motion, start, goal
        self.ends = self.motion.ends(start, goal)
        self.options, self.min_gain, self.improvement = options, options.min_gain, options.improvement
        self.seconds_left, self.begin = options.seconds_left, perf_counter()

    def answer(self, path: Path, *, look: bool = False) -> ReplanResult:
        """Return the path to follow from here on instead of ``path``, or the rest of it."""
        rest = rest_of(self.motion, path, self.start, None if look else self.model.passed)
        if not np.array_equal(rest.vertices[-1], self.ends[1]):
            return as_replan(self._planned(None), "the path leads to another goal")
        if rest.free.all():
            better = self._better(rest.vertices, rest)
            result = None if better is None or self.improvement > 0.0 else self.result(better)
            if result is not None:
                return as_replan(result, self._gained(result, rest.vertices))
            kept = self.kept(rest)
            if kept is not None:
                return kept if self.improvement <= 0.0 else self._improved(kept, rest.vertices, better)
        known = self._repaired(rest)
        if known is not None:
            better = self._better(known, rest)
            known = known if better is None else better
            result = None if self.improvement > 0.0 else self.result(known)
            if result is not None:
                return as_replan(result, "the path is blocked")
        return as_replan(self._planned(known), "the path is blocked")

    def _planned(self, known: FloatArray | None) -> PlanResult:
        """Return what planning the whole query gives, beginning with a path if there is one."""
        budget = Budget(max(self.seconds_left() if known is None else self.improvement, MIN_SECONDS))
        result = plan_single(self.model, self.start, self.goal, budget, known=known)
        return explained(self.model, self.start, self.goal, result, budget)

    def kept(self, rest: Rest) -> ReplanResult | None:
        """Return the rest of the path, if what was looked at now passes the final check as well."""
        verification, vertices = self.model.verification, rest.vertices
        for i in np.flatnonzero(rest.checked).tolist():
            piece = vertices[i : i + 2]
            if verification.verifier.fault(self.motion.path(piece), *piece) is not None:
                return None
        self.model.passed = Passed(vertices, self.model.checker)
        incumbent = self._incumbent(vertices)
        result = verification.result(incumbent, "solved", incumbent.path(), self.model.shared.roadmap)
        return replace(as_replan(result, "the path is free, and no better one is known"), kept=True)

    def _improved(self, kept: ReplanResult, vertices: FloatArray, better: FloatArray | None) -> ReplanResult:
        """Return what comes of bettering a path, if that is better by more than the share wanted, or the one kept."""
        passed = self.model.passed
        result = self._planned(vertices if better is None else better)
        if result.cost is None or result.cost >= (kept.cost or 0.0) / (1.0 + self.min_gain):
            self.model.passed = passed
            return kept
        return as_replan(result, self._gained(result, vertices))

    def _gained(self, result: PlanResult, vertices: FloatArray) -> str:
        """Return in words what a path costs in place of the one over vertices, shape (n, 3)."""
        cost = self.motion.whole_cost(self.motion.cost_of(vertices), self.start, self.goal)
        return f"another path costs {result.cost:.4g} m instead of {cost:.4g} m"

    def _better(self, vertices: FloatArray, rest: Rest) -> FloatArray | None:
        """Return a path that takes the place of the one over vertices, shape (n, 3); None if there is none.

        It is the direct motion, or one that is sought where obstacles went since the path passed the final check.
        """
        motion, cost = self.motion, self.motion.cost_of(vertices)
        # A disc's turning is in neither cost.
        turning = motion.whole_cost(0.0, self.start, self.goal)
        straight, limit = motion.cost_of(self.ends), (cost + turning) / (1.0 + self.min_gain) - turning
        if straight < limit and motion.motions_between_valid(self.ends[:1], self.ends[1:])[0]:
            return self.ends
        if (straight >= limit and motion.direct_is_best) or not self._may_lead_through(rest.freed, limit):
            return None
        shortest = self._shortest_way(self.model.checker)
        if shortest < np.inf and shortest >= motion.longest(limit):
            return None
        for found in self._paths(self.ends):
            # Shortening saves no more than that.
            if motion.cost_of(found) < WORTH_SHORTENING * limit:
                found = self._shortened(found)
                if motion.cost_of(found) < limit:
                    return found
        # Without a lattice little is found so soon: a closer look is due where the disc's way became shorter, too.
        if motion.has_lattice or motion.longest(cost) <= FAR_ABOVE * shortest:
            return None
        before = np.inf if rest.before is None else self._shortest_way(rest.before)
        if (1.0 + self.min_gain) * shortest >= before:
            return None
        budget, passed = Budget(max(min(LOOK_SECONDS, self.seconds_left()), MIN_SECONDS)), self.model.passed
        path = plan_single(self.model, self.start, self.goal, budget).path
        self.model.passed = passed
        if path is None or motion.cost_of(states := vertices_of(motion, path)) >= limit:
            return None
        return states

    def _may_lead_through(self, freed: FloatArray, limit: float) -> bool:
        """Return whether a path that costs less than ``limit`` may lead through freed boxes, shape (f, 4)."""
        limit = float(self.motion.longest(limit))
        gaps = [np.hypot(*np.maximum(np.maximum(freed[:, :2] - q[:2], q[:2] - freed[:, 2:]), 0.0).T) for q in self.ends]
        return bool((gaps[0] + gaps[1] - 2.0 * self.model.checker.robot.circumradius < limit).any())

    def _shortest_way(self, checker: StateChecker) -> float:
        """Return about the length (metres) that no path in a world falls below: the inscribed disc's shortest.

        It is not proven: what goes by it is whether a search is worth its time. Infinite if the disc seems shut in.
        """
        guide = CostToGo.of(checker, self.ends[1], GUIDE_CELLS, tightness=0.0)
        length = guide.at(*checker.disc_center(self.ends[0]))
        return max(float(np.hypot(*(self.ends[1] - self.ends[0])[:2])), length / OVER - 3.0 * guide.size)

    def _repaired(self, rest: Rest) -> FloatArray | None:
        """Return a path, shape (n, 3), for one that is blocked; None if none was found soon.

        It is led around what blocks it. Another one is sought only if that made it costlier by more than a little.
        """
        motion = self.motion
        around, best = self._led_around(rest), np.inf
        if around is not None:
            best = motion.cost_of(around)
            if best <= SLIGHTLY * motion.cost_of(rest.vertices):
                return around
        other = self._first_path(self.ends)
        # Shortening saves no more than that.
        if len(other) and motion.cost_of(other) < WORTH_SHORTENING * best:
            other = self._shortened(other)
            if motion.cost_of(other) < best:
                return other
        return around

    def _led_around(self, rest: Rest) -> FloatArray | None:
        """Return the path with a way around where it is blocked, shape (n, 3); None if none was found soon."""
        motion, vertices, blocked = self.motion, rest.vertices, np.flatnonzero(~rest.free)
        if len(blocked) == 0:
            return None
        first, last = int(blocked[0]), int(blocked[-1])
        before = self._place_before(vertices[first], vertices[first + 1], reverse=False)
        after = self._place_before(vertices[last], vertices[last + 1], reverse=True)
        if before is None or after is None:
            return None
        around = self._first_path(np.array([before, after]), near=True)
        if len(around) == 0:
            return None
        piece = without_repetitions(np.vstack([vertices[first], around, vertices[last + 1]]))
        if not motion.motions_valid(piece[:-1], piece[1:]).all():
            return None
        # What is kept of the path is short already, but for where it meets what is new.
        low, high = max(0, first - 1), min(len(vertices), last + 3)
        piece = self._shortened(np.vstack([vertices[low:first], piece, vertices[last + 2 : high]]))
        return np.vstack([vertices[:low], piece, vertices[high:]])

    def _place_before(self, a: FloatArray, b: FloatArray, *, reverse: bool) -> FloatArray | None:
        """Return a configuration on the motion from a to b some way before where it is blocked, or after it.

        None if a is not valid, or b.
        """
        motion, checker = self.motion, self.model.checker
        places = np.array(motion.path(np.array([a, b])).at(np.linspace(0.0, 1.0, PLACES + 1)))
        places[0], places[-1] = a, b
        if reverse:
            places = places[::-1].copy()
        valid = checker.states_free(places)
        if not valid[0]:
            return None
        blocked = int(np.argmin(valid)) if not valid.all() else PLACES // 2
        step = float(motion.costs(a, b)[0]) / PLACES
        k = blocked - 1 - int(np.ceil(BACK_OFF * checker.robot.circumradius / max(step, 1e-9)))
        if k > 0:
            ends = (places[k : k + 1], places[:1]) if reverse else (places[:1], places[k : k + 1])
            if motion.motions_between_valid(*ends)[0]:
                return np.array(places[k])
        return np.array(places[0])

    def _shortened(self, states: FloatArray) -> FloatArray:
        """Return a path made shorter, in the time that a robot may be kept waiting for it."""
        end = perf_counter() + min(SHORTENING, self.seconds_left())
        return shorten(self.motion, states, self.model.rng, sweeps=SWEEPS, seconds_left=lambda: end - perf_counter())

    def _first_path(self, ends: FloatArray, *, near: bool = False) -> FloatArray:
        """Return a path of certified motions, shape (n, 3), that was soon found, ``near`` the ends; else (0, 3)."""
        motion = self.motion
        direct = motion.motions_between_valid(ends[:1], ends[1:])[0]
        if direct and motion.direct_is_best:
            return ends
        found = next(self._paths(ends, near=near), ends[:0])
        if direct and (len(found) == 0 or motion.cost_of(ends) < motion.cost_of(found)):
            return ends
        return found

    def _paths(self, ends: FloatArray, *, near: bool = False) -> Iterator[FloatArray]:
        """Yield paths of certified motions, (n, 3): of the roadmap, and over lattices, or only ``near`` the ends."""
        model, motion, window = self.model, self.motion, None
        if not near and len(found := known_path(model.shared.roadmap, ends)):
            yield found
        if not motion.has_lattice:
            return
        if near:
            xy, bounds = ends[:, :2], model.checker.world.bounds
            room = NEAR * max(model.checker.robot.circumradius, float(np.hypot(*(xy[1] - xy[0]))))
            low, high = np.maximum(xy.min(axis=0) - room, bounds[:2]), np.minimum(xy.max(axis=0) + room, bounds[2:])
            window = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
        lattices = LatticeSchedule(
            motion, ends, model.relaxation.size, self.seconds_left, model.settings.without, window
        )
        for _ in range(NEAR_LEVELS if near else LEVELS):
            if len(found := lattices.first_path()):
                yield found

    def result(self, states: FloatArray) -> PlanResult | None:
        """Return the result for a path of certified motions, states of shape (n, 3); None if it is not free."""
        incumbent = self._incumbent(states)
        path = incumbent.path()
        if path is None or not self.model.verification.certified(path, np.array([self.start, self.goal])):
            return None
        self.model.passed = Passed(vertices_of(self.motion, path), self.model.checker)
        return self.model.verification.result(incumbent, "solved", path, self.model.shared.roadmap)

    def _incumbent(self, states: FloatArray) -> Incumbent:
        incumbent = Incumbent(self.motion, self.start, self.goal, self.begin)
        incumbent.offer(states)
        return incumbent
