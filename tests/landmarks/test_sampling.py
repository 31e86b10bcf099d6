"""Samples: where they lie, that they are valid, and that a seed decides them. Validity is judged by shapely."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from tests.helpers.oracle import Oracle
from tests.helpers.random_worlds import ROBOTS, random_world

from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError
from trailmark.landmarks import draw, free_samples
from trailmark.shapes import Disc, Polygon, Rectangle
from trailmark.world import Robot, World

BOUNDS = (-3.0, 2.0, 5.0, 18.0)
METHODS = ("uniform", "halton")


@pytest.mark.parametrize("method", METHODS)
def test_a_seed_decides_the_draws_and_a_generator_goes_on(method: str) -> None:
    def draws(state: int | np.random.Generator | None) -> NDArray[np.float64]:
        return draw(BOUNDS, 50, method=method, random_state=state)  # type: ignore[arg-type]  # a parameter of the test

    assert np.array_equal(draws(7), draws(7))
    assert not np.array_equal(draws(7), draws(8))
    assert not np.array_equal(draws(None), draws(None))
    rng = np.random.default_rng(7)
    assert np.array_equal(draws(rng), draws(7))
    assert not np.array_equal(draws(rng), draws(7))


def test_bad_arguments_are_named() -> None:
    with pytest.raises(ConfigurationError, match=r"expected halton, uniform, got 'halten' \(did you mean 'halton'\?\)"):
        draw(BOUNDS, 3, method="halten")  # type: ignore[arg-type]  # wrong on purpose
    with pytest.raises(ConfigurationError, match="expected 0 or more, got -1"):
        draw(BOUNDS, -1)
    checker = StateChecker(World("empty", BOUNDS), Robot.disc(0.5))
    for n in (0, 5):
        with pytest.raises(ConfigurationError, match="got 'sobol'"):
            free_samples(checker, n, method="sobol")  # type: ignore[arg-type]  # wrong on purpose
    with pytest.raises(ConfigurationError, match="expected 0 or more, got -2"):
        free_samples(checker, -2)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ROBOTS)
def test_free_samples_are_valid(name: str, method: str) -> None:
    world = random_world(3, 60, size=50.0, discs=0.3, holes=0.3, boundary=True)
    checker = StateChecker(world, ROBOTS[name])
    q = free_samples(checker, 300, method=method, random_state=4)  # type: ignore[arg-type]  # a parameter of the test
    assert q.shape == (300, 3)
    assert not Oracle(world, ROBOTS[name]).collides(q).any()
    assert len(np.unique(q, axis=0)) == 300
    assert (name == "disc") == (not q[:, 2].any())
    again = free_samples(checker, 300, method=method, random_state=4)  # type: ignore[arg-type]  # as above
    assert np.array_equal(q, again)
    other = free_samples(checker, 300, method=method, random_state=5)  # type: ignore[arg-type]  # as above
    assert not np.array_equal(q, other)


def test_free_samples_reach_every_part_of_free_space() -> None:
    # Two rooms joined by nothing: the robot's free space has two parts, 4 x 4 and 2 x 4 m for its centre.
    checker = StateChecker(World("rooms", (0, 0, 10, 6), (Rectangle((6.5, 3.0), 1.0, 6.0),)), Robot.disc(1.0))
    q = free_samples(checker, 3000, random_state=1)
    left, right = shapely.box(1, 1, 5, 5), shapely.box(8, 1, 9, 5)
    shares = [shapely.contains_xy(part, q[:, 0], q[:, 1]).mean() for part in (left, right)]
    assert shares == pytest.approx([16.0 / 20.0, 4.0 / 20.0], abs=0.03)


def test_what_is_enclosed_is_left_out() -> None:
    ring = Polygon(
        np.array([[10.0, 10.0], [30.0, 10.0], [30.0, 30.0], [10.0, 30.0]]),
        (np.array([[12.0, 12.0], [28.0, 12.0], [28.0, 28.0], [12.0, 28.0]]),),
    )
    checker = StateChecker(World("ring", (0, 0, 40, 40), (ring, Disc((20.0, 20.0), 2.0))), Robot.rectangle(1.5, 1.0))
    inside = shapely.box(12, 12, 28, 28)

    def share(start: tuple[float, float, float] | None) -> float:
        at = None if start is None else np.array(start)
        q = free_samples(checker, 500, reachable_from=at, random_state=2)
        assert len(q) == 500
        return float(shapely.contains_xy(inside, q[:, 0], q[:, 1]).mean())

    assert 0.05 < share(None) < 0.95
    assert share((5.0, 5.0, 1.0)) == 0.0
    assert share((15.0, 15.0, 1.0)) == 1.0


def test_none_wanted_or_none_found() -> None:
    tight = StateChecker(World("tight", (0, 0, 1.1, 1.1)), Robot.disc(0.5))
    assert free_samples(tight, 0).shape == (0, 3)
    few = free_samples(tight, 10, random_state=1, max_draws=30)
    assert len(few) < 10
    assert (np.abs(few[:, :2] - 0.55) <= 0.05 + 1e-7).all()
    full = StateChecker(World("full", (0, 0, 4, 4), (Rectangle((2, 2), 4, 4),)), Robot.disc(0.5))
    assert free_samples(full, 10, random_state=1).shape == (0, 3)


def test_draws_end_where_they_are_told_to(monkeypatch: pytest.MonkeyPatch) -> None:
    checker = StateChecker(World("full", (0, 0, 4, 4), (Rectangle((2, 2), 4, 4),)), Robot.disc(0.5))
    seen: list[int] = []

    def none_valid(q: NDArray[np.float64]) -> NDArray[np.bool_]:
        seen.append(len(q))
        return np.zeros(len(q), np.bool_)

    monkeypatch.setattr(checker, "valid", none_valid)
    free_samples(checker, 10, random_state=1)
    assert sum(seen) == 500
    seen.clear()
    free_samples(checker, 10, random_state=1, max_draws=77)
    assert sum(seen) == 77
