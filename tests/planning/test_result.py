"""PlanResult as a record of plain values."""

from __future__ import annotations

import json

import numpy as np
import pytest

from trailmark.planning import PlanResult
from trailmark.trajectories.path import Path


def test_a_solved_result() -> None:
    path = Path(np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 1.0], [3.0, 4.0, -1.0]]))
    times: dict[str, float | None] = {"load": 0.25, "build": 0.5, "first_solution": 1.0, "total": 2.0}
    result = PlanResult("solved", path, 7, 5.5, 9.0, 0.125, 20, 30, ((1.0, 9.0), (2.0, 6.5)), times)
    assert result.cost == 6.5
    record = result.to_dict("office", "door")
    assert record == {
        "world": "office",
        "query": "door",
        "planner": "landmark",
        "status": "solved",
        "reason": "",
        "seed": 7,
        "states": [[0.0, 0.0, 0.0], [3.0, 4.0, 1.0], [3.0, 4.0, -1.0]],
        "cost": 6.5,
        "length": 5.0,
        "rotation": 3.0,
        "min_clearance": 0.125,
        "lower_bound": 5.5,
        "first_cost": 9.0,
        "landmarks": 20,
        "edges": 30,
        "history": [[1.0, 9.0], [2.0, 6.5]],
        "time": times,
    }
    assert json.loads(json.dumps(record, allow_nan=False)) == record
    # A copy: filling in the time of loading does not change the result.
    record["time"]["load"] = 9.0
    assert result.time["load"] == 0.25


@pytest.mark.parametrize("status", ["timeout", "infeasible"])
def test_a_result_without_a_path(status: str) -> None:
    bound = 5.5 if status == "timeout" else None
    result = PlanResult(status, None, 7, bound, None, None, 20, 30)  # type: ignore[arg-type]  # a parameter of the test
    assert result.cost is None
    record = result.to_dict("office")
    assert (record["query"], record["status"], record["states"], record["history"]) == (None, status, [], [])
    assert [record[key] for key in ("cost", "length", "rotation", "min_clearance", "first_cost")] == [None] * 5
    assert record["lower_bound"] == bound
    assert json.loads(json.dumps(record, allow_nan=False)) == record
