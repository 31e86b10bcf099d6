"""Random things from a seed. Only the uniform doubles of PCG64 are drawn, a stream that numpy keeps fixed."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from blocks import PI, poly
from trailmark import Polygon, World


class Dice:
    """Uniform numbers from a seed."""

    def __init__(self, seed: int) -> None:
        self._next = np.random.Generator(np.random.PCG64(seed)).random

    def __call__(self, low: float = 0.0, high: float = 1.0) -> float:
        """Return a number from low to high."""
        return low + (high - low) * float(self._next())

    def whole(self, low: int, high: int) -> int:
        """Return one of low, …, high."""
        return low + int(self() * (high - low + 1))

    def rock(self, x: float, y: float, radius: float, corners: int) -> Polygon:
        """Return a star-shaped polygon about x, y within the radius; from 4 corners on no angle reaches half a turn."""
        turns = [2 * PI * (i + 0.8 * self()) / corners for i in range(corners)]
        reach = [radius * self(0.6, 1.0) for _ in turns]
        return poly([(x + r * math.cos(t), y + r * math.sin(t)) for r, t in zip(reach, turns, strict=True)])

    def blob(self, x: float, y: float, a: float, b: float, corners: int, roughness: float) -> NDArray[np.float64]:
        """Return a smooth closed curve about an ellipse: its first harmonics with random phases."""
        angles = 2 * PI * np.arange(corners) / corners
        reach = np.ones(corners)
        for k in range(2, 7):
            reach += roughness / k * self(0.5, 1.0) * np.cos(k * angles + self(0, 2 * PI))
        return np.column_stack([x + a * reach * np.cos(angles), y + b * reach * np.sin(angles)])


class Scatter:
    """Random places that keep off the bounds, off the queries' ends and, by ``gap``, off one another.

    Every thing counts as its circumscribed disc, so starts and goals keep at least ``clearance`` about them.
    """

    def __init__(
        self, dice: Dice, world: World, clearance: float, gap: float | None = None,
        wanted: Callable[[float, float], bool] = lambda x, y: True,
    ) -> None:  # fmt: skip  # one parameter a line would say no more
        self._dice, self._bounds, self._gap, self._wanted = dice, world.bounds, gap, wanted
        reach = (world.robot.circumradius if world.robot else 0.0) + clearance
        self._taken = np.array([(*q[:2], reach) for each in world.queries for q in (each.start, each.goal)])

    def place(self, radius: float, tries: int = 2000) -> tuple[float, float] | None:
        """Return a free place for a disc of that radius, or None if all tries fail."""
        x0, y0, x1, y1 = self._bounds
        for _ in range(tries):
            x, y = self._dice(x0 + radius, x1 - radius), self._dice(y0 + radius, y1 - radius)
            away = np.hypot(self._taken[:, 0] - x, self._taken[:, 1] - y) - self._taken[:, 2]
            if self._wanted(x, y) and float(away.min()) >= radius:
                if self._gap is not None:
                    self._taken = np.vstack([self._taken, (x, y, radius + self._gap)])
                return x, y
        return None
