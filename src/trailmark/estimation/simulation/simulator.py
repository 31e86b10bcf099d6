# ruff: noqa: N806 # the filter's own symbol: Q
"""A robot driven through a world, with noisy odometry and noisy sensors: a log, and the truth.

What is simulated is exactly what the filters assume, so that they can be tested: noise is white and Gaussian, drawn
from the very models (:mod:`trailmark.estimation.filter.motion`, :mod:`trailmark.estimation.filter.sensors`) that a
filter is given.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.checked import Numbers, Positive, RandomState, checked_arguments
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.filter.motion import PoseIncrement, Unicycle
from trailmark.estimation.logs.records import Increment, Log, Odometry, Pose, Record
from trailmark.estimation.simulation.driving import Drive
from trailmark.estimation.simulation.raycast import RayCaster
from trailmark.estimation.simulation.virtual_sensors import Detector, Scanner
from trailmark.se2 import FloatArray, compose, wrap
from trailmark.world import World

if TYPE_CHECKING:
    import shapely

__all__ = ["Simulation", "simulate"]

_INSTANT = 1e-9
"""Seconds: events closer together are simultaneous."""

_TOUCH = 1e-6
"""Metres that the robot's reference point may be inside an obstacle: it may touch one."""

_INCREMENT, _VELOCITY, _TRUTH, _DETECTION, _SCAN = range(5)
"""The order of records at one time."""


class Simulation(NamedTuple):
    """What a simulated robot recorded, and where it really was."""

    log: Log
    """All records by time; the truth is among them as ``Pose(truth=True)``, and ``landmarks`` are the true discs."""
    truth: FloatArray
    """Shape (n, 4), rows t, x, y, theta: one for each time of the log, seconds from 0."""


@checked_arguments(EstimationError)
def simulate(
    world: World,
    states: Numbers,
    motion: Unicycle | PoseIncrement,
    *,
    detector: Detector | None = None,
    scanner: Scanner | None = None,
    speed: Positive = 1.0,
    turn_rate: Positive = 1.0,
    period: Positive = 0.1,
    name: str | None = None,
    random_state: RandomState = None,
) -> Simulation:
    """Drive a robot through a world and record what its odometry and its sensors say.

    The robot drives exactly along the path (:class:`trailmark.estimation.simulation.driving.Drive`); its odometry
    errs. With :class:`Unicycle` the log holds velocities, each until the next, and an exact stop at the end; with
    :class:`PoseIncrement` it holds increments with their covariances, and the robot can move in every direction. The
    noise is drawn so that the true step is the recorded one with w added, w ~ N(0, Q), Q that of the true step. There
    is an odometry record every ``period``, and wherever a velocity changes or a sensor reads.

    At one time an increment comes first, then a velocity, the truth, detections, and the scan. Odometry, detector and
    scanner draw from streams of their own: to leave one out does not change the others.

    Args:
        world: what the sensors see. Only the robot's reference point and its scanner are checked for collision.
        states: the path, shape (n, 3), or waypoints, shape (n, 2); metres and radians.
        motion: the odometry's noise; the model decides the kind of record.
        detector: reads discs; None for a robot without one.
        scanner: casts beams; None for a robot without one.
        speed: metres per second.
        turn_rate: radians per second.
        period: seconds between odometry records.
        name: of the log; the world's if left out.
        random_state: seed or generator; the same one gives the same log.

    Raises:
        EstimationError: values out of range, or a path that leaves the world or leads into an obstacle.
    """
    drive = Drive(states, speed, turn_rate, holonomic=isinstance(motion, PoseIncrement))
    end = float(drive.times[-1])
    sweeps = [_ticks(end, sensor.period) if sensor else np.empty(0) for sensor in (detector, scanner)]
    times = _merged([drive.times, _ticks(end, period), *sweeps])
    poses = drive.poses(times)
    _check_free(world, poses[:, :2], "states: the path", joined=True)
    odometry_rng, detector_rng, scanner_rng = np.random.default_rng(random_state).spawn(3)
    records: list[tuple[float, int, Record]]
    if isinstance(motion, PoseIncrement):
        records = [(step.t, _INCREMENT, step) for step in _increments(motion, times, poses, odometry_rng)]
    else:
        records = [(held.t, _VELOCITY, held) for held in _velocities(motion, drive, times, odometry_rng)]
    rows = zip(times.tolist(), poses.tolist(), strict=True)
    records += ((t, _TRUTH, Pose(t, x, y, theta, truth=True)) for t, (x, y, theta) in rows)
    features = np.empty((0, 4))
    if detector is not None:
        features = detector.features(world)
        caster = RayCaster(world)
        for i in _places(times, sweeps[0]):
            found = detector.sweep(float(times[i]), poses[i], features, caster, detector_rng)
            records += ((detection.t, _DETECTION, detection) for detection in found)
    if scanner is not None:
        caster = RayCaster(world, bounds=scanner.bounds)
        own = compose(poses[_places(times, sweeps[1])], np.array(scanner.mount))
        _check_free(world, own[:, :2], "states: the scanner's path", joined=False)
        for i in _places(times, sweeps[1]):
            scan = scanner.sweep(float(times[i]), poses[i], caster, scanner_rng)
            records.append((scan.t, _SCAN, scan))
    records.sort(key=lambda entry: entry[:2])
    log = Log(world.name if name is None else name, tuple(record for _, _, record in records), features[:, :3])
    return Simulation(log, np.column_stack([times, poses]))


