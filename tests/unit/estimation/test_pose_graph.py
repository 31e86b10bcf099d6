"""A graph of poses: its optimum, what it drops, and its covariances, against dense algebra and simulated errors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.helpers.trials import few

from trailmark.estimation.pose_graph import Relation, optimise, pose_covariances, relative_covariances
from trailmark.se2 import FloatArray, between, compose

COVARIANCE = np.diag([0.02, 0.01, 0.01]) ** 2


def ring(n: int = 24, radius: float = 5.0) -> FloatArray:
    angle = np.linspace(0.0, 2.0 * math.pi, n, endpoint=False)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), angle + 0.5 * math.pi])


def measured(true: FloatArray, pairs: list[tuple[int, int]], rng: np.random.Generator) -> list[Relation]:
    noise = rng.multivariate_normal(np.zeros(3), COVARIANCE, len(pairs))
    return [
        Relation(a, b, compose(between(true[a], true[b]), error), COVARIANCE, b == a + 1)
        for (a, b), error in zip(pairs, noise, strict=True)
    ]


def pairs(n: int = 24) -> list[tuple[int, int]]:
    return [*((i, i + 1) for i in range(n - 1)), (0, n - 1), (3, n - 4)]


def dead_reckoned(relations: list[Relation], first: FloatArray, n: int) -> FloatArray:
    poses = [first]
    for relation in relations[: n - 1]:
        poses.append(compose(poses[-1], relation.pose))
    return np.array(poses)


def test_wrong_closures_are_dropped_and_right_ones_count() -> None:
    true, rng = ring(), np.random.default_rng(0)
    relations = measured(true, pairs(), rng)
    wrong = Relation(5, 15, np.array([1.0, 0.0, 0.3]), COVARIANCE, certain=False)
    begin = dead_reckoned(relations, true[0], len(true))
    poses, counts = optimise([*relations, wrong], begin)
    assert counts.tolist() == [True] * len(relations) + [False]
    assert np.allclose(poses[0], true[0], atol=1e-6)
    assert np.hypot(*(poses - true)[:, :2].T).max() < 0.2 < np.hypot(*(begin - true)[:, :2].T).max() + 0.2
    alone, every = optimise(relations, begin)
    assert every.all()
    assert np.allclose(alone, poses, atol=1e-3)


@pytest.mark.slow
def test_covariances_are_those_of_the_errors_after_the_best_alignment() -> None:
    true, rng = ring(), np.random.default_rng(1)
    errors = []
    for _ in range(few(300, of=2)):
        relations = measured(true, pairs(), rng)
        poses, _ = optimise([r._replace(certain=True) for r in relations], true)
        away, off = true[:, :2] - true[:, :2].mean(axis=0), poses - true
        turn = (away[:, 0] * off[:, 1] - away[:, 1] * off[:, 0]).sum() / (away**2).sum()
        off[:, :2] -= off[:, :2].mean(axis=0) + turn * np.column_stack([-away[:, 1], away[:, 0]])
        off[:, 2] = np.remainder(off[:, 2] - turn + math.pi, 2.0 * math.pi) - math.pi
        errors.append(off)
    sampled = np.einsum("kni,knj->nij", errors, errors) / len(errors)
    stated = relative_covariances(measured(true, pairs(), rng), true)
    ratio = np.sqrt(np.einsum("nii->ni", sampled) / np.einsum("nii->ni", stated))
    assert np.abs(ratio - 1.0).max() < 0.2
    assert abs(ratio.mean() - 1.0) < 0.05


@pytest.mark.slow
def test_covariances_of_a_long_corridor_are_those_of_its_steps_added_up() -> None:
    """Headings that are known to 1e-4 after a first one that is not: Cholesky factors of such a graph do not exist."""
    n, rng = 1500, np.random.default_rng(0)
    poses = np.column_stack([0.8 * np.arange(n), 0.3 * rng.standard_normal(n), 0.5 * np.sin(np.arange(n))])
    relations, expected = [], [np.zeros((3, 3))]
    for i, step in enumerate(between(poses[k], poses[k + 1]) for k in range(n - 1)):
        along, own = rotation(-poses[i + 1, 2]), np.diag([1.0, 1e-3, 7e-5 if i else 0.08]) ** 2
        relations.append(Relation(i, i + 1, step, along @ own @ along.T))
        # Of a pose's error in the frame of the next one (by the adjoint of SE(2)).
        adjoint = rotation(step[2])
        adjoint[:2, 2] = step[1], -step[0]
        back = np.linalg.inv(adjoint)
        expected.append(back @ expected[-1] @ back.T + relations[-1].covariance)
    turns = np.array([rotation(pose[2]) for pose in poses])
    worlds = turns @ np.array(expected) @ turns.transpose(0, 2, 1)
    sigma = np.sqrt(np.einsum("nii->ni", worlds))
    off = np.abs(pose_covariances(relations, poses) - worlds)[1:] / (sigma[1:, :, None] * sigma[1:, None, :])
    assert off.max() <= 1e-3


def test_small_covariances_keep_what_lies_beside_their_diagonal() -> None:
    """gtsam takes entries under 1e-9 for 0."""
    covariance = np.array([[1e-10, 9e-11, 0.0], [9e-11, 1e-10, 0.0], [0.0, 0.0, 1e-10]])
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    relations = [Relation(0, 1, poses[1], covariance)]
    frame = 1e-12 * np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 1.0], [0.0, 1.0, 1.0]])  # of the first pose, a metre away
    np.testing.assert_allclose(pose_covariances(relations, poses)[1], covariance + frame, rtol=1e-6, atol=1e-17)


def rotation(angle: float) -> FloatArray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
