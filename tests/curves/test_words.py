"""Words lead where they say: against numerical integration of the car's equations of motion."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.helpers.trials import trials

from trailmark import se2
from trailmark.curves.dubins import dubins_words
from trailmark.curves.reeds_shepp import reeds_shepp_words
from trailmark.curves.words import rounding, seen_from, unit_length, walk

WORDS = {"dubins": dubins_words, "reeds-shepp": reeds_shepp_words}


def integrated(q: np.ndarray, sides: np.ndarray, ways: np.ndarray, radius: float, steps: int = 400) -> np.ndarray:
    """Drive x' = cos θ, y' = sin θ, θ' = side / ρ over each piece by Runge and Kutta's classical method."""
    x, y, theta = (float(v) for v in q)
    for side, way in zip(sides, ways, strict=True):
        h, turn = way / steps, side / radius
        for _ in range(steps):
            middle, after = theta + 0.5 * h * turn, theta + h * turn
            x += h / 6.0 * (math.cos(theta) + 4.0 * math.cos(middle) + math.cos(after))
            y += h / 6.0 * (math.sin(theta) + 4.0 * math.sin(middle) + math.sin(after))
            theta = after
    return np.array([x, y, theta])


def words_to(kind: str, a: np.ndarray, b: np.ndarray, radius: float) -> np.ndarray:
    words = np.empty((60, 2, 5))
    return words[: WORDS[kind](*seen_from(a, b, radius), rounding(a, b, radius), words)]


@pytest.mark.slow
@pytest.mark.parametrize("kind", WORDS)
@pytest.mark.parametrize("radius", [0.3, 1.0, 25.0])
def test_every_word_leads_to_the_goal(kind: str, radius: float) -> None:
    rng = np.random.default_rng(3)
    seen = set()
    for _ in range(400):
        a, b = rng.uniform((-30, -30, -math.pi), (30, 30, math.pi), (2, 3))
        if rng.random() < 0.7:
            b[:2] = a[:2] + radius * rng.uniform(-4.0, 4.0, 2)
        for word in words_to(kind, a, b, radius):
            end = np.empty(3)
            walk(a, word, radius, math.inf, end)
            assert np.abs(se2.difference(end, b)).max() < 1e-9 * max(1.0, radius)
            # A piece on the wrong side of 0 by a hair is driven in the other direction.
            if not ((word[0] != 0.0) & (np.abs(word[0]) < 1.1e-3)).any():
                seen.add("".join("SLR"[int(side)] + "-+"[int(way > 0.0)] for way, side in word.T if way))
    # All six words of Dubins, and the 48 of Reeds and Shepp (none is left out because a piece happens to be 0).
    assert len(seen) == (6 if kind == "dubins" else 48)


@pytest.mark.slow
@pytest.mark.parametrize("kind", WORDS)
def test_words_drive_as_a_car_does(kind: str) -> None:
    rng = np.random.default_rng(4)
    for _ in trials(25):
        radius = float(rng.uniform(0.5, 5.0))
        a, b = rng.uniform((-8, -8, -math.pi), (8, 8, math.pi), (2, 3))
        words = words_to(kind, a, b, radius)
        for word in words[:: max(1, len(words) // 6)]:
            assert np.abs(se2.difference(integrated(a, word[1], word[0] * radius, radius), b)).max() < 1e-7
            # And halfway too.
            along = rng.uniform(0.0, 1.0) * radius * unit_length(word)
            ends = np.cumsum(np.abs(word[0])) * radius
            ways = np.clip(along - (ends - np.abs(word[0]) * radius), 0.0, np.abs(word[0]) * radius) * np.sign(word[0])
            q = np.empty(3)
            walk(a, word, radius, along, q)
            assert -math.pi < q[2] <= math.pi
            assert np.abs(se2.difference(integrated(a, word[1], ways, radius), q)).max() < 1e-7
