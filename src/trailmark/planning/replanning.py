"""Replanning: the path being followed is kept while it holds in the changed world, repaired where it does not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from time import perf_counter

import numpy as np

from trailmark.collision import StateChecker
from trailmark.landmarks.band import Band
from trailmark.path import Path
from trailmark.planning.followed import Passed, Rest, rest_of, vertices_of
from trailmark.planning.incumbent import Incumbent
from trailmark.planning.lattice.cost_to_go import CostToGo
from trailmark.planning.lattice.schedule import LatticeSchedule
from trailmark.planning.placement import Placement
from trailmark.planning.query import Clock, Query
from trailmark.planning.reasons import explained
from trailmark.planning.result import PlanResult, ReplanResult
from trailmark.planning.roadmap_lookup import RoadmapLookup
from trailmark.planning.shortening import shorten
from trailmark.planning.single_query import answer_query
from trailmark.planning.world_model import WorldModel
from trailmark.roadmap import Roadmap
from trailmark.roadmap.search import without_repetitions
from trailmark.se2 import FloatArray

__all__ = ["MIN_SECONDS", "ReplanOptions", "Replanner", "as_replan"]

LEVELS, NEAR_LEVELS = 3, 2
"""Lattices that a path is sought on before the whole query is planned anew, and for a way around close by."""

PLACES = 32
"""Places along a motion that is blocked at which it is looked where."""

BACK_OFF = 2.0
"""Circumradii from where a motion is blocked to where a way around may begin."""

GUIDE_CELLS, OVER = 1 << 14, 1.09
"""Cells of the inscribed disc's grid that tells whether a better path may lead through freed space, and the times by
which a way along its eight directions is longer than a straight one, at most."""

NEAR = 1.0
"""Times the distance from where a way around begins to where it ends that it may lead off to the sides."""

SWEEPS = 40
"""Of shortening at most: mostly the time for it ends it."""

SLIGHTLY = 1.01
"""Times as much a path may cost by being led around what came before paths that lead elsewhere are looked at."""

FAR_ABOVE = 1.2
"""Times the length that no path falls below, from which on a closer look at a path is due after obstacles went."""

WIDENINGS, LANDMARKS, LOOK_SECONDS = (0.05, 0.12, 0.3, 0.7), 30, 0.1
"""Of a closer look: how much longer than the inscribed disc's shortest the ways are that landmarks are placed along,
one after the other, how many each time, and the seconds that all may take."""

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


class Replanner:
    """Answers one query for which there is a path already.

    Args:
        model: of the world as it is.
        start: where the robot is, shape (3,), valid.
        goal: shape (3,), valid.
        options: how to.
    """

    def __init__(self, model: WorldModel, start: FloatArray, goal: FloatArray, options: ReplanOptions) -> None:
        self.model, self.motion, self.start, self.goal = model, model.motion, start, goal
        self.ends = self.motion.ends(start, goal)
        self.options, self.min_gain, self.improvement = options, options.min_gain, options.improvement
        self.begin = perf_counter()

    def seconds_left(self) -> float:
        """Return the seconds left to find a path."""
        return self.options.deadline - perf_counter()

    def answer(self, path: Path, *, look: bool = False) -> ReplanResult:
        """Return the path to follow from here on instead of ``path``, or the rest of it.

        Args:
            path: being followed.
            look: for a better path though nothing was freed since this one passed the final check.
        """
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
        seconds = self.seconds_left() if known is None else self.improvement
        begin, seconds = perf_counter(), max(seconds, MIN_SECONDS)
        result = answer_query(self.model, self.start, self.goal, seconds, known=known)
        return explained(self.model, self.start, self.goal, result, begin, seconds)

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

    def _limit(self, cost: float) -> float:
        """Return below which cost (metres) a path takes the place of one of another; a disc's turning is in neither."""
        turning = self.motion.whole_cost(0.0, self.start, self.goal)
        return (cost + turning) / (1.0 + self.min_gain) - turning

    def _better(self, vertices: FloatArray, rest: Rest) -> FloatArray | None:
        """Return a path that takes the place of another, shape (n, 3); None if there is none.

        It is the direct motion, or one that is sought where obstacles went since the path passed the final check.

        Args:
            vertices: of the other path, shape (n, 3).
            rest: of the path that is being followed.
        """
        motion, cost = self.motion, self.motion.cost_of(vertices)
        straight, limit = motion.cost_of(self.ends), self._limit(cost)
        if straight < limit and motion.motions_between_valid(self.ends[:1], self.ends[1:])[0]:
            return self.ends
        if (straight >= limit and motion.direct_is_best) or not self._may_lead_through(rest.freed, limit):
            return None
        shortest = self._shortest_way(self.model.checker)
        if shortest < np.inf and shortest >= motion.longest(limit):
            return None
        for found in self._paths(self.ends):
            # Shortening saves no more than that.
            if motion.cost_of(found) < self.model.settings.worth_shortening * limit:
                found = self._shortened(found)
                if motion.cost_of(found) < limit:
                    return found
        # Without a lattice little is found so soon: a closer look is due where the disc's way became shorter, too.
        if motion.has_lattice or motion.longest(cost) <= FAR_ABOVE * shortest:
            return None
        before = np.inf if rest.before is None else self._shortest_way(rest.before)
        if (1.0 + self.min_gain) * shortest >= before:
            return None
        return self._looked_closely(vertices, FAR_ABOVE * shortest)

    def _looked_closely(self, vertices: FloatArray, enough: float) -> FloatArray | None:
        """Return a path over a few landmarks in place of another, shape (n, 3); None if none is found.

        They lie around the inscribed disc's shortest way, farther and farther to the sides.

        Args:
            vertices: of the other path, shape (n, 3).
            enough: length (metres) that is looked no further for.
        """
        model, limit = self.model, self._limit(self.motion.cost_of(vertices))
        clock = Clock(perf_counter(), min(LOOK_SECONDS, self.seconds_left()))
        roadmap = Roadmap(model.checker, self.motion)
        query = Query(roadmap, model.relaxation, model.rng, self._incumbent(vertices), clock, model.settings)
        band = Band(model.checker, model.relaxation, *query.ends)
        if not np.isfinite(band.shortest):
            return None
        placement, nodes = Placement(query, band), roadmap.add(query.ends)
        for widening in WIDENINGS:
            placement.place(roadmap, widening, LANDMARKS)
            # Whatever it costs at first: shortening saves a car much.
            placement.search(roadmap, nodes, banned=np.zeros(len(roadmap), np.bool_))
            if self.motion.longest(query.incumbent.cost) <= enough or clock.seconds_left() <= 0.0:
                break
        return query.incumbent.states if query.incumbent.cost < limit else None

    def _may_lead_through(self, freed: FloatArray, limit: float) -> bool:
        """Return whether a path that costs less than ``limit`` (metres) may lead through what was freed.

        Args:
            freed: boxes xmin, ymin, xmax, ymax (metres), shape (f, 4).
            limit: metres, or what an objective charges.
        """
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

        It is led around what blocks it. Another one is sought only if that made it dearer by more than a little.
        """
        motion = self.motion
        around, best = self._led_around(rest), np.inf
        if around is not None:
            best = motion.cost_of(around)
            if best <= SLIGHTLY * motion.cost_of(rest.vertices):
                return around
        other = self._first_path(self.ends)
        # Shortening saves no more than that.
        if len(other) and motion.cost_of(other) < self.model.settings.worth_shortening * best:
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
        before = place_before(self.model, vertices[first], vertices[first + 1], reverse=False)
        after = place_before(self.model, vertices[last], vertices[last + 1], reverse=True)
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

    def _shortened(self, states: FloatArray) -> FloatArray:
        """Return a path made shorter, in the time that a robot may be kept waiting for it."""
        end = perf_counter() + min(0.5 * self.model.settings.replan_shortening, self.seconds_left())
        return shorten(self.motion, states, self.model.rng, sweeps=SWEEPS, seconds_left=lambda: end - perf_counter())

    def _first_path(self, ends: FloatArray, *, near: bool = False) -> FloatArray:
        """Return a path of certified motions, shape (n, 3), that was soon found; (0, 3) if none was.

        Args:
            ends: start and goal, valid, shape (2, 3).
            near: whether to look only around the two.
        """
        motion = self.motion
        direct = motion.motions_between_valid(ends[:1], ends[1:])[0]
        if direct and motion.direct_is_best:
            return ends
        found = next(self._paths(ends, near=near), ends[:0])
        if direct and (len(found) == 0 or motion.cost_of(ends) < motion.cost_of(found)):
            return ends
        return found

    def _paths(self, ends: FloatArray, *, near: bool = False) -> Iterator[FloatArray]:
        """Yield paths of certified motions, shape (n, 3): of the roadmap, and as they are found over lattices.

        Args:
            ends: start and goal, valid, shape (2, 3).
            near: whether to look only around the two.
        """
        model, motion = self.model, self.motion
        if not near and len(found := RoadmapLookup(model.shared.roadmap, *ends).search_free_edges()):
            yield found
        if motion.has_lattice:
            window = self._window(ends) if near else None
            lattices = LatticeSchedule(
                motion, ends, model.relaxation.size, self.seconds_left, model.settings.without, window
            )
            for _ in range(NEAR_LEVELS if near else LEVELS):
                if len(found := lattices.first_path()):
                    yield found

    def _window(self, ends: FloatArray) -> tuple[float, float, float, float]:
        """Return a box xmin, ymin, xmax, ymax (metres) around two configurations, within the bounds."""
        xy, bounds = ends[:, :2], self.model.checker.world.bounds
        room = NEAR * max(self.model.checker.robot.circumradius, float(np.hypot(*(xy[1] - xy[0]))))
        low, high = np.maximum(xy.min(axis=0) - room, bounds[:2]), np.minimum(xy.max(axis=0) + room, bounds[2:])
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

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


def as_replan(result: PlanResult, reason: str) -> ReplanResult:
    """Return a result with why the path is not the rest of the one that was given."""
    if result.path is None:
        reason += ", and no other was found" if result.status == "timeout" else ", and there is no other"
        reason += f": {result.reason}" if result.reason else ""
    values = {field.name: getattr(result, field.name) for field in fields(PlanResult)}
    return ReplanResult(**values | {"reason": reason})


def place_before(model: WorldModel, a: FloatArray, b: FloatArray, *, reverse: bool) -> FloatArray | None:
    """Return a configuration on the motion from a to b, some way before where it is blocked; None if a is not valid.

    Args:
        model: of the world.
        a: shape (3,).
        b: shape (3,).
        reverse: whether to return one some way after where it is blocked instead; None if b is not valid.
    """
    motion = model.motion
    places = np.array(motion.path(np.array([a, b])).at(np.linspace(0.0, 1.0, PLACES + 1)))
    places[0], places[-1] = a, b
    if reverse:
        places = places[::-1].copy()
    valid = model.checker.states_free(places)
    if not valid[0]:
        return None
    blocked = int(np.argmin(valid)) if not valid.all() else PLACES // 2
    step = float(motion.costs(a, b)[0]) / PLACES
    k = blocked - 1 - int(np.ceil(BACK_OFF * model.checker.robot.circumradius / max(step, 1e-9)))
    if k > 0:
        ends = (places[k : k + 1], places[:1]) if reverse else (places[:1], places[k : k + 1])
        if motion.motions_between_valid(*ends)[0]:
            return np.array(places[k])
    return np.array(places[0])
