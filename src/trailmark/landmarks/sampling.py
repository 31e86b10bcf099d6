"""Configurations drawn over a world: uniform or Halton, all or only those that are valid and within reach."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError, expected_name
from trailmark.landmarks.relaxation import Relaxation

__all__ = ["RandomState", "draw", "free_samples", "generator"]

RandomState = int | np.random.Generator | None
"""A seed, a generator to draw from, or None for a random one."""

METHODS = ("uniform", "halton")


def generator(random_state: RandomState) -> np.random.Generator:
    """Return a numpy generator for a seed; a generator is returned as it is."""
    return random_state if isinstance(random_state, np.random.Generator) else np.random.default_rng(random_state)


def draw(
    bounds: tuple[float, float, float, float],
    n: int,
    *,
    method: Literal["uniform", "halton"] = "uniform",
    random_state: RandomState = None,
) -> se2.FloatArray:
    """Return n configurations over ``bounds`` and all headings, valid or not; shape (n, 3).

    Args:
        bounds: xmin, ymin, xmax, ymax in metres.
        n: how many, >= 0.
        method: ``uniform`` (independent) or ``halton`` (scrambled Halton sequence, bases 2, 3, 5; Halton 1960,
            scrambling by Owen 2017, Algorithm 1).
        random_state: seed or generator.

    Raises:
        ConfigurationError: an unknown method or a negative n.
    """
    _check(n, method)
    rng = generator(random_state)
    if method == "uniform":
        unit = rng.random((n, 3))
    else:
        own = rng.spawn(1)[0]
        unit = np.column_stack([_scrambled_digits(n, base, own) for base in (2, 3, 5)])
    low = np.array([bounds[0], bounds[1], -np.pi])
    high = np.array([bounds[2], bounds[3], np.pi])
    q = np.asarray(low + unit * (high - low))
    q[:, 2] = se2.wrap(q[:, 2])
    return q


def _scrambled_digits(n: int, base: int, rng: np.random.Generator) -> se2.FloatArray:
    """Return the first n numbers of the van der Corput sequence, each of its digits permuted; shape (n,).

    The same numbers as those of ``scipy.stats.qmc.Halton``, whose import alone takes longer than most plans.
    """
    permutations = [rng.permuted(np.arange(base)) for _ in range(math.ceil(54.0 / math.log2(base)) - 1)]
    numbers, rest, place = np.zeros(n), np.arange(n), 1.0
    for permutation in permutations:
        place /= base
        numbers += permutation[rest % base] * place
        rest //= base
    return numbers


def free_samples(
    checker: StateChecker,
    n: int,
    *,
    method: Literal["uniform", "halton"] = "uniform",
    reachable_from: se2.FloatArray | None = None,
    random_state: RandomState = None,
    max_draws: int | None = None,
) -> se2.FloatArray:
    """Return up to n valid configurations, shape (m, 3), m <= n.

    A disc robot's headings are all 0, unless it is a car.

    Args:
        checker: decides what is valid.
        n: how many are wanted, >= 0.
        method: see :func:`draw`.
        reachable_from: shape (3,): leave out what obstacles separate from this configuration (on the relaxation's
            grid: all that is left out is proven to be out of reach).
        random_state: seed or generator.
        max_draws: maximum number of configurations drawn, by default 50 n; fewer than n are returned if it is reached.

    Raises:
        ConfigurationError: an unknown method or a negative n.
    """
    _check(n, method)
    rng = generator(random_state)
    region: NDArray[np.bool_] | None = None
    if reachable_from is not None:
        relaxation = Relaxation(checker)
        region = relaxation.component(reachable_from)
    found: list[se2.FloatArray] = [np.empty((0, 3))]
    have, drawn, limit = 0, 0, 50 * n if max_draws is None else max_draws
    while have < n and drawn < limit:
        q = draw(checker.world.bounds, min(max(256, 2 * (n - have)), limit - drawn), method=method, random_state=rng)
        drawn += len(q)
        if not checker.robot.heading_matters:
            q[:, 2] = 0.0
        if region is not None:
            q = q[region[relaxation.cells(relaxation.disc_centers(q))]]
        q = q[checker.valid(q)] if len(q) else q
        found.append(q)
        have += len(q)
    return np.concatenate(found)[:n]


def _check(n: int, method: str) -> None:
    if method not in METHODS:
        raise ConfigurationError(f"method: {expected_name(str(method), METHODS)}")
    if n < 0:
        raise ConfigurationError(f"n: expected 0 or more, got {n}")
