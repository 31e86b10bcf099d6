"""The map of an exploration against shapely: what beams make of it, and the planner's world that follows it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
import shapely

from trailmark import Disc, Polygon, Rectangle, Robot, World
from trailmark.estimation.virtual_sensors import RayCaster, Scanner
from trailmark.exploration.cells import quarters
from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN, KnownMap
from trailmark.se2 import FloatArray
from trailmark.shapes import Shape

BOUNDS = (-1.0, 2.0, 4.0, 5.5)
ROOM = (0.0, 0.0, 8.0, 6.0)
CELL = 0.05
LASER = Scanner(720, 2.0 * math.pi, 6.0, sigma=0.0)
GAP = 2.0 * math.pi / 720


def room(*obstacles: Shape) -> World:
    return World("room", ROOM, obstacles)


def entered(
    world: World,
    poses: Sequence[Sequence[float]],
    scanner: Scanner = LASER,
    known: KnownMap | None = None,
    seed: int = 0,
) -> KnownMap:
    """Return a map into which scans from some poses went, by the ray caster's exact distances."""
    known = known or KnownMap(ROOM, CELL)
    known.noise = scanner.sigma
    caster, rng = RayCaster(world), np.random.default_rng(seed)
    for t, pose in enumerate(poses):
        known.add_scan(scanner.sweep(float(t), np.array(pose), caster, rng), np.array(pose), scanner.max_range)
    return known


def solid(world: World, kind: str = "") -> shapely.Geometry:
    """Return what a world's obstacles cover, those of one kind."""
    shapes = [s for s, name in zip(world.obstacles, world.ids, strict=True) if (name or "").startswith(kind)]
    return shapely.union_all([shape.polygon(1e-4).shapely() for shape in shapes])


def followed(known: KnownMap, world: World | None = None) -> World:
    return known.follow(world or World("known", known.bounds))


def line(a: tuple[float, float], b: tuple[float, float], count: int, heading: float = 0.0) -> FloatArray:
    return np.column_stack([np.linspace(a, b, count), np.full(count, heading)])


@pytest.mark.slow
def test_the_world_holds_exactly_what_is_not_free() -> None:
    rng = np.random.default_rng(0)
    known = KnownMap(BOUNDS, 0.1)
    world = World("hall", BOUNDS, robot=Robot.disc(0.2))
    for _ in range(4):
        state = known.state.copy()
        r, c = rng.integers(0, 30, 2)
        state[r : r + 20, c : c + 20] = rng.choice([UNKNOWN, FREE, OCCUPIED], size=state[r : r + 20, c : c + 20].shape)
        known.set_state(state)
        world = known.follow(world)
        for kind, name in ((UNKNOWN, "unknown"), (OCCUPIED, "occupied")):
            cells = known.centres(*np.nonzero(state == kind))
            region = shapely.union_all([shapely.box(*(xy - 0.05), *(xy + 0.05)) for xy in cells])
            covered = solid(world, name)
            assert covered.symmetric_difference(region).area < 1e-9
    assert known.revision == 4


THINGS = (
    Rectangle((3.013, 2.007), 0.6, 0.4, 0.4),
    Disc((5.5, 4.0), 0.45),
    Polygon(np.array([[6.0, 1.0], [7.0, 1.3], [6.4, 1.6], [6.9, 2.2], [5.9, 1.9]])),
    Rectangle((1.0, 4.6), 0.07, 1.3, -0.7),
)
PLACES = [*line((1.5, 1.0), (6.0, 3.2), 25, 0.3), *line((6.0, 3.2), (2.0, 4.4), 25, 2.0)]


@pytest.mark.slow
def test_without_noise_nothing_that_is_larger_than_the_gap_of_beams_is_taken_for_free() -> None:
    known = entered(room(*THINGS), PLACES)
    true = shapely.union_all([thing.polygon(1e-4).shapely() for thing in THINGS])
    open_space = shapely.difference(shapely.box(*ROOM), solid(followed(known)))
    # What a disc of three cells can get to; all of it was seen from at most 4 m.
    reached = open_space.buffer(-3 * CELL).buffer(2.99 * CELL)
    wrong = shapely.intersection(reached, true)
    assert wrong.area < 1e-3
    assert shapely.distance(shapely.points(shapely.get_coordinates(wrong)), true.boundary).max(initial=0.0) < 4.0 * GAP


