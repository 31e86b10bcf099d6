# ruff: noqa: N806 # the names are those of the literature: x, P, F, W, Q, H, R, S, K
"""A robot driven through a world, with noisy odometry and noisy sensors: a log, and the truth.

What is simulated is exactly what the filters assume, so that they can be tested: noise is white and Gaussian, drawn
from the very models (:mod:`trailmark.estimation.models`) that a filter is given.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark import se2
from trailmark.arguments import Numbers, Positive, RandomState, checked_arguments
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.models import PoseIncrement, Unicycle
from trailmark.estimation.records import Increment, Log, Odometry, Pose, Record
from trailmark.estimation.virtual_sensors import Detector, RayCaster, Scanner
from trailmark.se2 import FloatArray, between, compose
from trailmark.world import World

if TYPE_CHECKING:
    import shapely


_SAME = 1e-6  # Radians and metres: within these a motion counts as an arc, and a place as reached.
_NOTHING = 1e-9  # Seconds: a motion that takes no longer is none.
_ARC = Unicycle(0.0, 0.0)
_INSTANT = 1e-9  # Seconds: events closer together are simultaneous.
_TOUCH = 1e-6  # Metres that the robot's reference point may be inside an obstacle: it may touch one.
_INCREMENT, _VELOCITY, _TRUTH, _DETECTION, _SCAN = range(5)  # The order of records at one time.


class _Piece(NamedTuple):
    """A motion of constant velocities: of the robot's own (an arc), or, if ``holonomic``, of x, y and theta."""

    start: FloatArray
    end: FloatArray
    v: float
    omega: float
    duration: float
    holonomic: bool


class Drive:
    """A drive: constant velocities, piece by piece; ``times``, shape (k + 1,), are when they begin and the last ends.

    A robot that can move in every direction (``holonomic``) follows the configurations as a planner means them: x and
    y linearly, theta along the shorter arc. A unicycle drives an arc from one configuration to the next where one arc,
    forward or backward, joins them; elsewhere it turns on the spot, goes straight (backward if that takes less
    turning), and turns again.

    Args:
        states: configurations x, y, theta, shape (n, 3), n >= 1, each of which is reached; or waypoints x, y, shape
            (n, 2), n >= 2, which a robot of either kind drives to straight ahead, turning on the spot in between.
        speed: metres per second; the robot is as fast as that or as ``turn_rate`` allows.
        turn_rate: radians per second.
        holonomic: whether the robot can move in every direction.
    """

    @checked_arguments(EstimationError)
    def __init__(self, states: Numbers, speed: Positive, turn_rate: Positive, *, holonomic: bool = False) -> None:
        q, headings = _states(states)
        self._speed, self._turn_rate = speed, turn_rate
        self._pieces: list[_Piece] = []
        self._here = self._start = q[0]
        for target in q[1:]:
            if holonomic and headings:
                self._shift(target)
            elif headings:
                self._reach(target)
            else:
                x, y, _ = between(self._here, target).tolist()
                if math.hypot(x, y) > _SAME:
                    self._arc(0.0, math.atan2(y, x))
                    self._arc(math.hypot(x, y), 0.0)
        self.times: FloatArray = np.concatenate([[0.0], np.cumsum([piece.duration for piece in self._pieces])])

    def poses(self, times: ArrayLike) -> FloatArray:
        """Return the poses at these times, shape (m, 3); before the start and after the end the robot stands."""
        t = np.clip(np.asarray(times, dtype=np.float64), 0.0, self.times[-1])
        which = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, max(0, len(self._pieces) - 1))
        poses = np.tile(self._start, (len(t), 1))
        for i in np.unique(which) if self._pieces else ():
            poses[which == i] = _along(self._pieces[i], t[which == i] - self.times[i])
        return poses

    def velocities(self, times: ArrayLike) -> FloatArray:
        """Return v (m/s) and omega (rad/s) at these times, shape (m, 2); 0 where the robot stands."""
        which = np.searchsorted(self.times, np.asarray(times, dtype=np.float64), side="right") - 1
        which[(which < 0) | (which >= len(self._pieces))] = -1
        table = [(piece.v, piece.omega) for piece in self._pieces]
        return np.array([*table, (0.0, 0.0)])[which]

    def _reach(self, target: FloatArray) -> None:
        """Drive to a configuration as a unicycle."""
        x, y, turn = between(self._here, target).tolist()
        away, alpha = math.hypot(x, y), math.atan2(y, x)
        if away <= _SAME:
            self._arc(0.0, turn)
            return
        back = float(se2.wrap(alpha + math.pi))
        for sign, half in ((1.0, alpha), (-1.0, back)):
            # A chord leaves its arc by half of the arc's turn.
            if abs(half) <= math.pi / 2 and abs(se2.wrap(turn - 2.0 * half)) <= _SAME:
                self._arc(sign * away / float(np.sinc(half / math.pi)), 2.0 * half)
                return
        forward, backward = (abs(first) + abs(se2.wrap(turn - first)) for first in (alpha, back))
        sign, first = (1.0, alpha) if forward <= backward else (-1.0, back)
        self._arc(0.0, first)
        self._arc(sign * away, 0.0)
        self._arc(0.0, float(between(self._here, target)[2]))

    def _arc(self, length: float, turn: float) -> None:
        self._add(_ARC.f(self._here, (length, turn, 1.0)), length, turn, holonomic=False)

    def _shift(self, target: FloatArray) -> None:
        x, y, turn = between(self._here, target).tolist()
        self._add(target, math.hypot(x, y), turn, holonomic=True)

    def _add(self, end: FloatArray, length: float, turn: float, *, holonomic: bool) -> None:
        """Add a motion that is as fast as speed and turning rate allow."""
        duration = max(abs(length) / self._speed, abs(turn) / self._turn_rate)
        if duration > _NOTHING:
            v = 0.0 if holonomic else length / duration
            self._pieces.append(_Piece(self._here, end, v, turn / duration, duration, holonomic))
            self._here = end


