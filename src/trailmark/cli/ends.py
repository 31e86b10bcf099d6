"""Where a path begins and where it may end, as the shell's options or a world's query say it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, NamedTuple

from trailmark.cli.options import Configuration, UsageError, option, read_configuration, read_number

if TYPE_CHECKING:
    from trailmark.goals import Goal
    from trailmark.world import World

__all__ = ["EndOptions", "Ends", "GoalOption", "GoalToleranceOption", "StartOption"]

StartOption = Annotated[str | None, option("--start", "X,Y,T", "Metres, metres, radians.")]
GoalOption = Annotated[
    list[str] | None,
    option("--goal", "X,Y[,T]", "Without T any heading will do. Given several times: the cheapest is reached."),
]
GoalToleranceOption = Annotated[
    str | None,
    option("--goal-tolerance", "M[,RAD]", "The path may end so far from the goal, and turned by so much."),
]


class Ends(NamedTuple):
    """Start and goals of a query, and its name if it is one of the world's."""

    query: str | None
    start: Configuration
    goal: Configuration | tuple[Goal, ...]


class EndOptions(NamedTuple):
    """What ``--query``, ``--start``, ``--goal`` and ``--goal-tolerance`` say, looked at before the world is read."""

    query: str | None
    start: Configuration | None
    goals: list[tuple[float, ...]]
    tolerance: tuple[float, float] | None

    @classmethod
    def read(cls, query: str | None, start: str | None, goals: list[str] | None, tolerance: str | None) -> EndOptions:
        """Return what the options say.

        Raises:
            UsageError: one of them cannot be read, or they do not go together.
        """
        within = None if tolerance is None else _read_tolerance(tolerance)
        if start is None and not goals:
            return cls(query, None, [], within)
        if query is not None:
            raise UsageError(f"expected --query or --start and --goal, got both (--query {query!r})")
        if start is None or not goals:
            given, missing = (f"--start {start!r}", "--goal") if not goals else (f"--goal {goals[0]!r}", "--start")
            raise UsageError(f"{given} given without {missing}; expected both or neither")
        poses = [_within_a_turn(_read_goal(goal)) for goal in goals]
        if within is not None and within[1] > 0.0 and all(len(pose) == 2 for pose in poses):
            raise UsageError(f"--goal-tolerance {tolerance!r}: expected a goal X,Y,T, got --goal {goals[0]!r}")
        x, y, theta = _within_a_turn(read_configuration(start, "--start"))
        return cls(None, (x, y, theta), poses, within)

    def ends(self, world: World) -> Ends:
        """Return the ends in a world, whose query counts where none are given.

        Raises:
            UsageError: a tolerance for a query that says itself where its paths may end.
            WorldError: no such query.
        """
        from trailmark.goals import Goal

        if self.start is not None:
            start, poses, name = self.start, self.goals, None
        else:
            query = world.query(self.query)
            start, poses, name = query.start, [query.goal], query.name
            if isinstance(query.goal[0], Goal):
                if self.tolerance is not None:
                    raise UsageError(f"--goal-tolerance: expected --goal, for query {name!r} holds tolerances itself")
                return Ends(name, start, query.goal)
        if len(poses) == 1 and len(poses[0]) == 3 and self.tolerance is None:
            x, y, theta = poses[0]
            return Ends(name, start, (x, y, theta))
        position, heading = self.tolerance or (0.0, 0.0)
        headings = (heading if len(pose) == 3 else 0.0 for pose in poses)
        goals = (
            Goal(q, position_tolerance=position, heading_tolerance=h) for q, h in zip(poses, headings, strict=True)
        )
        return Ends(name, start, tuple(goals))


def _within_a_turn(q: tuple[float, ...]) -> tuple[float, ...]:
    """Return a configuration whose heading, if it was warned of, nobody warns of again."""
    return (*q[:2], *(math.remainder(v, 2.0 * math.pi) if abs(v) > 2.0 * math.pi else v for v in q[2:]))


def _read_goal(text: str) -> tuple[float, ...]:
    """Return the numbers of ``X,Y,T`` or ``X,Y``."""
    if text.count(",") != 1:
        return read_configuration(text, "--goal")
    x, y = (read_number(word, "--goal", "X,Y or X,Y,T, finite numbers (metres, radians)") for word in text.split(","))
    return x, y


def _read_tolerance(text: str) -> tuple[float, float]:
    """Return the metres and radians, 0 by default, of ``M[,RAD]``."""
    from trailmark.arguments import angle

    metres, comma, heading = text.partition(",")
    try:
        radians = angle(heading) if comma else 0.0
    except ValueError:
        radians = math.nan
    expected = "M or M,RAD, numbers of 0 or more (metres, radians or degrees such as 10deg)"
    if not 0.0 <= radians < math.inf:
        raise UsageError(f"expected {expected}, got --goal-tolerance {text!r}")
    return read_number(metres, "--goal-tolerance", expected, low=0.0), radians
