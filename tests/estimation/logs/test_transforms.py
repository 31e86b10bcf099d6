"""Frames and their places, against scipy's rotations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trailmark.estimation.logs.rosbag import Transforms, matrix


def test_a_chain_and_a_branch() -> None:
    rng = np.random.default_rng(0)
    shifts = rng.normal(size=(3, 3))
    turns = Rotation.random(3, rng=rng)
    frames = Transforms()
    for (parent, child), shift, turn in zip((("/a", "b"), ("b", "c"), ("a", "d")), shifts, turns, strict=True):
        # Any length of the quaternion means the same turn.
        frames.add(parent, child, matrix(tuple(shift), tuple(3.0 * turn.as_quat())))
    point = np.array([0.3, -0.2, 0.5])
    in_a = shifts[0] + turns[0].apply(shifts[1] + turns[1].apply(point))
    place = frames.between("a", "/c")
    assert place is not None
    assert (place @ [*point, 1.0])[:3] == pytest.approx(in_a)
    # From d over their common parent to c.
    place = frames.between("d", "c")
    assert place is not None
    assert (place @ [*point, 1.0])[:3] == pytest.approx(turns[2].inv().apply(in_a - shifts[2]))
    place = frames.between("x", "x")
    assert place is not None
    assert np.array_equal(place, np.eye(4))


def test_what_is_not_joined() -> None:
    frames = Transforms()
    frames.add("a", "b", np.eye(4))
    frames.add("c", "d", np.eye(4))
    assert frames.between("a", "d") is None
    frames.add("b", "a", np.eye(4))  # a circle: no tree, but no endless search either
    assert frames.between("a", "d") is None
    assert frames.between("a", "b") is not None


def test_the_first_place_stays() -> None:
    frames = Transforms()
    frames.add("a", "b", matrix((1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
    frames.add("a", "b", matrix((2.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
    place = frames.between("a", "b")
    assert place is not None
    assert place[0, 3] == 1.0