def _states(states: ArrayLike) -> tuple[FloatArray, bool]:
    """Return configurations, shape (n, 3), and whether their headings are to be reached."""
    given = np.asarray(states, dtype=np.float64)
    columns = given.shape[1] if given.ndim == 2 else 0
    if columns not in (2, 3) or len(given) < 4 - columns:
        raise EstimationError(f"states: expected shape (n, 3), n >= 1, or (n, 2), n >= 2, got {given.shape}")
    if columns == 3:
        return se2.configurations(given, name="states"), True
    moves = np.diff(given, axis=0)
    moves = moves[np.hypot(moves[:, 0], moves[:, 1]) > _SAME]
    heading = float(np.arctan2(moves[0, 1], moves[0, 0])) if len(moves) else 0.0
    return np.column_stack([given, np.full(len(given), heading)]), False


def _along(piece: _Piece, s: FloatArray) -> FloatArray:
    """Return the poses s seconds (m,) into a piece, shape (m, 3)."""
    if piece.holonomic:
        return se2.interpolate(piece.start, piece.end, s / piece.duration)
    return _ARC.f(piece.start, np.column_stack([piece.v * s, piece.omega * s, np.ones(len(s))]))


class Simulation(NamedTuple):
    """What a simulated robot recorded, and where it really was."""

    #: All records by time; the truth is among them as ``Pose(truth=True)``, and ``landmarks`` are the true discs.
    log: Log
    truth: FloatArray  #: Shape (n, 4), rows t, x, y, theta: one for each time of the log, seconds from 0.


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

    The robot drives exactly along the path (:class:`trailmark.estimation.simulation.Drive`); its odometry
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
    for t, u in zip(times[1:].tolist(), between(poses[:-1], poses[1:]), strict=True):
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
