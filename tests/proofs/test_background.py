"""Proofs in the background: found, not found, cancelled; threads that end."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from trailmark.collision import StateChecker
from trailmark.planning import LandmarkPlanner
from trailmark.proofs.background import Background, in_time
from trailmark.proofs.enclosure import enclosed
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


def proof_of(world: World) -> Background[bool]:
    checker = StateChecker(world)
    return Background(lambda stop: enclosed(checker, *ENDS, seconds=50.0, stop=stop), "proof of infeasibility")


@pytest.mark.slow
def test_a_proof_is_found_and_none_where_there_is_a_path() -> None:
    for world, shut in ((SHUT, True), (SLIT, False)):
        proof = proof_of(world).begin()
        proof.wait(60.0)
        assert proof.found() == shut
    assert LandmarkPlanner(SLIT, seed=0).plan(*ENDS, 20.0, gap=np.inf).status == "solved"


def test_what_is_no_longer_wanted_ends_soon() -> None:
    running, unwanted = proof_of(SLIT), proof_of(SHUT)
    running.begin()
    running.cancel()
    # This one would be found, were it not for that.
    unwanted.cancel()
    unwanted.begin()
    for proof in (running, unwanted):
        proof.wait(120.0)
        assert not proof.running
        assert not proof.found()
    proof_of(SLIT).end()  # it never began
    assert others() == 0


def test_an_error_is_raised_where_the_result_is_asked_for() -> None:
    def fail(stop: object) -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        in_time(10.0, fail)
    assert in_time(0.0, lambda stop: threading.Event().wait(0.2)) is None
