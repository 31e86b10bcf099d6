"""Why there is no path: which end is at fault and by how much, where the robot is shut in, or what ended the search."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from time import perf_counter
from typing import Any, Final, Literal, NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.certify import CONTACT, END_ZONE
from trailmark.goals import Ends, Goal, goals_of
from trailmark.planning.proofs.enclosure import Enclosure, enclosure
from trailmark.planning.proofs.region import MARGIN, local_origin, region_parts
from trailmark.planning.result import PlanResult
from trailmark.planning.world_model import WorldModel, zones_at
from trailmark.se2 import FloatArray, transform
from trailmark.shapes import Disc
from trailmark.world import Robot

__all__ = ["ENDS", "Reach", "Ways", "explained", "reach"]

SHARE, BEYOND, LEAST = 0.2, 0.05, 0.02
"""Of the time limit: for saying why at most, and of that beyond the limit, or so many seconds if that is more."""

MOST_SECONDS = 5.0
"""For saying why, whatever the limit."""

HEADINGS, DRAWN = 8, 40
"""Configurations of a goal that are looked at: so many headings at its nearest position, and so many drawn."""

MOST_CORNERS = 20_000
"""Of obstacles, up to which it is told where the robot is shut in."""

NAMED = 8
"""Goals that are spoken of one by one."""


def explained(
    model: WorldModel,
    start: ArrayLike,
    goal: Ends,
    result: PlanResult,
    begin: float,
    limit: float,
    *,
    stop: Callable[[], bool] | None = None,
    max_rounds: int | None = None,
    **_others: Any,
) -> PlanResult:
    """Return a result with why there is no path; one with a path, as it is.

    Args:
        model: of the world.
        start: of the query, shape (3,).
        goal: of the query.
        result: its answer.
        begin: reading of ``time.perf_counter`` at which the query began, seconds.
        limit: seconds that it had.
        stop: asked whether it was to end early.
        max_rounds: rounds of landmarks that it had; other options of it make no difference.
    """
    if result.path is not None:
        return result
    now, stopped = perf_counter(), stop is not None and stop()
    over_time = now - begin >= limit
    ended = ""
    if result.status == "timeout":
        if stopped:
            ended = f"planning was told to stop after {now - begin:.3g} s"
        elif over_time:
            ended = f"the time limit of {limit:g} s is up"
        elif max_rounds is not None:
            ended = f"no path was found in {max_rounds} rounds of landmarks"
        else:
            ended = f"nothing is left to try after {now - begin:.3g} s of {limit:g} s"
    seconds = min(SHARE * limit, max(begin + limit - now, BEYOND * limit, LEAST), MOST_SECONDS)
    reasons = [text for text in (ended, result.reason) if text]
    if not stopped:
        reasons += _reasons(model, start, goal, result.status == "infeasible", now + seconds, stop)
    time = {**result.time, "total": (result.time["total"] or 0.0) + perf_counter() - now}
    return replace(result, reason="; ".join(reasons) or "it is proven that no path exists", time=time)


def _reasons(
    model: WorldModel,
    start: ArrayLike,
    goal: Ends,
    infeasible: bool,
    deadline: float,
    stop: Callable[[], bool] | None,
) -> Iterator[str]:
    """Yield what is wrong with each goal, and with the ways there, as far as there is time to tell."""
    state = se2.configurations(start)
    goals = goals_of(goal)
    # Zones that a path may leave close no way.
    zones = zones_at(model.checker, state)
    outside = model.without(zones) if zones else model

    def over() -> bool:
        late = perf_counter() > deadline or outside.bound.corners > MOST_CORNERS
        return late or (stop is not None and stop())

    several = () if goals is None else goals
    ends: Sequence[FloatArray | Goal]
    ends = [se2.configurations(goal)] if goals is None else several[:NAMED]  # type: ignore[arg-type]  # an array then
    found: dict[str, list[str]] = {}
    for i, each in enumerate(ends):
        name = "the goal" if len(several) <= 1 else f"goal {i}"
        free, end = _free_end(model, state, each, deadline) if isinstance(each, Goal) else (True, each)
        if not free:
            at = ", ".join(f"{v:.4g}" for v in end)
            nowhere = f"{name} is free nowhere" if infeasible else f"nothing free was found in {name}"
            yield f"{nowhere}: even at ({at}) the robot {model.checker.fault(end)}"
            continue
        if not over() and (fault := _way_fault(outside, state, end, infeasible, over, deadline)):
            found.setdefault(fault, []).append(name)
    for fault, names in found.items():
        yield fault if len(several) <= 1 else f"{', '.join(names)}: {fault}"
    if len(several) > NAMED:
        yield f"and so on for {len(several) - NAMED} goals more"


def _way_fault(
    model: WorldModel, start: FloatArray, end: FloatArray, infeasible: bool, over: Callable[[], bool], deadline: float
) -> str:
    """Return why there is no way to a valid configuration, in a clause; empty if that is not known."""
    found = reach(
        model.checker, start, end, infeasible=infeasible, over=over, seconds=max(0.0, deadline - perf_counter())
    )
    if found.why or over():
        return found.why
    ways = Ways(model.checker, start, end, over)
    return ways.touching() or narrow_clause(ways).removeprefix("; ")


def _free_end(model: WorldModel, start: FloatArray, goal: Goal, deadline: float) -> tuple[bool, FloatArray]:
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
    return False, model.checker.nearest_to_valid(states, lambda: perf_counter() > deadline)


# --- What the robot reaches from an end of a query: where it is shut in, and where the widest way is and how wide.

FEWEST, HALVINGS = 5, 12
"""Steps in which the width of the widest way is found, at least and at most."""

SAME_WIDTH = 1e-5
"""Metres: widths that differ by no more are the same, in contact with both sides no motion being certified."""

ENDS: Final = ("start", "goal")


class Reach(NamedTuple):
    """What is reached from an end of a query.

    Attributes:
        end: 0 if that is the start, 1 if it is the goal.
        proof: of that there is no path: by the disc inside the robot, by the robot's headings, or none.
        why: a clause that says so; empty if nothing is known to shut the robot in.
        part: where the disc's centre can be (shapely), relative to ``origin``; None where headings prove it.
        origin: shape (2,).
        gap: x, y and radius (metres) of the largest disc that gets to the other end, where it is narrowest; None if
            none does, or there was no time.
        cells: that hold what the robot reaches, where headings prove it.
    """

    end: int
    proof: Literal["disc", "headings"] | None
    why: str
    part: Any
    origin: FloatArray
    gap: list[float] | None = None
    cells: Enclosure | None = None


class Ways:
    """The ways of discs, of whatever radius, between where the centre of a robot's inscribed disc is at two ends.

    Args:
        checker: the world and the robot.
        start: configuration, shape (3,).
        goal: configuration, shape (3,).
        over: whether time is up.
    """

    def __init__(
        self, checker: StateChecker, start: FloatArray, goal: FloatArray, over: Callable[[], bool] = lambda: False
    ) -> None:
        self.checker, self.world, self.over = checker, checker.world, over
        disc = checker.robot.inscribed_disc
        self.radius, self.origin = disc.radius, local_origin(self.world)
        centers = [transform(np.asarray(q), np.asarray(disc.center)[None])[0] for q in (start, goal)]
        self._centers = [shapely.Point(center - self.origin) for center in centers]

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

    def widest(self, low: float, high: float) -> list[float] | None:
        """Return x, y and radius of the largest disc that gets from one end to the other, where it is narrowest.

        Of discs a little larger, what can be reached from the one and from the other nearly meets there. Nothing is in
        the list if no disc gets there; None is returned if time was up too soon to tell.

        Args:
            low: radius of a disc that gets there, metres; 0 if none is known.
            high: radius of one that does not.
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
        if low == 0.0 or not apart:
            return []
        return [round(float(v), 4) for v in (*self._between(apart), low)]

    def touching(self) -> str:
        """Return a clause that says where the robot fits only in contact with both sides; empty if it may be nowhere.

        No motion along which it touches is certified, for more than 1 mm from its ends.
        """
        half = 0.5 * narrowest_width(self.checker.robot)
        # A disc larger by what motions must keep.
        found = self.parts(half + MARGIN + CONTACT)
        if half - self.radius < SAME_WIDTH:
            away = [shapely.distance(*pair) for pair in zip(found, self._centers, strict=bool(found))]
            for end, distance in enumerate(away or (np.inf, np.inf)):
                if distance > END_ZONE:
                    return f"the robot fits only in contact at the {ENDS[end]}"
        if not found or found[0] is found[1]:
            return ""
        place = self._between(found)
        width = 2.0 * self._room(place)
        if abs(width - 2.0 * half) > SAME_WIDTH or not self.joined(half):
            return ""
        return (
            f"the robot fits only in contact: the widest way to the goal is {width:.6g} m wide {_at(place)}, and it "
            f"needs {2.0 * half:.6g} m{_kept(self.checker.robot)}; motions that touch both sides are not certified"
        )

    def _between(self, apart: list[Any]) -> FloatArray:
        """Return the place, shape (2,), where two polygons are nearest to each other."""
        return np.asarray(shapely.get_coordinates(shapely.shortest_line(*apart)).mean(axis=0) + self.origin)

    def _room(self, place: FloatArray) -> float:
        """Return how far (metres) a place, shape (2,), is from what is nearest."""
        xmin, ymin, xmax, ymax = self.world.bounds
        x, y = place.tolist()
        point = shapely.Point(x, y)
        gaps = [x - xmin, xmax - x, y - ymin, ymax - y]
        for shape in self.world.obstacles:
            if isinstance(shape, Disc):
                gaps.append(float(np.hypot(*(place - shape.center))) - shape.radius)
            else:
                gaps.append(float(shapely.distance(shape.polygon().shapely(), point)))
        if self.world.boundary is not None:
            gaps.append(float(shapely.distance(self.world.boundary.shapely().exterior, point)))
        return float(min(gaps))


