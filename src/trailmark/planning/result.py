"""What a planner returns: PlanResult and ReplanResult, PlanProgress on the way, and Update after changes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from trailmark.shown import Shown
from trailmark.trajectories import CurvePath, Path
from trailmark.world import Robot, World
from trailmark.world.goals import ReachedGoal
from trailmark.world.objective import Objective

__all__ = ["PlanProgress", "PlanResult", "ReplanResult", "Status", "Update"]

Status = Literal["solved", "timeout", "infeasible"]


@dataclass(frozen=True)
class PlanProgress:
    """How far a planner has come.

    Attributes:
        elapsed: seconds since planning began.
        phase: what it is doing, in a word or two.
        landmarks: nodes of the roadmap so far.
        cost: the best path's cost in metres; None before there is one.
        path: the best path so far; None before there is one.
        nearest: before there is one, the certified path from the start that ends nearest to the goal, if known.
    """

    elapsed: float
    phase: str
    landmarks: int
    cost: float | None
    path: Path | None = None
    nearest: Path | None = None


@dataclass(frozen=True)
class PlanResult(Shown):
    """The answer to one query.

    Attributes:
        status: ``solved``, ``timeout`` (no path within the limit) or ``infeasible`` (proven: there is none).
        path: the path if solved, every motion of it certified; a car's is a :class:`~trailmark.CurvePath`.
        seed: the planner's seed.
        lower_bound: proven lower bound (metres) on the cost of any valid path; None if infeasible.
        first_cost: cost (metres) of the first path found, before it was shortened; None if there is none.
        min_clearance: smallest clearance (metres) found along the path, at its states and between them; the true one is
            at most 1 mm less.
        landmarks: nodes of the roadmap.
        edges: edges of the roadmap that are not known to be blocked.
        history: (seconds, cost in metres) for each better path.
        time: seconds: ``load`` (reading the world; the shell fills it in), ``build`` (checker, field and
            relaxed problem), ``first_solution`` (from the call to the first path; None if there is none),
            ``total`` (the whole call).
        nearest: without a path, the certified path from the start that ends nearest to the goal, if one was found.
        clearance: certified clearance of the whole path, metres: the planner's, or less with ``relax``.
        clearance_bound: with ``relax``, a proven upper bound on the clearance of any path, metres; else None.
        goal: the goal at which the path ends, if goals (:class:`~trailmark.Goal`) were given; else None.
        charged: the path's cost under the objective; None if there is no path, or if that is its length (:attr:`cost`).
        cost_error: bound on the error of ``charged``; 0 where it is exact but for rounding.
        objective: the objective; None for a plain length.
        world: the world; results compare without it, and without the next three.
        robot: the robot.
        start: configuration (x, y, theta).
        target: the goal that was given: a configuration, or goals.
        escape: number of motions at the path's beginning that lead the robot out of the obstacle or the keep-out zones
            in which it starts. They are not free, but along them the robot never gets deeper. One-way zones do not
            count on the way out of an obstacle.
        legs: for a path through via points, the result of each leg; the last has no path if none was found. Else empty.
        reason: why there is no path: an end in collision, with what and how deep; where the robot is enclosed, and the
            width of the widest passage; or what ended the search. Empty if solved.
    """

    status: Status
    path: Path | None
    seed: int
    lower_bound: float | None
    first_cost: float | None
    min_clearance: float | None
    landmarks: int
    edges: int
    history: tuple[tuple[float, float], ...] = ()
    time: dict[str, float | None] = field(default_factory=dict)
    nearest: Path | None = None
    clearance: float = 0.0
    clearance_bound: float | None = None
    goal: ReachedGoal | None = None
    charged: float | None = None
    cost_error: float = 0.0
    objective: Objective | None = None
    world: World | None = field(default=None, repr=False, compare=False)
    robot: Robot | None = field(default=None, repr=False, compare=False)
    start: tuple[float, float, float] | None = field(default=None, repr=False, compare=False)
    target: Any = field(default=None, repr=False, compare=False)
    reason: str = ""
    escape: int = 0
    legs: tuple[PlanResult, ...] = ()

    def __repr__(self) -> str:
        facts = [str(self.status), *([] if self.path is None else [repr(self.path)])]
        if self.cost is not None and self.lower_bound:
            facts.append(f"at most {100.0 * (self.cost / self.lower_bound - 1.0):.2g} % above the optimum")
        for name, unit in (("first_solution", "first path after"), ("total", "in all")):
            seconds = self.time.get(name)
            facts += [] if seconds is None else [f"{unit} {seconds:.3g} s"]
        return f"{type(self).__name__}({', '.join(facts)})"

    @property
    def cost(self) -> float | None:
        """The path's cost under the objective, with that of the goal it ends at; None if there is no path."""
        if self.path is None:
            return None
        return (self.path.cost if self.charged is None else self.charged) + (
            0.0 if self.goal is None else self.goal.cost
        )

    def summary(self) -> dict[str, Any]:
        """Return the record of a leg that ``plan --json`` prints."""
        end = None if self.path is None else self.path.states[-1].tolist()
        return {"status": self.status, "to": end, "cost": self.cost, "lower_bound": self.lower_bound}

    def to_dict(self, world: str, query: str | None = None) -> dict[str, Any]:
        """Return the record that ``plan --json`` prints, made of plain numbers, strings and lists."""
        path = self.path
        kept = {"clearance": self.clearance} if self.clearance > 0.0 or self.clearance_bound is not None else {}
        if self.clearance_bound is not None:
            kept["clearance_bound"] = self.clearance_bound
        curve: dict[str, Any] = {}
        if isinstance(path, CurvePath):
            curve = {
                "curve": path.record(),
                "direction_changes": path.cusps,
                "reverse_length": path.reverse_length,
            }
        return {
            "world": world,
            "query": query,
            "planner": "landmark",
            "status": self.status,
            "reason": self.reason,
            **({} if self.goal is None else {"goal": self.goal.to_dict()}),
            **({} if not self.escape else {"escape": self.escape}),
            **({} if not self.legs else {"legs": [leg.summary() for leg in self.legs]}),
            "seed": self.seed,
            "states": [] if path is None else path.states.tolist(),
            "cost": self.cost,
            **(
                {} if self.objective is None else {"objective": self.objective.to_dict(), "cost_error": self.cost_error}
            ),
            "length": None if path is None else path.length,
            "rotation": None if path is None else path.rotation,
            **curve,
            "min_clearance": self.min_clearance,
            **kept,
            "lower_bound": self.lower_bound,
            "first_cost": self.first_cost,
            "landmarks": self.landmarks,
            "edges": self.edges,
            "history": [list(entry) for entry in self.history],
            "time": dict(self.time),
        }


@dataclass(frozen=True, repr=False)
class ReplanResult(PlanResult):
    """The result of replanning a path that is being followed.

    Attributes:
        kept: whether the path is the rest of the given one.
        reason: why the path was kept or replaced, or why there is none.
    """

    kept: bool = False


@dataclass(frozen=True)
class Update:
    """How a change of the world changed a planner.

    Attributes:
        changes: obstacles that were added, removed, moved or refined; of a grid map, cells that differ.
        checked: edges of the roadmap that were checked again.
        gained: of those, edges that are certified now and were not before.
        lost: of those, edges that are no longer certified, edges of dropped landmarks included.
        landmarks_dropped: landmarks that are no longer valid.
        landmarks_retracted: of those, landmarks that were moved beside the obstacle.
        landmarks_added: landmarks in freed space.
        seconds: time of the update.
    """

    changes: int = 0
    checked: int = 0
    gained: int = 0
    lost: int = 0
    landmarks_dropped: int = 0
    landmarks_retracted: int = 0
    landmarks_added: int = 0
    seconds: float = 0.0
