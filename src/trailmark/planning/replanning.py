"""Replanning: the path being followed is kept while it holds in the changed world, repaired where it does not."""

# Tested by tests/planning/test_replanning.py.

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from time import perf_counter

import numpy as np

from trailmark.path import Path
from trailmark.planning.followed import FollowedPath
from trailmark.planning.incumbent import Incumbent
from trailmark.planning.lattice.cost_to_go import CostToGo
from trailmark.planning.lattice.schedule import LatticeSchedule
from trailmark.planning.reasons import explained
from trailmark.planning.rest import Rest, rest_of
from trailmark.planning.result import PlanResult, ReplanResult
from trailmark.planning.roadmap_lookup import RoadmapLookup
from trailmark.planning.shortening import shorten
from trailmark.planning.single_query import answer_query
from trailmark.planning.world_model import WorldModel
from trailmark.roadmap.search import without_repetitions
from trailmark.se2 import FloatArray

__all__ = ["MIN_SECONDS", "ReplanOptions", "Replanner", "as_replan"]

LEVELS, NEAR_LEVELS = 5, 2
"""Lattices that a path is sought on before the whole query is planned anew, and for a way around close by."""

PLACES = 32
"""Places along a motion that is blocked at which it is looked where."""

BACK_OFF = 2.0
"""Circumradii from where a motion is blocked to where a way around may begin."""

GUIDE_CELLS, GUIDE_GAIN = 1 << 14, 0.5
"""Cells of the costs to go that tell whether a better path may lead through freed space, and the share of the gain
sought by which they must fall: they are those of a disc that shuns tight places."""

NEAR = 1.0
"""Times the distance from where a way around begins to where it ends that it may lead off to the sides."""

SWEEPS = 40
"""Of shortening at most: mostly the time for it ends it."""

