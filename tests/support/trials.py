"""How many random trials a test makes: a few each time, all of them with ``--hypothesis-profile thorough``."""

from __future__ import annotations

from hypothesis import settings

__all__ = ["THOROUGH", "few", "thorough", "trials"]

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
