# ruff: noqa: N806 # the names are those of the literature: R
"""Features merged, split and dropped, and readings assigned anew, against how they were made."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.graph.readings import Readings
from trailmark.estimation.graph.reassociation import Labels, assigned, merged, split, without_unseen
from trailmark.se2 import wrap

FloatArray = NDArray[np.float64]
POSTS = np.array([[2.0, 0.3], [2.2, 0.3], [4.0, -1.0]])
"""The first two stand 20 cm apart."""
POSES = np.column_stack([np.linspace(0.0, 0.8, 30), np.zeros(30), np.zeros(30)])


def seen(posts: FloatArray = POSTS, sigma: float = 0.01, seed: int = 0) -> tuple[Readings, NDArray[np.intp]]:
    """All posts from all poses, with noise of sigma metres and as much sideways."""
    rng = np.random.default_rng(seed)
    instant, of = (grid.ravel() for grid in np.mgrid[0 : len(POSES), 0 : len(posts)])
    dx, dy = (posts[of] + sigma * rng.standard_normal((len(of), 2)) - POSES[instant, :2]).T
    z = np.column_stack([np.hypot(dx, dy), wrap(np.arctan2(dy, dx) - POSES[instant, 2])])
    R = np.zeros((len(z), 2, 2))
    R[:, 0, 0], R[:, 1, 1] = sigma**2, (sigma / z[:, 0]) ** 2
    return Readings(instant, z, R, False), of


def test_readings_go_to_the_feature_that_they_fit() -> None:
    readings, of = seen()
    mixed = np.random.default_rng(1).permutation(of)
    found = assigned(Labels(POSTS, mixed), POSES, readings, 0.01, 0.9999)
    assert (found.feature == of).mean() > 0.99
    # What fits no feature is of none; each takes one reading of an instant.
    assert (assigned(Labels(POSTS[:2], mixed), POSES, readings, 0.01, 0.9999).feature[of == 2] == -1).all()
    twice = readings._replace(instant=np.zeros(len(of), dtype=np.intp), z=np.tile(readings.z[:1], (len(of), 1)))
    alone = assigned(Labels(POSTS, mixed), POSES, twice, 0.01, 0.9999).feature
    assert np.count_nonzero(alone == 0) == 1


def test_one_thing_begun_twice_is_merged_and_neighbours_are_not() -> None:
    readings, of = seen()
    late = np.where((of == 2) & (readings.instant >= 15), 3, of)
    joint = 0.02**2 * np.eye(8)
    places = np.vstack([POSTS, POSTS[2] + np.array([0.03, -0.02])])
    found = merged(Labels(places, late), joint, readings.instant, 0.9999)
    assert len(found.places) == 3
    assert (found.feature == of).all()
    # However uncertain, what was read together is not one.
    assert len(merged(Labels(POSTS, of), np.eye(6), readings.instant, 0.9999).places) == 3


def test_merging_corrects_what_has_errors_in_common() -> None:
    """A place seen again after a drift: once one pair is known to be one, so is the other."""
    first, again = POSTS[1:], POSTS[1:] + np.array([0.4, 0.0])
    drift = np.tile([1.0, 0.0], 2)
    joint = 1e-4 * np.eye(8)
    joint[4:, 4:] += 0.3**2 * np.outer(drift, drift)
    feature, instant = np.repeat([0, 1, 2, 3], 5), np.tile(np.arange(5), 4) + np.repeat([0, 0, 9, 9], 5)
    found = merged(Labels(np.vstack([first, again]), feature), joint, instant, 0.9999)
    assert len(found.places) == 2
    assert np.abs(found.places - first).max() < 0.02


def test_two_things_taken_for_one_are_split() -> None:
    readings, of = seen()
    one = np.where(of == 1, -1, of)
    labels = Labels(POSTS[[0, 2]], np.where(one == 2, 1, one))
    found = split(labels, POSES, readings, 0.01, 5)
    assert len(found.places) == 3
    assert np.hypot(*(found.places[2] - POSTS[1])) < 0.02
    assert (found.feature[of == 1] == 2).mean() > 0.9
    few = np.where((of == 1) & (readings.instant < 26), 0, labels.feature)
    assert len(split(Labels(labels.places, few), POSES, readings, 0.01, 5).places) == 2


def test_ghosts_are_dropped() -> None:
    readings, of = seen()
    ghost = of.copy()
    ghost[np.flatnonzero(of == 0)[:3]] = 3
    labels = Labels(np.vstack([POSTS, [2.5, 0.0]]), ghost)
    assert len(without_unseen(labels, POSES, readings, 5).places) == 3  # too few readings
    assert len(without_unseen(labels, POSES, readings, 2).places) == 3  # seen in a tenth of the instants at most
    assert len(without_unseen(Labels(POSTS, of), POSES, readings, 5).places) == 3
