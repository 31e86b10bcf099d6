"""LandmarkValidStateSampler and LandmarkStateSampler: landmarks for OMPL's planners to draw from.

:func:`trailmark.ompl_bridge.plug.plug_landmark_sampler` plugs them in, and returns which of OMPL's planners draws from
which of the two in the installed OMPL.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ompl import base as ob

from trailmark.motion.pointwise import PointwiseChecker
from trailmark.ompl_bridge.guard import caught, returns_on_error
from trailmark.ompl_bridge.landmark_source import LandmarkSource
from trailmark.ompl_bridge.mixture import ROADMAP_MIXTURE, TREE_MIXTURE, LandmarkStream, Mixture, Seed
from trailmark.ompl_bridge.spaces import require_se2, space_of

__all__ = ["LandmarkStateSampler", "LandmarkValidStateSampler"]

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
        self.stream = LandmarkStream(source, mixture, seed, valid=True, tally=tally)
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


class LandmarkStateSampler(ob.StateSampler):  # type: ignore[misc]  # OMPL's bindings carry no types
    """States: landmarks first, then the mixture; all are valid but the uniform ones and those near a given state.

    Args:
        space: an SE(2)-like state space. It is not stored here.
        source: the landmarks; several samplers may share them.
        mixture: what is drawn between the rounds of landmarks.
        seed: as for :class:`LandmarkValidStateSampler`.
        tally: likewise.

    Attributes:
        stream: where the states come from.

    Raises:
        SpaceError: a space not made of x, y and heading.
        ConfigurationError: a mixture with impossible shares.
    """

    def __init__(
        self,
        space: Any,
        source: LandmarkSource,
        mixture: Mixture = TREE_MIXTURE,
        seed: Seed = None,
        tally: list[int] | None = None,
    ) -> None:
        require_se2(space)
        super().__init__(space)
        self.stream = LandmarkStream(source, mixture, seed, valid=False, tally=tally)

    def sampleUniform(self, state: Any) -> None:  # noqa: N802  # OMPL's name
        """Set a state to the next landmark, or to one of the mixture."""
        _draw(state, lambda: self.stream.take() or self.stream.anywhere(), (0.0, 0.0, 0.0))

    def sampleUniformNear(self, state: Any, near: Any, distance: float) -> None:  # noqa: N802  # OMPL's name
        """Set a state to a landmark within ``distance`` of another, or to one drawn as OMPL's own sampler does."""
        q = _read(near)
        _draw(state, lambda: self.stream.near(q, distance) or self.stream.uniform_near(q, distance), q)

    def sampleGaussian(self, state: Any, mean: Any, deviation: float) -> None:  # noqa: N802  # OMPL's name
        """Set a state to one normally distributed about another, as OMPL's own sampler does."""
        q = _read(mean)
        _draw(state, lambda: self.stream.normal_near(q, deviation), q)


def _draw(state: Any, draw: Callable[[], Configuration], otherwise: Configuration) -> None:
    """Set a state to what is drawn: OMPL takes it as it is, so it is set after an error too."""
    try:
        row = draw()
    except BaseException as error:  # nothing may pass through OMPL's C++
        caught(error)
        row = otherwise
    _write(state, row)


def _read(state: Any) -> Configuration:
    return state.getX(), state.getY(), state.getYaw()


def _write(state: Any, row: Configuration) -> None:
    x, y, theta = row
    state.setX(x)
    state.setY(y)
    state.setYaw(theta)
