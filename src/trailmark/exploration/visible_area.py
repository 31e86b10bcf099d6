"""What can be seen in a world from where a robot can get to, and how much of it an exploration has seen.

Only a simulator can know this. It is found on grids, so that it has a resolution, but nothing on them is guessed: the
robot goes from one configuration of its grid to the next by motions certified free of collision, and a point is seen
along a line of sight certified free as well (:class:`trailmark.collision.StateChecker`, the second time for a point).
Where a passage leaves less room than the grid's distance, the planner is asked for a way. What is seen only from
between the places is missed, and what lies beyond passages that the planner does not find in half a second.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.collision import StateChecker
from trailmark.estimation.virtual_sensors import Scanner
from trailmark.exploration.known_map import UNKNOWN, KnownMap
from trailmark.exploration.result import Evaluation
from trailmark.exploration.simulated_robot import SimulatedRobot
from trailmark.goals import Goal
from trailmark.planning import LandmarkPlanner
from trailmark.robot import Robot
from trailmark.se2 import FloatArray, compose, difference, interpolate
from trailmark.world import World

__all__ = ["VisibleArea", "evaluate", "reachable_places", "visible_area"]

PLACES: Final = 20_000
"""Places of the robot's grid in the bounds, and points of the area: an office of 240 m² has one every 0.11 m."""

HEADINGS: Final = 16
"""Of a robot whose heading makes a difference."""

POINT: Final = 1e-6
"""Metres: radius of what goes along a line of sight."""

ASKED_FOR: Final = 4
"""Parts of free space, at most, that the grid does not reach and the planner is asked for."""

LEAST_PART: Final = 0.005
"""Share of the free configurations that such a part has at least."""

PLANNING: Final = 0.5
"""Seconds for each of them."""

CERTAIN: Final = 1e-6
"""Metres or radians: a pose with a standard deviation of less is taken as known."""

ASKED_AT_ONCE: Final = 64
"""Places that are asked together whether they see a point."""


class VisibleArea(NamedTuple):
    """Points, each for the square around it."""

    points: FloatArray
    """Shape (n, 2), metres: all that can be seen."""
    side: float
    """Of a square, metres."""

    def share_known(self, known: KnownMap) -> float:
        """Return the share of the points that lie in cells that are not unknown."""
        if not len(self.points):
            return 1.0
        return float((known.state[known.cells_of(self.points)] != UNKNOWN).mean())


def evaluate(robot: SimulatedRobot, known: KnownMap, trajectory: FloatArray, covariances: FloatArray) -> Evaluation:
    """Return what a simulated robot's exploration was worth.

    Args:
        robot: at the end of it; its world is as it is by then.
        known: the map that was made.
        trajectory: where the robot was, as the mapper says, shape (n, 4), rows t, x, y, theta.
        covariances: of these poses, shape (n, 3, 3).
    """
    truth = robot.truth
    places = reachable_places(robot.world, robot.robot, truth[:, 1:])
    area = visible_area(robot.world, places, robot.sensor.max_range, _mount(robot))
    return Evaluation(area.share_known(known), robot.collisions, _nees(truth, trajectory, covariances))


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
    planner: LandmarkPlanner | None = None
    asked = np.zeros(len(states), np.bool_)
    for _ in range(ASKED_FOR):
        other = ~np.isin(place, np.unique(place[reached])) & ~asked
        sizes = np.bincount(label[other], minlength=1)
        if sizes.max() < LEAST_PART * len(states):
            break
        # Whether a passage leads there that is too narrow for the grid, is the planner's to say.
        part = int(np.argmax(sizes))
        inside = states[other & (label == part)]
        goal = inside[np.argmax(checker.clearance(inside))]
        planner = planner or LandmarkPlanner(world, checker.robot, seed=0, checker=checker)
        path = planner.plan(driven[0], Goal((goal[0], goal[1])), PLANNING, gap=10.0).path if len(driven) else None
        asked |= label == part
        reached |= (label == part) & (path is not None)
    return np.concatenate([driven, states[reached]])