SLIGHTLY = 1.01
"""Times as much a path may cost by being led around what came before paths that lead elsewhere are looked at."""

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

    def answer(self, path: Path) -> ReplanResult:
        """Return the path to follow from here on instead of ``path``, or the rest of it."""
        rest = rest_of(self.model, path, self.start)
        if not np.array_equal(rest.vertices[-1], self.ends[1]):
            return as_replan(self._planned(None), "the path leads to another goal")
        if rest.free.all():
            kept = self.kept(rest)
            if kept is not None:
                return self._bettered(kept, rest.vertices)
        repaired, growth = self._repaired(rest)
        if repaired is not None and self.improvement <= 0.0:
            result = self.result(repaired, growth)
            if result is not None:
                return as_replan(result, "the path is blocked")
        return as_replan(self._planned(repaired), "the path is blocked")

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
            if verification.final_check.fault(self.motion.path(piece), *piece) is not None:
                return None
        least, least_at = rest.least, rest.least_at
        if least is None or rest.checked[1:].any():
            least, least_at = verification.least_clearance(vertices)
        elif rest.checked[0]:
            found, new = verification.least_clearance(vertices[:2], least)
            least, least_at = (found, 0) if new == 0 else (least, least_at)
        freed = np.empty((0, 4)) if self.model.followed is None else self.model.followed.freed
        untouched = np.zeros(len(rest.free), np.bool_)
        self.model.followed = FollowedPath(vertices, untouched, freed, least, least_at, rest.growth)
        incumbent = self._incumbent(vertices)
        result = verification.result(
            incumbent, "solved", incumbent.path(), self.model.shared.roadmap, min_clearance=least
        )
        return replace(as_replan(result, "the path is free, and no better one is known"), kept=True)

    def _bettered(self, kept: ReplanResult, vertices: FloatArray) -> ReplanResult:
        """Return a path that is better by more than the share wanted, or the one that is free."""
        better, limit = self._better(vertices), (kept.cost or 0.0) / (1.0 + self.min_gain)
        result: PlanResult | None = None
        if self.improvement > 0.0:
            result = self._planned(vertices if better is None else better)
        elif better is not None:
            result = self.result(better)
        if result is None or result.cost is None or result.cost >= limit:
            return kept
        return as_replan(result, f"another path costs {result.cost:.4g} m instead of {kept.cost:.4g} m")

    def _better(self, vertices: FloatArray) -> FloatArray | None:
        """Return a better path, shape (n, 3), sought only where obstacles went since the last look; None if none is."""
        model, followed = self.model, self.model.followed
        if followed is None or len(followed.freed) == 0:
            return None
        model.followed = replace(followed, freed=np.empty((0, 4)))
        if len(vertices) < 3:
            return None
        limit = self.motion.cost_of(vertices) / (1.0 + self.min_gain)
        if not self._may_be_better(followed.freed, limit):
            return None
        found = self._first_path(self.ends)
        if len(found):
            found = self._shortened(found)
        return found if len(found) and self.motion.cost_of(found) < limit else None

    def _may_be_better(self, freed: FloatArray, limit: float) -> bool:
        """Return whether a path that costs less than ``limit`` (metres) may lead through what was freed.

        Args:
            freed: boxes xmin, ymin, xmax, ymax (metres), shape (f, 4).
            limit: metres, or what an objective charges.
        """
        model = self.model
        limit = float(self.motion.longest(limit))
        gaps = [np.hypot(*np.maximum(np.maximum(freed[:, :2] - q[:2], q[:2] - freed[:, 2:]), 0.0).T) for q in self.ends]
        if (gaps[0] + gaps[1] - 2.0 * model.checker.robot.circumradius >= limit).all():
            return False
        if not (self.motion.moves_anywhere and self.motion.direct_is_best):
            return True
        here, goal = (model.checker.disc_center(q) for q in self.ends)
        if model.guide is None or model.guide[0] != goal:
            model.guide = goal, CostToGo.of(model.checker, self.ends[1], GUIDE_CELLS)
            return True
        before = model.guide[1].at(*here)
        # Beyond where the robot is, costs do not matter to it.
        guide = model.guide[1].lowered(model.checker, freed, before)
        model.guide = goal, guide
        return guide.at(*here) < before / (1.0 + GUIDE_GAIN * self.min_gain)

    def _repaired(self, rest: Rest) -> tuple[FloatArray | None, float]:
        """Return a path for one that is blocked, shape (n, 3), and its growth; None if none was found soon.

        It is led around what blocks it. Another one is sought only if that made it dearer by more than a little.
        """
        around, best, growth = self._led_around(rest), np.inf, 1.0
        if around is not None:
            best = self.motion.cost_of(around)
            growth = rest.growth * best / max(self.motion.cost_of(rest.vertices), 1e-9)
            if growth <= SLIGHTLY:
                return around, growth
        other = self._first_path(self.ends)
        # Shortening saves no more than that.
        if len(other) and self.motion.cost_of(other) < self.model.settings.worth_shortening * best:
            other = self._shortened(other)
            if self.motion.cost_of(other) < best:
                return other, 1.0
        return around, 1.0

    def _led_around(self, rest: Rest) -> FloatArray | None:
        """Return the path with a way around where it is blocked, shape (n, 3); None if none was found soon."""
        blocked = np.flatnonzero(~rest.free)
        if len(blocked) == 0:
            return None
        motion, vertices = self.motion, rest.vertices
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
        model, motion = self.model, self.motion
        direct = motion.motions_between_valid(ends[:1], ends[1:])[0]
        if direct and motion.direct_is_best:
            return ends
        found = np.empty((0, 3))
        if not near:
            found = RoadmapLookup(model.shared.roadmap, *ends).search_free_edges()
        if len(found) == 0 and motion.has_lattice:
            window = self._window(ends) if near else None
            lattices = LatticeSchedule(
                motion, ends, model.relaxation.size, self.seconds_left, model.settings.without, window
            )
            found = lattices.first_path(NEAR_LEVELS if near else LEVELS)
        if direct and (len(found) == 0 or motion.cost_of(ends) < motion.cost_of(found)):
            return ends
        return found

    def _window(self, ends: FloatArray) -> tuple[float, float, float, float]:
        """Return a box xmin, ymin, xmax, ymax (metres) around two configurations, within the bounds."""
        xy, bounds = ends[:, :2], self.model.checker.world.bounds
        room = NEAR * max(self.model.checker.robot.circumradius, float(np.hypot(*(xy[1] - xy[0]))))
        low, high = np.maximum(xy.min(axis=0) - room, bounds[:2]), np.minimum(xy.max(axis=0) + room, bounds[2:])
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    def result(self, states: FloatArray, growth: float = 1.0) -> PlanResult | None:
        """Return the result for a path of certified motions, which is followed from here on; None if it is not free."""
        incumbent = self._incumbent(states)
        path = incumbent.path()
        if path is None or not self.model.verification.certified(path, np.array([self.start, self.goal])):
            return None
        self.model.followed = replace(FollowedPath.of(self.motion, path), growth=growth)
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
