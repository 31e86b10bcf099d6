"""PathAuditor: where a path collides and with what, how near it comes, how long it is; whoever planned it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from trailmark import se2
from trailmark.arguments import brief, one_of, real
from trailmark.audit.attribution import Attribution, merged, merged_intervals
from trailmark.audit.depth import Penetration, deepest, first_rise
from trailmark.audit.one_way import wrong_ways
from trailmark.audit.result import Collision, PathAudit, Undrivable
from trailmark.audit.scale import Scale
from trailmark.audit.verdict import colliding_parts
from trailmark.collision import StateChecker
from trailmark.collision.body import core_of, whole
from trailmark.collision.least_clearance import least_clearance
from trailmark.curves import CurvePath, Steering
from trailmark.errors import ConfigurationError, FormatError, TrailmarkError
from trailmark.formats.any_path import PathFile
from trailmark.keep_out import keep_outs
from trailmark.path import Path
from trailmark.robot import TURNING_LIMIT
from trailmark.se2 import FloatArray
from trailmark.world import BOUNDS_LIMIT, Robot, World

__all__ = ["PathAuditor", "check_path", "recorded_path", "repaired"]

SAGITTA = 5e-8
"""Metres that a car's arc may be off its chords: near their ends, certified curves may touch."""

WITHIN = 5e-7
"""Metres that the true least clearance may be less than the one found."""

STILL = 1e-9
"""Metres, and radians, below which a robot does not move, or turn: rounding has no curvature."""

DIGITS = 2e-3
"""Metres, and radians, that a motion may be off what a drive makes of it, and as much again for each metre: those of
files of few digits."""

SMOOTH = 0.25
"""Turning radii up to which a motion may be one piece of a car's curve, whose states are so far apart."""

REMEMBERED = 2
"""Auditors that :func:`check_path` keeps, so that one who asks for path after path builds none anew."""

_recent: list[tuple[World, PathAuditor]] = []


class PathAuditor:
    """Audits paths of one robot in one world: a fraction of a millisecond for a free path of 50 m.

    A path is free if nowhere along it the robot overlaps an obstacle or a keep-out zone, or reaches over bounds or
    boundary, by more than 1e-7 m: touching is allowed (:class:`trailmark.collision.StateChecker`). A path that starts
    in a keep-out zone may leave it, and then stays out. What travels through a one-way zone in a wrong direction counts
    as a collision with it. It is certified, not sampled: intervals are
    cleared by distances, and where the robot comes near to something, all events are found at which it may begin or
    cease to overlap it.

    Args:
        checker: for the world and the robot; that it keeps a clearance is left aside.
        rise: metres by which it may be deeper in a keep-out zone that it leaves than it was before: planners are
            stricter than an audit of anybody's path, which may leave by any way.
    """

    def __init__(self, checker: StateChecker, rise: float = np.inf) -> None:
        one_of(checker, StateChecker, "audit: checker:")
        if checker.robot.clearance > 0.0:
            checker = StateChecker(checker.world, checker.robot, clearance=0.0)
        self.checker, self._rise = checker, rise
        self._core, self._body = core_of(checker.robot), whole(checker.robot)
        self._attribution = Attribution(checker, self._core)
        self._keep_outs = keep_outs(checker.world)

    def audit(self, path: Path | ArrayLike) -> PathAudit:
        """Audit a path.

        Args:
            path: straight motions between states, shape (n, 3), n >= 1, metres and radians, or a Path; of a
                :class:`~trailmark.curves.CurvePath` the curves. At a single state the robot stands.

        Raises:
            ConfigurationError: another shape, values that are not finite, or positions beyond 1e7 m.
        """
        given = path if isinstance(path, Path) else Path(path)  # type: ignore[arg-type]  # it makes an array itself
        audited = given.polyline(SAGITTA) if isinstance(given, CurvePath) else given
        if len(audited) == 1:  # The robot stays where it is.
            audited = Path(np.repeat(audited.states, 2, axis=0))
        # A copy: read-only arrays would be another type to the kernels, and compiled for anew.
        states = np.array(audited.states)
        farthest = float(np.abs(states[:, :2]).max())
        if farthest > BOUNDS_LIMIT:
            raise ConfigurationError(f"path: expected x and y of at most {BOUNDS_LIMIT:g} m, got {farthest:g}")
        field, grid, footprint = self.checker.field, self.checker.grid, self.checker.footprint
        parts = colliding_parts(grid, field, footprint, self._core, states)
        scale = Scale(states, footprint.sweep_radius)
        if len(parts):
            found = self._attribution.collisions(scale, merged(parts, scale))
            clearance, place = 0.0, scale.interval(found[0].motions)[0]
            kept = (c if c.obstacle not in self._keep_outs else self._unless_it_leaves(c, scale) for c in found)
            collisions = tuple(c for c in kept if c is not None)
        else:
            collisions = ()
            clearance, motion, share = least_clearance(grid, field, footprint, self._body, states, WITHIN)
            place = float(scale.place(motion, share))
        if wrong := wrong_ways(self.checker.world.zones, scale, isinstance(given, CurvePath)):
            collisions = tuple(sorted([*collisions, *wrong], key=lambda c: (c.motions, str(c.obstacle))))
        x, y, theta = scale.poses(place)[0].tolist()
        return PathAudit(
            path=audited,
            free=not collisions,
            collisions=collisions,
            min_clearance=float(clearance),
            min_clearance_at=scale.length(place),
            min_clearance_state=(x, y, theta),
            length=given.length,
            rotation=given.rotation,
            cost=given.cost if self.checker.robot.turning_radius is None else given.length,
            max_curvature=_max_curvature(states),
            undrivable=_undrivable(states, self.checker.robot),
            **(_maneuvers(given) if self.checker.robot.turning_radius is not None else {}),
        )

    def _unless_it_leaves(self, found: Collision, scale: Scale) -> Collision | None:
        """Return a collision with a keep-out zone; None if the path starts in it and may leave it so."""
        if found.motions[0] > 0.0 or found.motions[1] == len(scale.states) - 1:
            return found
        if self._rise == np.inf:
            return None
        begin, end = scale.interval(found.motions)
        depths = Penetration(self.checker.robot, self._keep_outs[str(found.obstacle)]).at
        rises = first_rise(depths, scale.poses, begin, end, self._rise)
        if rises is None:
            return None
        motion, share = scale.motion(rises)
        depth = deepest(depths, scale.poses, rises, end)
        return replace(found, begin=scale.length(rises), motions=(motion + share, found.motions[1]), depth=depth)


