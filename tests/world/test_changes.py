"""Changes: the difference of two worlds, and applying it."""

from __future__ import annotations

import gc
import pickle
import random
import weakref
from typing import Any

import pytest
from tests.helpers.trials import trials

from trailmark.errors import WorldError
from trailmark.shapes import Disc, Rectangle
from trailmark.world import World
from trailmark.world.changes import Change, Changes

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


def test_the_difference_says_what_came_went_and_moved() -> None:
    other = World("x", BOUNDS, (B, Disc((3.5, 1.0), 0.4), Rectangle((9, 9), 1, 1)), ids=(None, "c", "new"))
    changes = WORLD.difference(other)
    found = {(item.id, item.index_before, item.index_after): (item.before, item.after) for item in changes.items}
    assert found == {
        ("c", 2, 1): (C, other.obstacles[1]),
        ("a", 0, None): (A, None),
        (None, 3, None): (D, None),
        ("new", None, 2): (None, other.obstacles[2]),
    }
    assert repr(changes) == "Changes(~c, -a, -3, +new)"


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
            add=dict(zip(names, new, strict=True)) if named else new,  # type: ignore[arg-type]  # names are texts then
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
