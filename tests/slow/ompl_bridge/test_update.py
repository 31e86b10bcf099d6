"""OMPL's parts in a world that changes: the same SpaceInformation, the answers of parts made anew."""

from __future__ import annotations

from typing import Any

import pytest

WORLD = """
from trailmark import Disc, Rectangle, StateChecker
world = World("hall", (0.0, 0.0, 20.0, 10.0), (Rectangle((10.0, 2.0), 0.5, 4.0),), Robot.rectangle(1.0, 0.5))
ends = ((2.0, 2.0, 0.0), (18.0, 2.0, 0.0))
def answers(problem, n):
    rng = np.random.default_rng(4)
    si = problem.information
    q = rng.uniform((0.0, 0.0, -np.pi), (20.0, 10.0, np.pi), (n, 3))
    made = [state(si, row) for row in q]
    valid = [si.isValid(s) for s in made]
    free = [s for s, ok in zip(made, valid) if ok]
    return [valid, [si.checkMotion(a, b) for a, b in zip(free, free[1:])],
            [si.getStateValidityChecker().clearance(s) for s in made[:50]]]
"""


@pytest.mark.parametrize("robot", ["world.robot", "world.robot.steered(0.8)", "world.robot.steered(0.8, False)"])
def test_an_updated_problem_answers_as_one_made_anew(run_ompl: Any, robot: str) -> None:
    found = run_ompl(
        WORLD
        + f"""
robot = {robot}
problem = SE2Problem(world, robot, ends)
before, address = answers(problem, 300), id(problem.information)
same, old = [], before
for edit in (dict(add=[Disc((5.0, 5.0), 1.0)]), dict(move={{0: (0.0, 3.0)}}), dict(remove=[0])):
    world = world.edited(**edit)
    problem.update(world)
    now = answers(problem, 300)
    same.append([now == answers(SE2Problem(world, robot, ends), 300), now != old])
    old = now
tell(same=same, address=id(problem.information) == address, counted=problem.validity.checked)
"""
    )
    assert found["same"] == [[True, True]] * 3
    assert found["address"]
    assert found["counted"] == 1200


def test_planners_find_their_way_in_the_changed_world(run_ompl: Any) -> None:
    found = run_ompl(
        WORLD
        + """
world = World("hall", world.bounds, (Rectangle((10.0, 3.0), 0.5, 6.0),), world.robot)
problem = SE2Problem(world, query=ends)
for name, limit in (("RRTConnect", 5.0), ("landmark", 0.5)):  # one ends at its first path, the other at the limit
    problem.update(world)
    problem.set_planner(OmplLandmarkPlanner(problem.information, seed=1) if name == "landmark" else name)
    problem.solve(limit)
    over = problem.path
    # What was the passage is closed, whatever the way through it, and the wall below it opened.
    moved = world.edited(move={0: (0.0, 4.0)})
    problem.update(moved)
    problem.solve(limit)
    under = problem.path
    anew = StateChecker(moved)
    free = [bool(anew.motions_valid(path.states[:-1], path.states[1:]).all()) for path in (over, under)]
    tell(**{name: [bool(max(over.states[:, 1]) > 4.0), *free]})
"""
    )
    assert found == {"RRTConnect": [True, False, True], "landmark": [True, False, True]}


def test_the_landmark_planner_keeps_its_roadmap(run_ompl: Any) -> None:
    found = run_ompl(
        WORLD
        + """
from trailmark import PlannerSettings
problem = SE2Problem(world, query=ends)
quick = PlannerSettings(first_landmarks=60, patience=1)
planner = problem.set_planner(OmplLandmarkPlanner(problem.information, seed=1, settings=quick))
problem.solve(5.0)
landmarks = planner.roadmap.graph.number_of_nodes()
problem.update(world.edited(add=[Disc((2.0, 9.0), 0.2)]))
problem.solve(0.0)
tell(landmarks=landmarks, kept=planner.roadmap.graph.number_of_nodes(), world=planner.checker.world is problem.world)
"""
    )
    assert found["landmarks"] > 10
    assert found["kept"] > 0.8 * found["landmarks"]
    assert found["world"]


def test_what_does_not_fit_changes_nothing(run_ompl: Any) -> None:
    found = run_ompl(
        WORLD
        + """
from dataclasses import replace
problem = SE2Problem(world, query=ends)
small, robot = replace(world, bounds=(0.0, 0.0, 15.0, 10.0)), StateChecker(world, Robot.disc(0.3))
messages = []
for part in (problem, problem.validity, problem.motions, OmplLandmarkPlanner(problem.information)):
    for wrong in (small, "hall"):
        try:
            part.update(wrong)
        except Exception as error:
            messages.append(f"{type(error).__name__}: {error}")
for part in (problem.validity, problem.motions):
    try:
        part.update(robot)
    except Exception as error:
        messages.append(f"{type(error).__name__}: {error}")
tell(messages=messages, world=problem.validity.checker.world is world and problem.motions.checker.world is world)
"""
    )
    assert [message.partition(": ")[0] for message in found["messages"]] == [
        *["BoundsError", "ConfigurationError"] * 3, "BoundsError", "WorldError", *["ConfigurationError"] * 2
    ]  # fmt: skip
    assert found["world"]