def reach(
    checker: StateChecker,
    start: FloatArray,
    goal: FloatArray,
    *,
    infeasible: bool,
    over: Callable[[], bool],
    seconds: float,
) -> Reach:
    """Return what the disc inside the robot reaches from an end, or, if only headings prove it, what the robot does.

    Args:
        checker: the world and the robot.
        start: valid, shape (3,).
        goal: valid, shape (3,).
        infeasible: whether it is proven that there is no path; by which headings is found anew.
        over: asked whether to give up looking for that, or for the narrowest place.
        seconds: for a proof, at most.
    """
    ways = Ways(checker, start, goal, over)
    parts = ways.parts(ways.radius)
    if not parts:
        return Reach(0, None, "", None, ways.origin)
    if parts[0] is not parts[1]:
        end = int(np.argmin(shapely.area(parts)))
        gap = ways.widest(0.0, ways.radius)
        return Reach(end, "disc", _disc_clause(end, gap, ways), parts[end], ways.origin, gap or None)
    proof = enclosure(checker, start, goal, seconds=seconds, stop=over) if infeasible else None
    if proof is None:
        return Reach(0, None, "", parts[0], ways.origin)
    why = (
        f"shut in at the {ENDS[proof.end]}: a disc inside the robot would get out, the robot does not, at any heading"
        f"{narrow_clause(ways)}"
    )
    return Reach(proof.end, "headings", why, None, ways.origin, cells=proof)


