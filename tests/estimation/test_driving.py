"""Drives: the places reached, the velocities in between, and that a unicycle never slides sideways."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from trailmark.estimation.simulation import Drive

FloatArray = NDArray[np.float64]
places = st.floats(-20.0, 20.0)
headings = st.floats(-math.pi, math.pi, exclude_min=True)
states = st.lists(st.tuples(places, places, headings), min_size=1, max_size=6).map(np.array)


def turn(a: float, b: float) -> float:
    """The angle between two headings."""
    return abs(math.remainder(a - b, 2 * math.pi))


@pytest.mark.slow
@given(q=states, speed=st.floats(0.1, 5.0), rate=st.floats(0.1, 5.0), holonomic=st.booleans())
def test_each_configuration_is_reached_in_order(q: FloatArray, speed: float, rate: float, holonomic: bool) -> None:
    drive = Drive(q, speed, rate, holonomic=holonomic)
    reached = drive.poses(drive.times)
    at = 0
    for x, y, theta in q:
        while math.hypot(*(reached[at, :2] - (x, y))) > 1e-5 or turn(reached[at, 2], theta) > 1e-5:
            at += 1
            assert at < len(reached), (x, y, theta)
    # Before and after, the robot stands.
    assert np.array_equal(drive.poses([-1.0, drive.times[-1] + 1.0]), reached[[0, -1]])
    assert np.abs(drive.velocities([-1.0, drive.times[-1] + 1.0])).max() == 0.0


@pytest.mark.slow
@given(q=states, speed=st.floats(0.1, 5.0), rate=st.floats(0.1, 5.0))
def test_velocities_are_the_poses_derivative(q: FloatArray, speed: float, rate: float) -> None:
    drive = Drive(q, speed, rate)
    middle = 0.5 * (drive.times[1:] + drive.times[:-1])
    middle = middle[np.diff(drive.times) > 1e-3]
    h = 1e-5
    before, after = drive.poses(middle - h), drive.poses(middle + h)
    here = drive.poses(middle)
    v, omega = drive.velocities(middle).T
    assert (np.abs(v) <= speed * (1 + 1e-9)).all()
    assert (np.abs(omega) <= rate * (1 + 1e-9)).all()
    dx, dy = ((after - before)[:, :2] / (2 * h)).T
    assert np.abs(dx - v * np.cos(here[:, 2])).max(initial=0.0) < 1e-5
    assert np.abs(dy - v * np.sin(here[:, 2])).max(initial=0.0) < 1e-5
    dtheta = np.angle(np.exp(1j * (after[:, 2] - before[:, 2]))) / (2 * h)
    assert np.abs(dtheta - omega).max(initial=0.0) < 1e-5


def test_a_circle_is_driven_as_arcs() -> None:
    angle = np.linspace(0.0, 3.0, 40)
    circle = np.column_stack([5 * np.sin(angle), 5 - 5 * np.cos(angle), angle])
    drive = Drive(circle, 2.0, 10.0)
    assert len(drive.times) == 40
    assert drive.times[-1] == pytest.approx(15.0 / 2.0)
    poses = drive.poses(np.linspace(0.0, drive.times[-1], 500))
    assert np.abs(np.hypot(poses[:, 0], poses[:, 1] - 5.0) - 5.0).max() < 1e-9
    assert drive.velocities([1.0])[0] == pytest.approx([2.0, 0.4])
    back = Drive(circle[::-1], 2.0, 10.0)
    assert len(back.times) == 40
    assert back.velocities([1.0])[0] == pytest.approx([-2.0, -0.4])


@pytest.mark.parametrize("holonomic", [False, True])
def test_waypoints_are_passed_ahead(holonomic: bool) -> None:
    drive = Drive([[0, 0], [0, 3], [0, 3], [-4, 3]], 1.0, 1.0, holonomic=holonomic)
    assert drive.poses([0.0])[0] == pytest.approx([0, 0, math.pi / 2])
    assert drive.times == pytest.approx([0, 3, 3 + math.pi / 2, 7 + math.pi / 2])
    assert drive.poses([99.0])[0] == pytest.approx([-4, 3, math.pi])
