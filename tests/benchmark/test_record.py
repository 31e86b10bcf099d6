"""RunRecord and Status."""

from __future__ import annotations

import json

import pytest
from ompl import base as ob
from tests.benchmark.conftest import solved

from trailmark.benchmark.record import RunRecord, Status


def test_statuses_have_ompls_numbers() -> None:
    for status in Status:
        assert getattr(ob.PlannerStatus, status.name).value == status


def test_a_record_survives_json() -> None:
    record = solved(3)
    assert RunRecord.from_json(json.loads(json.dumps(record.to_json()))) == record


def test_unknown_names_are_left_out() -> None:
    assert RunRecord.from_json({"status": 4, "weather": "fine"}) == RunRecord(status=4)


@pytest.mark.parametrize("answer", [{"status": 77}, {"time": float("nan")}, {"memory": float("inf")}])
def test_what_ompl_or_sqlite_would_not_take_is_refused(answer: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"77|finite"):
        RunRecord.from_json(answer)