@pytest.mark.slow
def test_surfaces_lie_where_they_were_met() -> None:
    world = room(*THINGS)
    known = entered(world, PLACES)
    true = shapely.union_all([thing.polygon(1e-4).shapely() for thing in THINGS])
    walls = shapely.union(true, shapely.box(*ROOM).exterior)
    corners = shapely.points(shapely.get_coordinates(solid(followed(known), "occupied")))
    away = shapely.distance(walls, corners)
    assert np.median(away) < CELL / 8.0
    assert np.quantile(away, 0.98) < CELL
    assert away.max() < 2.0 * CELL


@pytest.mark.slow
@pytest.mark.parametrize(("offset", "sigma"), [(0.0, 0.01), (0.013, 0.0), (0.03, 0.01)])
def test_a_door_is_as_wide_as_it_is(offset: float, sigma: float) -> None:
    width, wall = 0.9, 4.0 + offset
    low, high = 2.5 + offset, 2.5 + offset + width
    world = room(Rectangle((wall, 0.5 * low), 0.15, low), Rectangle((wall, 0.5 * (high + 6.0)), 0.15, 6.0 - high))
    scanner = Scanner(720, 2.0 * math.pi, 6.0, sigma=sigma)
    known = entered(world, [*line((1.0, 2.0), (6.0, 3.0), 60)], scanner)
    across = shapely.LineString([(wall, 1.0), (wall, 5.0)])
    free = shapely.difference(across, solid(followed(known)))
    passages = [part for part in shapely.get_parts(free) if part.length > 0.1]
    assert len(passages) == 1
    # As much is lost on each side as an end point errs, and as boxes are widened.
    assert width - 2.0 * (CELL / 8.0 + 0.01 + 4.0 * sigma) < passages[0].length < width + 2e-3 + 2.0 * sigma


NOISY = Scanner(360, 2.0 * math.pi, 6.0, sigma=0.01)
AHEAD = Scanner(180, math.pi, 6.0, sigma=0.01)
"""The half of it that looks ahead."""


def heights(world: World, axis: int, low: float, places: FloatArray) -> FloatArray:
    """Return where the surfaces of a map end on lines along an axis from ``low`` 0.6 m on, the higher ends."""
    occupied, ends = solid(world, "occupied"), []
    for at in places:
        line = [(low, at), (low + 0.6, at)] if axis == 0 else [(at, low), (at, low + 0.6)]
        ends.append(occupied.intersection(shapely.LineString(line)).bounds[2 + axis])
    return np.array(ends)


@pytest.mark.slow
@pytest.mark.parametrize(("cell", "offset"), [(0.04, 0.4), (0.065, 0.0), (0.1, 0.4)])
def test_a_thin_wall_seen_from_both_sides_grows_no_thicker_and_no_side_of_it_is_lost(
    cell: float, offset: float
) -> None:
    x, thick, along = 3.0 + offset * cell, 0.015, np.arange(2.4, 3.6, 0.013)
    world, known = room(Rectangle((x + 0.5 * thick, 3.0), thick, 2.0)), KnownMap(ROOM, cell)
    made = World("known", ROOM)
    for side in range(4):
        sign = -1.0 if side % 2 else 1.0
        heading = 0.0 if side % 2 else math.pi
        away = [(1.0 + 0.3 * math.sin(0.1 * k), 0.6 * math.cos(0.07 * k)) for k in range(60)]
        entered(world, [(x + sign * ahead, 3.0 + aside, heading) for ahead, aside in away], AHEAD, known, seed=side)
        made = followed(known, made)
        ahead = heights(made, 0, x - 0.1, along) - (x + thick)
        assert ahead.min() >= 0.0, "the surface lies no farther than it is, wherever it was seen last"
        # What readings of the other side reach through it, and a part of a cell to which it is widened.
        assert np.median(ahead) <= 3.5 * NOISY.sigma - thick + cell / known.parts


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cell", "high", "offset"), [(0.04, 0.02, 0.67), (0.065, 0.03, 0.33), (0.1, 0.05, 0.0), (0.1, 0.02, 0.33)]
)
def test_what_stands_out_of_a_wall_by_little_more_than_the_noise_is_not_averaged_away(
    cell: float, high: float, offset: float
) -> None:
    y = 2.0 + cell * offset
    world = room(Rectangle((3.0, y - 0.25), 4.0, 0.5), Rectangle((3.0, y + 0.5 * high), 0.12, high))
    places = [(3.0 + 1.2 * math.sin(0.05 * k), y + 1.0 + 0.4 * math.cos(0.031 * k)) for k in range(200)]
    known = entered(world, [(*place, -0.5 * math.pi) for place in places], AHEAD, KnownMap(ROOM, cell))
    made = followed(known)
    assert (heights(made, 1, y - 0.05, np.arange(2.945, 3.055, 0.007)) >= y + high).all()
    flat = heights(made, 1, y - 0.05, np.concatenate([np.arange(2.4, 2.8, 0.007), np.arange(3.2, 3.6, 0.007)]))
    assert (flat >= y).all()
    assert np.median(flat) <= y + 1.5 * NOISY.sigma + cell / known.parts


