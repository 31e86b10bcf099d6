"""A planner's life as chance has it: queries, many at once, files, threads, interrupts; what it says is true."""

from __future__ import annotations

import math
import os
import tempfile
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from benchmarks.soundness.cases import judge_path, judge_result
from benchmarks.soundness.reference import Reference, deepest, moves
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule
from numpy.typing import NDArray
from tests.helpers.interrupts import interrupted
from tests.helpers.worlds import ROBOTS, random_states, random_world

from trailmark import CurvePath, LandmarkPlanner, PlannerSettings, Roadmap, Robot, StateChecker, Steering
from trailmark.collision.kernels import FREE
from trailmark.motion import CurveMotion
from trailmark.planning.warmup import warm_up

FloatArray = NDArray[np.float64]

# As crowded as larger worlds that other tests plan in; the judge looks at each obstacle.
WORLD = random_world(3, 24, size=25.0, radii=(0.3, 3.0), discs=0.3)

LIVES = {
    "rectangle": ROBOTS["rectangle"],
    "disc": Robot.disc(0.6),
    "L": ROBOTS["L"],
    "car": ROBOTS["rectangle"].steered(1.5),
    "car forwards": ROBOTS["rectangle"].steered(1.5, reverse=False),
}

FILES = (
    "roadmap/roadmap.py",
    "roadmap/search.py",
    "roadmap/snapshot.py",
    "roadmap/files.py",
    "planning/planner.py",
    "planning/dispatch.py",
    "planning/pipeline.py",
    "planning/incumbent.py",
    "planning/query.py",
    "planning/placement.py",
    "planning/batch.py",
)
"""Files between whose lines an interrupt may come."""

SETTINGS = PlannerSettings(probes=50, max_spread_landmarks=400, sweeps=5, first_sweeps=2, patience=1)
"""Of a planner that does not take long to prepare for many queries, and whose paths need not be the shortest."""

STATES = 60
"""Configurations that queries join."""

EXAMPLES = int(os.environ.get("TRAILMARK_LIVES", "2"))
"""Lives of each robot; more by hand."""


@cache
def known(name: str) -> tuple[StateChecker, Reference, FloatArray]:
    """Return a robot's checker, its judge and valid configurations."""
    robot = LIVES[name]
    if robot.turning_radius is not None:
        warm_up("curve")
    checker = StateChecker(WORLD, robot)
    q = random_states(WORLD, 40 * STATES, np.random.default_rng(1))
    return checker, Reference(WORLD, robot), q[np.asarray(checker.valid(q))][:STATES]


