"""The map of an exploration against shapely: what beams make of it, and the planner's world that follows it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
import shapely

from trailmark import Disc, Polygon, Rectangle, Robot, World
from trailmark.estimation.virtual_sensors import RayCaster, Scanner
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


def solid(world: World) -> shapely.Geometry:
    """Return what a world's obstacles cover."""
    return shapely.union_all([shape.polygon(1e-4).shapely() for shape in world.obstacles])


def followed(known: KnownMap, world: World | None = None) -> World:
    return known.follow(world or World("known", known.bounds))


def line(a: tuple[float, float], b: tuple[float, float], count: int, heading: float = 0.0) -> FloatArray:
    return np.column_stack([np.linspace(a, b, count), np.full(count, heading)])


def test_the_world_holds_exactly_what_is_not_free() -> None:
    rng = np.random.default_rng(0)
    known = KnownMap(BOUNDS, 0.1)
    world = World("hall", BOUNDS, robot=Robot.disc(0.2))
    for _ in range(4):
        state = known.state.copy()
        r, c = rng.integers(0, 30, 2)
        state[r : r + 20, c : c + 20] = rng.choice([UNKNOWN, FREE, OCCUPIED], size=state[r : r + 20, c : c + 20].shape)
        revision = known.revision
        known.set_state(state)
        assert known.revision > revision
        world = known.follow(world)
        cells = known.centres(*np.nonzero(state != FREE))
        region = shapely.union_all([shapely.box(*(xy - 0.05), *(xy + 0.05)) for xy in cells])
        assert solid(world).symmetric_difference(region).area < 1e-9
    assert known.follow(world) is world


THINGS = (
    Rectangle((3.013, 2.007), 0.6, 0.4, 0.4),
    Disc((5.5, 4.0), 0.45),
    Polygon(np.array([[6.0, 1.0], [7.0, 1.3], [6.4, 1.6], [6.9, 2.2], [5.9, 1.9]])),
    Rectangle((1.0, 4.6), 0.07, 1.3, -0.7),
)
PLACES = [*line((1.5, 1.0), (6.0, 3.2), 25, 0.3), *line((6.0, 3.2), (2.0, 4.4), 25, 2.0)]


def test_without_noise_surfaces_are_occupied_and_nothing_larger_than_the_gap_of_beams_is_free() -> None:
    known = entered(room(*THINGS), PLACES)
    true = shapely.union_all([thing.polygon(1e-4).shapely() for thing in THINGS])
    open_space = shapely.difference(shapely.box(*ROOM), solid(followed(known)))
    # What a disc of three cells can get to; all of it was seen from at most 4 m.
    wrong = shapely.intersection(open_space.buffer(-3 * CELL).buffer(2.99 * CELL), true)
    assert wrong.area < 1e-3
    assert shapely.distance(shapely.points(shapely.get_coordinates(wrong)), true.boundary).max(initial=0.0) < 4.0 * GAP
    walls = shapely.union(true.boundary, shapely.box(*ROOM).exterior)
    away = shapely.distance(walls, shapely.points(known.centres(*np.nonzero(known.state == OCCUPIED))))
    assert np.quantile(away, 0.98) < 0.71 * CELL
    assert away.max() < 2.0 * CELL


@pytest.mark.parametrize(("offset", "sigma"), [(0.0, 0.01), (0.013, 0.0), (0.03, 0.01)])
def test_a_door_is_as_wide_as_it_is_but_for_two_cells(offset: float, sigma: float) -> None:
    width, wall = 0.9, 4.0 + offset
    low, high = 2.5 + offset, 2.5 + offset + width
    world = room(Rectangle((wall, 0.5 * low), 0.15, low), Rectangle((wall, 0.5 * (high + 6.0)), 0.15, 6.0 - high))
    scanner = Scanner(720, 2.0 * math.pi, 6.0, sigma=sigma)
    known = entered(world, [*line((1.0, 2.0), (6.0, 3.0), 60)], scanner)
    across = shapely.LineString([(wall, 1.0), (wall, 5.0)])
    free = shapely.difference(across, solid(followed(known)))
    passages = [part for part in shapely.get_parts(free) if part.length > 0.1]
    assert len(passages) == 1
    assert width - 2.0 * (CELL + 3.0 * sigma) < passages[0].length < width + 2e-3 + 2.0 * sigma


@pytest.mark.parametrize("sigma", [0.02, 0.04])
def test_walls_grow_no_thicker_by_noise_the_longer_they_are_seen(sigma: float) -> None:
    scanner, occupied = Scanner(360, 2.0 * math.pi, 6.0, sigma=sigma), list[int]()
    known = KnownMap(ROOM, CELL)
    for seed in range(4):
        entered(room(), [*line((2.0, 2.0), (6.0, 4.0), 60)], scanner, known, seed)
        occupied.append(int((known.state == OCCUPIED).sum()))
    assert occupied[-1] < 1.1 * occupied[0]
    assert occupied[-1] < (2.0 + 4.0 * sigma / CELL) * 2.0 * (8.0 + 6.0) / CELL


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
    assert away.max() < 3.0 * sigma + 0.01


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


def test_what_a_scan_says_of_the_map() -> None:
    world, pose = room(*THINGS), np.array([1.5, 1.0, 0.3])
    known = entered(world, PLACES)
    scan = LASER.sweep(99.0, pose, RayCaster(world), np.random.default_rng(0))
    same = known.agreement(scan, pose, 6.0)
    assert same.is_sure
    assert same.against <= 5
    elsewhere = known.agreement(scan, np.array([5.0, 2.5, 2.0]), 6.0)
    assert elsewhere.is_strange
    assert min(elsewhere.through, elsewhere.new) > 0.07 * elsewhere.beams
    nothing = known.agreement(scan._replace(ranges=np.full(720, np.inf)), pose, 6.0)
    assert nothing.is_strange


def test_what_the_robot_ran_into_stays_whatever_beams_tell() -> None:
    known = KnownMap(ROOM, CELL)
    assert known.add_contact(np.array([[4.32, 3.03]]))
    assert not known.add_contact(np.array([[4.32, 3.03]]))
    entered(room(), [(4.0, 3.0, 0.0)] * 50, known=known)
    known.clear()
    assert (known.state == OCCUPIED).sum() == 1
    assert np.abs(known.contacts - [4.32, 3.03]).max() <= 0.5 * CELL
