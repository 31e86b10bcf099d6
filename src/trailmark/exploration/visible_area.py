"""What can be seen in a world from where a robot can get to, and how much of it an exploration has seen.

Only a simulator can know this. The robot goes from one configuration of a grid to the next by motions certified free of
collision; where a passage leaves less room than the grid's distance, the planner is asked for a way. What it would see
is the map that exact scans from these places make, cell by cell. What is seen only from between the places is missed,
and what lies beyond passages that the planner does not find in half a second.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trailmark.collision import StateChecker
from trailmark.estimation.virtual_sensors import RayCaster, Scanner
from trailmark.exploration.known_map import FREE, UNKNOWN, KnownMap
from trailmark.exploration.result import Evaluation
from trailmark.exploration.simulated_robot import SimulatedRobot
from trailmark.planning import LandmarkPlanner
from trailmark.se2 import FloatArray, difference, interpolate
from trailmark.world import World
from trailmark.world.goals import Goal
from trailmark.world.robot import Robot

__all__ = ["evaluate", "reachable_places", "visible_area"]

# Places of the robot's grid in the bounds, and cells of the area: an office of 240 m² has one every 0.11 m.
PLACES: Final = 20_000
HEADINGS: Final = 16  # Of a robot whose heading makes a difference.
VIEWS: Final = 1500  # Places that are looked from, at most: evenly spread.
# Parts of free space, at most, that the grid does not reach and the planner is asked for; the share of the free
# configurations that such a part has at least; and seconds for each of them.
ASKED_FOR, LEAST_PART, PLANNING = 4, 0.005, 0.5
CERTAIN: Final = 1e-6  # Metres or radians: a pose with a standard deviation of less is taken as known.


def evaluate(robot: SimulatedRobot, known: KnownMap, trajectory: FloatArray, covariances: FloatArray) -> Evaluation:
    """Return what a simulated robot's exploration was worth.

    Args:
        robot: at the end of it; its world is as it is by then.
        known: the map that was made.
        trajectory: where the robot was, as the mapper says, shape (n, 4), rows t, x, y, theta.
        covariances: of these poses, shape (n, 3, 3).
    """
    places = reachable_places(robot.world, robot.robot, robot.truth[:, 1:])
    mount = robot.sensor.mount if isinstance(robot.sensor, Scanner) else (0.0, 0.0, 0.0)
    area = visible_area(robot.world, places, robot.sensor.max_range, mount)
    points = area.centres(*np.nonzero(area.state == FREE))
    seen = float((known.state[known.cells_of(points)] != UNKNOWN).mean()) if len(points) else 1.0
    return Evaluation(seen, robot.collisions, _nees(robot.truth, trajectory, covariances))


def reachable_places(world: World, robot: Robot, driven: FloatArray) -> FloatArray:
    """Return configurations that a robot can get to, shape (m, 3).

    A robot that steers like a car or drives along its heading gets, in the end, nearly wherever it can be turned and
    pushed to: it is taken as one that moves in every direction.

    Args:
        world: as it truly is.
        robot: footprint.
        driven: where it has been, shape (n, 3): what can be reached from anywhere there counts.
    """
    from scipy.spatial import cKDTree

    world = replace(world, zones=())
    checker = StateChecker(world, Robot(robot.footprint))
    states, place, label, step = _parts(checker)
    driven = _thinned(driven[checker.states_free(driven)], step)  # what has moved since may stand there now
    near: Any = cKDTree(states[:, :2]).query_ball_point(driven[:, :2], 1.5 * step)
    ways = np.array([(i, j) for i, row in enumerate(near) for j in row], dtype=np.intp).reshape(-1, 2)
    ways = ways[checker.motions_free(driven[ways[:, 0]], states[ways[:, 1]])]
    reached = np.isin(label, np.unique(label[ways[:, 1]]))
    planner = LandmarkPlanner(world, checker.robot, seed=0, checker=checker)
    asked = np.zeros(len(states), np.bool_)
    for _ in range(ASKED_FOR if len(driven) else 0):
        other = ~np.isin(place, np.unique(place[reached])) & ~asked
        sizes = np.bincount(label[other], minlength=1)
        if sizes.max() < LEAST_PART * len(states):
            break
        # Whether a passage leads there that is too narrow for the grid, is the planner's to say.
        part = label == int(np.argmax(sizes))
        inside = states[other & part]
        goal = inside[np.argmax(checker.clearance(inside))]
        path = planner.plan(driven[0], Goal((goal[0], goal[1])), PLANNING, gap=10.0).path
        asked |= part
        reached |= part & (path is not None)
    return np.concatenate([driven, states[reached]])


def _parts(checker: StateChecker) -> tuple[FloatArray, NDArray[np.intp], NDArray[np.intp], float]:
    """Return free configurations, shape (n, 3), joined by free motions in connected parts.

    With them come the number of each one's place, shape (n,), of its part, shape (n,), and how far places are apart.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    (xmin, ymin, xmax, ymax), step = checker.world.bounds, _side(checker.world)
    xs, ys = np.arange(xmin + 0.5 * step, xmax, step), np.arange(ymin + 0.5 * step, ymax, step)
    count = HEADINGS if checker.robot.sweep_radius > 0.0 else 1
    headings = np.linspace(np.pi, -np.pi, count, endpoint=False)  # along the axes, as many walls are
    grid = np.stack(np.meshgrid(ys, xs, headings, indexing="ij"), axis=-1)[..., [1, 0, 2]]
    free = checker.states_free(grid.reshape(-1, 3)).reshape(grid.shape[:3])
    index = np.arange(free.size).reshape(free.shape)
    every, but, last = slice(None), slice(None, -1), slice(1, None)
    sides = [((every, but), (every, last)), ((but,), (last,)), ((but, but), (last, last)), ((but, last), (last, but))]
    pairs = [(index[a], index[b], free[a] & free[b]) for a, b in sides]
    pairs.append((index, np.roll(index, -1, axis=2), free & np.roll(free, -1, axis=2)))
    states, joined = grid.reshape(-1, 3), np.concatenate([np.column_stack([a[m], b[m]]) for a, b, m in pairs])
    joined = joined[checker.motions_free(states[joined[:, 0]], states[joined[:, 1]])]
    graph = coo_array((np.ones(len(joined), np.int8), tuple(joined.T)), shape=(len(states), len(states)))
    _, label = connected_components(graph, directed=False)
    kept = np.flatnonzero(free)
    return states[kept], kept // count, np.asarray(label[kept], np.intp), step


