"""Wrong arguments are told in one line of trailmark's own; numpy's numbers are numbers."""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from tests.helpers.wrong import WRONG

from trailmark import (
    CurvePath,
    Disc,
    LandmarkPlanner,
    Path,
    Polygon,
    Query,
    Rectangle,
    Robot,
    StateChecker,
    Steering,
    TrailmarkError,
    World,
)
from trailmark.arguments import number_array, whole
from trailmark.errors import ConfigurationError, ShapeError, WorldError

WORLD = World("room", (0.0, 0.0, 6.0, 4.0), (Disc((3.0, 2.0), 0.5),), Robot.rectangle(0.6, 0.4))
A, B = (1.0, 1.0, 0.0), (5.0, 1.0, 1.0)
KNOTS = [[1.0, 1.0, 0.0], [3.0, 2.0, 1.0]]


@pytest.fixture(scope="module")
def planner() -> LandmarkPlanner:
    planner = LandmarkPlanner(WORLD, seed=0)
    planner.build(20)
    return planner


def entries(planner: LandmarkPlanner) -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    """Return the public ways in, each with arguments that are right."""
    checker, path, steering = planner.checker, Path(np.array(KNOTS)), Steering(0.5)
    curves = CurvePath(np.array(KNOTS), steering)
    parking = World("queries", WORLD.bounds, queries=(Query("a", A, B),))
    few = {"time_limit": 0.01, "max_iterations": 1, "gap": 0.1, "on_progress": None, "stop": None}
    many = {"time_limit": 0.01, "workers": 1, "max_iterations": 1, "on_progress": None}
    return {
        "Disc": (Disc, {"center": (1.0, 2.0), "radius": 1.0}),
        "Rectangle": (Rectangle, {"center": (1.0, 2.0), "length": 1.0, "width": 1.0, "heading": 0.0}),
        "Polygon": (Polygon, {"vertices": [[0, 0], [1, 0], [0, 1]], "holes": ()}),
        "Robot": (Robot, {"footprint": Disc((0, 0), 1.0), "turning_radius": 1.0, "reverse": True}),
        "Robot.disc": (Robot.disc, {"radius": 1.0}),
        "Robot.rectangle": (Robot.rectangle, {"length": 1.0, "width": 1.0}),
        "Robot.polygon": (Robot.polygon, {"vertices": [[0, 0], [1, 0], [0, 1]]}),
        "Robot.parse": (Robot.parse, {"text": "disc:1"}),
        "Robot.steered": (Robot.disc(1.0).steered, {"turning_radius": 1.0, "reverse": True}),
        "Query": (Query, {"name": "a", "start": A, "goal": B}),
        "World": (
            World,
            {
                "name": "a",
                "bounds": (0, 0, 1, 1),
                "obstacles": (),
                "robot": None,
                "boundary": None,
                "queries": (),
                "estimates": (),
                "risk": None,
            },
        ),
        "World.query": (parking.query, {"name": None}),
        "StateChecker": (StateChecker, {"world": WORLD, "robot": None, "cell": None}),
        "valid": (checker.valid, {"q": A}),
        "clearance": (checker.clearance, {"q": A, "cap": 1.0}),
        "motions_valid": (checker.motions_valid, {"a": [A], "b": [B]}),
        "motion_valid": (checker.motion_valid, {"a": A, "b": B}),
        "motions_between_valid": (checker.motions_between_valid, {"a": [A], "b": [B]}),
        "motions_by_field": (checker.motions_by_field, {"a": [A], "b": [B]}),
        "disc_center": (checker.disc_center, {"q": A}),
        "require_for": (checker.require_for, {"world": WORLD, "robot": None}),
        "Path": (Path, {"states": KNOTS}),
        "Path.at": (path.at, {"fraction": 0.5}),
        "Path.resample": (path.resample, {"step": 1.0}),
        "CurvePath": (CurvePath, {"knots": KNOTS, "steering": steering}),
        "CurvePath.at": (curves.at, {"fraction": 0.5}),
        "CurvePath.resample": (curves.resample, {"step": 1.0}),
        "Steering": (Steering, {"radius": 1.0, "reverse": True}),
        "Steering.of": (Steering.of, {"robot": Robot.disc(1.0)}),
        "Steering.lengths": (steering.lengths, {"a": A, "b": B}),
        "Steering.curves": (steering.curves, {"a": A, "b": B}),
        "Steering.states": (steering.states, {"a": A, "b": B, "along": [0.1, 0.2]}),
        "LandmarkPlanner": (
            LandmarkPlanner,
            {"world": WORLD, "robot": None, "seed": 0, "landmarks": None, "checker": None, "warm": False},
        ),
        "build": (planner.build, {"landmarks": 5}),
        "plan": (planner.plan, {"start": A, "goal": B, **few}),
        "plan_many": (planner.plan_many, {"starts": [A], "goals": [B], **many}),
    }


