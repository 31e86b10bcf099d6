"""States and motions that just collide, or are just free: shapely tells what is true of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from tests.helpers.oracles import Oracle, motion_states

from trailmark import PathAuditor, Robot, Steering, World
from trailmark.collision import StateChecker, kernels
from trailmark.formats.grid import CellObstacles
from trailmark.motion import CurveMotion
from trailmark.shapes import Disc, Polygon, Rectangle, Shape

FloatArray = np.ndarray[Any, np.dtype[np.float64]]

DEPTHS = (0.0, 1e-7, 1e-5, 1e-3, 3e-2)
"""How much further than the least overlap that counts (fractions of a step) a colliding state is moved."""

BAND = 1.5e-7
"""Metres of overlap that count as a collision: half as much again as what is allowed."""

CLEAR = 0.02
"""Metres that a motion keeps from everything if it has to be accepted."""


@dataclass
class Case:
    """One robot in one world.

    Attributes:
        name: for the report.
        world: obstacles and bounds.
        robot: footprint.
        cell: of the field, metres.
        hit: (n, 3) states that overlap something by more than BAND, or lie beyond the bounds; with the clearance that
            the robot keeps, as for all that follow.
        free: (n, 3) states that keep at least 1e-6 m away.
        clearances: (n,) of ``free``, metres; without the clearance that the robot keeps.
        bad_motions: (n, 2, 3): both ends are free, something between them is not.
        good_motions: (n, 2, 3) that keep CLEAR away.
        bad_curves: (n, 2, 3): likewise along the shortest curves of ``radius``.
        good_curves: (n, 2, 3).
        radius: turning radius, metres.
    """

    name: str
    world: World
    robot: Robot
    cell: float
    hit: FloatArray
    free: FloatArray
    clearances: FloatArray
    bad_motions: FloatArray
    good_motions: FloatArray
    bad_curves: FloatArray = field(default_factory=lambda: np.empty((0, 2, 3)))
    good_curves: FloatArray = field(default_factory=lambda: np.empty((0, 2, 3)))
    radius: float = 0.7


def _room(oracle: Oracle, q: FloatArray) -> FloatArray:
    """Return the distances to what blocks, beyond the clearance that the robot keeps."""
    return np.maximum(0.0, oracle.clearance(q) - oracle.kept)


def _polygon(outline: list[list[float]], *holes: list[list[float]]) -> Polygon:
    return Polygon(np.array(outline, dtype=np.float64), tuple(np.array(hole, dtype=np.float64) for hole in holes))


def _scenes() -> list[tuple[str, World, Robot, float]]:
    """Return name, world, robot and cell size of every scene."""
    room = (0.0, 0.0, 6.0, 5.0)
    hole = _polygon([[1, 1], [4.6, 0.8], [5, 4], [0.9, 4.2]], [[1.6, 1.5], [4.3, 1.4], [4.2, 3.6], [1.5, 3.5]])
    polygons: tuple[Shape, ...] = (
        Rectangle((1.5, 1.6), 1.1, 0.5, 0.4),
        _polygon([[3.0, 0.6], [4.4, 0.9], [3.6, 1.2], [4.5, 1.9], [3.1, 1.5]]),
        _polygon([[0.5, 3.2], [1.9, 3.0], [1.2, 3.6], [1.8, 4.4]]),
        Rectangle((2.9, 3.1), 0.02, 0.9, 0.2),
    )
    mixed = (*polygons, Disc((4.2, 3.4), 0.55))
    specks: tuple[Shape, ...] = tuple(
        Disc((x, y), 1e-3) if (i + j) % 2 else _polygon([[x, y], [x + 1e-3, y], [x, y + 1e-3]])
        for i, x in enumerate((0.9, 2.3, 3.7, 5.1))
        for j, y in enumerate((1.1, 2.5, 3.9))
    )
    boundary = _polygon(
        [[0.2, 0.3], [5.8, 0.1], [5.5, 2.4], [4.1, 2.5], [5.6, 2.9], [5.7, 4.9], [0.1, 4.7], [0.9, 2.2]]
    )
    rectangle = Robot.rectangle(0.7, 0.3)
    hook = Robot.polygon([[-0.1, -0.3], [0.8, -0.3], [0.8, -0.1], [0.1, 0], [0, 0.5]])
    # Far from its reference point: what mistakes where its discs lie, looks at quite another place.
    aside = Robot.polygon([[0.6, 0.9], [1.1, 0.9], [1.1, 1.3], [0.6, 1.3]])
    places = ((1.5, 1.5), (2.5, 1.5), (4.0, 3.0), (4.5, 1.0), (1.0, 4.0))
    squares: tuple[Shape, ...] = tuple(Rectangle((x, y), 1.0, 1.0) for x, y in places)
    frame = _polygon([[2, 2.5], [3, 2.5], [3, 4.5], [2, 4.5]], [[2.25, 2.75], [2.75, 2.75], [2.75, 4.25], [2.25, 4.25]])
    lattice = World("w", room, (*squares, frame))
    # Beyond the origin on both axes, with cells and robots of more than a metre: neither offset nor size is forgotten.
    large = tuple(Polygon(20.0 * s.polygon().vertices + (40.0, 30.0)) for s in polygons if not isinstance(s, Disc))
    yard = World("w", (40.0, 30.0, 160.0, 130.0), (*large, Disc((124.0, 98.0), 11.0)))
    # In the first and last rows and columns of cells, and just beyond them.
    edges = [(x, y) for x in (0.02, 0.47, 5.53, 5.98) for y in np.arange(0.5, 5.0, 0.9)]
    edges += [(x, y) for y in (0.02, 0.47, 4.53, 4.98) for x in np.arange(0.9, 5.4, 0.9)]
    rim = World("w", room, tuple(Rectangle((x, y), 0.02, 0.02) for x, y in edges))
    far = tuple(Polygon(np.add(s.polygon().vertices, (2e5, -1e5))) for s in polygons if not isinstance(s, Disc))
    distant: tuple[Shape, ...] = (*far, Disc((2e5 + 4.2, 3.4 - 1e5), 0.55))
    # So many discs above each other that cells within one of them list no other; small ones look out from under them.
    rng = np.random.default_rng(0)
    heap = [((x, y), r) for x, y, r in rng.uniform((2.4, 2.0, 0.7), (3.6, 3.0, 1.2), (150, 3))]
    heap += [((3.0 + 1.55 * math.cos(a), 2.5 + 1.5 * math.sin(a)), 0.2) for a in rng.uniform(0.0, 2.0 * math.pi, 20)]
    crowd = World("w", room, tuple(Disc(*disc) for disc in heap))
    # A robot that fits where a cell's corner looks out from under the disc that is said to cover the cell.
    bubbles = np.random.default_rng(1).uniform((0.8, 0.8, 0.3), (5.2, 4.2, 0.6), (600, 3))
    foam = World("w", room, tuple(Disc((x, y), r) for x, y, r in bubbles))
    # The same with coordinates of both signs and radii above a metre.
    suds = tuple(Disc((4.0 * x - 12.0, 4.0 * y - 10.0), 4.0 * r) for x, y, r in bubbles)
    around = World("w", (-12.0, -10.0, 12.0, 10.0), suds)
    occupied = rng.random((10, 12)) < 0.12
    occupied[2:8, 4], occupied[7, 4:9] = True, True
    cells = World("w", room, CellObstacles(occupied, 0.5).as_tuple())
    return [
        ("mixed, rectangle", World("w", room, mixed), rectangle, 0.11),
        ("mixed, disc", World("w", room, mixed), Robot.disc(0.21), 0.13),
        ("mixed, hook, large cells", World("w", room, mixed), hook, 0.9),
        ("hole, hook", World("w", room, (hole,)), hook, 0.17),
        ("boundary, rectangle", World("w", room, (mixed[0], mixed[-1]), boundary=boundary), rectangle, 0.23),
        ("specks, rectangle", World("w", room, specks), Robot.rectangle(1.1, 0.8), 0.19),
        ("specks, disc", World("w", room, specks), Robot.disc(0.5), 0.31),
        ("specks, aside", World("w", room, specks), aside, 0.05),
        ("mixed, aside", World("w", room, mixed), aside, 0.07),
        ("lattice, square", lattice, Robot.rectangle(0.25, 0.25), 0.25),
        ("lattice, disc", lattice, Robot.disc(0.125), 0.125),
        ("large, rectangle", yard, Robot.rectangle(14.0, 6.0), 2.2),
        ("large, disc", yard, Robot.disc(4.2), 2.6),
        ("rim, rectangle", rim, Robot.rectangle(0.3, 0.15), 0.05),
        ("rim, small, large cells", rim, Robot.rectangle(0.1, 0.06), 0.45),
        ("far away, hook", World("w", (2e5, -1e5, 2e5 + 6, 5 - 1e5), distant), hook, 0.21),
        ("crowded, rectangle", crowd, rectangle, 0.2),
        ("crowded, disc", crowd, Robot.disc(0.21), 0.26),
        ("crowded, tiny disc", foam, Robot.disc(0.01), 0.25),
        ("crowded, around the origin", around, Robot.disc(0.04), 1.0),
        ("cells, hook", cells, Robot.polygon(0.5 * np.array([[-0.1, -0.3], [0.8, -0.3], [0.1, 0], [0, 0.5]])), 0.12),
        ("kept clearance, hook", World("w", room, mixed), hook.keeping(0.13), 0.11),
        ("kept clearance, aside", World("w", room, specks), aside.keeping(0.2), 0.16),
        ("kept clearance, disc", World("w", room, mixed), Robot.disc(0.1).keeping(0.11), 0.13),
        # Less than what the core is eroded by.
        ("little clearance, rectangle", World("w", room, mixed), rectangle.keeping(2.5e-7), 0.11),
    ]


def cases(seed: int, size: int) -> list[Case]:
    """Return the cases, with ``size`` colliding motions in each, and other numbers in proportion."""
    rng = np.random.default_rng(seed)
    return [*(_case(*scene, rng, size) for scene in _scenes()), *_corners(rng, size)]


def _corners(rng: np.random.Generator, size: int) -> list[Case]:
    """Return corners that graze each other: what collides is about as short as the gap that an end's rule leaves open.

    A square on its tip drives past the tip of another, ``depth`` lower than would be free: they overlap while the tips
    are less than ``depth`` apart, by ``depth`` where they are above each other. In the middle of a motion every overlap
    above the tolerance counts, at its ends too.
    """
    n = 8 * size
    short = rng.uniform(0.05, 1.2, (6, n))
    slight = rng.uniform(1.6e-7, 4.5e-7, (3, n))
    deeper = 10.0 ** rng.uniform(-6.15, -4.5, (2, n))
    close = deeper * rng.uniform(1.02, 3.0, (2, n)) + 1e-7
    # Within END_ZONE of an end, but not at it.
    beside = 10.0 ** rng.uniform(-5.0, -3.1, (2, n))
    near = _corner_case(
        "corners",
        0.11,
        4.0,
        depth=np.concatenate([*slight, *deeper]),
        before=np.concatenate([short[0], beside[0], short[1], close[0], short[2]]),
        after=np.concatenate([short[3], short[4], beside[1], short[5], close[1]]),
    )
    # Long motions: a share of their length is no distance.
    far = rng.uniform(20.0, 45.0, (2, n))
    deep = 10.0 ** rng.uniform(-5.0, -3.5, (2, n))
    close = deep * rng.uniform(1.02, 3.0, (2, n))
    long = _corner_case(
        "corners, long motions",
        2.0,
        50.0,
        depth=np.concatenate([*deep]),
        before=np.concatenate([close[0], far[0]]),
        after=np.concatenate([far[1], close[1]]),
    )
    # A robot of a millimetre: to it a micrometre is much.
    tiny = rng.uniform(1e-4, 1e-3, (2, n))
    close = 10.0 ** rng.uniform(-7.5, -6.3, (2, n))
    small = _corner_case(
        "corners, a millimetre",
        1e-3,
        4e-3,
        depth=rng.uniform(1.6e-7, 4.5e-7, 2 * n),
        before=np.concatenate([close[0], tiny[0]]) + 5e-7,
        after=np.concatenate([tiny[1], close[1]]) + 5e-7,
        size=1e-3,
    )
    # The same beside its reference point, whose coordinates are no measure of its size.
    beside_it = _corner_case(
        "corners, a millimetre, aside",
        1e-3,
        4e-3,
        depth=rng.uniform(1.6e-7, 4.5e-7, 2 * n),
        before=np.concatenate([close[0], tiny[0]]) + 5e-7,
        after=np.concatenate([tiny[1], close[1]]) + 5e-7,
        size=1e-3,
        aside=2e-2,
    )
    return [near, long, small, beside_it]


def _corner_case(
    name: str,
    cell: float,
    reach: float,
    *,
    depth: FloatArray,
    before: FloatArray,
    after: FloatArray,
    size: float = 1.0,
    aside: float = 0.0,
) -> Case:
    """Return the case of motions along x that reach ``before`` and ``after`` (metres) beyond the tips' meeting.

    ``size`` (metres) is that of either square's diagonal, ``aside`` (metres) how far the robot lies to the right and
    above its reference point.
    """
    robot = Robot.polygon(size * np.array([[0.5, 0.0], [0.0, 0.5], [-0.5, 0.0], [0.0, -0.5]]) + aside)
    obstacle = _polygon((size * np.array([[0.5, 2.0], [0.0, 2.5], [-0.5, 2.0], [0.0, 1.5]])).tolist())
    world = World("w", (-reach, 0.0, reach, 5.0 * size), (obstacle,))
    y, heading = 3.0 * size - depth, np.zeros(len(depth))
    a, b = np.column_stack([-before, y, heading]), np.column_stack([after, y, heading])
    # Motions that begin or end in contact, as they may.
    gaps = np.geomspace(3e-7, 3e-6, 8)
    touching = np.column_stack([np.zeros(8), 3.0 * size + gaps, np.zeros(8)])
    away = touching + np.array([0.7 * size, 0.6 * size, 0.0 if aside else 0.3])
    a, b, touching, away = (q - (aside, aside, 0.0) for q in (a, b, touching, away))
    return Case(
        name,
        world,
        robot,
        cell,
        np.array([[-aside, 3.0 * size - 1e-6 - aside, 0.0]]),
        np.array([[-aside, 3.0 * size + 1e-4 - aside, 0.0]]),
        np.array([1e-4]),
        np.stack([a, b], axis=1),
        np.concatenate([np.stack([touching, away], axis=1), np.stack([away, touching], axis=1)]),
    )


def _case(name: str, world: World, robot: Robot, cell: float, rng: np.random.Generator, size: int) -> Case:
    oracle = Oracle(world, robot, BAND)
    low, high = np.array([*world.bounds[:2], -math.pi]), np.array([*world.bounds[2:], math.pi])
    q = rng.uniform(low, high, (400 * size, 3))
    collides, clearance = oracle.collides(q), _room(oracle, q)
    outside, inside = q[~collides & (clearance > 2e-6)], q[collides]
    beyond = rng.uniform(np.subtract(low, (3, 3, 0)), np.add(high, (3, 3, 0)), (8 * size, 3))
    hit = [inside[: 3 * size], beyond[oracle.collides(beyond)]]
    if name.startswith("lattice"):
        # Vertices, edges and centres of cells on the very same coordinates.
        x, y = (v.ravel() for v in np.meshgrid(np.arange(-1.0, 7.25, 0.25), np.arange(-1.0, 6.25, 0.25)))
        even = np.column_stack([x, y, np.zeros(len(x))])
        hit.append(even[oracle.collides(even)])
        outside = np.concatenate([even[~oracle.collides(even) & (_room(oracle, even) > 2e-6)], outside])
    # The last free and the first colliding state on the way from one to the other.
    pairs = 6 * size
    a, b = outside[rng.integers(0, len(outside), pairs)], inside[rng.integers(0, len(inside), pairs)]
    near = rng.random(pairs) < 0.5
    b[near] = a[near] + (b[near] - a[near]) * rng.uniform(0.0, 1.0, (near.sum(), 1))
    there = oracle.collides(b)
    a, b = a[there], b[there]
    low_t, high_t = np.zeros(len(a)), np.ones(len(a))
    for _ in range(48):
        middle = 0.5 * (low_t + high_t)
        into = oracle.collides(_between(a, b, middle))
        low_t, high_t = np.where(into, low_t, middle), np.where(into, middle, high_t)
    for depth in DEPTHS:
        moved = _between(a, b, np.minimum(1.0, high_t + depth))
        hit.append(moved[oracle.collides(moved)])
    graze = np.concatenate(hit[-len(DEPTHS) :])
    free = np.concatenate([outside[: 2 * size], _between(a, b, np.maximum(0.0, low_t - 2e-5))])
    clearances = _room(oracle, free)
    keep = ~oracle.collides(free) & (clearances > 1.1e-6)
    free, clearances = free[keep], clearances[keep]
    bad_motions = _bad_motions(oracle, graze, rng, size)
    good_motions = _good_motions(oracle, outside, rng, size // 2)
    clearances = clearances + robot.clearance
    case = Case(name, world, robot, cell, np.concatenate(hit), free, clearances, bad_motions, good_motions)
    # Radii smaller and larger than the robot.
    case.radius = float(rng.choice([0.15, 0.7, 2.0]))
    _add_curves(case, oracle, outside, rng, size // 2)
    return case


def _between(a: FloatArray, b: FloatArray, t: FloatArray) -> FloatArray:
    return np.asarray(a + t[:, None] * (b - a))


def _bad_motions(oracle: Oracle, graze: FloatArray, rng: np.random.Generator, size: int) -> FloatArray:
    """Return motions with free ends through states that just collide, most of them shallow and long or short."""
    middle = graze[rng.integers(0, len(graze), 60 * size)]
    way = rng.normal(size=middle.shape) * 10.0 ** rng.uniform(-2.5, 0.3, (len(middle), 1))
    way[:, 2] = np.clip(way[:, 2] * rng.integers(0, 2, len(way)), -1.2, 1.2)
    share = rng.uniform(0.05, 0.95, (len(middle), 1))
    a, b = middle - share * way, middle + (1.0 - share) * way
    for ends in (a, b):
        ends[:, 2] = np.remainder(ends[:, 2] + math.pi, 2.0 * math.pi) - math.pi
    fits = ~oracle.collides(a) & ~oracle.collides(b) & (np.minimum(_room(oracle, a), _room(oracle, b)) > 2e-7)
    a, b = a[fits], b[fits]
    # Seldom hit first: of those that are, little collides.
    share_hit = oracle.collides(motion_states(a, b, 60).reshape(-1, 3)).reshape(len(a), 60).mean(axis=1)
    order = np.argsort(share_hit, kind="stable")[: 3 * size]
    chosen = np.concatenate([order[:size], rng.permutation(order[size:])[: size // 2]])
    return np.stack([a[chosen], b[chosen]], axis=1)


def _good_motions(oracle: Oracle, outside: FloatArray, rng: np.random.Generator, size: int) -> FloatArray:
    a = outside[rng.integers(0, len(outside), 100 * size)]
    b = a + rng.normal(size=a.shape) * rng.uniform(0.02, 0.8, (len(a), 1))
    b[:, 2] = np.remainder(b[:, 2] + math.pi, 2.0 * math.pi) - math.pi
    states = motion_states(a, b, 50).reshape(-1, 3)
    clear = _room(oracle, states).reshape(len(a), 50).min(axis=1) > CLEAR
    return np.stack([a[clear], b[clear]], axis=1)[:size]


def _add_curves(case: Case, oracle: Oracle, outside: FloatArray, rng: np.random.Generator, size: int) -> None:
    """Add shortest curves: some that keep CLEAR away, some of which little collides."""
    a = outside[rng.integers(0, len(outside), 40 * size)]
    b = outside[rng.integers(0, len(outside), 40 * size)]
    near = np.hypot(*(b - a)[:, :2].T) < 2.5
    a, b = a[near][: 12 * size], b[near][: 12 * size]
    steering = Steering(case.radius)
    lengths = steering.lengths(a, b)
    states = steering.states(a, b, lengths[:, None] * np.linspace(0.0, 1.0, 150)).reshape(-1, 3)
    hit = oracle.collides(states).reshape(len(a), 150).mean(axis=1)
    clear = _room(oracle, states).reshape(len(a), 150).min(axis=1) > 2.0 * CLEAR
    some = np.flatnonzero(hit > 0.0)
    bad = some[np.argsort(hit[some])][:size]
    case.bad_curves = np.stack([a[bad], b[bad]], axis=1)
    case.good_curves = np.stack([a[clear], b[clear]], axis=1)[: max(2, size // 2)]


@pytest.fixture(scope="module")
def made() -> list[tuple[Case, StateChecker]]:
    return [(case, StateChecker(case.world, case.robot, cell=case.cell)) for case in cases(1, 2)]


@pytest.mark.slow
def test_what_just_collides_is_refused(made: list[tuple[Case, StateChecker]]) -> None:
    assert sum(len(case.hit) for case, _ in made) > 500
    assert sum(len(case.bad_motions) for case, _ in made) > 50
    assert sum(len(case.bad_curves) for case, _ in made) > 10
    for case, checker in made:
        assert not checker.valid(case.hit).any(), case.name
        assert not (kernels.field_states(checker.field, checker.footprint, case.hit) == kernels.FREE).any(), case.name
        assert checker.clearance(case.hit).max() <= case.robot.clearance + 1e-8, case.name
        if case.robot.clearance == 0.0:
            assert not any(PathAuditor(checker).audit(q[None]).free for q in case.hit[-5:]), case.name
        a, b = case.bad_motions[:, 0].copy(), case.bad_motions[:, 1].copy()
        assert not checker.motions_valid(a, b).any(), case.name
        assert not checker.motions_between_valid(a, b).any(), case.name
        assert not (checker.motions_by_field(a, b) == kernels.FREE).any(), case.name
        car = CurveMotion(checker, Steering(case.radius))
        curves = case.bad_curves[:, 0].copy(), case.bad_curves[:, 1].copy()
        assert not car.motions_between_valid(*curves).any(), case.name


@pytest.mark.slow
def test_what_is_just_free_is_accepted(made: list[tuple[Case, StateChecker]]) -> None:
    assert sum(len(case.free) for case, _ in made) > 200
    assert sum(len(case.good_motions) for case, _ in made) > 10
    for case, checker in made:
        assert checker.valid(case.free).all(), case.name
        assert np.abs(checker.clearance(case.free) - case.clearances).max() <= 1e-8, case.name
        assert all(PathAuditor(checker).audit(q[None]).free for q in case.free[-5:]), case.name
        known = kernels.field_states(checker.field, checker.footprint, case.free)
        assert not (known == kernels.BLOCKED).any(), case.name
        a, b = case.good_motions[:, 0].copy(), case.good_motions[:, 1].copy()
        assert checker.motions_valid(a, b).all(), case.name
        assert not (checker.motions_by_field(a, b) == kernels.BLOCKED).any(), case.name
        car = CurveMotion(checker, Steering(case.radius))
        curves = case.good_curves[:, 0].copy(), case.good_curves[:, 1].copy()
        assert car.motions_between_valid(*curves).all(), case.name