def _velocities(motion: Unicycle, drive: Drive, times: FloatArray, rng: np.random.Generator) -> list[Odometry]:
    """Return a record at the start of each step, and the stop at the end."""
    # In the middle of a step: at its ends rounding could take the neighbour's velocity.
    velocities = drive.velocities(0.5 * (times[:-1] + times[1:]))
    records = []
    for t, dt, (v, omega) in zip(times.tolist(), np.diff(times).tolist(), velocities.tolist(), strict=False):
        w_v, w_omega = np.sqrt(np.diag(motion.Q((v, omega, dt)))) * rng.standard_normal(2)
        records.append(Odometry(t, v - float(w_v), omega - float(w_omega)))
    return [*records, Odometry(float(times[-1]), 0.0, 0.0)]


def _increments(
    motion: PoseIncrement, times: FloatArray, poses: FloatArray, rng: np.random.Generator
) -> list[Increment]:
    """Return a record at the end of each step."""
    records = []
    cos, sin = np.cos(poses[:-1, 2]), np.sin(poses[:-1, 2])
    dx, dy, dtheta = np.diff(poses, axis=0).T
    steps = np.column_stack([cos * dx + sin * dy, cos * dy - sin * dx, np.asarray(wrap(dtheta))])
    for t, u in zip(times[1:].tolist(), steps, strict=True):
        Q = motion.Q(u)
        x, y, theta = (u - np.sqrt(np.diag(Q)) * rng.standard_normal(3)).tolist()
        records.append(Increment(t, x, y, theta, Q))
    return records


def _ticks(end: float, period: float) -> FloatArray:
    """Return the multiples of a period from 0 to the end."""
    return period * np.arange(math.floor((end + _INSTANT) / period) + 1, dtype=np.float64)


def _merged(parts: list[FloatArray]) -> FloatArray:
    """Return all times in order, those that lie within an instant as one."""
    times = np.sort(np.concatenate(parts))
    return np.asarray(times[np.concatenate([[True], np.diff(times) > _INSTANT])])


def _places(times: FloatArray, some: FloatArray) -> NDArray[np.intp]:
    """Return where these times are among the merged ones, shape as ``some``."""
    return np.asarray(np.searchsorted(times, some, side="right") - 1)


def _check_free(world: World, xy: FloatArray, what: str, *, joined: bool) -> None:
    """Raise if points (n, 2), or the line that joins them, leave the world or lead into an obstacle."""
    import shapely

    path = shapely.LineString(xy) if joined and np.ptp(xy, axis=0).any() else shapely.MultiPoint(xy)
    xmin, ymin, xmax, ymax = world.bounds
    inside = [shapely.box(xmin - _TOUCH, ymin - _TOUCH, xmax + _TOUCH, ymax + _TOUCH)]
    if world.boundary is not None:
        inside.append(shapely.buffer(world.boundary.shapely(), _TOUCH))
    for region, edge in zip(inside, ("bounds", "boundary"), strict=False):
        if not region.covers(path):
            raise EstimationError(f"{what} leaves the world's {edge} near {_first_point(path.difference(region))}")
    for i, obstacle in enumerate(world.obstacles):
        # A disc's polygon contains the disc; it is shrunk again by less than its tolerance.
        region = obstacle.polygon(0.5 * _TOUCH).shapely()
        met = path.intersection(shapely.buffer(region, -_TOUCH, join_style="mitre"))
        if not met.is_empty:
            raise EstimationError(f"{what} leads through obstacles[{i}] near {_first_point(met)}")


def _first_point(geometry: shapely.Geometry) -> str:
    import shapely

    x, y = shapely.get_coordinates(geometry)[0]
    return f"({x:.3g}, {y:.3g})"
