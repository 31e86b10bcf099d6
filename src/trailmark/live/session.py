"""What one client of the live page works on: a world, a planner that follows it, and the last path."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path as FilePath
from threading import Event
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from trailmark.arguments import brief
from trailmark.errors import ConfigurationError, WorldError
from trailmark.live.messages import Message
from trailmark.world import World
from trailmark.world.robot import Robot

if TYPE_CHECKING:
    from trailmark.planning import LandmarkPlanner, PlanProgress, PlanResult
    from trailmark.trajectories import Path

__all__ = ["Answer", "Session"]

Answer = dict[str, Any]

TIME_LIMIT = 1.0
"""Seconds of a plan, unless the message says otherwise."""

MAX_OBSTACLES = 20_000
"""Of a world; edits are refused beyond."""

DRAWN = 2000
"""Configurations among which a start and a goal are chosen for a world without a query."""

BETTER = 0.002
"""Share of its cost by which a path must be better than the last one told of, and"""
BETWEEN = 0.03
"""seconds that must lie between the two: a screen shows no more."""


class Session:
    """Answers messages, one after the other, in one thread.

    Args:
        world: to begin with.
        robot: that moves in it.
        tell: sends an answer.
        seed: of the planner.
    """

    def __init__(
        self,
        world: World,
        robot: Robot,
        tell: Callable[[Answer], None],
        seed: int = 0,
    ) -> None:
        self._world, self._tell, self._seed = _named(world.with_robot(robot)), tell, seed
        self._options: dict[str, Any] = {}
        self._planner: LandmarkPlanner | None = None
        self._path: Path | None = None

    @property
    def world(self) -> World:
        """The world as it is, with its robot; every obstacle has an id."""
        return self._world

    @property
    def planner(self) -> LandmarkPlanner:
        """Plans in the world as it is."""
        if self._planner is None:
            from trailmark.planning import LandmarkPlanner

            self._planner = LandmarkPlanner(self._world, seed=self._seed, **self._options)
        return self._planner

    def handle(self, message: Message, stop: Event) -> None:
        """Answer a message.

        Args:
            message: that was understood.
            stop: set when the answer is not wanted any more; a plan ends with what it has.

        Raises:
            TrailmarkError: what the message asks for cannot be done; nothing is changed then.
        """
        begin, fields, answer = perf_counter(), message.fields, {"type": message.type, "id": message.id}
        if message.type == "hello":
            from trailmark.world.library import shipped_worlds

            self._tell(
                {
                    **answer,
                    "type": "world",
                    **self._described(),
                    "worlds": list(shipped_worlds()),
                }
            )
        elif message.type in ("world", "open"):
            self._replace_world(self._opened(fields) if message.type == "open" else fields)
            answer["type"] = "world"
            self._tell({**answer, **self._described(), "time": {"build": perf_counter() - begin}})
        elif message.type == "edit":
            edited = self._edit(fields)
            world = {} if fields.get("brief") else self._described()
            self._tell({**answer, "type": "world", **world, **edited, "time": {"update": perf_counter() - begin}})
        elif message.type in ("plan", "replan"):
            self._plan(message, stop)
        elif message.type == "save":
            from trailmark.world.world_file import query_from_data, world_text

            query = query_from_data({"name": "live", **fields}, "save")
            self._tell({**answer, "text": world_text(replace(self._world, queries=(query,)))})

    def _described(self) -> Answer:
        from trailmark.world.world_file import world_data

        content = world_data(self._world)
        if not self._world.queries:
            content["queries"] = [{"name": "live", **self._far_apart()}]
        unknown = [
            {"vertices": p.vertices.tolist(), "holes": [h.tolist() for h in p.holes]} for p in self._world.unknown
        ]
        return {"world": content, "name": self._world.name, "unknown": unknown}

    def _far_apart(self) -> dict[str, list[float]]:
        """Return a start and a goal for a world that has none: free places, far from each other."""
        xmin, ymin, xmax, ymax = self._world.bounds
        drawn = np.random.default_rng(self._seed).uniform((xmin, ymin, -np.pi), (xmax, ymax, np.pi), (DRAWN, 3))
        free = drawn[np.asarray(self.planner.checker.valid(drawn), dtype=bool)]
        if len(free) == 0:
            return {"start": [xmin, ymin, 0.0], "goal": [xmax, ymax, 0.0]}
        start = free[np.argmin(free[:, :2].sum(axis=1))]
        return {"start": start.tolist(), "goal": free[np.argmax(np.hypot(*(free - start)[:, :2].T))].tolist()}

    def _opened(self, fields: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the content of a shipped world, or of the text of a world file, which goes nowhere else."""
        from trailmark.errors import FormatError, expected_name
        from trailmark.formats.yaml_data import parse_yaml
        from trailmark.world.library import shipped_worlds
        from trailmark.world.world_file import world_data

        if (name := fields.get("name")) is not None:
            shipped = shipped_worlds()
            if name not in shipped:
                raise ConfigurationError(f"open.name: {expected_name(name, shipped)}")
            return {"world": world_data(World.load(shipped[name]))}
        path = FilePath("world")
        data = parse_yaml(fields.get("text", ""), path)
        if not isinstance(data, dict) or "trailmark" not in data:
            raise FormatError(path, "expected the text of a world file (key 'trailmark'), got something else")
        return {"world": data}

    def _replace_world(self, fields: Mapping[str, Any]) -> None:
        from trailmark.planning import LandmarkPlanner
        from trailmark.world.world_file import world_fields

        world = World(**world_fields({"trailmark": 1, **fields["world"]}, FilePath("world")))
        same = (world.name, world.bounds) == (self._world.name, self._world.bounds)
        unknown = self._world.unknown if same else ()  # world files hold none
        world = _named(replace(world, robot=world.robot or self._world.robot, sources=(), unknown=unknown))
        options = {name: fields[name] for name in ("clearance", "objective") if name in fields}
        # What cannot be planned in leaves the old world as it was.
        planner = LandmarkPlanner(world, seed=self._seed, **options)
        self._world, self._options, self._planner = world, options, planner
        self._path = None

    def _edit(self, fields: Mapping[str, Any]) -> Answer:
        """Change obstacles, and return what an answer says of it."""
        from trailmark.world.world_file import obstacles_from_data

        ids = {name for name in self._world.ids if name is not None}
        remove = [_named_as(name, ids, self._world, "remove") for name in fields.get("remove", [])]
        move = {_named_as(name, ids, self._world, "move"): by for name, by in fields.get("move", {}).items()}
        add, taken = {}, set(ids)
        for name, obstacle in obstacles_from_data(fields.get("add", []), "add"):
            own = _free_id(taken, len(taken)) if name is None else name
            if own in add:
                raise WorldError(f"add: expected ids that differ, got {own!r} twice")
            taken.add(own)
            add[own] = obstacle
        if len(self._world.obstacles) + len(add) - len(remove) > MAX_OBSTACLES:
            raise WorldError(f"edit: expected at most {MAX_OBSTACLES:,} obstacles")
        world = self._world.edited(add=add, remove=remove, move=move)
        if self._planner is not None:
            self._planner.update(world)
        self._world = world
        return {"name": world.name, "obstacles": len(world.obstacles), "added": list(add)}

    def _plan(self, message: Message, stop: Event) -> None:
        """Plan, and tell of the first path at once, of better ones as they come, and of the end."""
        from trailmark.world.world_file import query_from_data

        fields = message.fields
        entry = {"name": "live", "start": fields["start"], "goal": fields["goal"]}
        query = query_from_data(entry, message.type)
        seconds, planner = float(fields.get("time_limit", TIME_LIMIT)), self.planner
        extras: dict[str, Any] = {}
        result: PlanResult
        if message.type == "replan" and self._path is not None:
            replanned = planner.replan(query.start, query.goal, self._path, seconds, escape=True)
            extras, result = {"kept": replanned.kept}, replanned
        else:
            better = _BetterPaths(lambda progress, first: self._tell(self._progress(message, progress, first)))
            how: dict[str, Any] = {"stop": stop.is_set, "on_progress": better.look}
            if via := fields.get("via"):
                result = planner.plan_through(query.start, [*via, query.goal], seconds, **how)
            else:
                result = planner.plan(query.start, query.goal, seconds, **how)
        self._path = result.path
        self._tell({"type": "path", "id": message.id, "final": True, **self._record(result), **extras})

    def not_planned(self, message: Message) -> Answer:
        """Return the answer to a plan that a newer one took the place of before it began."""
        from trailmark.planning import PlanResult

        reason = "a newer plan took its place"
        result = PlanResult("timeout", None, self._seed, None, None, None, landmarks=0, edges=0, reason=reason)
        times = dict.fromkeys(("load", "build", "first_solution", "total"))
        return {"type": "path", "id": message.id, "final": True, **self._record(result), "time": times}

    def _record(self, result: PlanResult) -> Answer:
        record = result.to_dict(world=self._world.name)
        if result.path is None and result.nearest is not None:
            record["nearest"] = result.nearest.states.tolist()
        return record

    def _progress(self, message: Message, state: PlanProgress, first: float) -> Answer:
        """Return the record of a path that may yet get better; the first one came after so many seconds."""
        from trailmark.planning import PlanResult

        result = PlanResult(
            status="solved",
            path=state.path,
            seed=self.planner.seed,
            lower_bound=None,
            first_cost=None,
            min_clearance=None,
            landmarks=state.landmarks,
            edges=0,
            time={"load": 0.0, "build": 0.0, "first_solution": first, "total": state.elapsed},
            clearance=self.planner.checker.robot.clearance,
        )
        record = self._record(result)
        return {"type": "path", "id": message.id, "final": False, **record, "cost": state.cost}


