"""Changes: the difference of two worlds, and applying it."""

from __future__ import annotations

import gc
import math
import pickle
import random
import weakref
from typing import Any

import numpy as np
import pytest
import shapely
from tests.helpers.trials import trials

from trailmark import Change, Changes, ShapeError, TrailmarkError, World, WorldError
from trailmark.shapes import Disc, Polygon, Rectangle, Shape
from trailmark.world.moving import DISC_ERROR, Moving

A, B, C, D = (Disc((float(x), 1.0), 0.4) for x in range(1, 5))
BOUNDS = (0.0, 0.0, 20.0, 20.0)
WORLD = World("w", BOUNDS, (A, B, C, D), ids=("a", None, "c", None))


def rebuilt(world: World) -> World:
    """Return an equal world that shares no object with it."""
    twin: World = pickle.loads(pickle.dumps(world))  # noqa: S301 # its own pickle
    return twin


def contents(world: World) -> list[Any]:
    """Return what is said of each obstacle, in an order that does not depend on theirs."""
    columns = ((column or (None,) * len(world.obstacles)) for column in (world.ids, world.estimates, world.moving))
    return sorted(map(repr, zip(world.obstacles, *columns, strict=True)))


@pytest.mark.slow
def test_the_changes_of_an_edit_are_remembered_and_no_world_is_kept_alive() -> None:
    world = rebuilt(WORLD)
    edited = world.edited(move={1: (0, 1)})
    (item,) = world.difference(edited).items
    assert (item.index_before, item.index_after, item.before) == (1, 1, B)  # not one removed and one added
    assert world.difference(edited) is world.difference(edited)
    gone = weakref.ref(world)
    del world, item
    gc.collect()
    assert gone() is None
    assert len(WORLD.difference(edited).items) == 2
    assert pickle.loads(pickle.dumps(edited)) == edited  # noqa: S301 # its own pickle


@pytest.mark.parametrize(
    ("items", "message"),
    [
        ([Change("a", B, None, 0, None)], "expected changes of this world, got one of another: -a at index 0"),
        ([Change(None, A, None, 0, None)], "expected changes of this world"),
        ([Change(None, A, None, 9, None)], "expected changes of this world, got one of another: -9 at index 9"),
        ([Change(None, None, A, None, 9)], r"expected changes with different indices below 5, got \[9\]"),
        ([Change(None, None, A, None, 1), Change(None, None, B, None, 1)], "different indices below 6"),
        ([Change("c", None, A, None, 4)], "expected each id once, got 'c' more than once"),
    ],
)
def test_changes_of_another_world_are_refused(items: list[Change], message: str) -> None:
    with pytest.raises(WorldError, match=message):
        WORLD.apply(Changes(tuple(items)))


@pytest.mark.slow
def test_random_edits_agree_with_lists() -> None:
    rng = random.Random(3)  # noqa: S311 # a test's
    world = World("w", BOUNDS)
    rows: list[tuple[str | None, Disc]] = []
    first, count = world, 0
    for _ in trials(300):
        picked = rng.sample(range(len(rows)), min(len(rows), rng.randrange(4)))
        verbs = {i: rng.choice(("remove", "move", "replace")) for i in picked}
        key: dict[int, Any] = {i: rows[i][0] if rows[i][0] and rng.random() < 0.5 else i for i in picked}
        new = [Disc((rng.uniform(0, 9), rng.uniform(0, 9)), 0.3) for _ in range(rng.randrange(4))]
        named = rng.random() < 0.5
        names = [f"n{count + k}" if named else None for k in range(len(new))]
        count += len(new)
        edited = world.edited(
            add=dict(zip(names, new, strict=True)) if named else new,
            remove=[key[i] for i in picked if verbs[i] == "remove"],
            move={key[i]: (1.0, 0.5) for i in picked if verbs[i] == "move"},
            replace={key[i]: A for i in picked if verbs[i] == "replace"},
        )
        for i in sorted(picked, reverse=True):
            name, disc = rows[i]
            if verbs[i] == "remove":
                del rows[i]
            else:
                moved = Disc((disc.center[0] + 1.0, disc.center[1] + 0.5), disc.radius)
                rows[i] = (name, A if verbs[i] == "replace" else moved)
        rows += zip(names, new, strict=True)
        assert edited.obstacles == tuple(disc for _, disc in rows)
        assert (edited.ids or (None,) * len(rows)) == tuple(name for name, _ in rows)
        assert edited == World("w", BOUNDS, edited.obstacles, ids=edited.ids)
        for before in (world, first, rebuilt(world)):
            assert contents(before.apply(before.difference(edited))) == contents(edited)
        if rng.random() < 0.1:
            first = edited
        world = edited
    assert len(rows) > 50


