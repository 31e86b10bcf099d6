"""LandmarkValidStateSampler: landmarks for OMPL's planners to draw from; plug_landmark_sampler sets it up."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from ompl import base as ob

from trailmark import se2
from trailmark.arguments import one_of
from trailmark.collision import StateChecker
from trailmark.motion import kind_of
from trailmark.motion.pointwise import PointwiseChecker
from trailmark.ompl_bridge.checker import checker_in
from trailmark.ompl_bridge.goals import is_one_state
from trailmark.ompl_bridge.guard import caught, returns_on_error
from trailmark.ompl_bridge.landmark_stream import LandmarkSource, LandmarkStream, Seed, warm_up_sampling
from trailmark.ompl_bridge.planners import planner_names
from trailmark.ompl_bridge.spaces import require_within, space_of
from trailmark.ompl_bridge.states import starts_and_goal, write_state

__all__ = ["LandmarkValidStateSampler", "PluggedSampler", "plug_landmark_sampler"]

VALID_STATES = frozenset(
    ("BKPIECE1", "BiEST", "EST", "PRM", "PRMstar", "ProjEST", "SBL", "SPARS", "SPARStwo", "STRIDE")
)
"""OMPL's planners that ask the ``SpaceInformation`` for a ``ValidStateSampler``."""

OWN_SAMPLERS = frozenset(("ABITstar", "AITstar", "BITstar", "EITstar", "InformedRRTstar", "SORRTstar"))
"""OMPL's planners that draw from an informed sampler of OMPL's own, made of the space's default one."""

NOT_BOUND = "OMPL's Python bindings have no StateSpace.setStateSamplerAllocator"
INFORMED = "it draws from an informed sampler of OMPL's own, whatever the space's sampler is"


class LandmarkValidStateSampler(ob.ValidStateSampler):  # type: ignore[misc]  # OMPL's bindings carry no types
    """Valid states: landmarks, then some around them and anywhere; then more landmarks, and so on.

    The share of uniform samples never ends, so what a planner finds with probability one as time goes on it still does.
    ``sample`` and ``sampleNear`` return only valid states.

    Args:
        information: the ``SpaceInformation`` of an SE(2)-like space. It is not stored here.
        source: the landmarks; several samplers may share them.
        seed: the same one gives the same states, if the source has a seed too.

    Attributes:
        stream: where the states come from.

    Raises:
        SpaceError: a space not made of x, y and heading.
    """

    def __init__(self, information: Any, source: LandmarkSource, seed: Seed = None) -> None:
        space_of(information)
        super().__init__(information)
        self.setName("landmark")
        self.stream = LandmarkStream(source, seed)
        self._single = PointwiseChecker(source.checker)

    @returns_on_error(False)
    def sample(self, state: Any) -> bool:
        """Set a state to a valid one and return True, or return False if none was found this time."""
        row = self.stream.take()
        if row is not None:
            write_state(state, row)
        return row is not None

    @returns_on_error(False)
    def sampleNear(self, state: Any, near: Any, distance: float) -> bool:  # noqa: N802  # OMPL's name
        """Set a state to a valid one within about ``distance`` (the space's) of another; False if none was found."""
        q = near.getX(), near.getY(), near.getYaw()
        for _ in range(max(1, self.getNrAttempts())):
            drawn = self.stream.near(q, distance)
            if self._single.valid(*drawn):
                write_state(state, drawn)
                return True
        return False


@dataclass(frozen=True)
class PluggedSampler:
    """Where the landmark samplers were plugged in, and what is drawn from them.

    Attributes:
        valid_states: the planners of the installed OMPL that draw valid states from the landmarks.
        cannot: the others, and why.
        source: the landmarks.
        streams: of the planners' samplers, which count what they returned.
    """

    valid_states: tuple[str, ...]
    cannot: Mapping[str, str]
    source: LandmarkSource
    streams: list[LandmarkStream] = field(default_factory=list)

    def __str__(self) -> str:
        lines = [f"valid states from landmarks: {', '.join(self.valid_states) or 'no planner'}"]
        reasons: dict[str, list[str]] = {}
        for planner, reason in self.cannot.items():
            reasons.setdefault(reason, []).append(planner)
        lines += [f"not {', '.join(planners)}: {reason}" for reason, planners in reasons.items()]
        return "\n".join(lines)


def plug_landmark_sampler(
    setup: Any,
    landmarks: ArrayLike | None = None,
    *,
    checker: StateChecker | None = None,
    seed: int | None = None,
) -> PluggedSampler:
    """Let OMPL's planners draw from landmarks, as many of them as the installed OMPL allows.

    Call it after start and goal are set, and again when they or the world have changed; planners that were set up
    before need a ``clear``. Landmarks that are to be made are made when a planner requests the first of them, within
    its time.

    Args:
        setup: a ``SimpleSetup`` of an SE(2)-like space.
        landmarks: valid configurations, shape (k, 3). None makes them: for the query from the start to the goal where
            there are both, over all free space otherwise.
        checker: trailmark's checker; by default that of the ``StateValidityChecker`` in ``setup``. What is valid for
            it must be valid for ``setup`` too.
        seed: the same one makes the same landmarks and draws the same states, planner by planner.

    Returns:
        Which planners draw from the landmarks and which cannot, and why; ``print`` it.

    Raises:
        SpaceError: a space not made of x, y and heading.
        BoundsError: a space that reaches beyond the world.
        LandmarkError: landmarks of another shape, not finite, not valid or out of bounds.
        ConfigurationError: a negative seed.
        BridgeError: no checker given, and none of trailmark's in ``setup``.
    """
    information = setup.getSpaceInformation()
    space = space_of(information)
    checker = checker_in(setup) if checker is None else one_of(checker, StateChecker, "checker:")
    require_within(space, checker.world)
    query = None if landmarks is not None else _query(setup.getProblemDefinition(), checker)
    bounds = space.getBounds()
    (xmin, ymin), (xmax, ymax) = bounds.low, bounds.high
    source = LandmarkSource(checker, landmarks, query=query, bounds=(xmin, ymin, xmax, ymax), seed=seed)
    names = planner_names()
    plugged = PluggedSampler(
        valid_states=tuple(name for name in names if name in VALID_STATES),
        cannot={name: INFORMED if name in OWN_SAMPLERS else NOT_BOUND for name in names if name not in VALID_STATES},
        source=source,
    )
    warm_up_sampling(kind_of(checker.robot))
    seeds = np.random.SeedSequence(source.seed)

    # What OMPL stores refers to no OMPL object: a cycle through its C++ would never be freed.
    def allocate(owner: Any) -> Any:
        try:
            made = LandmarkValidStateSampler(owner, source, seeds.spawn(1)[0])
            plugged.streams.append(made.stream)
        except BaseException as error:  # nothing may pass through OMPL's C++
            caught(error)
            return ob.UniformValidStateSampler(owner)
        return made

    information.setValidStateSamplerAllocator(allocate)
    return plugged


def _query(problem: Any, checker: StateChecker) -> se2.FloatArray | None:
    """Return start and goal, shape (2, 3), or None where one is missing or not valid, or there are several of them."""
    starts, goal = starts_and_goal(problem)
    if len(starts) != 1 or goal is None or not is_one_state(problem.getGoal()):
        # One pair of several may be the one that no path joins.
        return None
    ends = np.array([starts[0], goal])
    return ends if checker.valid(ends).all() else None
