from __future__ import annotations

import numpy as np
import pytest

from trailmark import Disc, Robot, World
from trailmark.exploration import ExplorationSettings, Explorer
from trailmark.exploration.certainty import expected_falls, places_of
from trailmark.exploration.outlook import Outlook


def test_a_place_is_as_unsure_as_its_longest_axis() -> None:
    trajectory = np.array([[0.0, 1.0, 2.0, 0.3], [0.1, 1.5, 2.0, 0.4]])
    axis = np.array([0.6, 0.8, 0.0])
    covariances = np.array([np.zeros((3, 3)), 0.04 * np.outer(axis, axis) + np.diag([1e-4, 1e-4, 9.0])])
    np.testing.assert_allclose(
        places_of(trajectory, covariances), [[1.0, 2.0, 0.0], [1.5, 2.0, np.sqrt(0.0401)]], atol=1e-12
    )


def test_a_place_is_as_sure_as_the_surest_visit_near_it() -> None:
    visited = np.array([[0.0, 0.0], [2.0, 0.0], [4.0, 0.0], [6.0, 0.0]])
    sigmas = np.array([0.0, 0.02, 0.04, 0.03])
    places = np.array([[0.5, 0.0], [3.0, 0.0], [5.0, 0.5], [9.0, 0.0]])
    np.testing.assert_allclose(expected_falls(places, visited, sigmas, 1.5), [0.03, 0.01, 0.0, 0.0])
    assert not expected_falls(places, visited[:0], sigmas[:0], 1.5).any()


@pytest.mark.slow
def test_strategies_are_told_with_noise_and_without_there_is_nothing_to_tell() -> None:
    world = World("hall", (0.0, 0.0, 9.0, 3.0), (Disc((4.5, 1.5), 0.3), Disc((6.5, 0.5), 0.3)), Robot.disc(0.2))
    for noise in (0.0, 1.0):
        told = list[Outlook]()

        def first(outlook: Outlook, told: list[Outlook] = told) -> int:
            told.append(outlook)
            return int(np.argmin(outlook.costs))

        settings = ExplorationSettings(time_limit=8.0)
        explorer = Explorer(
            world, strategy=first, sensor_range=2.0, start=(0.6, 1.5, 0.0), noise=noise, settings=settings
        )
        while explorer.ended is None:
            explorer.step()
        falls = np.concatenate([outlook.certainty for outlook in told])
        assert (falls >= 0.0).all()
        assert (falls.max() > 0.0) == (noise > 0.0)
