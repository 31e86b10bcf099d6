"""Wrong arguments of the bridge are told in one line of trailmark's own, before OMPL sees them."""

from __future__ import annotations

from typing import Any

import pytest
from ompl import base as ob
from ompl import geometric as og

from trailmark.ompl_bridge.errors import PlannerNameError
from trailmark.ompl_bridge.planners import parameters_of, planner_names, set_parameters

WRONG = """
import numpy as np
from trailmark import Disc, Query, Robot, StateChecker, TrailmarkError, World
query = Query("a", (1, 1, 0), (5, 1, 0))
world = World("room", (0, 0, 6, 4), (Disc((3, 2), 0.5),), Robot.rectangle(0.6, 0.4), queries=(query,))
other = StateChecker(world, Robot.disc(0.1))
problem = SE2Problem(world)
information, checker = problem.information, problem.checker
ends = ((1, 1, 0), (5, 1, 0))
line, unbound, wide, bounds = ob.RealVectorStateSpace(2), ob.SE2StateSpace(), ob.SE2StateSpace(), ob.RealVectorBounds(2)
bounds.setLow(-1.0); bounds.setHigh(50.0)
line.setBounds(bounds); wide.setBounds(bounds)
class Odd(ob.OptimizationObjective):
    def stateCost(self, s): return ob.Cost(1.0)
    def motionCost(self, a, b): return ob.Cost(1.0)
def with_odd_objective():
    posed = SE2Problem(world)
    posed.set_planner(OmplLandmarkPlanner(posed.information))
    posed.setup.setOptimizationObjective(Odd(posed.information))
    posed.solve(1.0)
calls = {
    "world": lambda: SE2Problem("office"),
    "robot": lambda: SE2Problem(world, "disc:1"),
    "query": lambda: SE2Problem(world, None, 3),
    "text ends": lambda: SE2Problem(world, None, (("1", "1", "0"), ends[1])),
    "checker": lambda: SE2Problem(world, checker=world),
    "other checker": lambda: SE2Problem(world, world.robot, checker=other),
    "certified": lambda: SE2Problem(world, certified="yes"),
    "resolution": lambda: SE2Problem(world, resolution="1"),
    "limit": lambda: problem.solve("1"),
    "no limit": lambda: solve(problem.setup, None),
    "validity": lambda: StateValidityChecker(information, world),
    "motions": lambda: MotionValidator(information, "checker"),
    "planner's seed": lambda: OmplLandmarkPlanner(information, seed=1.5),
    "planner's checker": lambda: OmplLandmarkPlanner(information, world),
    "source's seed": lambda: LandmarkSource(checker, seed="1"),
    "source's checker": lambda: LandmarkSource(world),
    "plug's checker": lambda: plug_landmark_sampler(problem.setup, checker=3),
    "no checker": lambda: plug_landmark_sampler(og.SimpleSetup(problem.space)),
    "planner without checker": lambda: OmplLandmarkPlanner(ob.SpaceInformation(problem.space)),
    "line": lambda: MotionValidator(ob.SpaceInformation(line), checker),
    "no bounds": lambda: MotionValidator(ob.SpaceInformation(unbound), checker),
    "wide": lambda: StateValidityChecker(ob.SpaceInformation(wide), checker),
    "wide plug": lambda: plug_landmark_sampler(og.SimpleSetup(wide), checker=checker),
    "one landmark": lambda: LandmarkSource(checker, [1.0, 2.0, 0.0]),
    "columns": lambda: plug_landmark_sampler(problem.setup, [[1.0, 2.0]]),
    "text landmark": lambda: LandmarkSource(checker, "here"),
    "invalid landmark": lambda: plug_landmark_sampler(problem.setup, [[1.0, 1.0, 0.0], [3.0, 2.0, 0.0]]),
    "outside": lambda: LandmarkSource(checker, [[1.0, 1.0, 0.0]], bounds=(2.0, 0.0, 6.0, 4.0)),
    "objective": with_odd_objective,
    "planner's name": lambda: problem.set_planner("RTTConnect"),
    "query's name": lambda: SE2Problem(world, query="b"),
    "start": lambda: SE2Problem(world, query=((-5, 0, 0), (1, 1, 0))),
    "no robot": lambda: SE2Problem(World("bare", world.bounds), query=ends),
}
said = {}
for name, call in calls.items():
    try:
        call()
        said[name] = "nothing"
    except TrailmarkError as error:
        said[name] = str(error)
    except Exception as error:
        said[name] = f"RAW {error!r}"
tell(said=said, solved=problem.solve(np.float64(0.2)).asString())
"""


def test_wrong_arguments_are_errors_of_our_own(run_ompl: Any) -> None:
    found = run_ompl(WRONG)
    raw = {name: text for name, text in found["said"].items() if text == "nothing" or text.startswith("RAW")}
    assert raw == {}
    assert [text for text in found["said"].values() if "\n" in text] == []
    assert "expected one for robot" in found["said"]["other checker"]
    assert found["said"]["limit"] == "limit: expected a finite number of 0 or more, got '1' s"
    assert "landmark 1 (3, 2, 0) is not valid" in found["said"]["invalid landmark"]
    assert "did you mean 'RRTConnect'?" in found["said"]["planner's name"]
    assert "within world 'room'" in found["said"]["wide"]
    assert "solution" in found["solved"].lower()


def test_the_planners_old_name_is_told_of() -> None:
    from trailmark import ompl_bridge

    with pytest.warns(DeprecationWarning, match="expected OmplLandmarkPlanner"):
        assert ompl_bridge.LandmarkPlanner is ompl_bridge.OmplLandmarkPlanner


def test_parameters_are_those_that_the_planners_own_getters_tell() -> None:
    information = ob.SpaceInformation(ob.SE2StateSpace())
    star, batches = og.RRTstar(information), og.BITstar(information)
    set_parameters("RRTstar", {"range": "2.5", "goal_bias": "0.25", "use_k_nearest": "false"})(star)
    assert (star.getRange(), star.getGoalBias(), star.getKNearest()) == (2.5, 0.25, False)
    set_parameters("BITstar", {"samples_per_batch": "7", "use_graph_pruning": "0"})(batches)
    assert (batches.getSamplesPerBatch(), batches.getPruning()) == (7, False)
    for name in planner_names():
        known = parameters_of(name)
        assert known
        assert all(parameter.replace("_", "").islower() for parameter in known)
        assert len({setter for setter, _ in known.values()}) == len(known)
    with pytest.raises(PlannerNameError, match="parameter: expected max_nearest_neighbors, got 'range'"):
        set_parameters("PRM", {"range": "1"})
