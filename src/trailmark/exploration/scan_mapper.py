"""The map of a robot that explores with a laser: poses by matching scans, cells by their beams."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.covariance import chi_square_quantile
from trailmark.estimation.laser_slam import ScanSlam
from trailmark.estimation.odometry import DeadReckoning
from trailmark.estimation.pose_graph import MIN_POINTS, GraphSettings
from trailmark.estimation.records import Increment, Log, Odometry, Record, Scan
from trailmark.estimation.scan_matching import Window, joined, local_map, refine, search, surface_cloud
from trailmark.estimation.virtual_sensors import Scanner
from trailmark.exploration.known_map import KnownMap
from trailmark.exploration.mapper import CARRIED, Belief, Mapper
from trailmark.exploration.result import ExplorationSettings
from trailmark.se2 import FloatArray, between, compose, difference
from trailmark.world import Robot

__all__ = ["ScanMapper", "apart", "graph_settings"]


# Metres and radians between scans by which a map is drawn anew, or from the log: in between little else is seen.
SPACING: Final = 0.25, 0.3
RECENT: Final = 10  # Scans that are drawn in any case: what has vanished since is gone.
# Times the standard deviation of a step that odometry states, for matching: what it does not know of.
SLIPPING: Final = 1.5
LEAST: Final = 0.01  # Metres by which end points scatter at least about a map made of cells.
FAR: Final = 10.0  # Metres: for sensors of a longer range, the lengths of scan matching grow in proportion.
# Share of the distance between nodes that counts as driven at least: before, hardly anything has been stated.
SHORTEST: Final = 0.1
# Metres and radians: odometry that states a smaller error over ten metres is taken as exact; no match is as good.
TRUSTED: Final = 0.002, 0.001
GAP: Final = 0.1  # Metres between end points of one surface from which on they would count as shapes of their own.
# Scans after which odometry that is taken as exact is checked again, by those of one and two such times ago.
CHECK: Final = 10
# Metres and radians: a scan that fits better farther than that from where odometry has it says that it errs.
EXACT: Final = 0.05, 0.03
ALIKE: Final = 0.9  # Share of the best place's fit from which on another place fits as well.
# Metres and radians: standard deviation of a matched pose in the map around it, as measured against the truth; and
# that of the ranges by which it was measured, metres.
MATCHED, MATCHED_AT = (0.008, 0.002), 0.01
# Metres and radians by which wheels stray to the side in a period of a tenth of a second, slipping now and then.
STRAYED: Final = 0.01, 0.004
PLACES: Final = 20  # Narrow places that a run leads through, over which the risk is spread.
POINTS: Final = 200  # End points of a scan, at most, by which odometry is checked.
MOVED: Final = 0.5  # Cells by which a closed loop must have moved some pose for the map to be drawn anew.


def apart(poses: FloatArray) -> NDArray[np.bool_]:
    """Return which scans, by their poses of shape (m, 3), lie SPACING apart from those before, and the last ones."""
    chosen, last = np.zeros(len(poses), np.bool_), 0
    for i, pose in enumerate(poses):
        off = np.abs(difference(poses[last], pose))
        if i == 0 or np.hypot(off[0], off[1]) > SPACING[0] or off[2] > SPACING[1]:
            chosen[i], last = True, i
    chosen[-RECENT:] = True
    return chosen


def graph_settings(sensor: Scanner, errors: FloatArray, driven: float, exact: bool) -> GraphSettings:
    """Return how scans are matched.

    Args:
        sensor: its range and noise.
        errors: variances of place (m²) and heading (rad²) that odometry has stated so far, shape (2,).
        driven: metres, and radians of turns, over which it has stated them.
        exact: whether these are to count for nothing, since scans say otherwise.
    """
    s, far = GraphSettings(), max(1.0, sensor.max_range / FAR)
    s = replace(
        s,
        scale=far,
        max_range=min(far * s.max_range, sensor.max_range),
        scatter=max(sensor.sigma, LEAST),
    )
    if exact:
        return s
    # Of a step from node to node, with something for wheels that slip.
    place, heading = SLIPPING * np.sqrt(errors / max(driven, SHORTEST * s.key_distance) * s.key_distance)
    floor = min(float(place), far * s.odometry_floor[0]), min(float(heading), s.odometry_floor[1])
    grown = min(floor[0] / s.key_distance, s.odometry[0]), min(floor[1] / s.key_distance, s.odometry[1])
    return replace(s, odometry=grown, odometry_floor=floor)


class ScanMapper(Mapper):
    """A mapper for a laser.

    Odometry is taken as exact as long as it states so and scans do not contradict it. Else scans are matched, and loops
    closed (:class:`trailmark.estimation.laser_slam.ScanSlam`).

    Args:
        start: where the robot stands first, shape (3,).
        known: the cells to fill in, nothing known so far.
        sensor: the laser's range and noise.
        robot: of the world.
        settings: the confidence asked for.
    """

    def __init__(
        self, start: FloatArray, known: KnownMap, sensor: Scanner, robot: Robot, settings: ExplorationSettings
    ) -> None:
        super().__init__(start, known, robot, settings, Scan, sensor.max_range)
        known.noise, self._sensor, self._reckoning = sensor.sigma, sensor, DeadReckoning(self._start)
        self._slam: ScanSlam | None = None  # None as long as odometry is taken as exact
        self._scans = list[tuple[Scan, FloatArray]]()  # with their poses by odometry
        self._drawn = list[FloatArray]()  # where they were when the map was drawn
        self._errors, self._driven = np.zeros(2), 0.0
        self._at = self._pose = self._start  # by odometry, at the last scan; and where that was
        self._left_out, self._moved = list[Scan](), False

    @property
    def pose(self) -> FloatArray:
        """Where the robot is, shape (3,)."""
        return compose(self._pose, between(self._at, self._reckoning.pose))

    @property
    def covariance(self) -> FloatArray:
        """Of the pose, shape (3, 3): that in the map around the robot, and what that has drifted since the start."""
        if self._slam is None or not self._scans:
            return np.zeros((3, 3))
        return self._slam.covariance + float(self._slam.drifts()[0, 1]) ** 2 * np.diag([1.0, 1.0, 0.0])

    @property
    def trajectory(self) -> FloatArray:
        """Where the scans were taken, as is known now, shape (n, 4), rows t, x, y, theta."""
        poses = self._slam.poses if self._slam is not None else np.array([pose for _, pose in self._scans])
        return np.column_stack([[scan.t for scan, _ in self._scans], poses.reshape(-1, 3)])

    @property
    def covariances(self) -> FloatArray:
        """Of the trajectory's poses, shape (n, 3, 3), in the world's axes."""
        return np.zeros((len(self._scans), 3, 3)) if self._slam is None else self._slam.covariances()

    @property
    def margin(self) -> float:
        """Metres to keep from what is occupied or unknown for the confidence asked for; 0 without one.

        The pose's error in the map around the robot, which grows with the noise of ranges, and what wheels stray in a
        period, each with what its heading's error comes to at the robot's farthest point, over :data:`PLACES` narrow
        places. The error of ranges themselves is in the map: cells in which a fourth of the beams ends are occupied.
        """
        if self._confidence is None:
            return 0.0
        times = max(1.0, self._sensor.sigma / MATCHED_AT)
        place, heading = np.hypot(times * np.array(MATCHED), STRAYED)
        sigma = np.hypot(place, heading * self._robot.sweep_radius)
        return float(np.sqrt(chi_square_quantile(1.0 - (1.0 - self._confidence) / PLACES, 1)) * sigma)

    def take(self, records: Sequence[Record]) -> Belief:
        """Take in what was sensed, and bring pose and map up to date."""
        readings, refused, self._moved = 0, list[str](), False
        for record in self._usable(records, refused):
            self._reckoning.add(record)
            if not isinstance(record, Scan):
                self.records.append(record)
                if isinstance(record, Increment | Odometry):
                    self._count_errors(record)
            elif self._fits(record):
                self._add(record)
                readings += 1
            else:
                refused.append(
                    f"scan at {record.t:.3f} s left out: expected what the map shows here, got another place"
                )
        return self._belief(readings, refused, self._moved)

    def relocate(self) -> bool:
        """Look for the robot in the map, after it was lost; return whether it was found."""
        if not self._left_out:
            return False
        scan, slam = self._left_out.pop(), self._match_from_now_on()
        pose = self._place_of(scan, slam.candidates(scan))
        if pose is None:
            return False
        carried = self._carry(scan.t, pose, CARRIED)
        self._reckoning.add(carried)
        self.records += [carried, scan]
        slam.place(scan, pose, self._reckoning.pose)
        self._scans.append((scan, self._reckoning.pose))
        self._at, self._pose = self._reckoning.pose, slam.pose
        self._drawn.append(self._pose)
        self.known.add_scan(scan, self._pose, self._sensor.max_range)
        return True

    def finished_log(self, log: Log) -> Log:
        """Return the log with the poses of its scans, found from all of them together, and those that lie apart alone.

        With exact odometry it is as it was.
        """
        if self._slam is None:
            return log
        found = self._slam.finish(np.array([pose for _, pose in self._scans])).poses
        kept = np.flatnonzero(apart(found))
        poses = {self._scans[i][0].t: tuple(found[i].tolist()) for i in kept.tolist()}
        records = list[Record]()
        for record in log.records:
            if not isinstance(record, Scan):
                records.append(record)
            elif record.t in poses:
                records.append(record._replace(pose=poses[record.t]))
        return log._replace(records=tuple(records))

    def _count_errors(self, record: Increment | Odometry) -> None:
        """Take note of how sure the odometry says it is."""
        if isinstance(record, Odometry) or record.covariance is None:
            self._errors[:] = np.inf
        else:
            covariance = np.asarray(record.covariance)
            self._errors += max(covariance[0, 0], covariance[1, 1]), covariance[2, 2]
            self._driven += float(np.hypot(record.dx, record.dy) + abs(record.dtheta))
        if self._slam is None and not self._states_exactness:
            self._match_from_now_on()

    @property
    def _states_exactness(self) -> bool:
        return bool((self._errors <= np.square(TRUSTED) * max(self._driven, 1.0) / 10.0).all())

    def _match_from_now_on(self) -> ScanSlam:
        """Match scans from now on, and those so far with them."""
        if self._slam is None:
            slam = ScanSlam(graph_settings(self._sensor, self._errors, self._driven, self._states_exactness))
            for scan, pose in self._scans:
                slam.add(scan, pose)
            self._slam = slam
            if self._scans:
                self._at, self._pose = self._scans[-1][1], self._slam.pose
                self._draw_if_moved()
        return self._slam

    def _is_exact(self, scan: Scan) -> bool:
        """Return whether a scan lies, among those of a while ago, where odometry has it."""
        reach, here = min(GraphSettings.max_range, self._sensor.max_range), self._reckoning.pose
        before = self._scans[-2 * CHECK :: CHECK]
        cloud = surface_cloud(scan, reach)
        if len(cloud.points) < MIN_POINTS or not before:
            return True
        joint = joined([surface_cloud(old, reach) for old, _ in before], np.array([pose for _, pose in before]))
        area = local_map(joint, gap=GAP)
        points = cloud.points[:: -(-len(cloud.points) // POINTS)]
        # Where nothing holds the scan, as along a corridor, it is where odometry has it.
        information = np.diag([1.0 / EXACT[0] ** 2, 1.0 / EXACT[0] ** 2, 1.0 / EXACT[1] ** 2])
        found = search(area, points, here, Window(1.5, 0.5), information=information, coarseness=2)
        if found is None:
            return True
        off = np.abs(difference(here, refine(area, cloud, found.pose, information=information, guess=here).pose))
        return bool(np.hypot(off[0], off[1]) <= EXACT[0] and off[2] <= EXACT[1])

    def _fits(self, scan: Scan) -> bool:
        """Return whether a scan shows what the map has where the robot should be."""
        fit = self.known.agreement(scan, self.pose, self._sensor.max_range)
        strange = fit.is_strange
        due = strange or len(self._scans) % CHECK == CHECK - 1
        if self._slam is None and due and not self._is_exact(scan):
            self._match_from_now_on()
        if strange and self._slam is not None:
            at = self._slam.match(scan, self._reckoning.pose)  # perhaps wheels have slipped
            strange = not self.known.agreement(scan, at, self._sensor.max_range).is_sure
        self._strange = self._strange + 1 if strange else 0
        self._left_out = [scan] if strange else []
        return not strange

    def _place_of(self, scan: Scan, candidates: FloatArray) -> FloatArray | None:
        """Return the one candidate, of shape (k, 3), that fits the map; None if none does, or several do."""
        fits = [self.known.agreement(scan, pose, self._sensor.max_range) for pose in candidates]
        good = sorted((fit.met - fit.against, i) for i, fit in enumerate(fits) if fit.is_sure)
        if not good:
            return None
        pose = candidates[good[-1][1]]
        for value, i in good[:-1]:
            off = np.abs(difference(pose, candidates[i]))
            if value > ALIKE * good[-1][0] and (np.hypot(off[0], off[1]) > 0.5 or off[2] > 0.3):
                return None
        return np.asarray(pose)

    def _add(self, scan: Scan) -> None:
        """Take in a scan."""
        self._at, before = self._reckoning.pose, 0
        self._scans.append((scan, self._at))
        if self._slam is None:
            self._pose = self._at
            scan = scan._replace(pose=tuple(self._at.tolist()))
        else:
            before = self._slam.corrections
            self._slam.add(scan, self._at)
            self._pose = self._slam.pose
        self.records.append(scan)
        self._drawn.append(self._pose)
        if self._slam is None or self._slam.corrections == before or not self._draw_if_moved():
            self.known.add_scan(scan, self._pose, self._sensor.max_range)

    def _draw_if_moved(self) -> bool:
        """Draw the map anew where poses were moved, by scans that lie apart and the last ones; return whether."""
        assert self._slam is not None  # noqa: S101 # the callers know
        poses = self._slam.poses
        self._moved = bool(np.hypot(*(poses - np.array(self._drawn))[:, :2].T).max() > MOVED * self.known.cell)
        if self._moved:
            self.known.clear()
            for i in np.flatnonzero(apart(poses)).tolist():
                self.known.add_scan(self._scans[i][0], poses[i], self._sensor.max_range)
            self._drawn = list(poses)
        return self._moved
