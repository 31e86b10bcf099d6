"""World.edited: what edits make of a world, and what they refuse."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from trailmark.errors import WorldError
from trailmark.shapes import Disc, Polygon, Rectangle
from trailmark.world import World
from trailmark.world.estimates import ObstacleEstimate, RiskBound

A, B, C, D = (Disc((float(x), 1.0), 0.4) for x in range(1, 5))
BOUNDS = (0.0, 0.0, 20.0, 20.0)
WORLD = World("w", BOUNDS, (A, B, C, D), ids=("a", None, "c", None))
COVARIANCE = 0.01 * np.eye(2)


def test_obstacles_come_go_and_move() -> None:
    new, box = Disc((9, 9), 1), Rectangle((5, 5), 2, 1)
    world = WORLD.edited(add={"new": new}, remove=["a"], move={3: (1, 2)}, replace={"c": box})
    assert world.obstacles == (B, box, Disc((5, 3), 0.4), new)
    assert world.ids == (None, "c", None, "new")
    assert WORLD.obstacles == (A, B, C, D)
    assert world.obstacles[0] is B
    plain = WORLD.edited(add=[new])
    assert plain.obstacles == (A, B, C, D, new)
    assert plain.ids == ("a", None, "c", None, None)
    assert WORLD.edited(remove=[0, "c", 3]) == World("w", BOUNDS, (B,))


def test_turns_are_about_the_obstacles_own_centre() -> None:
    triangle = Polygon(np.array([[0, 0], [3, 0], [0, 3.0]]))
    world = World("w", BOUNDS, (Rectangle((5, 5), 2, 1, 0.1), triangle, Disc((9, 9), 1)))
    turned = world.edited(move=dict.fromkeys(range(3), (1.0, 0.0, math.pi / 2))).obstacles
    assert turned[0] == Rectangle((6, 5), 2, 1, 0.1 + math.pi / 2)
    assert turned[2] == Disc((10, 9), 1)
    np.testing.assert_allclose(turned[1].polygon().vertices, [[3, 0], [3, 3], [0, 0]], atol=1e-12)


def test_where_obstacles_are_grown_for_a_risk_no_estimate_stands_as_it_is() -> None:
    estimate = ObstacleEstimate(Rectangle((5, 5), 2, 1), COVARIANCE, share=1.0)
    grown = World("w", BOUNDS, (Rectangle((5, 5), 3, 2),), estimates=(estimate,), risk=RiskBound(0.9))
    assert grown.edited(move={0: (1, 0)}).obstacles == (Rectangle((6, 5), 3, 2),)
    for edit in ({"add": [estimate]}, {"replace": {0: estimate}}):
        with pytest.raises(WorldError, match="expected a shape, for this world's obstacles are grown for a risk"):
            grown.edited(**edit)
    with pytest.raises(WorldError, match="is grown for a risk is not turned"):
        grown.edited(move={0: (1, 0, 0.1)})


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
    with pytest.raises(WorldError, match=message) as caught:
        WORLD.edited(**edit)
    assert "\n" not in str(caught.value)
    assert before == WORLD
