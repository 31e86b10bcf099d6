"""Proposals: where a vertex of a path might better be, for each kind of motion, and where to add some."""

from __future__ import annotations

from math import cos, hypot, pi, sin, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trailmark.compiled import by_type, njit, variant_of
from trailmark.heading import wrapped
from trailmark.motion.base import Scratch, cost, interpolate
from trailmark.motion.curve import Curve
from trailmark.motion.differential import Differential, facing
from trailmark.motion.straight import Straight
from trailmark.motion.translation import Translation
from trailmark.motion.weighted import Weighted
from trailmark.se2 import FloatArray

__all__ = ["halved", "propose", "split", "uniform"]

SHORT = 0.02
"""Share of a path's cost up to which a motion is not halved."""


@njit(cache=True)
def uniform(seed: NDArray[np.uint64]) -> float:
    """Return a number in [0, 1) and advance the seed (xorshift64*: Vigna 2016)."""
    s = seed[0]
    s ^= s >> np.uint64(12)
    s ^= s << np.uint64(25)
    s ^= s >> np.uint64(27)
    seed[0] = s
    return float((s * np.uint64(2685821657736338717)) >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@by_type
def propose(
    kind: Any,
    scratch: Scratch,
    path: FloatArray,
    i: int,
    share: float,
    attempt: int,
    seed: NDArray[np.uint64],
    scale: float,
    q: FloatArray,
) -> bool:
    """Write where vertex i might better be into q; return False if there is no other proposal.

    Args:
        kind: of motion.
        scratch: memory to work in.
        path: (n, 3).
        i: an inner vertex.
        share: of the cost from the vertex before to the one after, at which this one lies.
        attempt: number of the proposal, from 0 on.
        seed: of random numbers.
        scale: metres that random proposals lie away at most.
        q: where to.
    """
    raise NotImplementedError


@variant_of(propose, Straight)
@variant_of(propose, Translation)
@njit(cache=True)
def _propose_straight(
    kind: Any,
    scratch: Scratch,
    path: FloatArray,
    i: int,
    share: float,
    attempt: int,
    seed: NDArray[np.uint64],
    scale: float,
    q: FloatArray,
) -> bool:
    a, here, b = path[i - 1], path[i], path[i + 1]
    if attempt < (3 if has_heading(kind) else 2):
        straight = np.empty(3)
        interpolate(kind, scratch, a, b, share * cost(kind, scratch, a, b), straight)
        if attempt == 2:
            q[:] = here
            q[2] = straight[2]
        else:
            t = 0.5 if attempt == 0 else 0.1
            interpolate(kind, scratch, here, straight, t * cost(kind, scratch, here, straight), q)
        return True
    angle, step = 2.0 * pi * uniform(seed), scale * sqrt(uniform(seed))
    q[0], q[1] = here[0] + step * cos(angle), here[1] + step * sin(angle)
    q[2] = wrapped(here[2] + (uniform(seed) - 0.5) * min(2.0, 2.0 * scale)) if has_heading(kind) else here[2]
    return attempt == 3


@variant_of(propose, Curve)
@njit(cache=True)
def _propose_curve(
    kind: Curve,
    scratch: Scratch,
    path: FloatArray,
    i: int,
    share: float,
    attempt: int,
    seed: NDArray[np.uint64],
    scale: float,
    q: FloatArray,
) -> bool:
    a, here, b = path[i - 1], path[i], path[i + 1]
    if attempt == 0:
        interpolate(kind, scratch, a, b, share * cost(kind, scratch, a, b), q)
        return True
    angle, step = 2.0 * pi * uniform(seed), scale * sqrt(uniform(seed))
    if attempt == 1:
        # Along its heading, where it can go.
        angle = here[2] if uniform(seed) < 0.5 else here[2] + pi
    q[0], q[1], q[2] = here[0] + step * cos(angle), here[1] + step * sin(angle), here[2]
    if attempt == 2:
        q[0], q[1] = here[0], here[1]
    if attempt > 1:
        q[2] = wrapped(q[2] + (2.0 * uniform(seed) - 1.0) * min(1.0, scale / kind.radius))
    return True


@variant_of(propose, Weighted)
@njit(cache=True)
def _propose_weighted(
    kind: Weighted,
    scratch: Scratch,
    path: FloatArray,
    i: int,
    share: float,
    attempt: int,
    seed: NDArray[np.uint64],
    scale: float,
    q: FloatArray,
) -> bool:
    here = path[i]
    near = min(
        hypot(path[i - 1, 0] - here[0], path[i - 1, 1] - here[1]),
        hypot(path[i + 1, 0] - here[0], path[i + 1, 1] - here[1]),
    )
    # At all scales: what is cheapest is curved, here more and there less.
    step = 0.5 * near * 2.0 ** (-6.0 * uniform(seed))
    propose(kind.motion, scratch, path, i, share, (0, 2, 3, 3, 3)[attempt], seed, max(step, 1e-6), q)
    if kind.robot.sweep_radius == 0.0:
        q[2] = here[2]
    return attempt < 4


@variant_of(propose, Differential)
@njit(cache=True)
def _propose_differential(
    kind: Differential,
    scratch: Scratch,
    path: FloatArray,
    i: int,
    share: float,
    attempt: int,
    seed: NDArray[np.uint64],
    scale: float,
    q: FloatArray,
) -> bool:
    a, here, b = path[i - 1], path[i], path[i + 1]
    if attempt < 2:
        t = 0.5 if attempt == 0 else 0.1
        q[0] = here[0] + t * (a[0] + share * (b[0] - a[0]) - here[0])
        q[1] = here[1] + t * (a[1] + share * (b[1] - a[1]) - here[1])
    else:
        angle, step = 2.0 * pi * uniform(seed), scale * sqrt(uniform(seed))
        q[0], q[1] = here[0] + step * cos(angle), here[1] + step * sin(angle)
    # It arrives without a turn.
    q[2] = here[2]
    q[2] = facing(kind, a, q)
    return attempt < 3


@by_type
def has_heading(kind: Any) -> bool:
    """Return whether headings make a difference."""
    raise NotImplementedError


@variant_of(has_heading, Straight)
@njit(cache=True)
def _heading(kind: Straight) -> bool:
    return True


@variant_of(has_heading, Translation)
@njit(cache=True)
def _no_heading(kind: Translation) -> bool:
    return False


@njit(cache=True)
def split(
    kind: Any, scratch: Scratch, path: FloatArray, costs: FloatArray, seed: NDArray[np.uint64], scale: float
) -> FloatArray:
    """Return the path with two more vertices, on either side of a random one: a corner may take more than one."""
    n = len(path)
    i = 1 + int(uniform(seed) * (n - 2))
    result = np.empty((n + 2, 3))
    result[:i] = path[:i]
    result[i + 1] = path[i]
    result[i + 3 :] = path[i + 1 :]
    before = min(0.45 * costs[i - 1], scale * uniform(seed))
    interpolate(kind, scratch, path[i - 1], path[i], costs[i - 1] - before, result[i])
    interpolate(kind, scratch, path[i], path[i + 1], min(0.45 * costs[i], scale * uniform(seed)), result[i + 2])
    return result


@njit(cache=True)
def halved(kind: Any, scratch: Scratch, path: FloatArray, costs: FloatArray) -> FloatArray:
    """Return the path with a vertex in the middle of every longer motion: what is cheapest need not be straight."""
    longer = costs > SHORT * costs.sum()
    result, k = np.empty((len(path) + longer.sum(), 3)), 0
    for i in range(len(costs)):
        result[k] = path[i]
        k += 1
        if longer[i]:
            interpolate(kind, scratch, path[i], path[i + 1], 0.5 * costs[i], result[k])
            k += 1
    result[k] = path[-1]
    return result
