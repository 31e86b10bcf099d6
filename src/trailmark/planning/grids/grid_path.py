"""The shortest path of a disc in a grid map, with the bound that proves it, offered to a query."""

from __future__ import annotations

import numpy as np

from trailmark.motion import TranslationMotion
from trailmark.planning.grids.grid_tangents import GridTangents, TangentSearch
from trailmark.planning.query import Query

__all__ = ["shortest_grid_path"]

SPARES = (2e-3, 2e-4, 2e-5)
"""Shares of its radius by which the disc is made larger, those but the first where it does not fit: a motion at contact
itself takes forever to certify."""

STEPS = 20_000
"""Times as long as its spare clearance a motion is at most: whoever certifies it again takes so many steps."""

FIRST, SECOND, PART = 500, 20_000, 500
"""Labels of the exact search before a path is sought with a guide, before that is done again, and between two looks at
the clock."""

SOON, CLOSE = 0.97, 0.95
"""Shares of what the guide says of the rest that are believed: the more, the sooner there is a path, and the longer."""

KEPT = 0.03
"""Share of the time limit that is left at the end."""

CHECKING = 4e-6
"""Seconds for each state of a path that is returned: what checks it and tells its least clearance."""


def shortest_grid_path(query: Query, tangents: GridTangents | None) -> bool:
    """Offer the shortest path of a disc in a grid map and claim its bound; return False if no path was found."""
    if tangents is None or not isinstance(query.motion, TranslationMotion) or not query.settings.uses("disc-path"):
        return False
    query.report("looking along tangents")
    incumbent, (start, goal) = query.incumbent, query.ends[:, :2]
    search = tangents.search(start, goal)
    ended = _run(query, search, FIRST)
    guide = None
    for closeness, labels in ((SOON, SECOND), (CLOSE, 2**62)):
        if not ended:
            guide = tangents.guide(start, goal) if guide is None else guide
            guided = tangents.search(start, goal, spare=SPARES[0], guide=closeness * guide)
            _run(query, guided)
            if _offer(query, tangents, guided, SPARES[:1]):
                search.limit = min(search.limit, guided.length)
            ended = _run(query, search, labels)
    incumbent.raise_bound(query.motion.whole_cost(tangents.bound(search), incumbent.start, incumbent.goal))
    incumbent.bounded = True
    if ended and not _offer(query, tangents, search, SPARES):
        # In contact it would be shorter, by a gap that is as wide as the disc.
        for spare in SPARES[:2]:
            other = tangents.search(start, goal, spare=spare)
            _run(query, other)
            _offer(query, tangents, other, (spare,))
    return query.solved


def _run(query: Query, search: TangentSearch, labels: int = 2**62) -> bool:
    """Go on with a search as far as there is time; return whether it has ended."""
    states = query.incumbent.states
    kept = KEPT * query.budget.limit + CHECKING * (0 if states is None else len(states))
    while labels > 0 and query.seconds_left() > kept:
        if search.run(PART):
            return True
        labels -= PART
    return False


def _offer(query: Query, tangents: GridTangents, search: TangentSearch, spares: tuple[float, ...]) -> bool:
    """Offer the path that a search has found, for a disc larger by a spare; return whether one is certified."""
    for spare in spares if np.isfinite(search.length) else ():
        bends = tangents.bends(search, spare)
        if tangents.certified(bends):
            longest = STEPS * spare * tangents.radius
            steps = np.hypot(*np.diff(bends, axis=0).T)
            count = np.maximum(np.ceil(steps / longest), 1).astype(np.int64)
            of = np.repeat(np.arange(len(steps)), count)
            share = (np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)) / count[of]
            places = bends[of] + share[:, None] * np.diff(bends, axis=0)[of]
            states = np.vstack([np.column_stack([places, np.zeros(len(places))]), query.ends[1]])
            states[0] = query.ends[0]
            query.offer(states)
            return True
    return False
