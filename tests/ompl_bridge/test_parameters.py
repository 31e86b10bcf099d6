"""The parameters of OMPL's planners, against the values that its own getters tell."""

from __future__ import annotations

import pytest
from ompl import base as ob
from ompl import geometric as og

from trailmark.ompl_bridge.errors import PlannerNameError
from trailmark.ompl_bridge.planners import parameters_of, planner_names, set_parameters


def information() -> ob.SpaceInformation:
    return ob.SpaceInformation(ob.SE2StateSpace())


def test_what_is_given_is_what_the_planner_has() -> None:
    star = og.RRTstar(information())
    set_parameters("RRTstar", {"range": "2.5", "goal_bias": "0.25", "use_k_nearest": "false"})(star)
    assert (star.getRange(), star.getGoalBias(), star.getKNearest()) == (2.5, 0.25, False)
    batches = og.BITstar(information())
    set_parameters("BITstar", {"samples_per_batch": "7", "use_graph_pruning": "0"})(batches)
    assert (batches.getSamplesPerBatch(), batches.getPruning()) == (7, False)


@pytest.mark.parametrize("name", planner_names())
def test_every_planner_has_parameters_under_names_of_small_letters(name: str) -> None:
    known = parameters_of(name)
    assert known
    assert all(parameter.replace("_", "").islower() for parameter in known)
    assert len({found.setter for found in known.values()}) == len(known)


def test_other_parameters_are_refused() -> None:
    with pytest.raises(PlannerNameError, match="parameter: expected max_nearest_neighbors, got 'range'"):
        set_parameters("PRM", {"range": "1"})