class _BetterPaths:
    """Passes on the progress that shows a better path, with the seconds to the first one."""

    def __init__(self, tell: Callable[[PlanProgress, float], None]) -> None:
        self._tell, self._cost, self._told = tell, float("inf"), -float("inf")
        self._first: float | None = None

    def look(self, state: PlanProgress) -> None:
        if state.path is None or state.cost is None or state.cost > (1.0 - BETTER) * self._cost:
            return
        self._first = state.elapsed if self._first is None else self._first
        if perf_counter() - self._told >= BETWEEN:
            self._cost, self._told = state.cost, perf_counter()
            self._tell(state, self._first)


def _named(world: World) -> World:
    """Return the world with an id for each obstacle, by which the page speaks of it."""
    if len(world.obstacles) > MAX_OBSTACLES:
        raise WorldError(f"world: expected at most {MAX_OBSTACLES:,} obstacles, got {len(world.obstacles):,}")
    given = world.ids or (None,) * len(world.obstacles)
    taken, ids = {name for name in given if name is not None}, list[str | None]()
    for i, name in enumerate(given):
        own = _free_id(taken, i) if name is None else name
        taken.add(own)
        ids.append(own)
    return replace(world, ids=tuple(ids))


def _free_id(taken: set[str], number: int) -> str:
    """Return an id that no obstacle has."""
    while f"o{number}" in taken:
        number += 1
    return f"o{number}"


def _named_as(name: object, ids: set[str], world: World, verb: str) -> str | int:
    """Return an id, or an index, which a JSON key can only hold as a text."""
    if isinstance(name, str):
        if name not in ids and name.isdecimal() and int(name) < len(world.obstacles):
            return int(name)
        return name
    if isinstance(name, int) and not isinstance(name, bool):
        return name
    raise ConfigurationError(f"edit.{verb}: expected an id or an index, got {brief(name)}")
