"""Numbers of lattice nodes: there and back, moves and their inverses, configurations spelled out by complex numbers."""

from __future__ import annotations

import cmath
import math
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.helpers.random_worlds import ROBOTS
from tests.support.trials import few

from trailmark.collision import StateChecker
from trailmark.planning.lattice.nodes import (
    BITS,
    MULTI_STEPS,
    ORIGIN,
    TURNS,
    Nodes,
    child_of,
    configuration,
    move_cost,
    parent_of,
    place,
    position,
)
from trailmark.world import Robot, World

FloatArray = NDArray[np.float64]

BOUNDS = (-4.0, 3.0, 8.0, 12.0)

DIRECTIONS = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)]
"""Of the moves with one stride, in their order: columns and rows."""


@lru_cache(maxsize=16)
def checker(name: str) -> StateChecker:
    return StateChecker(World("open", BOUNDS), ROBOTS[name])


def number(k: int, row: int, column: int) -> int:
    return (k << 2 * BITS) + (row << BITS) + column


def at(nodes: Nodes, node: int) -> FloatArray:
    q = np.full(3, np.nan)
    configuration(nodes, node, q)
    return q


starts = st.builds(
    lambda x, y, theta: np.array([x, y, theta]),
    st.floats(-1.0, 5.0),
    st.floats(6.0, 9.0),
    st.one_of(
        st.floats(-math.pi, math.pi, exclude_min=True), st.sampled_from([math.pi, -math.pi + 1e-9, 0.0, math.pi / 2])
    ),
)
lattices = st.builds(
    lambda name, start, size, headings: (checker(name), start, Nodes.around(checker(name), start, size, headings)),
    st.sampled_from(sorted(ROBOTS)),
    starts,
    st.floats(0.3, 4.0),
    st.sampled_from([1, 2, 3, 8, 16, 64]),
)


def some_node(nodes: Nodes, data: st.DataObject) -> tuple[int, int, int]:
    """A node's heading, row and column."""
    return (
        data.draw(st.integers(0, nodes.headings - 1)),
        data.draw(st.integers(0, nodes.rows - 1)),
        data.draw(st.integers(0, nodes.columns - 1)),
    )


@given(k=st.integers(0, 2**15 - 1), row=st.integers(0, 2**BITS - 1), column=st.integers(0, 2**BITS - 1))
def test_numbers_tell_where_nodes_are(k: int, row: int, column: int) -> None:
    assert place(number(k, row, column)) == (k, row, column)


@pytest.mark.slow
@given(lattice=lattices)
def test_positions_cover_the_bounds_and_the_start_is_one(lattice: tuple[StateChecker, FloatArray, Nodes]) -> None:
    _, start, nodes = lattice
    xmin, ymin, xmax, ymax = BOUNDS
    assert place(nodes.origin) == (0, nodes.below, nodes.left)
    assert at(nodes, nodes.origin) == pytest.approx(start, abs=1e-12)
    low, high = position(nodes, 0), position(nodes, number(0, nodes.rows - 1, nodes.columns - 1))
    # Within the bounds, and one more would not be.
    for least, most, begin, end in zip(low, high, (xmin, ymin), (xmax, ymax), strict=True):
        assert begin - 1e-9 <= least < begin + nodes.size + 1e-9
        assert end - nodes.size - 1e-9 < most <= end + 1e-9


@given(lattice=lattices, data=st.data())
def test_a_configuration_has_the_disc_at_its_position(
    lattice: tuple[StateChecker, FloatArray, Nodes], data: st.DataObject
) -> None:
    judged, start, nodes = lattice
    k, row, column = some_node(nodes, data)
    x, y, theta = at(nodes, number(k, row, column))
    centre = complex(*judged.robot.inscribed_disc.center)
    first = complex(start[0], start[1]) + centre * cmath.exp(1j * start[2])
    where = first + nodes.size * complex(column - nodes.left, row - nodes.below)
    assert position(nodes, number(k, row, column)) == pytest.approx((where.real, where.imag), abs=1e-9)
    assert abs(complex(x, y) + centre * cmath.exp(1j * theta) - where) < 1e-9
    assert -math.pi < theta <= math.pi
    # k headings on from the start's.
    assert abs(cmath.exp(1j * theta) - cmath.exp(1j * (start[2] + 2.0 * math.pi * k / nodes.headings))) < 1e-12


@pytest.mark.slow
@settings(max_examples=few(200))
@given(lattice=lattices, data=st.data())
def test_moves_lead_where_they_say_and_back(
    lattice: tuple[StateChecker, FloatArray, Nodes], data: st.DataObject
) -> None:
    _, _, nodes = lattice
    k, row, column = some_node(nodes, data)
    node, inside = number(k, row, column), 0
    for move in range(ORIGIN):
        if move < TURNS:
            stride, (right, up) = MULTI_STEPS[move // 8], DIRECTIONS[move % 8]
            expected = (k, row + stride * up, column + stride * right)
        else:
            expected = ((k + (1 if move == TURNS else -1)) % nodes.headings, row, column)
        led = child_of(nodes, node, move)
        if 0 <= expected[1] < nodes.rows and 0 <= expected[2] < nodes.columns:
            assert led == number(*expected)
            assert parent_of(nodes, led, move) == node
            inside += 1
        else:
            assert led == -1
        back = parent_of(nodes, node, move)
        assert back == -1 or child_of(nodes, back, move) == node
    # At least the turns.
    assert inside >= 2


@pytest.mark.parametrize("headings", [1, 2, 3, 16])
def test_turns_wrap(headings: int) -> None:
    nodes = Nodes.around(checker("L"), np.array([2.0, 7.0, 0.3]), 1.0, headings)
    for turn in (TURNS, TURNS + 1):
        node, seen = nodes.origin, []
        for _ in range(headings):
            seen.append(node)
            node = child_of(nodes, node, turn)
        assert node == nodes.origin
        assert len(set(seen)) == headings


@pytest.mark.slow
@settings(max_examples=few(100))
@given(start=starts, size=st.floats(0.3, 4.0), headings=st.sampled_from([2, 3, 8, 16, 64]), data=st.data())
def test_moves_cost_what_their_motions_do(start: FloatArray, size: float, headings: int, data: st.DataObject) -> None:
    # The disc at the reference point, so that turns lead nowhere else.
    robot = StateChecker(World("open", BOUNDS), Robot.disc(0.5))
    assert np.array_equal(robot.robot.inscribed_disc.center, (0.0, 0.0))
    nodes = Nodes.around(robot, start, size, headings)
    node = number(*some_node(nodes, data))
    for move in range(ORIGIN):
        other = child_of(nodes, node, move)
        if other >= 0:
            a, b = at(nodes, node), at(nodes, other)
            turned = abs(cmath.phase(cmath.exp(1j * (b[2] - a[2]))))
            assert move_cost(nodes, move) == pytest.approx(math.dist(a[:2], b[:2]) + 0.5 * turned, rel=1e-9)


def test_strides_double_and_the_start_is_no_move() -> None:
    assert MULTI_STEPS[0] == 1
    assert all(b == 2 * a for a, b in pairwise(MULTI_STEPS))
    assert 8 * len(MULTI_STEPS) == TURNS
    # A move plus 1, ORIGIN too, fits into a byte.
    assert TURNS + 2 == ORIGIN < 255
