"""Proofs in the background: found, not found, cancelled; threads that end."""

from __future__ import annotations

import threading
from time import perf_counter
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from trailmark.collision import StateChecker
from trailmark.planning import LandmarkPlanner, PlannerSettings, PlanProgress
from trailmark.planning.proofs.prover import BackgroundProof, Prover
from trailmark.planning.query import Clock
from trailmark.shapes import Rectangle
from trailmark.world import Robot, World

ROD = Robot.rectangle(2.0, 0.3)
SLIT = World(
    "slit",
    (0, 0, 8, 6),
    (
        Rectangle((4.0, 1.4), 0.5, 2.8),
        Rectangle((4.0, 4.6), 0.5, 2.8),
    ),
    ROD,
)
"""A wall with a gap 0.4 m wide, which the rod gets through straight on."""
SHUT = World("shut", (0, 0, 8, 6), (*SLIT.obstacles, Rectangle((3.2, 3.0), 0.2, 1.8)), ROD)
"""The same gap with a pillar before it, which the inscribed disc gets around."""

ENDS = (np.array([1.5, 3.0, 1.5]), np.array([6.5, 3.0, 1.5]))


def others() -> int:
    return sum(thread.name == "proof of infeasibility" for thread in threading.enumerate())


@pytest.mark.slow
def test_a_proof_is_found() -> None:
    proof = BackgroundProof(StateChecker(SHUT), *ENDS, 60.0)
    proof.begin()
    proof.wait(60.0)
    assert proof.found
    proof.end()
    assert others() == 0


def test_nothing_is_found_where_there_is_a_path() -> None:
    assert LandmarkPlanner(SLIT, seed=0).plan(*ENDS, 20.0, gap=np.inf).status == "solved"
    proof = BackgroundProof(StateChecker(SLIT), *ENDS, 0.3)
    proof.begin()
    proof.wait(60.0)
    assert not proof.found
    assert others() == 0


def test_what_is_no_longer_wanted_ends_soon() -> None:
    running, unwanted = (BackgroundProof(StateChecker(world), *ENDS, 3600.0) for world in (SLIT, SHUT))
    running.begin()
    running.cancel()
    # This one would be found, were it not for that.
    unwanted.cancel()
    unwanted.begin()
    for proof in (running, unwanted):
        waiting = threading.Thread(target=proof.end, daemon=True)
        waiting.start()
        waiting.join(120.0)
        assert not waiting.is_alive()
        assert not proof.found
    assert others() == 0


class Asked:
    """A query as a prover sees it; the seconds left are those of a list, one after the other."""

    solved, motion = False, SimpleNamespace(turns=True)
    settings = PlannerSettings()

    def __init__(self, world: World, left: list[float]) -> None:
        self.checker, self.left = StateChecker(world), left
        self.incumbent = SimpleNamespace(start=ENDS[0], goal=ENDS[1], bounded=False, infeasible=False, claim=self.claim)
        self.incumbent.whole_cost = np.inf

    def claim(self, cost: float) -> None:
        self.incumbent.infeasible = cost == np.inf

    def seconds_left(self) -> float:
        return self.left.pop(0) if len(self.left) > 1 else self.left[0]


class Staged:
    """A bound of which it is known only once its region is made that an end is shut in, which takes little to prove."""

    def __init__(self) -> None:
        self.begun, self.asked = False, 0

    def seconds(self, *_query: object) -> float:
        return 0.01 if self.begun else 1.0

    def seconds_for_region(self) -> float:
        return 0.0 if self.begun else 0.2

    def make_region(self, _left: float) -> None:
        self.begun = True

    def known(self, *_query: object) -> float:
        return 1.0

    def of(self, *_query: object) -> Any:
        self.asked += 1
        return SimpleNamespace(cost=np.inf)


@pytest.mark.parametrize(
    ("left", "solved", "proven"), [(0.7, False, False), (0.9, False, True), (0.9, True, False), (9.0, True, True)]
)
def test_the_region_is_made_where_there_is_time_for_that_and_no_path_yet(
    left: float, solved: bool, proven: bool
) -> None:
    query: Any = Asked(SHUT, [left])
    query.solved = solved
    bound: Any = Staged()
    proofs = Prover(query, bound)
    for _ in range(2):
        proofs.bound_below(0.25)
    assert query.incumbent.infeasible == proven == bool(bound.asked)
    assert bound.asked <= 1
    assert bound.begun == (proven and not solved)
    # Who asks what a region takes that is not made yet is told all of it.
    assert proofs.seconds() == 1.0


@pytest.mark.slow
def test_a_proof_is_waited_for_no_longer_than_it_takes() -> None:
    query: Any = Asked(SHUT, [100.0])
    with Prover(query, cast(Any, object())) as proofs:
        proofs.wait(60.0)  # none has begun
        proofs.begin_in_background()
        assert not proofs.infeasible()
        proofs.wait(60.0)
        assert proofs.infeasible()
    assert others() == 0


@pytest.mark.parametrize(("left", "seconds"), [([9.0, 9.0, 9.0, 0.0], 60.0), ([9.0], 0.02)])
def test_who_is_stopped_or_has_waited_enough_waits_no_longer(left: list[float], seconds: float) -> None:
    query: Any = Asked(SLIT, left)
    with Prover(query, cast(Any, object())) as proofs:
        proofs.begin_in_background()
        proofs.wait(seconds)
        assert len(query.left) == 1  # asked until the last answer, which ends it
        query.left = [9.0, 8.0]
        proofs.wait(2.0)
        assert query.left == [9.0, 8.0]
        assert not proofs.infeasible()


@pytest.mark.slow
def test_planning_ends_with_the_proof_and_leaves_no_thread() -> None:
    result = LandmarkPlanner(SHUT, seed=0).plan(*ENDS, 60.0)
    assert result.status == "infeasible"
    assert others() == 0
    # Asked for rounds instead of time, the same.
    assert LandmarkPlanner(SHUT, seed=0).plan(*ENDS, 60.0, max_iterations=2).status == "infeasible"


@pytest.mark.slow
def test_an_error_ends_the_thread_too() -> None:
    def fail(progress: PlanProgress) -> None:
        if others() == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        LandmarkPlanner(SHUT, seed=0).plan(*ENDS, 60.0, on_progress=fail)
    assert others() == 0


@pytest.mark.slow
def test_a_proof_is_waited_for_without_a_limit_of_time_until_planning_is_told_to_stop() -> None:
    assert LandmarkPlanner(SHUT, seed=0).plan(*ENDS, np.inf, max_iterations=2).status == "infeasible"

    class Endless:
        running, found, waits = True, False, 0

        def wait(self, seconds: float) -> None:
            self.waits += 1

        def end(self) -> None:
            pass

    for limit in (60.0, np.inf):
        asked = iter([False] * 20)
        clock = Clock(perf_counter(), limit, lambda asked=asked: next(asked, True))  # type: ignore[misc]
        query: Any = Asked(SLIT, [1.0])
        query.seconds_left = clock.seconds_left
        with Prover(query, None) as proofs:
            proofs._background = endless = cast(Any, Endless())
            band: Any = SimpleNamespace(shortest=1.0)
            proofs.conclude(band)
        assert 0 < endless.waits <= 20
