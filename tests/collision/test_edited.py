"""StateChecker.edited: the answers of a checker built anew, and nothing changes for those who use the old one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.helpers.random_worlds import ROBOTS, random_states, random_world, short_motions

from trailmark import Disc, Robot, WorldError
from trailmark.collision import StateChecker
from trailmark.world import RiskBound


@pytest.mark.parametrize("kind", ["disc", "rectangle", "L", "thin"])
def test_an_edited_checker_answers_as_one_built_anew(kind: str) -> None:
    rng = np.random.default_rng(5)
    world = random_world(3, 25, size=20.0, radii=(0.3, 2.0), discs=0.3, holes=0.4, boundary=True)
    checker = StateChecker(world, ROBOTS[kind], cell=0.3)
    q, (a, b) = random_states(world, 300, rng), short_motions(world, 300, rng, 2.0)

    def answers(checker: StateChecker) -> list[np.ndarray]:
        asked = checker.valid(q), checker.clearance(q), checker.motions_valid(a, b)
        return [*asked, np.array([checker.scene.collides(row) for row in q[:20]])]

    before = answers(checker)
    for changed in (
        world.edited(add=[Disc((10.0, 10.0), 2.0)], remove=[3], move={5: (1.0, 0.5, 0.3)}),
        replace(world, bounds=(-5.0, 0.0, 30.0, 20.0), boundary=None),
    ):
        edited = checker.edited(changed)
        assert edited.world is changed
        assert edited.robot is checker.robot
        for mine, anew in zip(answers(edited), answers(StateChecker(changed, ROBOTS[kind], cell=0.3)), strict=True):
            assert np.array_equal(mine, anew)
        assert not np.array_equal(edited.clearance(q), before[1])
    assert all(map(np.array_equal, answers(checker), before))
    assert checker.edited(world) is checker


def test_a_world_grown_for_another_robot_is_refused() -> None:
    world = random_world(3, 5, size=20.0)
    checker = StateChecker(world, Robot.rectangle(2.0, 1.0))
    risk = RiskBound(0.9, np.eye(3) * 1e-4, reach=0.1)
    with pytest.raises(WorldError, match="grown for a robot that reaches"):
        checker.edited(replace(world, risk=risk))
