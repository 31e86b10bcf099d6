"""Why there is no path: which end is at fault and by how much, where the robot is shut in, or what ended the search."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.certify import CONTACT, END_ZONE
from trailmark.goals import Ends, Goal, goals_of
from trailmark.planning.model import WorldModel, zones_at
from trailmark.planning.proofs.enclosure import enclosure
from trailmark.planning.proofs.region import MARGIN, local_origin, region_parts
from trailmark.planning.query import Budget
from trailmark.planning.result import PlanResult
from trailmark.se2 import FloatArray, transform
from trailmark.shapes import Disc
from trailmark.world import Robot

__all__ = ["explained"]

SHARE, BEYOND, LEAST, MOST = 0.2, 0.05, 0.02, 5.0
"""Of the time limit, for saying why: at most, and beyond the limit, or so many seconds if that is more; and the most
seconds, whatever the limit."""

HEADINGS, DRAWN, NAMED = 8, 40, 8
"""Configurations of a goal that are looked at: so many headings at its nearest position, and so many drawn; and goals
that are spoken of one by one."""

FEWEST, HALVINGS = 5, 12
"""Steps in which the width of the widest way is found, at least and at most."""

MOST_CORNERS = 20_000
"""Of obstacles, up to which it is told where the robot is shut in."""

SAME_WIDTH = 1e-5
"""Metres: widths that differ by no more are the same, in contact with both sides no motion being certified."""

END = ("start", "goal")


def explained(model: WorldModel, start: ArrayLike, goal: Ends, result: PlanResult, budget: Budget) -> PlanResult:
    """Return a result with why there is no path; one with a path, as it is."""
    if result.path is not None:
        return result
    now, limit, stopped = perf_counter(), budget.limit, budget.stop is not None and budget.stop()
    took, ended = now - budget.begin, ""
    if result.status == "timeout":
        if stopped:
            ended = f"planning was told to stop after {took:.3g} s"
        elif took >= limit:
            ended = f"the time limit of {limit:g} s is up"
        elif budget.rounds is not None:
            ended = f"no path was found in {budget.rounds} rounds of landmarks"
        else:
            ended = f"nothing is left to try after {took:.3g} s of {limit:g} s"
    reasons = [text for text in (ended, result.reason) if text]
    if not stopped:
        left = Budget(min(SHARE * limit, max(limit - took, BEYOND * limit, LEAST), MOST), stop=budget.stop)
        reasons += _reasons(model, start, goal, result.status == "infeasible", left)
    time = {**result.time, "total": (result.time["total"] or 0.0) + perf_counter() - now}
    return replace(result, reason="; ".join(reasons) or "it is proven that no path exists", time=time)


def _reasons(model: WorldModel, start: ArrayLike, goal: Ends, infeasible: bool, budget: Budget) -> Iterator[str]:
    """Yield what is wrong with each goal, and with the ways there, as far as there is time to tell."""
    state = se2.configurations(start)
    goals = goals_of(goal) or ()
    # Zones that a path may leave close no way.
    zones = zones_at(model.checker, state)
    outside = model.without(zones) if zones else model

    def over() -> bool:
        return budget.is_up() or outside.bound.corners > MOST_CORNERS

    ends: list[Any] = list(goals[:NAMED]) or [se2.configurations(goal)]  # type: ignore[arg-type]  # an array then
    found: dict[str, list[str]] = {}
    for i, each in enumerate(ends):
        name = "the goal" if len(ends) == 1 else f"goal {i}"
        free, end = _free_end(model, state, each, budget) if isinstance(each, Goal) else (True, each)
        if not free:
            at = ", ".join(f"{v:.4g}" for v in end)
            nowhere = f"{name} is free nowhere" if infeasible else f"nothing free was found in {name}"
            yield f"{nowhere}: even at ({at}) the robot {model.checker.fault(end)}"
        elif not over() and (fault := _way_fault(outside.checker, state, end, infeasible, over, budget)):
            found.setdefault(fault, []).append(name)
    for fault, names in found.items():
        yield fault if len(ends) == 1 else f"{', '.join(names)}: {fault}"
    if len(goals) > NAMED:
        yield f"and so on for {len(goals) - NAMED} goals more"


def _free_end(model: WorldModel, start: FloatArray, goal: Goal, budget: Budget) -> tuple[bool, FloatArray]:
    """Return whether a free configuration of a goal is found, and that, or the one that overlaps least, shape (3,)."""
    if goal.configuration is not None:
        states = np.array([goal.configuration])
    else:
        turned = np.repeat(goal.nearest(start), HEADINGS, axis=0)
        turned[:, 2] += 2.0 * np.pi * np.arange(HEADINGS) / HEADINGS
        states = np.vstack([goal.nearest(turned), goal.draw(np.random.default_rng(model.seed), DRAWN)])
    free = model.checker.states_free(states)
    if free.any():
        return True, np.array(states[np.argmax(free)])
    return False, model.checker.nearest_to_valid(states, budget.is_up)


def _way_fault(
    checker: StateChecker,
    start: FloatArray,
    goal: FloatArray,
    infeasible: bool,
    over: Callable[[], bool],
    budget: Budget,
) -> str:
    """Return why there is no way to a valid configuration, in a clause; empty if that is not known."""
    ways = _Ways(checker, start, goal, over)
    parts = ways.parts(ways.radius)
    if parts and parts[0] is not parts[1]:
        end = int(np.argmin(shapely.area(parts)))
        return f"shut in at the {END[end]}: {ways.disc_clause(END[1 - end])}"
    if parts and infeasible and (proof := enclosure(checker, start, goal, seconds=budget.seconds_left(), stop=over)):
        inside = "a disc inside the robot would get out, the robot does not, at any heading"
        return "; ".join(part for part in (f"shut in at the {END[proof.end]}: {inside}", ways.narrow_clause()) if part)
    return "" if over() else ways.touching_clause() or ways.narrow_clause()


class _Ways:
    """The ways of discs, of whatever radius, between where the centre of a robot's inscribed disc is at two ends."""

    def __init__(self, checker: StateChecker, start: FloatArray, goal: FloatArray, over: Callable[[], bool]) -> None:
        self.robot, self.world, self.over = checker.robot, checker.world, over
        disc = self.robot.inscribed_disc
        self.radius, self.width, self.origin = disc.radius, _narrowest_width(self.robot), local_origin(self.world)
        centers = [transform(np.asarray(q), np.asarray(disc.center)[None])[0] for q in (start, goal)]
        self._centers = [shapely.Point(center - self.origin) for center in centers]
        self._kept = ", with the clearance that it keeps" if self.robot.clearance > 0.0 else ""

    def parts(self, radius: float) -> list[Any]:
        """Return the polygons from which a disc's centre gets from each end, the same twice if there is a way.

        By rounding, or because the disc is larger than the robot's, an end may lie outside: the nearest counts. The
        list is empty if the disc fits nowhere.
        """
        parts = region_parts(self.world, radius, origin=self.origin)
        if len(parts) == 0:
            return []
        return [parts[int(np.argmin(shapely.distance(parts, center)))] for center in self._centers]

    def joined(self, radius: float) -> bool:
        """Return whether a disc of a radius (metres) gets from one end to the other."""
        found = self.parts(radius)
        return len(found) == 2 and found[0] is found[1]

    def widest(self, low: float, high: float) -> tuple[FloatArray, float] | None:
        """Return where the largest disc that gets from one end to the other is narrowest, and its radius, metres.

        One of radius ``low`` gets there, or 0 is; one of ``high`` does not. Of discs a little larger, what can be
        reached from the one end and from the other nearly meets there. The radius is 0 if no disc gets there; None is
        returned if time was up too soon to tell.
        """
        apart = list[Any]()
        for halving in range(HALVINGS):
            if self.over():
                if halving < FEWEST:
                    return None
                break
            size = 0.5 * (low + high)
            found = self.parts(size)
            if found and found[0] is found[1]:
                low = size
            else:
                high, apart = size, found
        apart = apart or self.parts(high)
        return (self._between(apart), low) if apart else (self.origin, 0.0)

    def disc_clause(self, other: str) -> str:
        """Return why not even the disc inside the robot gets to the other end."""
        gap = self.widest(0.0, self.radius)
        if gap is None:
            return "a disc inside the robot does not get out"
        if gap[1] == 0.0:
            return f"obstacles close every way to the {other}"
        return (
            f"the widest way to the {other} lets a disc of about {2.0 * gap[1]:.2f} m through {_at(gap[0])}, and the "
            f"robot holds one of {2.0 * self.radius:.2f} m{self._kept}"
        )

    def narrow_clause(self) -> str:
        """Return that the widest way is less wide than the robot at its narrowest; empty if it is not."""
        if self.width - 2.0 * self.radius < SAME_WIDTH or self.over() or self.joined(0.5 * self.width):
            return ""
        gap = self.widest(self.radius, 0.5 * self.width)
        if gap is None or gap[1] == 0.0:
            return ""
        return (
            f"the widest way lets a disc of about {2.0 * gap[1]:.2f} m through {_at(gap[0])}, and the robot is "
            f"{self.width:.2f} m wide where it is narrowest{self._kept}"
        )

    def touching_clause(self) -> str:
        """Return where the robot fits only in contact with both sides; empty if it may be nowhere.

        No motion along which it touches is certified, for more than 1 mm from its ends.
        """
        half = 0.5 * self.width
        # A disc larger by what motions must keep.
        found = self.parts(half + MARGIN + CONTACT)
        if half - self.radius < SAME_WIDTH:
            away = [shapely.distance(*pair) for pair in zip(found, self._centers, strict=bool(found))]
            for end, distance in zip(END, away or (np.inf, np.inf), strict=True):
                if distance > END_ZONE:
                    return f"the robot fits only in contact at the {end}"
        if not found or found[0] is found[1]:
            return ""
        place = self._between(found)
        width = 2.0 * self._room(place)
        if abs(width - self.width) > SAME_WIDTH or not self.joined(half):
            return ""
        return (
            f"the robot fits only in contact: the widest way to the goal is {width:.6g} m wide {_at(place)}, and it "
            f"needs {self.width:.6g} m{self._kept}; motions that touch both sides are not certified"
        )

    def _between(self, apart: list[Any]) -> FloatArray:
        """Return the place, shape (2,), where two polygons are nearest to each other."""
        return np.asarray(shapely.get_coordinates(shapely.shortest_line(*apart)).mean(axis=0) + self.origin)

    def _room(self, place: FloatArray) -> float:
        """Return how far (metres) a place, shape (2,), is from what is nearest."""
        point, outside = shapely.Point(place), [shapely.box(*self.world.bounds).exterior]
        if self.world.boundary is not None:
            outside.append(self.world.boundary.shapely().exterior)
        gaps = [float(shapely.distance(line, point)) for line in outside]
        for shape in self.world.obstacles:
            if isinstance(shape, Disc):
                gaps.append(float(np.hypot(*(place - shape.center))) - shape.radius)
            else:
                gaps.append(float(shapely.distance(shape.polygon().shapely(), point)))
        return min(gaps)


def _narrowest_width(robot: Robot) -> float:
    """Return the width (metres) of the narrowest strip that holds a robot, with its clearance.

    For one that is not convex, which may wind through narrower places, that of its inscribed disc.
    """
    outline = robot.outline.shapely()
    hull = shapely.convex_hull(outline)
    if isinstance(robot.footprint, Disc) or hull.area > (1.0 + 1e-9) * outline.area:
        return 2.0 * robot.inscribed_disc.radius
    points = shapely.get_coordinates(hull)
    along = np.diff(points, axis=0)
    normals = np.column_stack([-along[:, 1], along[:, 0]]) / np.hypot(*along.T)[:, None]
    return float(np.ptp(points @ normals.T, axis=0).min()) + 2.0 * robot.clearance


def _at(place: FloatArray) -> str:
    return f"at ({place[0]:.2f}, {place[1]:.2f})"
