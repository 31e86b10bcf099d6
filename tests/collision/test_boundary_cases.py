"""What just collides is refused, and what is just free is not, by every kernel that certifies."""

from __future__ import annotations

import numpy as np
import pytest
from tests.helpers.boundary_cases import Case, cases

from trailmark.collision import StateChecker, kernels
from trailmark.curves import Steering
from trailmark.motion import CurveMotion


@pytest.fixture(scope="module")
def made() -> list[tuple[Case, StateChecker]]:
    return [(case, StateChecker(case.world, case.robot, cell=case.cell)) for case in cases(1, 2)]


@pytest.mark.slow
def test_what_just_collides_is_refused(made: list[tuple[Case, StateChecker]]) -> None:
    assert sum(len(case.hit) for case, _ in made) > 500
    assert sum(len(case.bad_motions) for case, _ in made) > 50
    assert sum(len(case.bad_curves) for case, _ in made) > 10
    for case, checker in made:
        assert not checker.valid(case.hit).any(), case.name
        assert not (kernels.field_states(checker.field, checker.footprint, case.hit) == kernels.FREE).any(), case.name
        assert checker.clearance(case.hit).max() <= case.robot.clearance + 1e-8, case.name
        a, b = case.bad_motions[:, 0].copy(), case.bad_motions[:, 1].copy()
        assert not checker.motions_valid(a, b).any(), case.name
        assert not checker.motions_between_valid(a, b).any(), case.name
        assert not (checker.motions_by_field(a, b) == kernels.FREE).any(), case.name
        car = CurveMotion(checker, Steering(case.radius))
        curves = case.bad_curves[:, 0].copy(), case.bad_curves[:, 1].copy()
        assert not car.motions_between_valid(*curves).any(), case.name


@pytest.mark.slow
def test_what_is_just_free_is_accepted(made: list[tuple[Case, StateChecker]]) -> None:
    assert sum(len(case.free) for case, _ in made) > 200
    assert sum(len(case.good_motions) for case, _ in made) > 10
    for case, checker in made:
        assert checker.valid(case.free).all(), case.name
        assert np.abs(checker.clearance(case.free) - case.clearances).max() <= 1e-8, case.name
        known = kernels.field_states(checker.field, checker.footprint, case.free)
        assert not (known == kernels.BLOCKED).any(), case.name
        a, b = case.good_motions[:, 0].copy(), case.good_motions[:, 1].copy()
        assert checker.motions_valid(a, b).all(), case.name
        assert not (checker.motions_by_field(a, b) == kernels.BLOCKED).any(), case.name
        car = CurveMotion(checker, Steering(case.radius))
        curves = case.good_curves[:, 0].copy(), case.good_curves[:, 1].copy()
        assert car.motions_between_valid(*curves).all(), case.name
