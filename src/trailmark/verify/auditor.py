"""PathAuditor: where a path collides and with what, how near it comes, how long it is; whoever planned it."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from trailmark import se2
from trailmark.arguments import one_of
from trailmark.collision import StateChecker
from trailmark.curves import CurvePath
from trailmark.errors import ConfigurationError
from trailmark.path import Path
from trailmark.verify.depths import deepest, first_rise
from trailmark.verify.motions import Motions
from trailmark.verify.result import Collision, PathAudit, Undrivable
from trailmark.verify.verifier import MISSED, Depths, Hit, Verifier
from trailmark.world import BOUNDS_LIMIT, Robot, World, keep_outs

__all__ = ["PathAuditor", "check_path"]

SAGITTA = 5e-8
"""Metres that a car's arc may be off the straight motions that stand for it in what is reported."""

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
    """Audits paths of one robot in one world: a millisecond or two for a free path of 50 m.

    A path is free if nowhere along it the robot overlaps an obstacle or a keep-out zone, or reaches over bounds or
    boundary, by more than 1e-7 m: touching is allowed (:class:`trailmark.collision.StateChecker`). A path that starts
    in a keep-out zone may leave it, and then stays out. What travels through a one-way zone in a wrong direction counts
    as a collision with it. It is certified, not sampled (:mod:`trailmark.verify.verifier`). Where a collision begins
    and ends is known to 0.1 mm; of paths longer than 100 m to a millionth of their length, but 1 cm at most.

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
        self._verifier = Verifier(checker.world, checker.robot)
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
        farthest = float(np.abs(given.states[:, :2]).max())
        if farthest > BOUNDS_LIMIT:
            raise ConfigurationError(f"path: expected x and y of at most {BOUNDS_LIMIT:g} m, got {farthest:g}")
        motions = self._verifier.motions(given)
        if motions.off > MISSED and isinstance(given, CurvePath):
            motions = self._verifier.motions(given.polyline(SAGITTA))
        states, of, _ = motions.chords(SAGITTA)
        states[-1] = given.states[-1]
        audited, chords = Path(states), np.bincount(of)
        before = np.cumsum(chords) - chords

        def collision(begin: float, end: float, name: str | int, depths: Depths) -> Collision:
            (i, k), (since, until) = motions.motion([begin, end])
            span = float(before[i] + since * chords[i]), float(before[k] + until * chords[k])
            depth = deepest(depths, motions.poses, begin, end)
            return Collision(motions.length(begin), motions.length(end), name, depth, span)

        hits = self._verifier.hits(motions)
        clearance, place = (0.0, hits[0].begin) if hits else self._verifier.clearance(motions, WITHIN)
        hits = [kept for hit in hits if (kept := self._unless_it_leaves(hit, motions)) is not None]
        one_way = self._verifier.one_way
        for zone, begin, end, _ in one_way.wrong_ways(motions):
            hits.append(Hit(begin, end, f"one-way zone {zone}", partial(one_way.depths, zone)))
        collisions = sorted((collision(*hit) for hit in hits), key=lambda c: (c.motions, str(c.obstacle)))
        x, y, theta = motions.poses(place)[0].tolist()
        return PathAudit(
            path=audited,
            free=not collisions,
            collisions=tuple(collisions),
            min_clearance=clearance,
            min_clearance_at=motions.length(place),
            min_clearance_state=(x, y, theta),
            length=given.length,
            rotation=given.rotation,
            cost=given.cost if self.checker.robot.turning_radius is None else given.length,
            max_curvature=_max_curvature(audited.states),
            undrivable=_undrivable(audited.states, self.checker.robot),
            **(_maneuvers(given) if self.checker.robot.turning_radius is not None else {}),
        )

    def _unless_it_leaves(self, hit: Hit, motions: Motions) -> Hit | None:
        """Return a hit; None if it is of a keep-out zone that the path starts in and may leave so."""
        zone = self._keep_outs.get(str(hit.name))
        if zone is None or hit.begin > 0.0 or hit.end == motions.total:
            return hit
        if self._rise == np.inf:
            return None
        rises = first_rise(hit.depths, motions.poses, hit.begin, hit.end, self._rise)
        return None if rises is None else hit._replace(begin=rises)


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
