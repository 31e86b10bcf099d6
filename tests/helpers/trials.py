"""How much tests do: a few random trials each time, all of them with ``--hypothesis-profile thorough``."""

from __future__ import annotations

import re
from collections.abc import Iterable
from itertools import product
from typing import TypeVar

from hypothesis import settings

from trailmark.planning.settings import PlannerSettings

__all__ = ["QUICK", "THOROUGH", "briefly", "few", "pairs", "thorough", "trials"]

A = TypeVar("A")
B = TypeVar("B")

THOROUGH = 1000
"""Examples of a property in the profile that asks for all."""


def thorough() -> bool:
    """Return whether all trials are asked for."""
    return settings.default is not None and settings.default.max_examples >= THOROUGH


def few(count: int, of: int = 3) -> int:
    """Return how many of ``count`` random trials to make: one of ``of``, at least one, or all."""
    return count if thorough() else -(-count // of)


def trials(count: int, of: int = 3) -> range:
    """Return the seeds of the random trials to make, of which there are ``count``."""
    return range(few(count, of))


def pairs(some: Iterable[A], others: Iterable[B], of: int = 3) -> list[tuple[A, B]]:
    """Return one of ``of`` pairs of two kinds of cases, or all of them.

    Each case is in a pair if there are ``of`` or more of either kind.
    """
    every = product(enumerate(some), enumerate(others))
    return [(a, b) for (i, a), (j, b) in every if i % of == j % of or thorough()]


QUICK = PlannerSettings(sweeps=10, first_sweeps=3, polishing_sweeps=3, patience=2)
"""Rounds are short, and paths settle after two that gain nothing."""

LIMIT = re.compile(r"(time_limit=|\.solve\()([\d.]+)")
"""How a program says how many seconds it plans."""
DEFAULT = """\
import functools, trailmark
trailmark.LandmarkPlanner.plan = functools.partialmethod(trailmark.LandmarkPlanner.plan, time_limit={seconds})
"""
"""What stands before a program that leaves it to the planner."""


def briefly(text: str, seconds: float) -> str:
    """Return a program whose plans take no more than so many seconds each."""
    shorter = LIMIT.sub(lambda found: f"{found[1]}{min(float(found[2]), seconds)}", text)
    return DEFAULT.format(seconds=seconds) + shorter if re.search(r"\.plan\((?!.*time_limit)", text) else shorter
