"""Planners by name."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from trailmark.benchmark.errors import SuiteError
from trailmark.benchmark.planners import known_planners, read_planners, settings_of
from trailmark.ompl_bridge import planner_names
from trailmark.planning.settings import METHODS


@pytest.fixture
def no_native(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trailmark.benchmark.planners.native_peer", lambda: None)


@pytest.mark.usefixtures("no_native")
def test_all_are_trailmarks_and_ompls_in_both_baselines() -> None:
    wanted = {*METHODS, *planner_names(), *(f"{name}+certified" for name in planner_names())}
    assert set(read_planners(["all"])) == set(known_planners()) == wanted
    assert {"PRM", "RRTstar+certified"} <= wanted


@pytest.mark.usefixtures("no_native")
@pytest.mark.parametrize(
    ("given", "problem"),
    [
        (["PMR"], r"^planner: expected PRM, got 'PMR' \(did you mean 'PRM'"),
        (["Foo"], r"^planner: expected all, landmark, lattice, paper, roadmap, roadmap-uniform, got 'Foo', or one of"),
        (["PRM+certain"], "did you mean 'PRM.certified'"),
        (["landmark+certified"], r"^planner: expected .*, got 'landmark\+certified'"),
        (["native:PRM"], "the native program is not built"),
        (["nosuchmodule:plan"], "there is no module 'nosuchmodule'"),
        ([], "no planner given"),
    ],
)
def test_other_names_are_refused(given: list[str], problem: str) -> None:
    with pytest.raises(SuiteError, match=problem):
        read_planners(given)


def test_a_function_of_the_users_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "my_planner.py").write_text("def plan(*args): pass\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    assert read_planners(["my_planner:plan"]) == ["my_planner:plan"]


def test_each_counts_once_as_it_is_spelt_with_its_parameters() -> None:
    given = ["rrtconnect+CERTIFIED:range=2", "prm", "Landmark:first_landmarks=50", "PRM"]
    assert read_planners(given) == ["RRTConnect+certified:range=2", "PRM", "landmark:first_landmarks=50"]
    assert "range=2, else default settings" in settings_of("RRTConnect+certified:range=2")
    assert "first_landmarks=50" in settings_of("landmark:first_landmarks=50")


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("RRTConnect:rnge=2", r"planner RRTConnect: parameter: expected .*, range, got 'rnge' \(did you mean 'range'"),
        ("RRTConnect:range=x", "planner RRTConnect: range: expected a finite number, 0 or more, got 'x'"),
        ("RRTstar:use_k_nearest=maybe", "use_k_nearest: expected true or false, got 'maybe'"),
        ("RRT:range=1,range=2", "expected PLANNER:name=value,name=value, each once, got 'range=2'"),
        ("landmark:first=1", "planner landmark: setting: expected .*, got 'first'"),
        ("landmark:sweeps=0", "planner landmark: sweeps: expected a whole number, 1 or more, got 0"),
        ("json:dumps:a=1", "expected no parameters, for 'json:dumps' takes none"),
    ],
)
def test_other_parameters_are_refused(name: str, problem: str) -> None:
    with pytest.raises(SuiteError, match=problem):
        read_planners([name])


def test_lattices_do_not_plan_for_cars() -> None:
    assert "lattice" in read_planners(["all"])
    assert "lattice" not in read_planners(["all"], cars=True)
    with pytest.raises(SuiteError, match="expected one that plans for cars, got 'lattice'"):
        read_planners(["lattice"], cars=True)
    assert read_planners(["roadmap", "paper"], cars=True) == ["roadmap", "paper"]


def test_parameters_of_native_planners_are_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    names = {"native:PRM": ["max_nearest_neighbors"]}
    peer = SimpleNamespace(native_planners=lambda: list(names), native_parameters=names.__getitem__)
    monkeypatch.setattr("trailmark.benchmark.planners.native_peer", lambda: peer)
    assert read_planners(["native:prm:max_nearest_neighbors=3"]) == ["native:PRM:max_nearest_neighbors=3"]
    with pytest.raises(SuiteError, match="planner native:PRM: parameter: expected max_nearest_neighbors, got 'range'"):
        read_planners(["native:PRM:range=1"])
    with pytest.raises(SuiteError, match="max_nearest_neighbors: expected a number, true or false, got 'x'"):
        read_planners(["native:PRM:max_nearest_neighbors=x"])