def _maneuvers(path: Path) -> dict[str, Any]:
    """Return how often a car changes its direction along a path, and metres driven backwards, by name."""
    if isinstance(path, CurvePath):
        return {"direction_changes": path.cusps, "reverse_length": path.reverse_length}
    move = se2.difference(path.states[:-1], path.states[1:])
    heading = path.states[:-1, 2] + 0.5 * move[:, 2]
    ahead = np.cos(heading) * move[:, 0] + np.sin(heading) * move[:, 1]
    changes = np.count_nonzero(np.diff(np.sign(ahead[ahead != 0.0])))
    return {"direction_changes": int(changes), "reverse_length": float(np.maximum(-ahead, 0.0).sum())}


def _undrivable(states: se2.FloatArray, robot: Robot) -> tuple[Undrivable, ...] | None:
    """Return the motions that a robot cannot make, which drives along its heading on straight lines and arcs.

    An arc's chord points half way between the headings at its ends. A car's states may lie on either side of where one
    arc becomes another.
    """
    if robot.drive == "omnidirectional":
        return None
    moves = se2.difference(states[:-1], states[1:])
    length, turned = np.hypot(moves[:, 0], moves[:, 1]), np.abs(moves[:, 2])
    heading = states[:-1, 2] + 0.5 * moves[:, 2]
    ahead = np.cos(heading) * moves[:, 0] + np.sin(heading) * moves[:, 1]
    beside = np.abs(np.cos(heading) * moves[:, 1] - np.sin(heading) * moves[:, 0])
    within = DIGITS * (1.0 + length)
    curvature = np.inf if robot.turning_radius is None else 1.0 / robot.turning_radius
    bend = length * curvature if robot.turning_radius is not None else np.zeros(len(length))
    sideways = beside > within + np.where(bend < SMOOTH, 0.5 * bend * length, 0.0)
    backwards = (ahead < -within) & (not robot.reverse)
    tight = (length > 0.0) & (2.0 * np.sin(0.5 * turned) > np.maximum(length, within) * curvature + within)
    if robot.turning_radius is not None:
        tight |= (length <= within) & (turned > within * (1.0 + curvature))
    along = np.concatenate([[0.0], np.cumsum(length)])
    found = []
    for i in np.flatnonzero(sideways | backwards | tight).tolist():
        if sideways[i]:
            why = f"sideways by {math.degrees(math.atan2(beside[i], abs(ahead[i]))):.0f} degrees"
        elif backwards[i]:
            why = "backwards"
        elif length[i] <= within[i]:
            why = "a turn in place"
        else:
            why = f"a turn of radius {length[i] / (2.0 * math.sin(0.5 * turned[i])):.3g} m"
        found.append(Undrivable(i, float(along[i]), float(along[i + 1]), why))
    return tuple(found)


def check_path(world: World, robot: Robot | None, path: Path | ArrayLike) -> PathAudit:
    """Audit a path of a robot in a world, whoever planned it.

    Args:
        world: obstacles, bounds and boundary.
        robot: whose path it is; the world's own robot if None.
        path: states (n, 3), n >= 1, metres and radians, or a Path; see :meth:`PathAuditor.audit`.

    Raises:
        ConfigurationError: a path of another shape, values that are not finite, or positions beyond 1e7 m.
        WorldError: no world, or no robot.
    """
    bare = robot or world.robot
    if isinstance(bare, Robot):
        bare = bare.keeping(0.0)
    for known, auditor in _recent:
        if known is world and auditor.checker.robot == bare:
            return auditor.audit(path)
    auditor = PathAuditor(StateChecker(world, bare))
    _recent[:] = [(world, auditor), *_recent[: REMEMBERED - 1]]
    return auditor.audit(path)


