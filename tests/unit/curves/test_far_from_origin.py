"""Cars at map coordinates of 1e3 to 1e7 m: rounding there costs no circle, and curves still lead to their goals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.helpers.trials import few

from trailmark import se2
from trailmark.curves import Steering
from trailmark.trajectories import CurvePath

ORIGINS = [(0.0, 0.0), (1e3, -1e3), (5e5, 4.5e6), (-1e7, 3.0)]
PIECES = [(0,), (1,), (-1,), (0, 1), (0, -1), (1, 0), (-1, 0), (1, 0, 1), (1, 0, -1), (-1, 0, 1), (-1, 0, -1), (1, -1)]


def rounding(origin: tuple[float, float]) -> float:
    """Metres that a place may be off by after a dozen roundings."""
    return 12.0 * math.ulp(max(abs(v) for v in origin) + 100.0)


def driven(q: np.ndarray, sides: tuple[int, ...], ways: np.ndarray, radius: float) -> np.ndarray:
    """Return where pieces lead to, as a program would compute it in world coordinates, one after the other."""
    x, y, theta = q
    for side, way in zip(sides, ways, strict=True):
        if side == 0:
            x, y = x + way * math.cos(theta), y + way * math.sin(theta)
        else:
            turned = theta + side * way / radius
            x += side * radius * (math.sin(turned) - math.sin(theta))
            y -= side * radius * (math.cos(turned) - math.cos(theta))
            theta = turned
    return np.array([x, y, math.atan2(math.sin(theta), math.cos(theta))])


def curves(
    origin: tuple[float, float], radius: float, reverse: bool, n: int
) -> list[tuple[np.ndarray, np.ndarray, float, tuple[int, ...]]]:
    """Return starts, ends, lengths and sides of curves made of pieces, none longer than 1.4 radians or 30 m."""
    rng = np.random.default_rng(7)
    made = []
    for k in range(n):
        sides = PIECES[k % len(PIECES)]
        ways = np.array([rng.uniform(0.02, 30.0) if side == 0 else radius * rng.uniform(0.02, 1.4) for side in sides])
        if reverse and rng.random() < 0.5:
            ways = -ways
        a = np.array([*(origin + rng.uniform(-40.0, 40.0, 2)), rng.uniform(-math.pi, math.pi)])
        made.append((a, driven(a, sides, ways, radius), float(np.abs(ways).sum()), sides))
    return made


@pytest.mark.parametrize("reverse", [True, False], ids=["reeds-shepp", "dubins"])
@pytest.mark.parametrize("radius", [0.3, 1.0, 4.5])
@pytest.mark.parametrize("origin", ORIGINS)
def test_rounding_makes_no_curve_longer(origin: tuple[float, float], radius: float, reverse: bool) -> None:
    steering = Steering(radius, reverse)
    made = curves(origin, radius, reverse, few(1200, of=6))
    a, b = np.array([row[0] for row in made]), np.array([row[1] for row in made])
    longer = steering.lengths(a, b) - [row[2] for row in made]
    # Moving aside costs a car the square root of how far: where it has to, it does so by manoeuvres.
    assert longer.max() < 1e-6 * radius + 10.0 * rounding(origin), (longer.argmax(), longer.max())
    curve = steering.curves(a, b)
    ends = steering.states(a, b, curve.lengths[:, None])[:, 0]
    assert np.abs((ends - b)[:, :2]).max() < 1e-9 * radius + 2.0 * rounding(origin)
    assert np.abs(se2.difference(ends, b)[:, 2]).max() < 1e-9
    assert reverse or (curve.signed_lengths >= 0.0).all()
    for p, q, length, sides in made[: few(60, of=2)]:
        path = CurvePath(np.array([p, q]), steering)
        assert path.length < length + 1e-6 * radius + 10.0 * rounding(origin)
        # Beside two arcs that touch, words with cusps are as short; at 1e7 m they may be beside single arcs.
        assert path.cusps == 0 or sides == (1, -1) or abs(origin[0]) > 1e6
