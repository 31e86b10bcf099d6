"""Problem and Job: a query in a world for a robot, and one run of a planner on it, as they are sent to workers."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path as FilePath
from typing import Any, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from trailmark.curves import Steering
from trailmark.errors import FormatError, WorldError
from trailmark.trajectories import CurvePath, Path
from trailmark.world import Query, Robot, World

__all__ = ["Job", "Problem", "problems_of", "read_problem"]


@dataclass(frozen=True)
class Problem:
    """One query in one world for one robot.

    Attributes:
        world: with the robot to plan for and this query alone.
    """

    world: World

    @property
    def query(self) -> Query:
        """Start and goal."""
        return self.world.queries[0]

    @property
    def robot(self) -> Robot:
        """The robot to plan for."""
        assert self.world.robot is not None  # noqa: S101  # problems_of makes sure
        return self.world.robot

    @property
    def name(self) -> str:
        """World and query, without blanks: the name of the experiment."""
        return "-".join(f"{self.world.name}-{self.query.name}".split())

    @property
    def text(self) -> str:
        """The whole problem as the text of a world file, made anew each time: it may be kilobytes of a grid's cells.

        A clearance that the robot keeps, of which world files know nothing, is one more key.
        """
        from trailmark.world.world_file import world_text

        kept = self.robot.clearance
        return world_text(self.world, grid=True) + (f"clearance: {kept!r}\n" if kept else "")

    @cached_property
    def key(self) -> str:
        """SHA-256 of the text: the same for the same problem, wherever it came from."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    @cached_property
    def steering(self) -> Steering | None:
        """Of a robot that is a car; None for one that moves straight in every direction."""
        return Steering.of(self.robot)

    @property
    def objective(self) -> str:
        """What a path costs, in words."""
        if self.steering is None:
            return "path length in SE(2): sum of |dxy| + 0.5 |dtheta|, metres"
        return f"length of the {self.steering.kind} curves, metres"

    def path(self, states: ArrayLike) -> Path:
        """Return the path of the robot's motions through these states, shape (n, 3)."""
        rows = np.asarray(states, dtype=np.float64)
        return Path(rows) if self.steering is None else CurvePath(rows, self.steering)


class Job(TypedDict):
    """One run to be made, as executors take it.

    Attributes:
        text: the problem.
        planner: as named on the command line.
        seed: 0 or more.
        time_limit: seconds of planning.
        memory_limit: MB above what the process holds when planning begins.
        resolution: metres, of the discrete baseline.
    """

    text: str
    planner: str
    seed: int
    time_limit: float
    memory_limit: float
    resolution: float


def problems_of(world: World, robot: Robot | None = None, queries: Iterable[str] = ()) -> Iterator[Problem]:
    """Yield the problems that a world poses.

    Args:
        world: as loaded.
        robot: instead of the world's own.
        queries: their names; all of the world's if empty.

    Raises:
        WorldError: no robot; no query, or none of a given name; a goal that is no single configuration.
    """
    chosen = robot or world.robot
    if chosen is None:
        raise WorldError(f"world {world.name!r} names no robot; expected --robot with disc:RADIUS or another shape")
    for query in [world.query(name) for name in queries] or world.queries or [world.query()]:
        query.pose()  # raises: before a results database is made
        yield Problem(replace(world, robot=chosen, queries=(query,)))


def read_problem(text: str) -> Problem:
    """Return the problem that a text holds, as :attr:`Problem.text` wrote it.

    Raises:
        FormatError: it does not.
    """
    from trailmark.formats.yaml_data import parse_yaml
    from trailmark.world.world_file import world_fields

    source = FilePath("problem")
    data = parse_yaml(text, source)
    if not isinstance(data, dict):
        raise FormatError(source, "no mapping; expected the text of a world file")
    kept: Any = data.pop("clearance", 0.0)
    world = World(**{**world_fields(data, source), "sources": ()})
    return Problem(world if world.robot is None else world.with_robot(world.robot.keeping(kept)))