def visible_area(
    world: World, places: FloatArray, max_range: float, mount: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> KnownMap:
    """Return the map that a sensor makes that looks all around in some places, without any noise.

    Args:
        world: as it truly is.
        places: configurations of the robot, shape (m, 3).
        max_range: metres.
        mount: the sensor's configuration in the robot's frame.
    """
    area, caster, rng = KnownMap(world.bounds, _side(world)), RayCaster(world), np.random.default_rng(0)
    beams = int(np.clip(4.0 * np.pi * max_range / area.cell, 180, 1000))
    scanner, spacing = Scanner(beams, 2.0 * np.pi, max_range, sigma=0.0, mount=mount), area.cell
    while len(views := _thinned(places, spacing)) > VIEWS:
        spacing *= 1.25
    for t, view in enumerate(views):
        area.add_scan(scanner.sweep(float(t), view, caster, rng), view, max_range)
    return area


def _side(world: World) -> float:
    """Return the side of squares that cover the bounds, metres."""
    xmin, ymin, xmax, ymax = world.bounds
    return float(np.sqrt((xmax - xmin) * (ymax - ymin) / PLACES))


def _thinned(rows: FloatArray, spacing: float) -> FloatArray:
    """Return the first row, of any that begin with x and y, in each square of a grid, metres."""
    _, first = np.unique(np.floor(rows[:, :2] / spacing), axis=0, return_index=True)
    return rows[np.sort(first)]


def _nees(truth: FloatArray, trajectory: FloatArray, covariances: FloatArray) -> float:
    """Return the mean of eᵀ P⁻¹ e over the poses that the mapper states, e their errors.

    Poses without any covariance are left out: the start is known, and odometry may be exact.
    """
    stated = np.trace(covariances, axis1=1, axis2=2) > CERTAIN**2
    if not stated.any():
        return 0.0
    t, poses, covariances = trajectory[stated, 0], trajectory[stated, 1:], covariances[stated]
    after = np.clip(np.searchsorted(truth[:, 0], t), 0, len(truth) - 1)
    before = np.maximum(after - 1, 0)
    span = truth[after, 0] - truth[before, 0]
    share = np.clip((t - truth[before, 0]) / np.where(span > 0.0, span, 1.0), 0.0, 1.0)
    error = difference(interpolate(truth[before, 1:], truth[after, 1:], share), poses)
    return float(np.einsum("ni,nij,nj->n", error, np.linalg.pinv(covariances, hermitian=True), error).mean())