def narrow_clause(ways: Ways) -> str:
    """Return what to add where the widest way is less wide than the robot at its narrowest; empty if it is not."""
    width = narrowest_width(ways.checker.robot)
    if width - 2.0 * ways.radius < SAME_WIDTH or ways.over() or ways.joined(0.5 * width):
        return ""
    gap = ways.widest(ways.radius, 0.5 * width)
    if not gap:
        return ""
    return (
        f"; the widest way lets a disc of about {2.0 * gap[2]:.2f} m through {_at(gap)}, and the robot is "
        f"{width:.2f} m wide where it is narrowest{_kept(ways.checker.robot)}"
    )


def narrowest_width(robot: Robot) -> float:
    """Return the width (metres) of the narrowest strip that holds a robot, with its clearance.

    For one that is not convex, which may wind through narrower places, that of its inscribed disc.
    """
    outline = robot.outline
    hull = shapely.convex_hull(outline.shapely())
    if isinstance(robot.footprint, Disc) or hull.area > (1.0 + 1e-9) * outline.shapely().area:
        return 2.0 * robot.inscribed_disc.radius
    points = shapely.get_coordinates(hull)
    along = np.diff(points, axis=0)
    normals = np.column_stack([-along[:, 1], along[:, 0]]) / np.hypot(*along.T)[:, None]
    return float(np.ptp(points @ normals.T, axis=0).min()) + 2.0 * robot.clearance


def _disc_clause(end: int, gap: list[float] | None, ways: Ways) -> str:
    if gap is None:
        return f"shut in at the {ENDS[end]}: a disc inside the robot does not get out"
    if not gap:
        return f"shut in at the {ENDS[end]}: obstacles close every way to the {ENDS[1 - end]}"
    return (
        f"shut in at the {ENDS[end]}: the widest way to the {ENDS[1 - end]} lets a disc of about {2.0 * gap[2]:.2f} m "
        f"through {_at(gap)}, and the robot holds one of {2.0 * ways.radius:.2f} m{_kept(ways.checker.robot)}"
    )


def _at(place: FloatArray | list[float]) -> str:
    return f"at ({place[0]:.2f}, {place[1]:.2f})"


def _kept(robot: Robot) -> str:
    return ", with the clearance that it keeps" if robot.clearance > 0.0 else ""
