# ruff: noqa: N806 # the filter's own symbols
"""Data association against brute force, and where joint compatibility sees what single distances cannot."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import chi2
from tests.helpers.trials import few

from trailmark.estimation import RangeBearing, SlamFilter, Unicycle
from trailmark.estimation.ekf_slam import (
    IGNORED,
    NEW,
    Compatibility,
    Gates,
    compatibility,
    distinct,
    joint_compatibility,
)

FloatArray = NDArray[np.float64]

SENSOR = RangeBearing(0.1, 0.03)
P = 0.95
GATES = Gates(P, 0.9999)
GATE, NEW_GATE = float(chi2.ppf(P, 2)), float(chi2.ppf(0.9999, 2))


def filter_and_readings(seed: int, features: int, readings: int) -> tuple[SlamFilter, FloatArray]:
    """A filter whose pose is known badly, features close together, and readings of some of them."""
    rng = np.random.default_rng(seed)
    ekf = SlamFilter()
    for _ in range(features):
        ekf.add_feature([rng.uniform(3.0, 4.0), rng.uniform(-0.3, 0.3)], SENSOR)
    ekf.predict(Unicycle(1.0, 0.3), [0.3, 0.0, 0.3])
    shift = rng.multivariate_normal(np.zeros(3), ekf.pose_covariance)
    pose = ekf.pose + shift
    some = rng.permutation(features)[:readings]
    z = [SENSOR.sample(pose, ekf.feature(int(i)), rng) for i in some]
    z += [np.array([rng.uniform(3.0, 5.0), rng.uniform(-1.0, 1.0)]) for _ in range(readings - len(some))]
    return ekf, np.array(z).reshape(-1, 2)


def assignments(readings: int, features: int) -> Iterator[tuple[int | None, ...]]:
    """All ways to give each reading a feature or none, no feature twice."""
    if readings == 0:
        yield ()
        return
    for head in assignments(readings - 1, features):
        yield (*head, None)
        yield from ((*head, j) for j in range(features) if j not in head)


def joint_distance(fit: Compatibility, joint: FloatArray, assignment: tuple[int | None, ...]) -> float:
    pairs = [(i, j) for i, j in enumerate(assignment) if j is not None]
    if not pairs:
        return 0.0
    y = np.concatenate([fit.y[i, j] for i, j in pairs])
    S = np.block([[joint[j, :, b, :] + (fit.R[i, j] if i == a else 0.0) for a, b in pairs] for i, j in pairs])
    return float(y @ np.linalg.solve(S, y))


@pytest.mark.slow
@settings(max_examples=few(60))
@given(seed=st.integers(0, 99999), features=st.integers(0, 4), readings=st.integers(0, 4))
def test_joint_compatibility_is_what_brute_force_finds(seed: int, features: int, readings: int) -> None:
    ekf, z = filter_and_readings(seed, features, readings)
    prediction = ekf.predict_readings(SENSOR)
    fit, joint = compatibility(z, prediction, SENSOR, [None] * len(z)), ekf.joint_covariance(prediction)
    found = joint_compatibility(fit, joint, GATES)
    assert found.complete

    def allowed(assignment: tuple[int | None, ...]) -> bool:
        if any(j is not None and fit.d2[i, j] > GATE for i, j in enumerate(assignment)):
            return False
        parts = [assignment[: n + 1] for n in range(len(assignment))]
        counts = [sum(j is not None for j in part) for part in parts]
        return all(
            n == 0 or joint_distance(fit, joint, part) <= chi2.ppf(P, 2 * n)
            for part, n in zip(parts, counts, strict=True)
        )

    all_allowed = [a for a in assignments(readings, features) if allowed(a)]
    best = min(all_allowed, key=lambda a: (a.count(None), joint_distance(fit, joint, a)))
    assert tuple(None if j < 0 else j for j in found.assigned.tolist()) == best
    assert found.nis == pytest.approx(joint_distance(fit, joint, best), abs=1e-9)
    for i in np.flatnonzero(found.assigned < 0):
        is_new = features == 0 or fit.d2[i].min() > NEW_GATE
        assert found.assigned[i] == (NEW if is_new else IGNORED)


def test_joint_compatibility_sees_a_turn_that_single_distances_do_not() -> None:
    # Posts on an arc 0.2 rad apart, and a heading off by 0.17: by itself each reading is nearest to its neighbour's
    # post, and the reading of the last post has none left. Only as one turn do all of them fit.
    motion, ekf = Unicycle(0.01, 1.0), SlamFilter()
    angles = np.array([-0.4, -0.2, 0.0, 0.2, 0.4])
    precise = RangeBearing(0.02, 0.005)
    for a in angles:
        ekf.add_feature([4.0, a], precise)
    ekf.predict(motion, [0.0, 0.0, 0.2])
    z = np.column_stack([np.full(5, 4.0), angles - 0.17])
    prediction = ekf.predict_readings(precise)
    fit = compatibility(z, prediction, precise, [None] * 5)
    assert fit.d2.argmin(axis=1).tolist()[1:] == [0, 1, 2, 3]
    joint = joint_compatibility(fit, ekf.joint_covariance(prediction), GATES)
    assert joint.assigned.tolist() == [0, 1, 2, 3, 4]


def test_a_reading_near_features_that_all_went_to_others_is_new() -> None:
    d2 = np.array([[1.0, 99.0], [2.0, 99.0], [50.0, 9.0]])
    assert distinct([0, IGNORED, IGNORED], d2, 20.0).tolist() == [0, NEW, IGNORED]


@pytest.mark.slow
def test_a_search_without_end_is_cut_short() -> None:
    # Twelve readings of twelve features all in one place: 12! ways, each as good as any.
    ekf = SlamFilter()
    for _ in range(12):
        ekf.add_feature([5.0, 0.0], SENSOR)
    prediction = ekf.predict_readings(SENSOR)
    z = prediction.z_hat + np.random.default_rng(1).normal(0, 0.02, (12, 2))
    fit = compatibility(z, prediction, SENSOR, [None] * len(z))
    found = joint_compatibility(fit, ekf.joint_covariance(prediction), GATES, node_limit=2000)
    assert not found.complete
    assert sorted(found.assigned.tolist()) == list(range(12))
