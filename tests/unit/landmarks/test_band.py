"""The band and retraction: samples where short paths are likely, pushed off the obstacles. Shapely judges them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.helpers.oracles import Oracle
from tests.helpers.worlds import ROBOTS, random_states, random_world

from trailmark.collision import StateChecker
from trailmark.landmarks import Relaxation, free_samples
from trailmark.landmarks.band import Band
from trailmark.landmarks.retraction import retract_all

FloatArray = NDArray[np.float64]


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_all_that_the_band_gives_is_valid_and_the_seeds_own(name: str) -> None:
    world = random_world(5, 40, size=40.0, discs=0.3, holes=0.2)
    checker = StateChecker(world, ROBOTS[name], cell=0.2)
    ends = free_samples(checker, 2, random_state=1)
    band = Band(checker, Relaxation(checker), ends[0], ends[1])
    assert np.isfinite(band.shortest)

    def all_kinds(seed: int) -> list[FloatArray]:
        rng = np.random.default_rng(seed)
        samples = [band.samples(100, widening, rng) for widening in (0.02, 0.3, 1.5, np.inf)]
        return [*samples, band.samples_near(ends[0], 3.0, 100, rng), band.guides(rng)[0]]

    for found, again, other in zip(all_kinds(1), all_kinds(1), all_kinds(2), strict=True):
        assert len(found) > 0
        assert not Oracle(world, ROBOTS[name]).collides(found).any()
        assert (np.abs(found[:, 2]) <= math.pi).all()
        assert (name == "disc") == (not found[:, 2].any())
        assert np.array_equal(found, again)
        assert not np.array_equal(found, other)


@pytest.mark.parametrize("name", ROBOTS)
def test_more_become_valid(name: str) -> None:
    world = random_world(4, 80, size=40.0, discs=0.3)
    checker, oracle = StateChecker(world, ROBOTS[name], cell=0.1), Oracle(world, ROBOTS[name])
    q = random_states(world, 400, np.random.default_rng(1))
    if name == "disc":
        q[:, 2] = 0.0
    before = q.copy()
    for reach in (0.2, 1.0):
        moved = retract_all(checker, q, reach)
        assert np.array_equal(q, before)
        assert (~oracle.collides(moved)).sum() > (~oracle.collides(q)).sum()
        assert name != "disc" or not moved[:, 2].any()
