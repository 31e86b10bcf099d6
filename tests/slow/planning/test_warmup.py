"""Compiled kernels: compiled for one set of types, by warm_up, and never again."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

# In a process of its own: other tests call kernels with arrays of their own kinds.
PROGRAM = """
import json, sys
import numpy as np
from numba.core.dispatcher import Dispatcher
from trailmark.motion import motion_of
from trailmark import KeepOutZone, LandmarkPlanner, Roadmap, Robot, StateChecker, World
from trailmark.landmarks import free_samples
from trailmark.planning import shorten
from trailmark.planning.warmup import ROBOTS, warm_up
from trailmark.roadmap.snapshot import RoadmapSnapshot
from trailmark.shapes import Disc, Polygon, Rectangle

def signatures():
    found = {}
    for name, module in list(sys.modules.items()):
        if name.startswith("trailmark"):
            for key, value in list(vars(module).items()):
                if isinstance(value, Dispatcher) and value.py_func.__module__ == name:
                    found[f"{name}.{key}"] = len(value.signatures)
    return found

for kind in ROBOTS:
    for use in ("plan", "changes", "grid", "leaving"):
        warm_up(kind, use)
report = {"warm": signatures()}
ring = [(8, 8), (12, 8), (12, 12), (8, 12)]
hole = [(9, 9), (11, 9), (11, 11), (9, 11)]
shapes = (Disc((3, 12), 1.5), Rectangle((10, 3), 1, 5, 0.3), Polygon(np.array(ring, float), (np.array(hole, float),)))
boundary = Polygon(np.array([(0.2, 0.2), (19, 0.5), (19.5, 19.5), (0.5, 19)], float))
worlds = [World("empty", (0, 0, 20, 20)), World("full", (0, 0, 20, 20), shapes, boundary=boundary)]
worlds.append(World("discs", (0, 0, 20, 20), (Disc((10, 10), 2), Disc((10, 6), 2), Disc((10, 14), 2))))
L = Robot.polygon([(-0.5, -0.5), (1.0, -0.5), (1.0, 0.0), (0.0, 0.0), (0.0, 1.0), (-0.5, 1.0)])
for world in worlds:
    for robot in (Robot.disc(0.4), Robot.rectangle(1.2, 0.5), L):
        planner = LandmarkPlanner(world, robot, seed=1, landmarks=20)
        result = planner.plan([2, 2, 0], (17.0, 17.0, 1), 60, max_iterations=1)
        assert result.status == "solved"
        checker, states = planner.checker, result.path.states
        for q in (states, states[::-1], np.asfortranarray(states), states.tolist(), states.astype(np.float32) * 0.99):
            checker.valid(q), checker.clearance(q), checker.clearance(q, cap=1)
        checker.valid(states[0]), checker.motion_valid(states[0], states[1])
        shorten(motion_of(checker), states, np.random.default_rng(1), sweeps=2)
        free_samples(checker, 20, reachable_from=states[0], random_state=1)
        planner.roadmap.certify_all()
        planner.roadmap.save(sys.argv[1])
        roadmap = Roadmap.load(sys.argv[1], checker)
        roadmap.add(states)
        roadmap.add_path(states)
        roadmap.find_path(states[0], states[-1], budget=50)
        roadmap.shortest_path(0, np.int64(5), limit=100)
        roadmap.shortest_path(0, 5, banned=np.zeros(len(roadmap), bool), to_go=np.zeros(len(roadmap)))
        len(roadmap.graph)
        middle = result.path.at(0.5)
        obstacle = Disc((float(middle[0]), float(middle[1])), 0.3)
        both = world.edited(add=[obstacle, Rectangle((4, 17), 1, 1, 0.3)])
        for changed in (world.edited(add=[obstacle]), both, world):
            planner.update(changed)
            result = planner.replan(result.path.states[0], result.path.states[-1], result.path, 60)
wall = tuple(Rectangle((5.0, y), 0.4, h) for y, h in ((4.0, 4.0), (6.75, 1.5), (8.75, 2.5)))
hall = World("hall", (0, 0, 10, 10), wall)
zone = KeepOutZone([(0, 7), (2, 7), (2, 9), (0, 9)])
cells = np.zeros((40, 40), bool)
cells[10:30, 18:22] = True
for robot in ROBOTS.values():
    start, goal = (1.0, 8.0, 0.0), (9.0, 8.0, 0.0)
    planner = LandmarkPlanner(hall, robot, seed=1)
    path = planner.plan(start, goal, 60, max_iterations=1).path
    planner.update(hall.edited(remove=[1]))
    for _ in range(3):
        path = planner.replan(start, goal, path, 60).path
    RoadmapSnapshot(planner.roadmap).between(0, 1)
    planner.update(hall.edited(add=[Disc((1.0, 8.2), 0.2)]))
    planner.replan(start, goal, path, 60, escape=True)
    planner.update(World("hall", hall.bounds, wall, zones=(zone,)))
    planner.plan(start, goal, 60, max_iterations=1)
    LandmarkPlanner(World.from_grid(cells, 0.25), robot, seed=1).plan((2, 5, 0), (8, 5, 0), 60, max_iterations=1)
report["used"] = signatures()
print(json.dumps(report))
"""


def test_warm_up_compiles_each_entrance_once_and_nothing_is_compiled_later(tmp_path: Path) -> None:
    here = tmp_path / "here"
    here.mkdir()
    words = [sys.executable, "-c", PROGRAM, str(tmp_path / "roadmap.npz")]
    done = subprocess.run(words, cwd=here, capture_output=True, text=True, timeout=600)
    assert (done.returncode, done.stderr) == (0, "")
    report: dict[str, Any] = json.loads(done.stdout)
    # The process needs no working directory of its own.
    assert list(here.iterdir()) == []
    assert report["used"] == report["warm"]
    # What only other kernels call is compiled as part of these.
    entrances = {
        "trailmark.collision.kernels.states_free": 1,
        "trailmark.collision.kernels.clearances": 1,
        "trailmark.collision.certify.motions_certified": 1,
        "trailmark.landmarks.grid_search.flood": 1,
        # For cars and for all others.
        "trailmark.roadmap.search.lazy_shortest_path": 2,
        "trailmark.planning.shortening._sweep": 2,
    }
    assert {name: report["warm"][name] for name in entrances} == entrances