class Life(RuleBasedStateMachine):
    """One planner from its making on; every path and every certified edge is judged by shapely."""

    name = "rectangle"

    @initialize(seed=st.integers(0, 1000), landmarks=st.sampled_from([None, None, 60]))
    def born(self, seed: int, landmarks: int | None) -> None:
        self.checker, self.reference, self.states = known(self.name)
        self.robot = self.checker.robot
        self.planner = LandmarkPlanner(
            WORLD, self.robot, seed=seed, landmarks=landmarks, checker=self.checker, settings=SETTINGS
        )
        self.rng = np.random.default_rng(seed)

    @rule(i=st.integers(0, STATES - 1), j=st.integers(0, STATES - 1), again=st.integers(1, 3))
    def plan(self, i: int, j: int, again: int) -> None:
        ends = self.states[[i, j]]
        for _ in range(again):
            result = self.planner.plan(ends[0], ends[1], 5.0, max_iterations=1)
            assert judge_result(WORLD, self.robot, ends, result, None, self.reference) is None

    @rule(seed=st.integers(0, 1000), n=st.integers(1, 3), workers=st.integers(1, 3))
    def plan_many(self, seed: int, n: int, workers: int) -> None:
        self.many(seed, n, workers)

    @rule(k=st.integers(1, 80))
    def build(self, k: int) -> None:
        before = len(self.planner.roadmap)
        self.planner.build(k)
        assert before <= len(self.planner.roadmap) <= before + k

    @rule()
    def save_and_load(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "roadmap.npz"
            roadmap = self.planner.roadmap
            roadmap.save(file)
            loaded = type(roadmap).load(file, self.checker)
        assert np.array_equal(loaded.configurations, roadmap.configurations)
        assert np.array_equal(loaded.edges, roadmap.edges)
        # What is not known may be asked again; what is known stays so.
        assert np.array_equal(loaded.certified, roadmap.certified)

    @rule(
        what=st.sampled_from(["plan", "many", "build", "save"]),
        line=st.integers(0, 3000),
        error=st.sampled_from([KeyboardInterrupt, RuntimeError, MemoryError]),
        i=st.integers(0, STATES - 1),
        j=st.integers(0, STATES - 1),
    )
    def interrupt(self, what: str, line: int, error: type[BaseException], i: int, j: int) -> None:
        def act() -> object:
            if what == "plan":
                return self.planner.plan(self.states[i], self.states[j], 5.0, max_iterations=1)
            if what == "many":
                return self.planner.plan_many(self.states[[i]], self.states[[j]], 5.0, max_iterations=1)
            if what == "build":
                return self.planner.build(40)
            with tempfile.TemporaryDirectory() as folder:
                self.planner.roadmap.save(Path(folder) / "roadmap.npz")
            return None

        interrupted(FILES, act, line, error)

    @rule(seed=st.integers(0, 1000))
    def threads(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        i, j = rng.integers(0, STATES, 2).tolist()
        with ThreadPoolExecutor(4) as threads:
            work = [threads.submit(self.many, seed + k, 2, 1) for k in range(2)]
            work += [threads.submit(self.plan, i, j, 1), threads.submit(self.save_and_load_anything)]
            for future in work:
                future.result()

    @invariant()
    def whole(self) -> None:
        if not hasattr(self, "planner"):
            return
        q, edges, lengths, status = self.planner.roadmap.rows()
        assert len(edges) == len(lengths) == len(status)
        assert edges.max(initial=-1) < len(q)
        assert np.isfinite(q).all()
        assert np.isfinite(lengths).all()

    def teardown(self) -> None:
        if not hasattr(self, "planner"):
            return
        self.judge_edges(self.planner.roadmap)
        self.plan(0, 1, 1)

    def many(self, seed: int, n: int, workers: int) -> None:
        """Ask many queries at once, and judge what comes back."""
        ends = self.states[np.random.default_rng(seed).integers(0, STATES, (n, 2))]
        results = self.planner.plan_many(ends[:, 0], ends[:, 1], 5.0, workers=workers, max_iterations=1)
        assert len(results) == n
        for pair, result in zip(ends, results, strict=True):
            assert judge_result(WORLD, self.robot, pair, result, None, self.reference) is None

    def save_and_load_anything(self) -> None:
        """Save while others let the roadmap grow; what is loaded is of one moment."""
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "roadmap.npz"
            self.planner.roadmap.save(file)
            self.judge_edges(type(self.planner.roadmap).load(file, self.checker))

    def judge_edges(self, roadmap: Roadmap) -> None:
        """Assert that certified edges are free, some of them drawn by lot."""
        q, edges, _, status = roadmap.rows()
        free = edges[status == FREE]
        free = free[np.random.default_rng(0).permutation(len(free))[:60]]
        if len(free) == 0:
            return
        a, b = q[free[:, 0]], q[free[:, 1]]
        if isinstance(roadmap.motion, CurveMotion):
            steering = Steering.of(self.robot)
            assert steering is not None
            for pair in np.stack([a, b], axis=1)[:15]:
                assert judge_path(self.reference, self.robot, pair, CurvePath(pair, steering)) is None
            return
        turn = np.abs(np.angle(np.exp(1j * (b - a)[:, 2])))
        # Exactly half a turn has a direction of its own, which tests of headings look at.
        clear = turn < math.pi - 1e-9
        bounds = np.hypot(*(b - a)[:, :2].T) + self.reference.sweep * turn
        worst, _ = deepest(self.reference, moves(a, b), bounds * (1.0 + 1e-9), 4)
        assert worst[clear].max(initial=0.0) <= self.reference.allowed


@pytest.mark.parametrize("name", list(LIVES))
def test_what_a_planner_says_is_true_all_its_life(name: str) -> None:
    class Named(Life):
        pass

    Named.name = name
    case = Named.TestCase
    case.settings = settings(
        max_examples=EXAMPLES,
        stateful_step_count=12 if "TRAILMARK_LIVES" in os.environ else 7,
        deadline=None,
        derandomize="TRAILMARK_LIVES" not in os.environ,
        suppress_health_check=list(HealthCheck),
        print_blob=True,
    )
    case("runTest").runTest()