@pytest.mark.slow
@pytest.mark.parametrize("high", [0.025, 0.035])
def test_a_narrow_post_that_was_seen_from_near_is_kept_where_beams_pass_beside_it(high: float) -> None:
    world = room(Rectangle((3.0, 1.8), 4.0, 0.5), Rectangle((3.0, 2.05 + 0.5 * high), 0.02, high))
    known = entered(world, [*line((2.6, 2.85), (3.4, 2.9), 40)], NOISY, KnownMap(ROOM, 0.1))
    for x in (2.8, 2.9, 3.0, 3.1):
        # Beams lie 24 mm apart there.
        entered(world, [(x, 3.45, 0.0)] * 40, NOISY, known, seed=int(100 * x))
    assert (heights(followed(known), 1, 2.0, np.array([2.992, 3.0, 3.008])) >= 2.05 + high).all()


@pytest.mark.slow
def test_looks_from_afar_do_not_shut_a_passage_that_was_seen_from_near() -> None:
    # Between the ends of two thin walls there is a gap of 0.85 m; from afar beams lie 0.1 m apart there.
    world = room(Rectangle((4.0, 1.3), 0.2, 2.6), Rectangle((4.0, 4.725), 0.2, 2.55))
    near, afar = [*line((3.0, 3.0), (5.0, 3.05), 60)], [*line((0.5, 2.8), (1.0, 3.1), 60)]
    known = entered(world, near, NOISY, KnownMap(ROOM, 0.065))
    made = followed(known)
    for turn in range(3):
        entered(world, afar, NOISY, known, seed=turn)
        made = followed(known, made)
        occupied = solid(made, "occupied")
        # A part of a cell and a standard deviation and a half; at corners beams graze, and tell less.
        for x0, x1, lost in ((3.95, 4.05, 0.03), (3.8, 4.2, 0.06)):
            assert not occupied.intersects(shapely.box(x0, 2.6 + lost, x1, 3.45 - lost))


@pytest.mark.slow
def test_a_door_that_closes_and_opens_again_is_known_within_a_few_scans() -> None:
    walls = (Rectangle((4.0, 1.3), 0.2, 2.6), Rectangle((4.0, 4.7), 0.2, 2.6))
    opened, closed = room(*walls), room(*walls, Rectangle((4.0, 3.0), 0.1, 0.8))
    here = [(2.0, 3.0, 0.0)]
    middle = shapely.LineString([(3.5, 3.0), (4.5, 3.0)])
    known = entered(opened, here * 10)
    world = followed(known)
    assert not solid(world).intersects(middle)
    entered(closed, here, known=known)
    world = followed(known, world)
    assert solid(world).intersects(middle)
    entered(closed, here * 30, known=known)
    entered(opened, here * 3, known=known)
    assert not solid(followed(known, world)).intersects(middle)


