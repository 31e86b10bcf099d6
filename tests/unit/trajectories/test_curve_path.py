"""Paths of curves: rows that follow the curves, with all knots and cusps, and the curves' own length."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.helpers.trials import trials

from trailmark import ConfigurationError, CurvePath, Steering, se2

KNOTS = np.array([(0.0, 0.0, 0.0), (8.0, 3.0, 1.0), (7.5, 3.5, 2.5), (2.0, 9.0, -3.0)])


def made(reverse: bool = True, radius: float = 2.0) -> CurvePath:
    return CurvePath(KNOTS, Steering(radius, reverse))


@pytest.mark.parametrize("reverse", [True, False])
def test_rows_follow_the_curves(reverse: bool) -> None:
    path = made(reverse)
    for knot in KNOTS:
        assert (path.states == knot).all(axis=1).any()
    assert np.array_equal(path.states[[0, -1]], KNOTS[[0, -1]])
    steps = np.diff(path.states[:, :2], axis=0)
    chords = np.hypot(*steps.T)
    assert path.length == pytest.approx(float(path.steering.lengths(KNOTS[:-1], KNOTS[1:]).sum()))
    assert 0.0 <= path.length - chords.sum() < 2e-3 * path.length
    # Each row's step goes along the heading half way between its ends, forwards or backwards: as on an arc.
    turn = se2.wrap(np.diff(path.states[:, 2]))
    heading = path.states[:-1, 2] + 0.5 * turn
    across = -np.sin(heading) * steps[:, 0] + np.cos(heading) * steps[:, 1]
    assert np.abs(across).max() < 1e-9
    assert np.abs(turn).max() <= 0.1 + 1e-9
    # The sagitta of an arc over a chord.
    assert (0.5 * chords * np.abs(np.tan(0.25 * turn))).max() < 1.01e-3
    assert path.rotation == pytest.approx(np.abs(turn).sum())
    assert path.cost == path.length


def test_states_at_given_places() -> None:
    path = made()
    places = np.array([0.0, 0.3, 0.3, path.length])
    given = CurvePath(KNOTS, path.steering, places)
    assert given.states == pytest.approx(path.at(places / path.length), abs=1e-9)
    assert not given.places.flags.writeable
    assert places.flags.writeable
    end = path.length
    for wrong in ([0.1, end], [0.0, 1.0], [0.0, 2.0, 1.0, end], [[0.0, end]], [], [0.0, np.nan]):
        with pytest.raises(ConfigurationError, match="path: places: expected"):
            CurvePath(KNOTS, path.steering, wrong)  # type: ignore[arg-type]  # a list serves, too


@pytest.mark.parametrize("reverse", [True, False])
def test_pieces_of_hardly_any_length(reverse: bool) -> None:
    # The next knot lies on an arc or ahead to rounding, so that the other pieces of its curve are all but empty.
    rng = np.random.default_rng(4)
    steering = Steering(0.9413138183310996, reverse)
    for _ in trials(300):
        q = rng.uniform((-10.0, -10.0, -math.pi), (10.0, 10.0, math.pi))
        knots = [q]
        for turn in rng.uniform(0.0, 2.0, 4) * rng.choice([-1.0, 0.0, 1.0], 4):
            x, y, heading = knots[-1]
            if turn:
                side = math.copysign(steering.radius, turn)
                x += side * (math.sin(heading + turn) - math.sin(heading))
                y -= side * (math.cos(heading + turn) - math.cos(heading))
            knots.append(np.array([x, y, heading + turn]) + rng.normal(0.0, 1e-16, 3))
        path = CurvePath(np.array(knots), steering)
        fine = path.refined(lambda a, b: np.asarray(np.hypot(*(b - a)[:, :2].T) < 0.05))
        for each in (path, fine, CurvePath(path.knots, steering, fine.record()["places"])):
            assert (np.diff(each.places) >= 0.0).all()
            assert np.array_equal(each.states[[0, -1]], path.knots[[0, -1]])
        assert np.isin(path.places, fine.places).all()


def test_arcs_get_more_states_where_their_chords_are_not_free() -> None:
    path = made()
    assert path.refined(lambda a, b: np.ones(len(a), np.bool_)) is path
    wall = path.at(0.4)[0]  # motions that cross it are free once they are a centimetre long

    def free(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        crosses = (a[:, 0] - wall) * (b[:, 0] - wall) <= 0.0
        return np.asarray(~crosses | (np.hypot(*(b - a)[:, :2].T) < 0.01))

    fine = path.refined(free)
    assert fine == path
    assert len(path) < len(fine) < len(path) + 40
    assert np.isin(path.places, fine.places).all()
    assert fine.states == pytest.approx(path.at(fine.places / path.length), abs=1e-9)
    # As near to the arcs as anything can ask for, and no nearer; straight pieces stay as they are.
    finest = path.refined(lambda a, b: np.zeros(len(a), np.bool_))
    gaps = np.diff(finest.places)
    assert gaps.max() > 0.5
    arcs = gaps < 0.5
    assert 0.2 < (gaps[arcs] ** 2 / (8.0 * 2.0 * 5e-8)).max() <= 1.0
    assert len(finest) < 4 * len(path.polyline(5e-8))
