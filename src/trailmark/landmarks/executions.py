"""Executions of the source method, and of trailmark's own, in a world: from sensing to usable landmarks."""

from __future__ import annotations

from functools import cache
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError
from trailmark.estimation import RangeBearing, sense_obstacles
from trailmark.landmarks.kmeans import k_means_landmarks
from trailmark.landmarks.paper import Initialisation, algorithm_2, require_count
from trailmark.landmarks.relaxation import Relaxation
from trailmark.landmarks.repair import repair_centres
from trailmark.landmarks.sampling import RandomState, draw, free_samples, generator
from trailmark.shapes import Disc
from trailmark.world import World

__all__ = ["Execution", "execute_paper", "execute_se2", "readings_in"]

SENSOR_RANGE = 12.0
"""Range of the sensor in metres by default: that of a common small laser scanner."""

SIGMA_RANGE, SIGMA_BEARING = 0.05, 0.01
"""Standard deviations (metres, radians) of a reading by default."""

POSES = (100, 2000)
"""Minimum and maximum number of places that the robot senses from."""

POINTS, POINT_SPACING = (24, 240), 3.0
"""Minimum and maximum number of points read of an outline, and the metres of the longest outline for each of them."""

AREA_PER_POSE = 20.0
"""Square metres of the bounds for each such place: several are within range of every obstacle."""


class Execution(NamedTuple):
    """One execution: what was drawn, what was clustered, and the result. Metres and radians.

    Attributes:
        samples: all that was drawn: points (n, 2), or configurations (n, 3) of trailmark's own method.
        forbidden: shape (n,), which of them were not clustered.
        enclosed: shape (n,), those of them that are free but out of the robot's reach.
        boxes: shape (m, 4), the source method's obstacles; none in trailmark's own method.
        centres: the landmarks, shape (k, 2) or (k, 3).
        labels: shape (v,), the landmark of each of the v valid samples.
        inertia: sum of the squared distances of the valid samples to their landmarks, square metres; trailmark's own
            in its embedding (:func:`trailmark.se2.embed`).
        iterations: steps of Lloyd's algorithm, or number of mini-batches; None if unknown.
        mini_batches: whether mini-batches were used.
        in_obstacle: shape (k,), see :class:`~trailmark.landmarks.repair.Repair`.
        invalid: shape (k,), see there.
        repaired: valid configurations in the centres' place, shape (k, 3).
        seconds: time from readings to landmarks, without loading scikit-learn.
    """

    samples: se2.FloatArray
    forbidden: NDArray[np.bool_]
    enclosed: NDArray[np.bool_]
    boxes: se2.FloatArray
    centres: se2.FloatArray
    labels: NDArray[np.int32]
    inertia: float
    iterations: int | None
    mini_batches: bool
    in_obstacle: NDArray[np.bool_]
    invalid: NDArray[np.bool_]
    repaired: se2.FloatArray
    seconds: float


def execute_paper(
    checker: StateChecker,
    n: int = 1000,
    k: int = 12,
    init: Initialisation = "forgy",
    random_state: RandomState = None,
    *,
    start: se2.FloatArray | None = None,
    sensor: RangeBearing | None = None,
    sensor_range: float = SENSOR_RANGE,
    grown: bool = False,
) -> Execution:
    """Return one execution of Algorithm 2 in the checker's world; the rectangle is the world's bounds.

    The obstacles are sensed (:func:`readings_in`), Algorithm 2 computes landmarks from the readings, and the checker
    finds which of them the robot can use.

    Args:
        checker: world and robot; Algorithm 2 itself uses only where the robot starts.
        n: how many points to draw, >= 1.
        k: how many landmarks.
        init: the first centres, see :func:`~trailmark.landmarks.paper.initial_centres`.
        random_state: seed or generator; the same one gives the same execution.
        start: where the robot starts, shape (3,); what it cannot reach from there counts as occupied. Without a valid
            one, only what obstacles separate from the bounds does.
        sensor: its noise; by default SIGMA_RANGE and SIGMA_BEARING.
        sensor_range: metres.
        grown: grow the obstacles' boxes by the radius of the robot's largest inscribed disc, so that points at which it
            can stand at no heading are not clustered.

    Raises:
        ConfigurationError: an argument out of range, fewer valid points than k, no place for the robot.
    """
    rng, home = generator(random_state), start if start is not None and checker.valid(start) else None
    readings = readings_in(checker, rng, start=home, sensor=sensor, sensor_range=sensor_range)
    robot = None if home is None else home[:2]
    margin = checker.robot.inscribed_disc.radius if grown else 0.0
    _load()
    begin = perf_counter()
    found = algorithm_2(readings, checker.world.bounds, n, k, init, rng, robot=robot, margin=margin)
    seconds = perf_counter() - begin
    repair = repair_centres(checker, found.centres, found.samples[~found.forbidden])
    return Execution(*found, repair.in_obstacle, repair.invalid, repair.configurations, seconds)


