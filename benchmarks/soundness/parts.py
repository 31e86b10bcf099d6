"""The campaign's parts: each asks many questions of one kind, a chunk at a time, and judges the answers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.soundness.carving import carved_world, drive_along, random_drive
from benchmarks.soundness.cases import judge_path, judge_result, question
from benchmarks.soundness.reference import REFUSED, Reference, deepest, moves
from benchmarks.soundness.report import Report, kind_of
from benchmarks.soundness.scenes import SCALES, random_car, random_disc, random_robot, random_scene
from benchmarks.soundness.walls import ceiling_world, spiked_world
from benchmarks.soundness.zones import ROBOTS as LEAVING
from benchmarks.soundness.zones import corner_query, judge_leaving, leaving_scene
from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.motion import CurveMotion
from trailmark.planning import LandmarkPlanner
from trailmark.proofs import LowerBound
from trailmark.shapes import Disc, Rectangle
from trailmark.trajectories import CurvePath
from trailmark.trajectories.path import Path as Way
from trailmark.verify import check_path
from trailmark.world import Robot, World

__all__ = ["PARTS", "Part"]

FloatArray = NDArray[np.float64]
Rng = np.random.Generator

HALVINGS = 28
"""Times that the gap between an accepted and a refused configuration or motion is halved."""

AWAY = tuple(name for name in SCALES if name != "plain")


class Part(NamedTuple):
    """A part of the campaign.

    Attributes:
        run: asks and judges one chunk.
        counts: the count that is to reach ``target``.
        target: how many are judged in a full run.
    """

    run: Callable[[Rng, Report], None]
    counts: str
    target: int


def _uniform(world: World, n: int, rng: Rng, margin: float = 0.0) -> FloatArray:
    xmin, ymin, xmax, ymax = world.bounds
    q = rng.uniform((xmin - margin, ymin - margin, -math.pi), (xmax + margin, ymax + margin, math.pi), (n, 3))
    # Headings at which sines and cosines are special are no rarer than others in practice.
    special = rng.random(n) < 0.1
    q[special, 2] = rng.choice([math.pi, 0.0, math.pi / 2, -math.pi / 2, np.nextafter(-math.pi, 0.0)], special.sum())
    return q


def _barely(accepted: Callable[[FloatArray], Any], good: FloatArray, bad: FloatArray) -> FloatArray:
    """Return what is barely accepted on the way from accepted to refused rows, each of shape (n, k)."""
    low, high = np.zeros(len(good)), np.ones(len(good))
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        ok = np.asarray(accepted(good + middle[:, None] * (bad - good)))
        low, high = np.where(ok, middle, low), np.where(ok, high, middle)
    return np.asarray(good + low[:, None] * (bad - good))


def states(rng: Rng, report: Report, scale: str = "plain", n: int = 2000) -> None:
    """Configurations at random, and pushed to where they are barely valid or barely not."""
    for _ in range(4):
        world = random_scene(rng, scale)
        robot = world.robot
        assert robot is not None
        checker, reference = StateChecker(world, robot), Reference(world, robot)
        q = _uniform(world, n, rng, 0.5 * robot.circumradius)
        valid = np.asarray(checker.valid(q))
        if valid.any() and not valid.all():
            good = q[rng.choice(np.flatnonzero(valid), n)]
            bad = q[rng.choice(np.flatnonzero(~valid), n)]
            near = rng.random(n) < 0.5
            bad[near] = good[near] + (bad[near] - good[near]) * rng.uniform(0.0, 0.2, (int(near.sum()), 1))
            refused = ~np.asarray(checker.valid(bad))
            if refused.any():
                pushed = _barely(checker.valid, good[refused], bad[refused])
                q = np.concatenate([q, pushed])
                valid = np.concatenate([valid, np.asarray(checker.valid(pushed))])
                report.count("grazing states", len(pushed))
        report.count("states", len(q))
        wrong = np.zeros(len(q), bool)
        wrong[valid] = reference.collides(q[valid])
        for i in np.flatnonzero(wrong):
            complaint = f"valid although it overlaps by {reference.depth(q[i : i + 1])[0]:.3g} m"
            report.case("overlap", world, question("state", q[i : i + 1]), complaint)
        refused_ = np.flatnonzero(~valid)
        room = reference.clearance(q[refused_])
        for i in refused_[room > REFUSED + reference.allowed]:
            report.case("refusal", world, question("state", q[i : i + 1]), "not valid although there is room")


def motions(rng: Rng, report: Report, scale: str = "plain", n: int = 300) -> None:
    """Straight motions pushed until they are barely certified."""
    world = random_scene(rng, scale)
    robot = world.robot
    assert robot is not None
    checker, reference = StateChecker(world, robot), Reference(world, robot)
    pushed = _pushed(rng, world, checker.valid, lambda a, b: checker.motions_valid(a, b), n)
    if pushed is None:
        return
    a, b = pushed
    free = np.asarray(checker.motions_valid(a, b))
    a, b = a[free], b[free]
    report.count("grazing motions", len(a))
    turn = np.abs(np.angle(np.exp(1j * (b - a)[:, 2])))
    bounds = np.hypot(*(b - a)[:, :2].T) + reference.sweep * turn
    place = moves(a, b)
    worst, where = deepest(reference, place, bounds * (1.0 + 1e-9), 4)
    for i in np.flatnonzero(worst > reference.allowed):
        if reference.collides(place(np.array([i]), where[i : i + 1])).any():
            complaint = f"certified, but collides by {worst[i]:.3g} m at {where[i]!r}"
            report.case("motion", world, question("motion", np.array([a[i], b[i]])), complaint)


def curves(rng: Rng, report: Report, scale: str = "plain", n: int = 120) -> None:
    """Cars' curves pushed until they are barely certified."""
    world = random_scene(rng, scale, random_car)
    robot = world.robot
    assert robot is not None
    checker, reference = StateChecker(world, robot), Reference(world, robot)
    car = CurveMotion(checker)
    pushed = _pushed(rng, world, checker.valid, lambda a, b: car.motions_valid(a, b), n)
    if pushed is None:
        return
    free = np.asarray(car.motions_valid(*pushed))
    for a, b in zip(pushed[0][free], pushed[1][free], strict=True):
        report.count("grazing curves")
        way = CurvePath(np.array([a, b]), car.steering)
        complaint = judge_path(reference, robot, way.states[[0, -1]], way)
        if complaint is not None:
            report.case("curve", world, question("motion", np.array([a, b])), f"certified, but {complaint}")


