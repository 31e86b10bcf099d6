"""Proofs in the background: found, not found, cancelled; threads that end."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from trailmark.collision import StateChecker
from trailmark.planning import LandmarkPlanner
from trailmark.planning.proofs.prover import BackgroundProof
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


@pytest.mark.slow
def test_planning_ends_with_the_proof_and_leaves_no_thread() -> None:
    result = LandmarkPlanner(SHUT, seed=0).plan(*ENDS, 60.0)
    assert result.status == "infeasible"
    assert others() == 0
    # Asked for rounds instead of time, the same.
    assert LandmarkPlanner(SHUT, seed=0).plan(*ENDS, 60.0, max_iterations=2).status == "infeasible"


@pytest.mark.slow
def test_an_error_ends_the_thread_too() -> None:
    def fail() -> bool:
        if others() == 1:
            raise KeyboardInterrupt
        return False

    with pytest.raises(KeyboardInterrupt):
        LandmarkPlanner(SHUT, seed=0).plan(*ENDS, 60.0, stop=fail)
    assert others() == 0
