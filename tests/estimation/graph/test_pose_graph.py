"""A graph of poses: its optimum, what it drops, and its covariances, against dense algebra and simulated errors."""

from __future__ import annotations

import math

import numpy as np

from trailmark.estimation.graph.pose_graph import Relation, optimise, relative_covariances
from trailmark.estimation.scans.clouds import relative
from trailmark.se2 import FloatArray, compose

COVARIANCE = np.diag([0.02, 0.01, 0.01]) ** 2


def ring(n: int = 24, radius: float = 5.0) -> FloatArray:
    angle = np.linspace(0.0, 2.0 * math.pi, n, endpoint=False)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), angle + 0.5 * math.pi])


def measured(true: FloatArray, pairs: list[tuple[int, int]], rng: np.random.Generator) -> list[Relation]:
    noise = rng.multivariate_normal(np.zeros(3), COVARIANCE, len(pairs))
    return [
        Relation(a, b, compose(relative(true[a], true[b]), error), COVARIANCE, b == a + 1)
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


def test_covariances_are_those_of_the_errors_after_the_best_alignment() -> None:
    true, rng = ring(), np.random.default_rng(1)
    errors = []
    for _ in range(300):
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
