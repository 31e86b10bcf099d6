"""Audits: where a path collides and with what, how near it comes, how long it is; and the repair of what collides."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark import se2
from trailmark.arguments import one_of
from trailmark.collision import StateChecker
from trailmark.curves import CurvePath
from trailmark.errors import ConfigurationError
from trailmark.path import Path
from trailmark.se2 import FloatArray
from trailmark.verify.motions import Motions, merged
from trailmark.verify.verifier import MISSED, Depths, Hit, Verifier
from trailmark.world import BOUNDS_LIMIT, Robot, World, keep_outs

__all__ = ["RISE", "Collision", "PathAudit", "PathAuditor", "Undrivable", "check_path", "repaired"]

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

RISE = 1e-4
"""Metres by which a robot on its way out may be deeper than it was before."""

LOOKS = 50_000
"""Depths computed at most to see that they never rise: an interval for which that is not enough counts as one."""

SAMPLES, PRECISION, EFFORT = 17, 1e-3, 300
"""Depths of an interval computed at first; share of the largest to which it is known; depths computed at most."""

MARGINS = (0.1, 0.5, 2.0, 8.0, np.inf)
"""Circumradii along the path, from what collides to where the plan begins and ends: the next one if there is no way."""

ROOM = 0.05
"""Inscribed radii of clearance at a plan's ends, where the path has as much: from contact there may be no way out."""

Plan = Callable[[FloatArray, FloatArray], Path | None]
"""Returns a certified path from a start to a goal, or None if it found none."""


@dataclass(frozen=True)
class Collision:
    """An interval of a path on which the robot collides with one obstacle.

    Attributes:
        begin: where it begins: metres along the path, by the length of its xy curve; known to 0.1 mm.
        end: where it ends, likewise.
        obstacle: the obstacle's id, its index if it has none, ``keep-out zone i``, ``one-way zone i``, ``bounds``
            or ``boundary``.
        depth: metres of the shortest translation that would take the robot out of it (for bounds and boundary: back
            inside; for a one-way zone its reference point), where that is largest, to a thousandth.
        motions: the same interval as indices of the path's motions and shares of them: 2.25 is a quarter into the
            third motion. While a robot turns in place, the length stays the same, and this does not.
    """

    begin: float
    end: float
    obstacle: str | int
    depth: float
    motions: tuple[float, float]


@dataclass(frozen=True)
class Undrivable:
    """A motion of a path that the robot's drive cannot make.

    Attributes:
        motion: its index: 0 is the first one.
        begin: where it begins: metres along the path, by the length of its xy curve; known to 0.1 mm.
        end: where it ends, likewise.
        why: ``sideways by 90 degrees``, ``backwards``, ``a turn in place`` or ``a turn of radius 1 m``.
    """

    motion: int
    begin: float
    end: float
    why: str


@dataclass(frozen=True)
class PathAudit:
    """What an audit of a path found.

    Attributes:
        path: what was audited; of a car's curve, straight motions that follow it within 5e-8 m.
        free: whether the robot overlaps no obstacle by more than 1e-7 m anywhere along the path, and stays inside.
        collisions: in their order along the path, by obstacle; empty if it is free.
        min_clearance: least clearance along the path, metres; found by exact distances, at most 5e-7 m above the true
            one; 0 if it collides, or leaves a keep-out zone.
        min_clearance_at: where, metres along the path's xy curve; where the first collision begins if it collides.
        min_clearance_state: configuration there (x, y, theta).
        length: of the xy curve, metres.
        rotation: Σ |Δθ|, radians.
        cost: Σ (‖Δxy‖ + 0.5·|Δθ|), metres; that of a robot with a turning radius is the length.
        lower_bound: proven lower bound on the cost of any path between the same ends; None if none was computed.
        max_curvature: largest curvature (1/metres) of a motion in which the robot moves: 2·sin(|Δθ|/2)/‖Δxy‖, that of
            the circle which both states lie on; infinite where it turns in place.
        direction_changes: how often a robot with a turning radius changes between forwards and backwards; else None.
        reverse_length: metres that it drives backwards.
        undrivable: the motions that a differential drive or a car cannot make, in their order; None of another robot.
            Such a path is ``free`` all the same where nothing is met.
    """

    path: Path = field(repr=False)
    free: bool
    collisions: tuple[Collision, ...]
    min_clearance: float
    min_clearance_at: float
    min_clearance_state: tuple[float, float, float]
    length: float
    rotation: float
    cost: float
    max_curvature: float
    lower_bound: float | None = None
    direction_changes: int | None = None
    reverse_length: float | None = None
    undrivable: tuple[Undrivable, ...] | None = None

    def to_dict(self, world: str) -> dict[str, Any]:
        """Return the record that ``check --json`` prints, made of plain numbers, strings and lists.

        An infinite curvature, which JSON cannot hold, is null.
        """
        car = {"direction_changes": self.direction_changes, "reverse_length": self.reverse_length}
        return {
            "world": world,
            "free": self.free,
            "collisions": [
                {"from": c.begin, "to": c.end, "obstacle": c.obstacle, "depth": c.depth} for c in self.collisions
            ],
            "min_clearance": self.min_clearance,
            "min_clearance_at": self.min_clearance_at,
            "length": self.length,
            "rotation": self.rotation,
            "cost": self.cost,
            "lower_bound": self.lower_bound,
            "max_curvature": self.max_curvature if self.max_curvature < float("inf") else None,
            **(car if self.direction_changes is not None else {}),
            **({} if self.undrivable is None else {"undrivable": [asdict(motion) for motion in self.undrivable]}),
        }


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