def _pushed(
    rng: Rng,
    world: World,
    valid: Callable[[FloatArray], Any],
    certified: Callable[[FloatArray, FloatArray], Any],
    n: int,
) -> tuple[FloatArray, FloatArray] | None:
    """Return starts and ends, shapes (m, 3), of motions pushed until they are barely certified; None if none are."""
    robot = world.robot
    assert robot is not None
    a = _uniform(world, 40 * n, rng)
    a = a[np.asarray(valid(a))][: 6 * n]
    if len(a) == 0:
        return None
    reach = robot.circumradius * 10.0 ** rng.uniform(-1.5, 0.6, (len(a), 1))
    b = a + rng.normal(size=a.shape) * np.column_stack([reach, reach, rng.choice([0.0, 0.1, 1.0, 3.0], len(a))])
    both = np.column_stack([a, b])
    both[:, 3:] = _wrapped(both[:, 3:])
    both = both[np.asarray(certified(both[:, :3], both[:, 3:]))][:n]
    if len(both) == 0:
        return None
    shift = robot.circumradius * 10.0 ** rng.uniform(-2.0, 0.7, (len(both), 1)) * rng.normal(size=(len(both), 2))
    bad = both + np.column_stack([shift, np.zeros(len(both)), shift, np.zeros(len(both))])
    some = rng.random(len(both)) < 0.3
    bad[some, 3:5] += robot.circumradius * rng.normal(size=(int(some.sum()), 2))
    bad[some, 5] += rng.normal(size=int(some.sum()))

    def accepted(rows: FloatArray) -> NDArray[np.bool_]:
        return np.asarray(certified(_wrapped(rows[:, :3]), _wrapped(rows[:, 3:])))

    refused = ~accepted(bad)
    if not refused.any():
        return None
    found = _barely(accepted, both[refused], bad[refused])
    return _wrapped(found[:, :3]), _wrapped(found[:, 3:])


def _wrapped(rows: FloatArray) -> FloatArray:
    """Return configurations whose headings lie between minus and plus half a turn."""
    out = (rows[:, 2] > math.pi) | (rows[:, 2] <= -math.pi)
    if not out.any():
        return rows
    found = rows.copy()
    found[out, 2] = np.angle(np.exp(1j * rows[out, 2]))
    return found