def readings_in(
    checker: StateChecker,
    random_state: RandomState = None,
    *,
    start: se2.FloatArray | None = None,
    sensor: RangeBearing | None = None,
    sensor_range: float = SENSOR_RANGE,
) -> list[se2.FloatArray]:
    """Return the refined readings of each obstacle, shape (r, 2): Algorithm 2's first step, in a known world.

    The robot senses the obstacles' outlines from random valid configurations that it can reach, and the EKF refines the
    readings (:func:`trailmark.estimation.sense_obstacles`).

    Args:
        checker: world and robot.
        random_state: seed or generator.
        start: valid configuration, shape (3,), from which the robot reaches the others; None for anywhere.
        sensor: its noise; by default SIGMA_RANGE and SIGMA_BEARING.
        sensor_range: metres.

    Raises:
        ConfigurationError: no place for the robot.
    """
    world, rng = checker.world, generator(random_state)
    xmin, ymin, xmax, ymax = world.bounds
    count = int(np.clip((xmax - xmin) * (ymax - ymin) / AREA_PER_POSE, *POSES))
    poses = free_samples(checker, count, reachable_from=start, random_state=rng)
    if len(poses) == 0:
        raise ConfigurationError(f"world {world.name!r}: empty free space: no place for the robot was found")
    sensor = RangeBearing(SIGMA_RANGE, SIGMA_BEARING) if sensor is None else sensor
    return sense_obstacles(
        world,
        poses,
        sensor,
        points_per_obstacle=_outline_points(world),
        max_range=sensor_range,
        random_state=rng,
    )


def execute_se2(
    checker: StateChecker,
    n: int = 1000,
    k: int = 12,
    random_state: RandomState = None,
    *,
    start: se2.FloatArray | None = None,
) -> Execution:
    """Return one execution of trailmark's own method over a whole world: valid samples in SE(2), repaired centres.

    Args:
        checker: decides what is valid.
        n: how many configurations to draw, >= 1.
        k: how many landmarks; fewer are returned where two centres have the same nearest sample.
        random_state: seed or generator.
        start: configuration, shape (3,); if it is valid, what the robot cannot reach from there is left out.

    Raises:
        ConfigurationError: an argument out of range, or fewer valid samples than k.
    """
    from scipy.spatial import cKDTree

    if n < 1:
        raise ConfigurationError(f"n: expected 1 or more, got {n}")
    _load()
    begin, rng = perf_counter(), generator(random_state)
    samples = draw(checker.world.bounds, n, random_state=rng)
    if isinstance(checker.robot.footprint, Disc):
        samples[:, 2] = 0.0
    valid = np.asarray(checker.valid(samples))
    enclosed = np.zeros(n, dtype=np.bool_)
    if start is not None and checker.valid(start):
        relaxation = Relaxation(checker)
        enclosed = valid & ~relaxation.component(start)[relaxation.cells(relaxation.disc_centers(samples))]
    usable = samples[valid & ~enclosed]
    require_count(k, len(usable), f"{n} samples")
    radius = checker.footprint.sweep_radius
    landmarks = k_means_landmarks(usable, k, radius=radius, random_state=rng)
    found = cKDTree(se2.embed(landmarks, radius)).query(se2.embed(usable, radius))
    distance, labels = np.asarray(found[0]), np.asarray(found[1], dtype=np.int32)
    seconds = perf_counter() - begin
    invalid = ~np.asarray(checker.valid(landmarks))
    return Execution(
        samples,
        forbidden=~valid | enclosed,
        enclosed=enclosed,
        boxes=np.empty((0, 4)),
        centres=landmarks,
        labels=labels,
        inertia=float(distance @ distance),
        iterations=None,
        mini_batches=False,
        in_obstacle=invalid,
        invalid=invalid,
        repaired=landmarks,
        seconds=seconds,
    )


def _outline_points(world: World) -> int:
    """Return how many points of each outline are read: a large obstacle needs more to be sensed from everywhere."""
    longest = max((shape.polygon(1e-2).shapely().length for shape in world.obstacles), default=0.0)
    return int(np.clip(longest / POINT_SPACING, *POINTS))


@cache
def _load() -> None:
    """Load scikit-learn and scipy, which takes a second or two that a first execution's time must not include."""
    algorithm_2([[[0.4, 0.4], [0.6, 0.6]]], (0.0, 0.0, 1.0, 1.0), 50, 2, random_state=0)