@pytest.mark.slow
@pytest.mark.parametrize(("angle", "sigma"), [(0.0, 0.01), (0.35, 0.0), (0.35, 0.01), (0.8, 0.0)])
def test_beams_that_graze_a_wall_do_not_take_it_away(angle: float, sigma: float) -> None:
    along = np.array([math.cos(angle), math.sin(angle)])
    across = np.array([-along[1], along[0]])
    middle = np.array([4.0, 3.0])
    wall = Rectangle((float(middle[0]), float(middle[1])), 4.0, 0.2, angle)
    begin, end = (middle + s * along + 0.5 * across for s in (-1.8, 3.0 if angle < 0.5 else 2.2))
    scanner = Scanner(360, 2.0 * math.pi, 6.0, sigma=sigma)
    poses = list(line((float(begin[0]), float(begin[1])), (float(end[0]), float(end[1])), 50))
    known = entered(room(wall), [*poses, *([poses[-1]] * 30)], scanner)
    face = [middle + s * along + 0.1 * across for s in np.linspace(-1.7, 1.9, 200)]
    away = shapely.distance(solid(followed(known)), shapely.points(face))
    assert away.max() < CELL / 8.0 + 3.0 * sigma + 0.01


@pytest.mark.slow
def test_beams_in_front_of_a_slanted_wall_do_not_take_it_away() -> None:
    # Of the world `long`: they enter a cell of the wall in front of its surface and leave it sideways.
    bounds, (a, b) = (0.0, 0.0, 15.0, 20.0), np.array([[9.546, 12.251], [9.468, 11.59]])
    block = Polygon(np.array([(11.295, 11.784), (10.428, 12.36), (10.223, 12.404), a, b, (10.007, 10.54)]))
    scanner = Scanner(1000, 2.0 * math.pi, 15.0, sigma=0.0)
    drive = [*line((7.24, 8.3), (8.6, 9.1), 30, 0.3)]
    known = entered(World("block", bounds, (block,)), drive, scanner, KnownMap(bounds, CELL))
    face = shapely.points(a + np.linspace(0.0, 1.0, 150)[:, None] * (b - a))
    assert shapely.distance(solid(followed(known)), face).max() < 2e-3  # what a robot keeps away from it at least


def test_beams_that_meet_nothing_show_free_space_up_to_the_range_and_no_farther() -> None:
    known = entered(room(), [(4.0, 3.0, 0.0)], Scanner(720, math.pi, 2.0, sigma=0.0))
    away = known.centres(*np.nonzero(known.state == FREE)) - [4.0, 3.0]
    assert np.hypot(*away.T).max() <= 2.0 + CELL
    assert away[:, 0].min() > -CELL
    assert (known.state == FREE).sum() * known.cell**2 == pytest.approx(0.5 * math.pi * 4.0, rel=0.03)
    assert not (known.state == OCCUPIED).any()


@pytest.mark.slow
def test_what_a_scan_says_of_the_map() -> None:
    world, pose = room(*THINGS), np.array([1.5, 1.0, 0.3])
    known = entered(world, PLACES)
    scan = LASER.sweep(99.0, pose, RayCaster(world), np.random.default_rng(0))
    same = known.agreement(scan, pose, 6.0)
    assert same.is_sure
    assert same.against <= 5
    elsewhere = known.agreement(scan, np.array([5.0, 2.5, 2.0]), 6.0)
    assert elsewhere.is_strange
    assert elsewhere.through > 50
    assert elsewhere.new > 50
    nothing = known.agreement(scan._replace(ranges=np.full(720, np.inf)), pose, 6.0)
    assert nothing.is_strange


def test_cells_of_half_the_side_keep_what_the_robot_ran_into() -> None:
    known = entered(room(), [(4.0, 3.0, 0.0)])
    known.add_contact(np.array([[1.02, 2.03]]))
    finer = known.refined()
    assert finer.cell == known.cell / 2
    assert finer.noise == known.noise
    assert finer.bounds == known.bounds
    assert (finer.state == OCCUPIED).sum() == 4
    assert (finer.state == FREE).sum() == 0
    assert np.abs(finer.contacts - known.contacts).max() == pytest.approx(known.cell / 4)
    assert np.array_equal(quarters(np.arange(6).reshape(2, 3), (3, 5))[:, ::2], [[0, 1, 2], [0, 1, 2], [3, 4, 5]])