def _parts(checker: StateChecker) -> tuple[FloatArray, NDArray[np.intp], NDArray[np.intp], float]:
    """Return free configurations, shape (n, 3), joined by free motions in connected parts.

    With them come the number of each one's place, shape (n,), of its part, shape (n,), and how far places are apart.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    xs, ys, step = _axes(checker.world)
    count = HEADINGS if checker.robot.sweep_radius > 0.0 else 1
    headings = np.linspace(np.pi, -np.pi, count, endpoint=False)  # along the axes, as many walls are
    grid = np.stack(np.meshgrid(ys, xs, headings, indexing="ij"), axis=-1)[..., [1, 0, 2]]
    free = checker.states_free(grid.reshape(-1, 3)).reshape(grid.shape[:3])
    index = np.arange(free.size).reshape(free.shape)
    pairs = [_neighbours(index, free, dy, dx) for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1))]
    if count > 1:
        turned = np.roll(index, -1, axis=2)
        both = free & np.roll(free, -1, axis=2)
        pairs.append(np.column_stack([index[both], turned[both]]))
    states, joined = grid.reshape(-1, 3), np.concatenate(pairs)
    joined = joined[checker.motions_free(states[joined[:, 0]], states[joined[:, 1]])]
    graph = coo_array((np.ones(len(joined), np.int8), tuple(joined.T)), shape=(len(states), len(states)))
    _, label = connected_components(graph, directed=False)
    kept = np.flatnonzero(free)
    return states[kept], kept // count, np.asarray(label[kept], np.intp), step


def visible_area(
    world: World, places: FloatArray, max_range: float, mount: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> VisibleArea:
    """Return what a sensor sees that looks all around in some places.

    Args:
        world: as it truly is.
        places: configurations of the robot, shape (m, 3).
        max_range: metres.
        mount: the sensor's configuration in the robot's frame.
    """
    xs, ys, side = _axes(world)
    checker = StateChecker(replace(world, zones=()), Robot.disc(POINT), cell=side)
    points = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
    points = points[checker.states_free(_as_states(points))]
    views = np.asarray(compose(places, np.array(mount)))[:, :2]
    views = views[checker.states_free(_as_states(views))]
    seen = np.zeros(len(points), np.bool_)
    # A few places far apart see nearly all; the others are asked for what is left.
    for spacing in (max_range / 2.0, max_range / 8.0):
        for view in _thinned(views, spacing):
            near = np.flatnonzero(~seen & (np.hypot(*(points - view).T) <= max_range))
            seen[near] = _in_sight(checker, view, points[near])
    _look_closely(checker, points, seen, _thinned(views, 2.0 * side), max_range, 1.5 * side)
    return VisibleArea(points[seen], side)


def _look_closely(
    checker: StateChecker,
    points: FloatArray,
    seen: NDArray[np.bool_],
    views: FloatArray,
    max_range: float,
    next_to: float,
) -> None:
    """Mark the points that any of the views sees: all of a line of sight is seen, so these have seen ones beside."""
    from scipy.spatial import cKDTree

    pairs = cKDTree(points).query_pairs(next_to, output_type="ndarray")
    views = np.random.default_rng(0).permutation(views)  # so that a point that some see is seen by one of the first
    tree, asked = cKDTree(views), seen.copy()
    while True:
        edge = pairs[seen[pairs[:, 0]] != seen[pairs[:, 1]]].ravel()
        left = np.unique(edge[~asked[edge]])
        if not len(left):
            return
        asked[left] = True
        for i, near in zip(left, tree.query_ball_point(points[left], max_range, return_sorted=True), strict=True):
            for first in range(0, len(near), ASKED_AT_ONCE):
                if _in_sight(checker, points[i], views[near[first : first + ASKED_AT_ONCE]]).any():
                    seen[i] = True
                    break


def _in_sight(checker: StateChecker, a: FloatArray, b: FloatArray) -> NDArray[np.bool_]:
    """Return which points b, shape (n, 2), a point a, shape (2,), sees."""
    ends = _as_states(b)
    return checker.motions_free(_as_states(np.broadcast_to(a, b.shape)), ends)


def _axes(world: World) -> tuple[FloatArray, FloatArray, float]:
    """Return the x and the y of the centres of squares that cover the bounds, and their side, metres."""
    xmin, ymin, xmax, ymax = world.bounds
    side = float(np.sqrt((xmax - xmin) * (ymax - ymin) / PLACES))
    return np.arange(xmin + 0.5 * side, xmax, side), np.arange(ymin + 0.5 * side, ymax, side), side


def _neighbours(index: NDArray[np.intp], free: NDArray[np.bool_], dy: int, dx: int) -> NDArray[np.intp]:
    """Return pairs of indices, shape (n, 2), of free configurations of one heading, so many rows and columns apart."""
    rows, columns = index.shape[:2]
    a = slice(0, rows - dy), slice(max(0, -dx), columns - max(0, dx))
    b = slice(dy, rows), slice(max(0, dx), columns - max(0, -dx))
    both = free[a] & free[b]
    return np.column_stack([index[a][both], index[b][both]])


def _thinned(rows: FloatArray, spacing: float) -> FloatArray:
    """Return the first row, of any that begin with x and y, in each square of a grid, metres."""
    _, first = np.unique(np.floor(rows[:, :2] / spacing), axis=0, return_index=True)
    return rows[np.sort(first)]


def _as_states(points: FloatArray) -> FloatArray:
    return np.column_stack([points, np.zeros(len(points))])


def _mount(robot: SimulatedRobot) -> tuple[float, float, float]:
    return robot.sensor.mount if isinstance(robot.sensor, Scanner) else (0.0, 0.0, 0.0)


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