NAMES = [
    *("Disc", "Rectangle", "Polygon", "Robot", "Robot.disc", "Robot.rectangle", "Robot.polygon", "Robot.parse"),
    *("Robot.steered", "Query", "World", "World.query", "StateChecker", "valid", "clearance", "motions_valid"),
    *("motion_valid", "motions_between_valid", "motions_by_field", "disc_center", "require_for"),
    *("Path", "Path.at", "Path.resample", "CurvePath", "CurvePath.at", "CurvePath.resample"),
    *("Steering", "Steering.of", "Steering.lengths", "Steering.curves", "Steering.states", "LandmarkPlanner"),
    *("build", "plan", "plan_many"),
]


@pytest.mark.parametrize("name", NAMES)
def test_nothing_raw_comes_out(planner: LandmarkPlanner, name: str) -> None:
    call, right = entries(planner)[name]
    call(**right)
    told: list[str] = []
    for argument in right:
        for wrong in WRONG:
            try:
                call(**(right | {argument: wrong}))
            except TrailmarkError as error:
                told.append(str(error))
    assert len(told) > 5 * len(right)
    assert [line for line in told if "\n" in line or len(line) > 500] == []


NUMBERS: list[Callable[[float], Any]] = [np.float64, np.float32, np.array, Fraction, Decimal]


@pytest.mark.parametrize("kind", NUMBERS)
def test_numbers_of_all_kinds_are_taken(planner: LandmarkPlanner, kind: Callable[[float], Any]) -> None:
    assert Disc((kind(0.5), 2), kind(0.25)) == Disc((0.5, 2.0), 0.25)
    assert Steering(kind(0.5)) == Steering(0.5)
    assert planner.plan(A, B, kind(0.25), gap=kind(0.5)).status == "solved"
    assert World("a", (kind(0), kind(0), kind(4), kind(4))).bounds == (0.0, 0.0, 4.0, 4.0)
    assert planner.checker.clearance(A, cap=kind(0.125)) == 0.125


@pytest.mark.parametrize("kind", [np.int64, np.uint8, np.float64, float, np.array])
def test_whole_numbers_of_all_kinds_are_taken(kind: Callable[[int], Any]) -> None:
    planner = LandmarkPlanner(WORLD, seed=kind(3), landmarks=kind(7), warm=False)
    assert planner.seed == 3
    assert type(planner.seed) is int
    assert len(planner.plan_many([A], [B], workers=kind(2), max_iterations=kind(1))) == 1


def test_large_seeds_keep_their_digits() -> None:
    assert whole(2**70 + 1, "seed:", 0) == 2**70 + 1
    with pytest.raises(ConfigurationError):
        whole(Fraction(7, 2), "seed:", 0)


def test_arrays_are_new_and_in_c_order() -> None:
    given = np.asfortranarray(np.arange(6.0).reshape(2, 3))
    found = number_array(given, "q")
    assert found.flags.c_contiguous
    assert found is not given
    assert number_array(np.ma.masked_array(np.array([1, 2, 3]), mask=[False, False, False]), "q").tolist() == [
        1.0,
        2.0,
        3.0,
    ]
    assert number_array([Fraction(1, 4), 2, Decimal(3)], "q").tolist() == [0.25, 2.0, 3.0]
    with pytest.raises(ConfigurationError):
        number_array([Fraction(1, 4), "2", 3], "q")


def test_a_checker_for_something_else_is_refused() -> None:
    other = StateChecker(WORLD, Robot.disc(0.1))
    with pytest.raises(
        ConfigurationError, match=r"checker: expected one for robot .*, got one for disc 0\.1 m .*leave robot out"
    ):
        LandmarkPlanner(WORLD, WORLD.robot, checker=other, warm=False)
    assert LandmarkPlanner(WORLD, checker=other, warm=False).robot == Robot.disc(0.1)
    empty = World("empty", WORLD.bounds)
    with pytest.raises(ConfigurationError, match=r"checker: expected one for world 'empty' as it is, .* \('room'\)"):
        LandmarkPlanner(empty, Robot.disc(0.1), checker=other, warm=False)
    alike = World("room", WORLD.bounds, WORLD.obstacles)  # the same, but for the robot that it names
    assert LandmarkPlanner(alike, Robot.disc(0.1), checker=other, warm=False).checker is other


def test_no_queries_have_no_answers(planner: LandmarkPlanner) -> None:
    assert planner.plan_many([], []) == []
    assert planner.plan_many(np.empty((0, 3)), np.empty((0, 3))) == []
    with pytest.raises(ConfigurationError):
        planner.plan_many([], [B])


def test_errors_are_of_the_part_that_was_asked() -> None:
    with pytest.raises(WorldError):
        World("a", (0, 0, 1, 1), [1])  # type: ignore[arg-type]  # the point
    with pytest.raises(ShapeError):
        Robot(3)  # type: ignore[arg-type]  # the point
