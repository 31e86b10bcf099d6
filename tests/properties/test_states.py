"""Configurations: everyone who judges them says what shapely says, of every footprint in every world."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from tests.helpers.oracles import Oracle
from tests.helpers.trials import few
from tests.properties.cases import Case, cases, near_contact

from trailmark.collision import kernels
from trailmark.motion.pointwise import PointwiseChecker
from trailmark.verify import check_path


@pytest.mark.slow
@given(cases((1e5, -1e5), (-3.0, 9e6), drives=("any way",)))
@settings(max_examples=few(60))
def test_all_judges_of_a_configuration_agree_with_shapely(case: Case) -> None:
    checker, oracle = case.checker, case.oracle
    q = near_contact(case, 300)
    collides, expected, valid = oracle.collides(q), oracle.clearance(q), checker.valid(q)
    assert not oracle.disagrees(q, valid).any()
    # A double near 1e7 holds 2e-9.
    rounding = 2e-8 if max(map(abs, checker.world.bounds)) > 1e6 else 1e-9
    clearance = checker.clearance(q)
    assert clearance == pytest.approx(expected, abs=rounding)
    cap = 0.3 * case.size
    assert checker.clearance(q, cap=cap) == pytest.approx(np.minimum(expected, cap), abs=rounding)

    # The field is surer of itself than of everything, but never wrong.
    known = kernels.field_states(checker.field, checker.footprint, q)
    assert not collides[known == kernels.FREE].any()
    assert not valid[known == kernels.BLOCKED].any()

    # One a call, from raw memory; and FCL, which knows no grid.
    single, rows = PointwiseChecker(checker), q.tolist()
    assert [single.valid(*row) for row in rows] == valid.tolist()
    beyond = np.maximum(0.0, clearance[:100] - checker.robot.clearance)
    assert [single.clearance(*row) for row in rows[:100]] == pytest.approx(beyond, abs=rounding)
    some = case.rng.permutation(len(q))[:40]
    assert not oracle.disagrees(q[some], np.array([not checker.scene.collides(row) for row in q[some]])).any()

    # An audit of the robot that stands there, whatever clearance it is to keep, and the reason that is told.
    plain = Oracle(checker.world, checker.robot.keeping(0.0))
    for row in q[some[:10]]:
        audit = check_path(checker.world, checker.robot, row[None])
        assert not plain.disagrees(row[None], np.array([audit.free])).any()
        if audit.free:
            assert audit.min_clearance == pytest.approx(oracle.clearance(row[None])[0], abs=5e-7 + rounding)
        if oracle.collides(row[None])[0]:
            assert re.fullmatch(
                r"(reaches|overlaps|has a clearance) [^\n]*\d m\b[^\n]*|touches an obstacle within rounding",
                checker.fault(row),
            )