def _undrivable(states: FloatArray, robot: Robot) -> tuple[Undrivable, ...] | None:
    """Return the motions that a robot cannot make, which drives along its heading on straight lines and arcs.

    An arc's chord points half way between the headings at its ends. A car's states may lie on either side of where one
    arc becomes another.
    """
    if robot.drive == "omnidirectional":
        return None
    length, turned, ahead, beside = _chords(states)
    beside, radius, within = np.abs(beside), robot.turning_radius, DIGITS * (1.0 + length)
    curvature = np.inf if radius is None else 1.0 / radius
    bend = length * curvature if radius is not None else np.zeros(len(length))
    sideways = beside > within + np.where(bend < SMOOTH, 0.5 * bend * length, 0.0)
    backwards = (ahead < -within) & (not robot.reverse)
    tight = (length > 0.0) & (2.0 * np.sin(0.5 * turned) > np.maximum(length, within) * curvature + within)
    if radius is not None:
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


def _maneuvers(path: Path) -> dict[str, Any]:
    """Return how often a car changes its direction along a path, and metres driven backwards, by name."""
    if isinstance(path, CurvePath):
        return {"direction_changes": path.cusps, "reverse_length": path.reverse_length}
    _, _, ahead, _ = _chords(path.states)
    changes = np.count_nonzero(np.diff(np.sign(ahead[ahead != 0.0])))
    return {"direction_changes": int(changes), "reverse_length": float(np.maximum(-ahead, 0.0).sum())}


def _max_curvature(states: FloatArray) -> float:
    """Return the largest curvature (1/metres) of the circles that a path's motions are chords of."""
    length, turned, _, _ = _chords(states)
    turning = turned > STILL
    if (turning & (length <= STILL)).any():
        return np.inf
    return float((2.0 * np.sin(0.5 * turned[turning]) / length[turning]).max(initial=0.0))


def _chords(states: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return each motion's metres, radians turned, and metres ahead of and beside its middle heading, each (n,)."""
    move = se2.difference(states[:-1], states[1:])
    heading = states[:-1, 2] + 0.5 * move[:, 2]
    c, s = np.cos(heading), np.sin(heading)
    ahead, beside = c * move[:, 0] + s * move[:, 1], c * move[:, 1] - s * move[:, 0]
    return np.hypot(move[:, 0], move[:, 1]), np.abs(move[:, 2]), ahead, beside


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


# --- How deep the robot is along an interval of a path: nothing is sampled.


def deepest(depths: Depths, poses: Callable[[FloatArray], FloatArray], begin: float, end: float) -> float:
    """Return the largest depth on an interval of a path, by branch and bound to :data:`PRECISION`.

    Args:
        depths: of configurations (n, 3); changes by no more than what the robot's points move.
        poses: configurations at places on the path's scale (metres), which no point of the robot outruns.
        begin: place where the interval begins.
        end: where it ends.
    """
    places = np.linspace(begin, end, SAMPLES) if end > begin else np.array([begin])
    found = depths(poses(places))
    while 1 < len(places) < EFFORT:
        highest = 0.5 * (found[1:] + found[:-1] + np.diff(places))
        split = np.flatnonzero(highest > (1.0 + PRECISION) * found.max() + 1e-9)
        if len(split) == 0:
            break
        split = split[np.argsort(-highest[split])][: EFFORT // 8]
        places, found = _closer(places, found, split, depths, poses)
    return float(found.max())


def first_rise(
    depths: Depths, poses: Callable[[FloatArray], FloatArray], begin: float, end: float, rise: float
) -> float | None:
    """Return a place on an interval of a path before which depths are proven not to rise; None if that is so for all.

    Proven is that nowhere the depth is larger by more than ``rise`` (metres) than anywhere before. Other arguments are
    those of :func:`deepest`.
    """
    places = np.linspace(begin, end, SAMPLES) if end > begin else np.array([begin])
    found = depths(poses(places))
    while True:
        least = np.minimum.accumulate(found)
        # Between two places, depths change by no more than the path goes.
        most = 0.5 * (found[1:] + found[:-1] + np.diff(places)) - least[:-1]
        rises = found[1:] - least[:-1] > rise
        split = np.flatnonzero(rises | (most > rise))
        if rises.any() or (len(split) and len(places) > LOOKS):
            return float(places[split[0]])
        if len(split) == 0:
            return None
        places, found = _closer(places, found, split, depths, poses)


def _closer(
    places: FloatArray,
    found: FloatArray,
    split: NDArray[np.intp],
    depths: Depths,
    poses: Callable[[FloatArray], FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """Return places and depths with three more in each of the intervals to split, in order."""
    new = (places[split] + np.outer((0.25, 0.5, 0.75), np.diff(places)[split])).ravel()
    places, found = np.append(places, new), np.append(found, depths(poses(new)))
    order = np.argsort(places, kind="stable")
    return places[order], found[order]


# --- Repair.


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
    scale = Motions.of(audit.path, checker.robot.sweep_radius)
    broken = merged([scale.interval(collision.motions) for collision in audit.collisions])
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
            pieces.append(scale.states(resumed, begin)[:-1])
        pieces.append((detour.polyline(SAGITTA) if isinstance(detour, CurvePath) else detour).states)
        resumed, broken = end, broken[met:]
    if resumed < scale.total:
        pieces.append(scale.states(resumed, scale.total)[1:])
    found = Path(np.concatenate(pieces))
    return found if auditor.audit(found).free else None
