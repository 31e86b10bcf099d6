"""Query: from where to where."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from trailmark import se2
from trailmark.arguments import brief, one_of
from trailmark.errors import WorldError
from trailmark.goals import Goal, goals_of

__all__ = ["Query"]


@dataclass(frozen=True)
class Query:
    """One planning problem.

    Attributes:
        name: what reports call it.
        start: configuration x, y, theta; metres, radians.
        goal: configuration, or goals of which one is to be reached; one Goal that is but a configuration becomes that.
    """

    name: str
    start: tuple[float, float, float]
    goal: Any  # tuple[float, float, float] | tuple[Goal, ...]; who wrote the world's queries knows which

    def __post_init__(self) -> None:
        one_of(self.name, str, "query: name:", error=WorldError)
        object.__setattr__(self, "start", self._configuration("start"))
        goals = goals_of(self.goal)
        if goals is not None and len(goals) == 1 and goals[0].configuration is not None and not goals[0].cost:
            object.__setattr__(self, "goal", goals[0].configuration)
            goals = None
        object.__setattr__(self, "goal", self._configuration("goal") if goals is None else goals)

    def _configuration(self, end: str) -> tuple[float, ...]:
        q = se2.configurations(getattr(self, end), name=f"query {self.name!r}: {end}", by_hand=True)
        if q.ndim != 1:
            raise WorldError(f"query {self.name!r}: {end}: expected shape (3,), got {q.shape}")
        return tuple(float(v) for v in q)

    @property
    def goals(self) -> tuple[Goal, ...]:
        """The goals of which one is to be reached."""
        return goals_of(self.goal) or (Goal(self.pose()),)

    def to_dict(self) -> dict[str, Any]:
        """Return what a world file says of it, in plain numbers, texts and lists."""
        goal = [part.to_dict() if isinstance(part, Goal) else part for part in self.goal]
        return {"name": self.name, "start": list(self.start), "goal": goal}

    def pose(self) -> tuple[float, float, float]:
        """Return the goal for who can plan to a configuration only.

        Raises:
            WorldError: the goal is a region, has a tolerance, or is one of several.
        """
        if isinstance(self.goal[0], Goal):
            raise WorldError(f"query {self.name!r}: expected a goal that is one configuration, got {brief(self.goal)}")
        x, y, theta = self.goal
        return x, y, theta
