"""An exploration by hand, for what shows and keeps explorations: a drive through two rooms, seen by dense sampling."""

from __future__ import annotations

import itertools
import math
from functools import cache

import numpy as np

from trailmark import Rectangle, Roadmap, Robot, StateChecker, World
from trailmark.estimation.records import Increment, Log, Pose, Record
from trailmark.estimation.virtual_sensors import RayCaster, Scanner
from trailmark.exploration.known_map import UNKNOWN, KnownMap
from trailmark.exploration.result import Evaluation, ExplorationProgress, ExplorationResult, ExplorationSettings
from trailmark.se2 import FloatArray

__all__ = ["ROOMS", "made_exploration"]

ROOMS = World(
    "rooms",
    (0.0, 0.0, 8.0, 5.0),
    (
        Rectangle((4.0, 1.0), 0.3, 2.0),
        Rectangle((4.0, 4.2), 0.3, 1.6),
        Rectangle((2.0, 3.6), 1.0, 0.6, 0.4),
        Rectangle((6.5, 2.0), 0.6, 1.4),
    ),
    Robot.rectangle(0.6, 0.4),
)
STOPS = np.array([[1.0, 1.0], [2.8, 2.4], [5.0, 2.7], [7.3, 3.6], [5.6, 4.2]])
CELL, RANGE, BEAMS, PERIOD, STEP = 0.1, 3.0, 120, 0.2, 0.1


@cache
def made_exploration() -> ExplorationResult:
    """Return the outcome; the same at every call."""
    known = KnownMap(ROOMS.bounds, CELL)
    laser, caster, rng = Scanner(BEAMS, 2.0 * math.pi, RANGE, sigma=0.0), RayCaster(ROOMS), np.random.default_rng(0)
    first = np.full(known.state.shape, np.inf, dtype=np.float32)
    records: list[Record] = [Pose(0.0, *_row(STOPS[0], 0.0))]
    history, here, distance, time = list[ExplorationProgress](), np.array(_row(STOPS[0], 0.0)), 0.0, 0.0
    for leg, (a, b) in enumerate(itertools.pairwise(STOPS)):
        heading = math.atan2(*(b - a)[::-1])
        steps = int(np.linalg.norm(b - a) / STEP)
        for k in range(steps + 1):
            there = np.array(_row(a + (b - a) * k / steps, heading))
            if k:
                records.append(Increment.between(time, tuple(here.tolist()), tuple(there.tolist())))
                distance += float(np.hypot(*(there - here)[:2]))
            here = there
            scan = laser.sweep(time, here, caster, rng)
            records.append(scan)
            known.add_scan(scan, here, RANGE)
            first[(known.state != UNKNOWN) & np.isinf(first)] = time
            done = k == steps
            event = f"landmark {leg + 1} reached" if done else ""
            target = None if done else np.array(_row(b, heading))
            path = None if target is None else np.array([here, target])
            area = float((known.state != UNKNOWN).sum()) * CELL**2
            sigma = 0.01 + 0.002 * distance
            reached = leg + 1 if done else leg
            history.append(ExplorationProgress(time, distance, area, reached, sigma, here, target, path, event))
            time += PERIOD
    nodes = np.column_stack([STOPS, np.zeros(len(STOPS))])
    edges = np.array([[0, 1], [1, 2], [2, 3], [3, 4]], dtype=np.int32)
    roadmap = Roadmap.from_arrays(StateChecker(ROOMS, ROOMS.robot), nodes, edges, np.ones(len(edges), dtype=np.uint8))
    return ExplorationResult(
        status="complete",
        reason="all that can be seen from where the robot can get to has been seen",
        world=ROOMS,
        known=known,
        first_known=first,
        roadmap=roadmap,
        log=Log("rooms", tuple(records), np.empty((0, 3))),
        history=tuple(history),
        strategy="tour",
        seed=3,
        settings=ExplorationSettings(),
        seconds=1.5,
        decisions=np.array([0.02, 0.03, 0.05, 0.04]),
        evaluation=Evaluation(0.998, 0, 2.9),
        contacts=np.empty((0, 2)),
        robot_state={"truth": [[0.0, 1.0, 1.0, 0.0]]},
    )


def _row(xy: FloatArray, theta: float) -> tuple[float, float, float]:
    return float(xy[0]), float(xy[1]), theta
