"""Certified motions: what is accepted never collides, and what is clearly free is accepted."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark.collision import StateChecker
from trailmark.shapes import Polygon
from trailmark.world import Robot, World


def box(xmin: float, ymin: float, xmax: float, ymax: float) -> Polygon:
    return Polygon(np.array([[xmin, ymin], [xmax, ymin], [xmax, ymax], [xmin, ymax]]))


@pytest.mark.parametrize("gap", [0.02, 0.005])
@pytest.mark.parametrize("at", [3.0, 50.0, 93.0, 95.0, 96.5])
def test_a_tooth_in_a_long_tight_corridor_is_not_missed(gap: float, at: float) -> None:
    # So many gaps are open at once along the walls that the kernel's queue runs full: none may be lost.
    walls = (box(0, 0, 100, 4.5 - gap), box(0, 5.5 + gap, 100, 10))
    tooth = box(at, 5.0, at + 0.01, 5.5 + gap)
    checker = StateChecker(World("tooth", (0, 0, 100, 10), (*walls, tooth)), Robot.rectangle(1, 1))
    assert checker.valid([(1, 5, 0), (99, 5, 0)]).all()
    assert not checker.motion_valid((1, 5, 0), (99, 5, 0))
    assert not checker.motion_valid((99, 5, 0), (1, 5, 0))
