"""World and Query: what they derive, and what they refuse."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from trailmark.errors import ConfigurationError, FormatError, WorldError
from trailmark.shapes import Disc, Polygon
from trailmark.world import BOUNDS_LIMIT, Query, Robot, World

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def test_a_querys_ends_are_wrapped_tuples() -> None:
    query = Query("q", (0, 0, 4.0), [1, 2, -math.pi])
    assert query.start == pytest.approx((0, 0, 4.0 - 2 * math.pi))
    assert query.goal == (1.0, 2.0, math.pi)
    assert isinstance(query.goal, tuple)


@pytest.mark.parametrize(
    ("end", "error"),
    [((0, 0), ConfigurationError), ((0, 0, math.nan), ConfigurationError), ([[0, 0, 0]], WorldError)],
)
def test_a_query_with_a_bad_end_is_refused(end: Any, error: type[Exception]) -> None:
    with pytest.raises(error, match="query 'door': goal"):
        Query("door", (0, 0, 0), end)
    with pytest.raises(error, match="query 'door': start"):
        Query("door", end, (0, 0, 0))


# --- World


@pytest.mark.parametrize(
    "bounds",
    [
        (0, 0, 1),
        (0, 0, 1, 1, 1),
        (0, 0, math.inf, 1),
        (0, math.nan, 1, 1),
        (0, 0, 2 * BOUNDS_LIMIT, 1),
        (0, 0, 10**400, 1),
        (1, 0, 1, 1),
        (0, 2, 1, 1),
        ("a", 0, 1, 1),
        None,
        7,
    ],
)
def test_bad_bounds_are_refused_in_one_line(bounds: Any) -> None:
    with pytest.raises(WorldError, match="bounds: expected") as caught:
        World("w", bounds)
    assert "\n" not in str(caught.value)


def test_a_boundary_has_no_holes() -> None:
    with pytest.raises(WorldError, match=r"boundary: expected a polygon without holes, got one with holes \(make"):
        World("w", (0, 0, 9, 9), boundary=Polygon(SQUARE * 9, (SQUARE + 1,)))


def test_queries_are_found_by_name() -> None:
    queries = (Query("door", (0, 0, 0), (1, 1, 0)), Query("desk", (0, 0, 0), (2, 2, 0)))
    world = World("office", (0, 0, 9, 9), queries=queries)
    assert world.query().name == "door"
    assert world.query("desk") is queries[1]
    with pytest.raises(WorldError, match=r"query: expected desk, door, got 'dor' \(did you mean 'door'\?\)"):
        world.query("dor")
    with pytest.raises(WorldError, match="holds no query"):
        World("empty", (0, 0, 1, 1)).query()
    with pytest.raises(WorldError, match="expected each name once, got 'door' more than once"):
        World("twice", (0, 0, 9, 9), queries=(*queries, queries[0]))


def test_a_world_is_a_value() -> None:
    world = World("w", (0, 0, 3, 4), [Disc((1, 1), 0.5)])  # type: ignore[arg-type]  # a list, as a reader builds it
    assert isinstance(world.obstacles, tuple)
    assert world.bounds == (0.0, 0.0, 3.0, 4.0)
    assert world.extent == 5.0
    other = world.with_robot(Robot.disc(0.1))
    assert other.robot == Robot.disc(0.1)
    assert world.robot is None
    assert other.obstacles is world.obstacles
    assert hash(other) == hash(world.with_robot(Robot.disc(0.1)))


def test_a_world_is_described_in_one_line() -> None:
    world = World("yard", (0.0, 0.0, 9.0, 5.5), (Disc((1.0, 1.0), 0.5),), Robot.disc(0.2))
    assert repr(world) == "World('yard', 9 x 5.5 m, 1 obstacles, robot disc 0.2 m, queries: none)"
    queries = tuple(Query(name, (1.0, 2.0, 0.0), (3.0, 2.0, 0.0)) for name in "abcdefg")
    assert repr(replace(world, queries=queries)).endswith("queries: a, b, c, d, e, …)")


def test_load_finds_shipped_worlds_by_name() -> None:
    assert World.load("office").name == "office"
    with pytest.raises(FormatError, match=r"^ofice: no such file or shipped world; .*'office'\?\)$"):
        World.load("ofice")