def test_turns_are_about_the_obstacles_own_centre() -> None:
    triangle = Polygon(np.array([[0, 0], [3, 0], [0, 3.0]]))
    world = World("w", BOUNDS, (Rectangle((5, 5), 2, 1, 0.1), triangle, Disc((9, 9), 1)))
    turned = world.edited(move=dict.fromkeys(range(3), (1.0, 0.0, math.pi / 2))).obstacles
    assert turned[0] == Rectangle((6, 5), 2, 1, 0.1 + math.pi / 2)
    assert turned[2] == Disc((10, 9), 1)
    np.testing.assert_allclose(turned[1].polygon().vertices, [[3, 0], [3, 3], [0, 0]], atol=1e-12)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        ({"remove": ["b"]}, r"edited: remove: expected a, c, got 'b'"),
        ({"remove": [4]}, "edited: remove: expected an id or an index from 0 to 3, got 4"),
        ({"remove": "a"}, "edited: remove: expected a sequence, got 'a'"),
        ({"remove": ["a"], "move": {"a": (1, 1)}}, "in one edit, got 'a' in remove and move"),
        ({"move": {"a": (1, math.nan)}}, r"expected two or three finite numbers"),
        ({"replace": {"a": "disc"}}, r"edited: replace\['a'\]: expected Disc or .*, got 'disc'"),
        ({"add": {"": A}}, "edited: add: expected ids that are texts, not empty, not bounds or boundary, got ''"),
        ({"add": {"a": A}}, "expected each id once, got 'a' more than once"),
    ],
)
def test_bad_edits_are_refused_in_one_line_and_change_nothing(edit: Any, message: str) -> None:
    before = World("w", BOUNDS, (A, B, C, D), ids=("a", None, "c", None))
    with pytest.raises(WorldError, match=message):
        WORLD.edited(**edit)
    assert before == WORLD


L_SHAPE = Polygon(np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 3], [0, 3.0]]))


FRAME = Polygon(np.array([[0, 0], [4, 0], [4, 4], [0, 4.0]]), (np.array([[1, 1], [3, 1], [3, 3], [1, 3.0]]),))


def covered(motion: Moving, steps: int = 150) -> shapely.Geometry:
    """Return the union of the obstacle's places at many moments, discs drawn from within."""
    places = []
    for time in np.linspace(0.0, motion.until, steps):
        shape = motion.at(time)
        if isinstance(shape, Disc):
            places.append(shapely.Point(shape.center).buffer(shape.radius, quad_segs=64))
        else:
            places.append(shape.polygon().shapely())
    return shapely.union_all(places)


@pytest.mark.slow
@pytest.mark.parametrize("velocity", [(1.0, 0.0), (-0.3, 0.8), (0.0, -2.0)])
@pytest.mark.parametrize("shape", [Rectangle((1, 2), 3, 1, 0.4), L_SHAPE, FRAME])
def test_the_region_swept_is_exact_for_polygons(shape: Shape, velocity: tuple[float, float]) -> None:
    motion = Moving(shape, velocity, 2.0)
    swept, true = motion.swept.polygon().shapely(), covered(motion)
    assert swept.buffer(1e-9).covers(true)
    # What stands between two moments of the sample is a sliver along edges that lie askew to the motion.
    step = math.hypot(*velocity) * 2.0 / 149
    assert swept.area - true.area < 0.6 * step * true.length
    assert true.buffer(step).covers(swept)


def test_a_disc_sweeps_a_capsule_at_most_one_per_cent_larger() -> None:
    motion = Moving(Disc((1.0, -2.0), 0.5), (3.0, 1.0), 2.0)
    swept = motion.swept.polygon().shapely()
    line = shapely.LineString([(1.0, -2.0), (7.0, 0.0)])
    assert swept.exterior.distance(line) >= 0.5 * (1 - 1e-12)
    assert swept.contains(line)
    assert max(line.distance(shapely.Point(p)) for p in swept.exterior.coords) <= 0.5 * (1 + DISC_ERROR) * (1 + 1e-12)


@pytest.mark.parametrize(
    ("shape", "velocity", "until", "error", "message"),
    [
        ("disc", (1, 0), 1.0, WorldError, "moving: shape: expected Disc or Rectangle or Polygon"),
        (Disc((0, 0), 1), (1, 0, 0), 1.0, WorldError, "velocity: expected two finite numbers vx, vy"),
        (Disc((0, 0), 1), (1, 0), 0.0, WorldError, "until: expected a finite number above 0, got 0.0 s"),
        (Disc((0, 0), 1), (1e9, 0), 1.0, ShapeError, "moving: the region swept"),
    ],
)
def test_bad_motions_are_refused_in_one_line(
    shape: Any, velocity: Any, until: Any, error: type[TrailmarkError], message: str
) -> None:
    with pytest.raises(error, match=message):
        Moving(shape, velocity, until)


def test_a_world_holds_the_region_that_moving_obstacles_sweep() -> None:
    motion = Moving(Rectangle((2, 2), 1, 1), (1.0, 0.0), 3.0)
    world = World("w", (0, 0, 9, 9), (Disc((7, 7), 1), motion))  # type: ignore[arg-type]  # what World takes apart
    assert world.obstacles[1] is motion.swept
    assert world.moving == (None, motion)
    renamed = world.with_robot(world.robot)
    assert renamed == world
    with pytest.raises(WorldError, match=r"moving\[1\]: expected the region that it sweeps in its place"):
        World("w", (0, 0, 9, 9), (Disc((7, 7), 1), Disc((1, 1), 1)), moving=(None, motion))
    with pytest.raises(WorldError, match="moving: expected one for each of 1 obstacles, or none, got 2"):
        World("w", (0, 0, 9, 9), (motion.swept,), moving=(None, motion))
