"""Where the robot can get to in the known map: certainly, and perhaps."""

# Tested by tests/exploration/test_survey.py.

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.field import distance_transform
from trailmark.exploration.known_map import FREE, KnownMap
from trailmark.robot import Robot

__all__ = ["CERTAIN", "NOWHERE", "PERHAPS", "passable"]

NOWHERE, PERHAPS, CERTAIN = 0, 1, 2
"""The robot's reference point cannot be in a cell; it may be, with some heading; it can be, with any heading."""


def passable(known: KnownMap, robot: Robot) -> NDArray[np.uint8]:
    """Return where the robot's reference point can be: NOWHERE, PERHAPS or CERTAIN, shape (rows, columns).

    NOWHERE is proven: the largest disc about the reference point inside the robot meets a cell that is not free, or the
    outside, wherever in the cell it is. CERTAIN is so as well: the disc around the robot is clear of all that, at the
    cell's centre and on the way to the centres of the eight cells around, if they are CERTAIN too.
    """
    blocked = np.pad(known.state != FREE, 1, constant_values=True)
    # To the nearest centre of a cell that is not free; the cell itself may be nearer by half its diagonal.
    distance = distance_transform(blocked, known.cell)[1:-1, 1:-1]
    half = 0.5 * sqrt(2.0) * known.cell
    inner, outer = robot.reference_radius + robot.clearance, robot.circumradius
    state = np.zeros(known.state.shape, np.uint8)
    state[(distance > 0.0) & (distance >= inner - half)] = PERHAPS
    state[distance >= outer + 2.0 * half] = CERTAIN
    return state
