"""Exceptions that cut planning short: they arrive as what they are, and what is planned afterwards is right."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from collections import Counter
from types import FrameType

import numpy as np
import pytest
from tests.helpers.interrupts import interrupted, lines_run
from tests.helpers.oracles import judge
from tests.helpers.trials import few, trials
from tests.helpers.worlds import ROBOTS, joined_pairs, random_world

from trailmark import Disc, LandmarkPlanner, StateChecker
from trailmark.planning.warmup import warm_up

WORLD = random_world(3, 60, size=40.0, radii=(0.3, 3.0), discs=0.3)


@pytest.mark.parametrize("car", [False, True])
def test_ctrl_c_arrives_as_such(car: bool) -> None:
    if threading.current_thread() is not threading.main_thread():
        pytest.skip("signals go to the main thread")
    robot = ROBOTS["rectangle"]
    if car:
        warm_up("curve")
        robot = robot.steered(1.0)
    planner = LandmarkPlanner(WORLD, robot, seed=4)
    pairs = joined_pairs(planner, 10)
    rng = np.random.default_rng(2)
    arrived: Counter[str] = Counter()

    def ctrl_c(number: int, frame: FrameType | None) -> None:
        # Only within plan: a signal may arrive a moment after it has returned, when nothing here would catch it.
        while frame is not None and frame.f_code is not LandmarkPlanner.plan.__code__:
            frame = frame.f_back
        if frame is not None:
            raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, ctrl_c)
    try:
        for step in trials(30, of=2):
            ends = pairs[step % 10, 0], pairs[step % 10, 1]
            try:
                signal.setitimer(signal.ITIMER_REAL, rng.uniform(1e-4, 0.06))
                planner.plan(*ends, 0.06)
            except KeyboardInterrupt:
                arrived["KeyboardInterrupt"] += 1
            except BaseException as error:
                arrived[type(error).__name__] += 1
            finally:
                signal.setitimer(signal.ITIMER_REAL, 0.0)
    finally:
        signal.signal(signal.SIGALRM, before)
    assert set(arrived) == {"KeyboardInterrupt"}
    assert arrived["KeyboardInterrupt"] > few(10, of=2)


UPDATING = (
    "world/changes.py",
    "planning/model.py",
    "planning/growth.py",
    "verify/verifier.py",
    "planning/verification.py",
    "proofs/bound.py",
    "collision/checker.py",
    "collision/fcl_scene.py",
    "landmarks/relaxation.py",
)


def test_updates_after_an_interrupt_at_any_line_of_the_first_are_right() -> None:
    world = random_world(3, 12, size=25.0, radii=(0.3, 2.0), discs=0.3)
    worlds = [world.edited(remove=[3]), world.edited(remove=[7, 8]), world.edited(add=[Disc((5.0, 5.0), 0.4)])]
    robot = ROBOTS["rectangle"]
    warm_up(use="changes")
    states = np.random.default_rng(0).uniform((0, 0, -3), (25, 25, 3), (200, 3))
    valid = [StateChecker(changed, robot).valid(states) for changed in worlds]
    start, goal = states[np.logical_and.reduce(valid)][:2]

    def lived() -> LandmarkPlanner:
        planner = LandmarkPlanner(world, robot, seed=0)
        planner.plan(start, goal, 20.0, max_iterations=1)
        return planner

    lived().update(worlds[0])  # what is known of the worlds from then on
    planner = lived()
    lines = lines_run(UPDATING, lambda: planner.update(worlds[0]))
    hits, places = 0, range(0, lines, max(1, lines // few(60, of=2)))
    for k in places:
        planner = lived()
        hits += interrupted(UPDATING, lambda planner=planner: planner.update(worlds[0]), k)  # type: ignore[misc]
        for changed, expected in zip(worlds, valid, strict=True):
            planner.update(changed)
            assert np.array_equal(planner.checker.valid(states), expected)
        result = planner.plan(start, goal, 20.0, max_iterations=1)
        judge(worlds[-1], robot, start, goal, result.path.states)
    assert hits > 0.8 * len(places)


FORKING = """
import os, threading, time
from trailmark import Disc, LandmarkPlanner, Robot, World

planner = LandmarkPlanner(World("w", (0, 0, 10, 10), (Disc((5, 5), 1.0),)), Robot.disc(0.3), seed=0)
held, go_on = threading.Event(), threading.Event()


def stop():
    held.set()
    return go_on.wait(60.0)


thread = threading.Thread(target=planner.plan, args=((1, 5, 0), (9, 5, 0), 60.0), kwargs={"stop": stop}, daemon=True)
thread.start()
assert held.wait(60.0)
child = os.fork()
if child == 0:
    os._exit(0 if planner.plan((1, 5, 0), (9, 4, 0), 5.0).status == "solved" else 1)
ended = time.monotonic() + 30.0
while (status := os.waitpid(child, os.WNOHANG))[0] == 0 and time.monotonic() < ended:
    time.sleep(0.02)
if status[0] == 0:
    os.kill(child, 9)
    os.waitpid(child, 0)
go_on.set()
thread.join(60.0)
assert status == (child, 0), status
"""


def test_a_forked_process_plans_though_a_thread_did_when_it_was_forked() -> None:
    subprocess.run([sys.executable, "-c", FORKING], timeout=120.0, check=True)
