"""What the tests of the shell share: running it in this process, a small world, and a planner that is quick."""

from __future__ import annotations

import os
import pty
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
import typer
from tests.helpers.kernels import ready

import trailmark
from trailmark import ConfigurationError, PlanResult
from trailmark.cli import app, main

__all__ = ["planner", "ready", "shell", "terminal", "yard"]

WORLD = """\
trailmark: 1
name: yard
bounds: [0.0, 0.0, 10.0, 6.0]
robot: {shape: rectangle, length: 0.8, width: 0.4}
obstacles:
  - {shape: disc, center: [5.0, 3.0], radius: 1.0}
  - {shape: rectangle, center: [2.0, 5.0], length: 1.0, width: 0.5, heading: 0.3}
queries:
  - {name: across, start: [1.0, 1.0, 0.0], goal: [9.0, 5.0, 1.5]}
  - {name: back, start: [9.0, 5.0, 1.5], goal: [1.0, 1.0, 0.0]}
"""


@pytest.fixture(scope="session", autouse=True)
def _commands_are_made_once() -> Iterator[None]:
    """Keep typer's commands, which take longer to make than most tests do; each process makes its own."""
    made, make = typer.main.get_command(app), typer.main.get_command
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.main, "get_command", lambda of: made if of is app else make(of))
        yield


class Run(NamedTuple):
    status: int
    out: str
    err: str

    @property
    def problem(self) -> str:
        """The one line that an error must be, without its head; nothing may be on stdout."""
        assert self.out == ""
        assert self.err.endswith("\n")
        assert self.err.count("\n") == 1, self.err
        assert self.err.startswith("trailmark: error: ")
        return self.err.removeprefix("trailmark: error: ").rstrip("\n")


@pytest.fixture
def shell(capsys: pytest.CaptureFixture[str]) -> Callable[..., Run]:
    """Run ``trailmark`` with the given words in this process."""

    def run(*words: object) -> Run:
        capsys.readouterr()
        status = main([str(word) for word in words])
        return Run(status, *capsys.readouterr())

    return run


TERMINAL = {"TERM": "xterm-256color", "COLUMNS": "100"}


def shown_on(outside: int) -> str:
    """Return all that is written on a terminal, until nobody has its inner end open."""
    shown = b""
    while True:
        try:
            chunk = os.read(outside, 1 << 16)
        except OSError:  # how Linux says that the other end was closed
            chunk = b""
        if not chunk:
            os.close(outside)
            return shown.decode()
        shown += chunk


@pytest.fixture
def terminal(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Run]:
    """Run a process whose stderr is a terminal of 100 columns and whose stdout is not."""

    def run(*words: object) -> Run:
        outside, inside = pty.openpty()
        stdout = tmp_path_factory.mktemp("terminal") / "stdout"
        with stdout.open("wb") as out:
            process = subprocess.Popen(list(map(str, words)), stdout=out, stderr=inside, env=os.environ | TERMINAL)
        os.close(inside)
        shown = shown_on(outside)
        return Run(process.wait(), stdout.read_text(), shown)

    return run


@pytest.fixture
def yard(tmp_path: Path) -> Path:
    file = tmp_path / "yard.yaml"
    file.write_text(WORLD)
    return file


class FakePlanner:
    """Stands in for LandmarkPlanner: notes what it is asked and answers at once.

    Attributes:
        status: what the next plan comes to.
        calls: keyword by keyword, what the shell asked for.
        action: called while planning.
        stop: what the last plan was given to ask.
    """

    status: Any = "solved"
    calls: list[dict[str, Any]]
    action: Callable[[], None]
    stop: Callable[[], bool]

    def __init__(self, world: Any, robot: Any, **asked: Any) -> None:
        self.asked = {"world": world, "robot": robot, **asked}
        at = np.array([[1.0, 1.0, 0.0], [5.0, 1.0, 0.5], [9.0, 5.0, 1.5]])
        edges, status = np.array([[0, 1], [1, 2]]), np.array([1, 2])
        motion = SimpleNamespace(lines=lambda a, b: np.stack([a[:, :2], b[:, :2]], axis=1))
        self.roadmap = SimpleNamespace(
            configurations=at, edges=edges, status=status, certified=status == 1, motion=motion
        )

    def plan(
        self, start: Any, goal: Any, time_limit: float = 1.0, on_progress: Any = None, stop: Any = None, **others: Any
    ) -> PlanResult:
        type(self).calls.append(self.asked | {"start": start, "goal": goal, "time_limit": time_limit} | others)
        if start[0] < 0:
            raise ConfigurationError(f"start {start} is out of bounds by {-start[0]:g} m")
        type(self).stop = staticmethod(stop)
        for cost in (None, 12.0):
            on_progress(SimpleNamespace(elapsed=0.1, landmarks=3, cost=cost, phase="planning"))
        type(self).action()
        found: dict[str, Any] = {"path": None, "first_cost": None, "min_clearance": None, "lower_bound": None}
        if self.status == "solved":
            end = goal if trailmark.world.goals.goals_of(goal) is None else goal[0].nearest(start)[0]
            path = trailmark.Path(np.array([start, [5.0, 1.0, 0.5], end]))
            found = {"path": path, "first_cost": 12.0, "min_clearance": 0.25, "lower_bound": 8.0}
            found["history"] = ((0.25, path.cost),)
        times = {"load": 0.0, "build": 0.125, "first_solution": found["path"] and 0.25, "total": 0.5}
        reason = "" if self.status == "solved" else "shut in at the start"
        counts = {"landmarks": 3, "edges": 2, "seed": self.asked["seed"]}
        return PlanResult(status=self.status, time=times, reason=reason, **counts, **found)


@pytest.fixture
def planner(monkeypatch: pytest.MonkeyPatch) -> type[FakePlanner]:
    """Put a fresh FakePlanner in the place of trailmark.LandmarkPlanner."""
    fake = type("Fake", (FakePlanner,), {"calls": [], "action": staticmethod(lambda: None)})
    monkeypatch.setattr(trailmark, "LandmarkPlanner", fake, raising=False)
    return fake