def paths(rng: Rng, report: Report, scale: str = "plain", queries: int = 12) -> None:
    """Plans one by one and many at once, of robots that move every way and of cars."""
    car = rng.random() < 0.5
    world = random_scene(rng, scale, random_car if car else random_robot)
    robot = world.robot
    assert robot is not None
    seed = int(rng.integers(1000))
    planner = LandmarkPlanner(world, robot, seed=seed)
    reference = Reference(world, robot)
    q = _uniform(world, 400, rng)
    q = q[np.asarray(planner.checker.valid(q))]
    q = q[: len(q) // 2 * 2][: 4 * queries]
    if len(q) < 4:
        return
    seconds = float(rng.choice([0.1, 0.2] if car else [0.02, 0.05, 0.1]))
    alone, many = (q, q[:0]) if car else (q[:6], q[6:])
    for pair in alone.reshape(-1, 2, 3):
        asked = question("plan", pair, seconds=seconds, seed=seed)
        report.about_to_ask(world, asked)
        result = planner.plan(pair[0], pair[1], time_limit=seconds)
        _judged(report, world, robot, asked, pair, result, reference)
    if len(many):
        asked = question("many", many, seconds=seconds, seed=seed)
        report.about_to_ask(world, asked)
        for pair, result in zip(
            many.reshape(-1, 2, 3),
            planner.plan_many(many[::2], many[1::2], time_limit=seconds, workers=int(rng.integers(1, 4))),
            strict=True,
        ):
            _judged(report, world, robot, asked, pair, result, reference)


def clearances(rng: Rng, report: Report) -> None:
    """Least clearances along paths of all kinds of robots, most of which run along walls."""
    world = random_scene(rng, "plain", (random_disc, random_robot, random_robot, random_car)[int(rng.integers(4))])
    robot, wall = world.robot, Rectangle((10.0, rng.uniform(3.0, 17.0)), rng.uniform(6.0, 18.0), rng.uniform(0.05, 0.5))
    assert robot is not None
    if robot.turning_radius is None and rng.random() < 0.3:
        robot = robot.differential()
    world = replace(world, robot=robot, obstacles=(*world.obstacles, wall))
    q = _uniform(world, 400, rng)
    # Pairs of which most lead along the wall, in one heading.
    q[1::2, 1:] = np.where(rng.random((200, 1)) < 0.7, q[::2, 1:], q[1::2, 1:])
    q[::2, 2] = q[1::2, 2] = np.where(rng.random(200) < 0.5, 0.0, q[1::2, 2])
    free = np.asarray(StateChecker(world).valid(q)).reshape(-1, 2).all(axis=1)
    for pair in q.reshape(-1, 2, 3)[free][:10]:
        report.count("least clearances")
        report.ask(world, question("clearance", pair, seconds=0.05))


def _judged(
    report: Report, world: World, robot: Robot, asked: Any, pair: FloatArray, result: Any, reference: Reference
) -> None:
    report.count("plans")
    if result.path is not None:
        report.count("paths")
        report.count("paths of cars", robot.turning_radius is not None)
    if result.lower_bound is not None and result.cost is not None:
        report.count("bounds")
    complaint = judge_result(world, robot, pair, result, None, reference)
    if complaint is not None:
        report.case(f"path-{kind_of(complaint)}", world, asked, complaint)


def carved(rng: Rng, report: Report, scale: str = "plain") -> None:
    """Worlds with a way that is known: it must not be called infeasible, and no bound may lie above its cost."""
    known = None
    while known is None:
        if rng.random() < 0.3:
            known = ceiling_world(rng, scale)
        else:
            known = carved_world(rng, car=bool(rng.random() < 0.2), scale=scale)
    world, ends = known.world, known.way[[0, -1]]
    report.count("carved worlds")
    cost, seed = known.cost, int(rng.integers(1000))
    report.ask(world, question("bound", ends, cost=cost))
    report.count("bounds")
    seconds = float(rng.choice([0.05, 0.3, 1.0], p=[0.8, 0.15, 0.05]))
    report.ask(world, question("plan", ends, cost=cost, seconds=seconds, seed=seed))
    report.count("plans")
    if rng.random() < 0.5:
        report.ask(world, question("enclosed", ends, cost=cost, seconds=0.2))
        report.count("enclosures tried")


def bounds(rng: Rng, report: Report, scale: str | None = None) -> None:
    """Lower bounds beside the costs of paths and of their parts: walls uneven and spiked, cars in the open."""
    kind = rng.random()
    if kind < 0.1:
        _bounds_of_cars(rng, report)
        return
    if kind < 0.5:
        world, ends = spiked_world(rng)
        report.count("bounds")
        report.count("plans")
        report.ask(world, question("plan", ends, seconds=0.1, seed=0))
        return
    make = random_disc if rng.random() < 0.7 else random_robot
    world = random_scene(rng, scale or str(rng.choice(list(SCALES))), make)
    robot = world.robot
    assert robot is not None
    planner, bound = LandmarkPlanner(world, robot, seed=0, objective="length"), LowerBound(world, robot)
    q = _uniform(world, 200, rng)
    q = q[np.asarray(planner.checker.valid(q))]
    q = q[: len(q) // 2 * 2][:12]
    reference = Reference(world, robot)
    for pair in q.reshape(-1, 2, 3):
        asked = question("plan", pair, seconds=0.1)
        report.about_to_ask(world, asked)
        result = planner.plan(pair[0], pair[1], time_limit=0.1)
        _judged(report, world, robot, asked, pair, result, reference)
        if result.path is None:
            continue
        rows = result.path.states
        steps = np.hypot(*np.diff(rows[:, :2], axis=0).T) + 0.5 * np.abs(np.angle(np.exp(1j * np.diff(rows[:, 2]))))
        for _ in range(4):
            i, j = np.sort(rng.choice(len(rows), 2, replace=False))
            asked = question("bound", rows[[i, j]], cost=float(steps[i:j].sum()))
            report.about_to_ask(world, asked)
            claimed = bound.of(rows[i], rows[j]).cost
            report.count("bounds")
            if asked.cost is not None and claimed > asked.cost + 1e-9 * (1.0 + asked.cost):
                report.case("bound", world, asked, f"lower bound {claimed!r} above the cost {asked.cost!r}")


def _bounds_of_cars(rng: Rng, report: Report) -> None:
    """Drives in the open, single arcs among them, far from the origin."""
    _, origin = SCALES[str(rng.choice([name for name in SCALES if name not in ("1 mm", "100 km")]))]
    robot = random_car(rng)
    radius = robot.turning_radius
    assert radius is not None
    x, y = origin
    world = World("open", (x - 100.0, y - 100.0, x + 100.0, y + 100.0), (), robot)
    for _ in range(10):
        start = np.array([*rng.uniform(-50.0, 50.0, 2) + origin, rng.uniform(-math.pi, math.pi)])
        drive = random_drive(rng, radius, robot.reverse, int(rng.integers(1, 4)))
        if rng.random() < 0.5:
            drive = np.array([[float(rng.choice([-1.0, 1.0])), radius * float(rng.uniform(0.01, 3.0))]])
        ends = drive_along(start, drive, radius, np.inf)[[0, -1]]
        report.count("bounds")
        report.ask(world, question("bound", ends, cost=float(np.abs(drive[:, 1]).sum()) + 1e-6))


def angles(rng: Rng, report: Report, scale: str = "plain", n: int = 400) -> None:
    """Turns by half a turn, and some doubles more or less: certified must be the direction that is taken."""
    length = float(rng.uniform(0.5, 1.5))
    robot = Robot.polygon([(0.0, -0.05), (length, -0.05), (length, 0.05), (0.0, 0.05)])
    a = np.zeros((n, 3))
    a[:, 2] = np.where(rng.random(n) < 0.3, np.deg2rad(rng.integers(-180, 181, n)), rng.uniform(-math.pi, math.pi, n))
    edge = rng.random(n) < 0.2
    a[edge, 2] = rng.choice([math.pi, -math.pi, 0.0], int(edge.sum()))
    b = a.copy()
    b[:, 2] += np.where(rng.random(n) < 0.5, math.pi, -math.pi)
    for rows in (a, b):
        ulps = rng.integers(-4, 5, n) * (rng.random(n) < 0.5)
        rows[:, 2] += ulps * np.spacing(np.maximum(np.abs(rows[:, 2]), 0.1))
    b[:, :2] += rng.choice([0.0, 0.1], (n, 1)) * rng.normal(size=(n, 2))
    # Straight below or above where the arm is half-way: in the way of one direction only.
    side = float(rng.uniform(-math.pi, math.pi))
    world = World(
        "turn",
        (-3.0, -3.0, 3.0, 3.0),
        (Disc((0.7 * length * math.cos(side), 0.7 * length * math.sin(side)), 0.1),),
        robot,
    )
    checker, reference = StateChecker(world, robot), Reference(world, robot)
    a, b = se2.configurations(a), se2.configurations(b)
    free = np.asarray(checker.motions_valid(a, b))
    report.count("half turns", n)
    t = np.linspace(0.0, 1.0, 64)
    for i in np.flatnonzero(free):
        path = Way(np.array([a[i], b[i]]))
        for q in (path.at(t), path.resample(path.cost / 50.0).states, se2.interpolate(a[i], b[i], t)):
            if reference.collides(q).any():
                complaint = "certified, but collides as the path goes"
                report.case("half-turn", world, question("motion", np.array([a[i], b[i]])), complaint)
                break
    valid = np.flatnonzero(np.asarray(checker.valid(a)) & np.asarray(checker.valid(b)))[:2]
    for i in valid:
        report.count("plans")
        report.ask(world, question("plan", np.array([a[i], b[i]]), seconds=0.05))
    if len(valid):
        report.ask(world, question("many", np.array([a[valid[0]], b[valid[0]]]), seconds=0.05))


def scales(rng: Rng, report: Report) -> None:
    """The other parts in worlds of 1 mm and of 100 km, and far from the origin."""
    scale = AWAY[int(rng.integers(len(AWAY)))]
    states(rng, report, scale, 500)
    motions(rng, report, scale, 100)
    curves(rng, report, scale, 15)
    paths(rng, report, scale, 6)
    carved(rng, report, scale)
    report.count("scaled worlds")


def zones(rng: Rng, report: Report, n: int = 8) -> None:
    """Starts in one to three keep-out zones: no path comes back into one that it left, or gets deeper."""
    for _ in range(n):
        asked = leaving_scene(rng, LEAVING[str(rng.choice(sorted(LEAVING)))])
        if asked is None:
            continue
        ends = np.array([asked.start, asked.goal])
        case = question("plan", ends, seconds=float(rng.choice([0.05, 0.1, 0.2])))
        report.about_to_ask(asked.world, case)
        result = LandmarkPlanner(asked.world, seed=0).plan(ends[0], ends[1], time_limit=case.seconds)
        report.count("starts in zones")
        report.count("paths out", result.path is not None)
        complaint = None if result.path is None else judge_leaving(asked, result.path)
        if complaint is None and result.cost is not None and result.lower_bound > result.cost * (1.0 + 1e-9):  # type: ignore[operator]  # a path has one
            complaint = f"lower bound {result.lower_bound} above {result.cost}"
        if complaint is not None:
            report.case(kind_of(complaint), asked.world, case, complaint)


def touches(rng: Rng, report: Report, n: int = 30) -> None:
    """Motions past corners of one-way zones and obstacles, by 1e-9 to 1e-5 m: an audit finds all paths free."""
    for _ in range(n):
        world, ends = corner_query(rng)
        case = question("plan", ends, seconds=0.02)
        report.about_to_ask(world, case)
        report.count("touches")
        planner = LandmarkPlanner(world, seed=0)
        if not np.asarray(planner.checker.valid(ends)).all():
            continue
        result = planner.plan(ends[0], ends[1], time_limit=case.seconds)
        if result.path is not None and not (audit := check_path(world, None, result.path)).free:
            complaint = f"collides, says check_path: {audit.collisions}"
            report.case("collision", world, case, complaint)


PARTS = {
    "states": Part(states, "states", 1_000_000),
    "motions": Part(motions, "grazing motions", 100_000),
    "curves": Part(curves, "grazing curves", 10_000),
    "paths": Part(paths, "paths", 10_000),
    "carved": Part(carved, "carved worlds", 3_000),
    "bounds": Part(bounds, "bounds", 10_000),
    "angles": Part(angles, "half turns", 100_000),
    "scales": Part(scales, "scaled worlds", 300),
    "clearances": Part(clearances, "least clearances", 10_000),
    "zones": Part(zones, "starts in zones", 10_000),
    "touches": Part(touches, "touches", 10_000),
}
