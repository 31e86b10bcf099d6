"""Checkers and who judges them, made once for all tests of a file that ask for them."""

from __future__ import annotations

from functools import cache

from tests.helpers.oracle import Oracle

from trailmark.collision import StateChecker
from trailmark.world import Robot, World

__all__ = ["checker_and_oracle"]


@cache
def checker_and_oracle(world: World, robot: Robot) -> tuple[StateChecker, Oracle]:
    """Return a checker, which takes a while to make, and the oracle that shares no code with it."""
    return StateChecker(world, robot), Oracle(world, robot)
