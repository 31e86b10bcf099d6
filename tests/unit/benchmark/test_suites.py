"""Suites, and the ones in benchmarks/suites."""

from __future__ import annotations

from pathlib import Path

import pytest

from trailmark import FormatError, Query
from trailmark.benchmark.planners import read_planners
from trailmark.benchmark.suites import read_suite

SUITES = Path(__file__).resolve().parents[3] / "benchmarks" / "suites"

TEXT = """\
planners: [landmark, PRM]
runs: 3
time_limit: 0.5
data: real
worlds:
  - office
  - {world: yard.yaml, robot: "disc:0.2", queries: [door, {name: new, start: [1, 2, 0], goal: [3, 4, 0]}]}
  - {world: "data:maps/town.map"}
"""


def test_a_suite_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TRAILMARK_DATA", raising=False)
    (tmp_path / "yard.yaml").touch()
    (tmp_path / "suite.yaml").write_text(TEXT)
    suite = read_suite(tmp_path / "suite.yaml")
    office, yard, town = suite.entries
    assert (suite.planners, suite.runs, suite.time_limit, suite.memory_limit) == (("landmark", "PRM"), 3, 0.5, None)
    assert (office.world, office.optional, office.names, office.queries) == ("office", False, (), ())
    assert yard.world == str(tmp_path / "yard.yaml")
    assert yard.robot == "disc:0.2"
    assert yard.names == ("door",)
    assert yard.queries == (Query("new", (1.0, 2.0, 0.0), (3.0, 4.0, 0.0)),)
    assert town.world == str(tmp_path / "real" / "maps" / "town.map")
    assert town.missing
    assert not office.missing
    monkeypatch.setenv("TRAILMARK_DATA", str(tmp_path / "there"))
    assert read_suite(tmp_path / "suite.yaml").entries[2].world == str(tmp_path / "there" / "maps" / "town.map")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("- a\n", "expected a mapping with planners"),
        ("planers: [PRM]\nworlds: [office]\n", "planers: unknown key"),
        ("planners: [PRM]\n", "worlds: field required"),
        ("worlds: []\n", "worlds: list should have at least 1 item"),
        ("worlds: [office]\nruns: many\n", "runs: input should be a valid integer, got 'many'"),
        ("worlds: [office]\nplanners: PRM\n", "planners: input should be a valid list, got 'PRM'"),
        ("worlds: [{robot: disc}]\n", r"worlds\[0\]\.world: field required"),
        ("worlds: [{world: office, robot: 3}]\n", r"worlds\[0\]\.robot: input should be a valid string, got 3"),
        ("worlds: [{world: office, queries: door}]\n", r"worlds\[0\]\.queries: input should be a valid list"),
        ("worlds: [{world: office, queries: [3]}]\n", r"queries\[0\]: input should be a valid dictionary, got 3"),
        ("worlds: [{world: office, queries: [{name: a, start: [0, 0, 0]}]}]\n", "goal: field required"),
        ("worlds: [{world: office, queries: [{name: a, start: [0, 0], goal: [1, 1, 0]}]}]\n", "start"),
    ],
)
def test_what_is_no_suite_is_reported_in_one_line(text: str, problem: str, tmp_path: Path) -> None:
    (tmp_path / "suite.yaml").write_text(text)
    with pytest.raises(FormatError, match=problem):
        read_suite(tmp_path / "suite.yaml")


@pytest.mark.parametrize("file", sorted(SUITES.glob("*.yaml")), ids=lambda file: file.stem)
def test_the_suites_that_ship_can_be_run(file: Path) -> None:
    suite = read_suite(file)
    assert read_planners(suite.planners)
    assert all(Path(entry.world).suffix == "" for entry in suite.entries if not entry.optional), (
        "shipped worlds by name"
    )
