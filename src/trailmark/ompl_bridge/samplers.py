"""LandmarkValidStateSampler: landmarks for OMPL's planners to draw from.

:func:`trailmark.ompl_bridge.plug.plug_landmark_sampler` plugs them in, and returns which of OMPL's planners draws from
it.
"""

from __future__ import annotations

from typing import Any

from ompl import base as ob

from trailmark.motion.pointwise import PointwiseChecker
from trailmark.ompl_bridge.guard import returns_on_error
from trailmark.ompl_bridge.landmark_source import LandmarkSource
from trailmark.ompl_bridge.mixture import ROADMAP_MIXTURE, LandmarkStream, Mixture, Seed
from trailmark.ompl_bridge.spaces import space_of

__all__ = ["LandmarkValidStateSampler"]

Configuration = tuple[float, float, float]


class LandmarkValidStateSampler(ob.ValidStateSampler):  # type: ignore[misc]  # OMPL's bindings carry no types
    """Valid states: landmarks, then some around, between them and anywhere; then more landmarks, and so on.

    The share of uniform samples never ends, so what a planner finds with probability one as time goes on it still does.
    ``sample`` and ``sampleNear`` return only valid states.

    Args:
        information: the ``SpaceInformation`` of an SE(2)-like space. It is not stored here.
        source: the landmarks; several samplers may share them.
        mixture: what is drawn between the rounds of landmarks.
        seed: the same one gives the same states, if the source has a seed too.
        tally: counts the states by where they come from (:data:`~trailmark.ompl_bridge.mixture.ORIGINS`).

    Attributes:
        stream: where the states come from.

    Raises:
        SpaceError: a space not made of x, y and heading.
        ConfigurationError: a mixture with impossible shares.
    """

    def __init__(
        self,
        information: Any,
        source: LandmarkSource,
        mixture: Mixture = ROADMAP_MIXTURE,
        seed: Seed = None,
        tally: list[int] | None = None,
    ) -> None:
        space_of(information)
        super().__init__(information)
        self.setName("landmark")
        self.stream = LandmarkStream(source, mixture, seed, tally=tally)
        self._single = PointwiseChecker(source.checker)

    @returns_on_error(False)
    def sample(self, state: Any) -> bool:
        """Set a state to a valid one and return True, or return False if none was found this time."""
        row = self.stream.take()
        if row is not None:
            _write(state, row)
        return row is not None

    @returns_on_error(False)
    def sampleNear(self, state: Any, near: Any, distance: float) -> bool:  # noqa: N802  # OMPL's name
        """Set a state to a valid one within about ``distance`` (the space's) of another; False if none was found."""
        q = _read(near)
        row = self.stream.near(q, distance)
        for _ in range(max(1, self.getNrAttempts()) if row is None else 0):
            drawn = self.stream.uniform_near(q, distance)
            if self._single.valid(*drawn):
                row = drawn
                break
        if row is not None:
            _write(state, row)
        return row is not None


def _read(state: Any) -> Configuration:
    return state.getX(), state.getY(), state.getYaw()


def _write(state: Any, row: Configuration) -> None:
    x, y, theta = row
    state.setX(x)
    state.setY(y)
    state.setYaw(theta)