def _max_curvature(states: se2.FloatArray) -> float:
    """Return the largest curvature (1/metres) of the circles that a path's motions are chords of."""
    moves = se2.difference(states[:-1], states[1:])
    length, turned = np.hypot(moves[:, 0], moves[:, 1]), np.abs(moves[:, 2])
    turning = turned > STILL
    if (turning & (length <= STILL)).any():
        return np.inf
    return float((2.0 * np.sin(0.5 * turned[turning]) / length[turning]).max(initial=0.0))


# --- A path file's content as the path to audit: the curves of a car that trailmark planned for, else its states.

SMALLEST_RADIUS = 1e-6
"""Metres: who follows a smaller turning radius turns in place, and its arcs would be more than can be audited."""


def recorded_path(found: PathFile, file: FilePath) -> Path:
    """Return what a path file describes: a :class:`~trailmark.curves.CurvePath` if it records curves, else its states.

    Curves count as long as the states beside them are theirs: who edits the states wants those.

    Raises:
        FormatError: curves that are none.
    """
    if found.curve is None:
        return found.path
    curve = found.curve if isinstance(found.curve, dict) else {}
    kind, radius, knots, places = (curve.get(key) for key in ("kind", "turning_radius", "knots", "places"))
    if kind not in ("dubins", "reeds-shepp"):
        raise FormatError(file, f"curve: kind: expected dubins or reeds-shepp, got {brief(kind)}")
    if not SMALLEST_RADIUS <= real(radius) <= TURNING_LIMIT:
        allowed = f"expected metres from {SMALLEST_RADIUS:g} to {TURNING_LIMIT:g}"
        raise FormatError(file, f"curve: turning radius: {allowed}, got {brief(radius)}")
    try:
        curves = CurvePath(knots, Steering(real(radius), reverse=kind == "reeds-shepp"), places)  # type: ignore[arg-type]  # checked
    except TrailmarkError as error:
        raise FormatError(file, f"curve: {error}") from None
    same = len(curves) == len(found.path) and np.allclose(curves.states, found.path.states, rtol=0.0, atol=1e-6)
    return curves if same else found.path


# --- Repair: the parts of a path that are free stay as they are, those that collide are planned anew.

MARGINS = (0.1, 0.5, 2.0, 8.0, np.inf)
"""Circumradii along the path, from what collides to where the plan begins and ends: the next one if there is no way."""

ROOM = 0.05
"""Inscribed radii of clearance at a plan's ends, where the path has as much: from contact there may be no way out."""

Plan = Callable[[FloatArray, FloatArray], Path | None]
"""Returns a certified path from a start to a goal, or None if it found none."""


def repaired(auditor: PathAuditor, audit: PathAudit, plan: Plan) -> Path | None:
    """Return the path with its colliding parts planned anew, certified as a whole; None if no way past was found.

    A plan leads from the last place before a colliding part where the robot stands free to the first one after it.

    Args:
        auditor: that the audit is by.
        audit: of the path.
        plan: makes the new parts.

    Raises:
        ConfigurationError: the path's start or goal collides, or is out of bounds.
    """
    if audit.free:
        return audit.path
    states, checker = np.array(audit.path.states), auditor.checker
    checker.require_valid(states[0], "start")
    checker.require_valid(states[-1], "goal")
    scale = Scale(states, checker.footprint.sweep_radius)
    broken = merged_intervals([scale.interval(collision.motions) for collision in audit.collisions])
    room = ROOM * checker.robot.inscribed_disc.radius

    def end_near(place: float, direction: float, margin: int, limit: float) -> float:
        """Return a place that far away from what collides, or farther, with room around the robot; else the limit."""
        for share in MARGINS[margin:]:
            found = place + direction * share * checker.robot.circumradius
            if direction * (limit - found) <= 0.0:
                break
            if checker.clearance(scale.poses(found)[0]) >= room:
                return found
        return limit

    pieces: list[FloatArray] = []
    resumed = 0.0
    while broken:
        for margin in range(len(MARGINS)):
            begin = end_near(broken[0][0], -1.0, margin, resumed)
            end = end_near(broken[0][1], 1.0, margin, scale.total)
            met = 1
            while met < len(broken) and broken[met][0] <= end:
                end = end_near(broken[met][1], 1.0, margin, scale.total)
                met += 1
            a, b = scale.poses([begin, end])
            detour = plan(a, b)
            if detour is not None:
                break
        else:
            return None
        if begin > resumed:
            pieces.append(scale.part(resumed, begin)[:-1])
        pieces.append((detour.polyline(SAGITTA) if isinstance(detour, CurvePath) else detour).states)
        resumed, broken = end, broken[met:]
    if resumed < scale.total:
        pieces.append(scale.part(resumed, scale.total)[1:])
    found = Path(np.concatenate(pieces))
    return found if auditor.audit(found).free else None
