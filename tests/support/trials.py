"""How many random trials a test makes: a few each time, all of them with ``--hypothesis-profile thorough``."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product
from typing import TypeVar

from hypothesis import settings

__all__ = ["THOROUGH", "few", "pairs", "thorough", "trials"]

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
