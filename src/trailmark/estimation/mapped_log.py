"""The result of mapping a log: the world, the robot's trajectory, and figures on how reliable both are."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np

from trailmark.estimation.covariance import chi_square_quantile
from trailmark.estimation.ekf_slam import SlamResult
from trailmark.estimation.landmark_slam import BatchResult
from trailmark.estimation.laser_slam import ScanPoses
from trailmark.estimation.obstacles import ScanMap
from trailmark.estimation.pose_graph import OFF
from trailmark.estimation.records import Detection, Increment, Log, Odometry, Pose, Record, Scan
from trailmark.estimation.unnamed_features import seen_from
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc, Polygon, Rectangle
from trailmark.world import ObstacleEstimate, World

_KINDS = {Odometry: "odometry", Increment: "increments", Detection: "detections", Scan: "scans", Pose: "poses"}
# Kinds of obstacles: heaps are groups of cells that beams met, unknown is what no beam has reached.
_OBSTACLES = ("discs", "walls", "heaps", "unknown")
MAX_SPEED = 10.0  # Metres a second: no indoor robot is as fast, and few outdoors are.
# NIS to its expectation: what is nearer to 1 changes a covariance by less than a fifth of its deviation.
MIN_RATIO = 0.7
MIN_UPDATES = 30  # Updates before which the NIS says little.
MAX_LEFT_OUT = 0.05  # Share of the readings that may fit no feature.
SAME = 0.99  # Probability that two estimates of one thing pass as one.
# Share of the readings of features in the middle of the sensor's view that a right map has. Of 75 simulated maps
# without identities that were right, 70 had more, of 31 wrong ones 5, and these fail another check.
READ = 0.9
# Features that must have been read both before and after any time: fewer do not say how what was mapped before it
# lies beside what was mapped after it, and if the robot was carried, nothing shows it.
JOINED = 2
APART = 5.0  # Standard deviations that features must lie apart: nearer ones are taken for each other.
SHOWN = 5  # Places, at most, that a sentence names.
# Seconds without odometry, and in intervals as they mostly are, that are a gap: both together.
GAP, UNUSUAL = 5.0, 20.0
# Share of the end points that may contradict earlier visits: right maps of four public logs have 0.08 to 0.18; with one
# half turned by 3 degrees, 0.25 to 0.91.
MAX_OFF = 0.25
DAY = 86_400.0  # Seconds: a longer gap between two records is a clock that was set.


class MappedLog(NamedTuple):
    """The outcome of :func:`trailmark.estimation.map_log`."""

    log: Log  #: What it was made from.
    world: World  #: The obstacles with their covariances, grown if a confidence was asked for; the robot; queries.
    #: Where the robot was, shape (n, 4), rows t, x, y, theta: after each instant of EKF-SLAM, or at each scan.
    trajectory: FloatArray
    poses: str  #: Where it was by: "match", "slam", "log" or "odometry".
    association: str | None  #: How detections found their features, where EKF-SLAM ran.
    slam: SlamResult | None  #: EKF-SLAM's result, where it ran.
    tentative: int  #: Features that were still to be confirmed when its log ended; they are not in the world.
    batch: BatchResult | None  #: The batch over the log after it, where one was asked for.
    scans: ScanMap | None  #: The map from scans, where obstacles are made of those.
    matched: ScanPoses | None  #: The poses of the scans by matching, where they were matched.
    seconds: float  #: Time that it took.
    scan_seconds: float  #: Of that, the time for scans.
    warnings: tuple[str, ...] = ()  #: One sentence for each thing that looks wrong, and what to try.
    #: One sentence for each thing left out, assumed or not used, the reader's own among them.
    notes: tuple[str, ...] = ()

    def figures(self) -> dict[str, Any]:
        """Return counts, consistency and times as plain data that JSON can hold (no NaN, no infinity)."""
        risk = self.world.risk
        kinds = Counter(_KINDS[type(record)] for record in self.log.records)
        steps = np.diff(self.trajectory, axis=0)
        times, matched, matching = self.trajectory[:, 0], self.matched, dict[str, Any]()
        if matched is not None:
            matching = {"nodes": len(matched.keys), "relations": len(matched.relations)}
            matching |= {"closures": matched.closures, "rejected": matched.rejected}
            matching["revisits"] = None if matched.revisits is None else matched.revisits.figures()
        return {
            "name": self.log.name,
            "records": {"all": len(self.log.records), **{name: kinds[name] for name in _KINDS.values()}},
            "dropped": self.log.dropped,
            "poses": self.poses,
            "association": self.association,
            "matching": matching or None,
            "features": self._features(),
            "nis": self._nis(),
            "batch": None if self.batch is None else self.batch.figures,
            "counts": None if self.slam is None else asdict(self.slam.counts),
            "obstacles": self._obstacles(),
            "bounds": list(self.world.bounds),
            "trajectory": {
                "poses": len(times),
                "length": float(np.hypot(steps[:, 1], steps[:, 2]).sum()),
                "duration": duration(times),
            },
            "queries": [query.name for query in self.world.queries],
            "risk": None
            if risk is None
            else {"confidence": risk.confidence, "collision_at_most": 1.0 - risk.confidence},
            "time": {"total": self.seconds, "per_update": self._per_update()},
            "not_certified": self.world.not_certified,
            "warnings": list(self.warnings),
            "notes": list(self.notes),
        }

    def _features(self) -> dict[str, int]:
        """Return how many features there are, of those that obstacles are made of."""
        if self.scans is not None:
            confirmed = self.scans.walls + self.scans.discs
            return {"confirmed": confirmed, "tentative": 0, "dropped": self.scans.dropped}
        features, dropped = (0, 0) if self.slam is None else (len(self.slam.features), self.slam.counts.dropped)
        return {"confirmed": features, "tentative": self.tentative, "dropped": dropped}

    def _nis(self) -> dict[str, Any] | None:
        nis = None if self.slam is None else self.slam.nis()
        if nis is None or nis.size == 0:
            return None
        names = ("mean", "expected", "low", "high", "inside")
        return {**{name: getattr(nis, name) for name in names}, "updates": nis.size}

    def _obstacles(self) -> dict[str, Any]:
        """Return how many obstacles there are of each kind, and what their covariances are relative to."""
        every = len(self.world.obstacles)
        kinds = Counter(_kind(estimate) for estimate in self.world.estimates or (None,) * every)
        frame = next((estimate.frame for estimate in self.world.estimates if estimate is not None), None)
        return {"all": every, **{name: kinds[name] for name in _OBSTACLES}, **({"frame": frame} if frame else {})}

    def _per_update(self) -> float | None:
        """Return the seconds that an update took: of EKF-SLAM's state, or of the map by a scan."""
        if self.scans is not None:
            return self.scan_seconds / len(self.scans.poses)
        seconds = math.nan if self.slam is None else self.slam.seconds_per_update
        return seconds if math.isfinite(seconds) else None


def _kind(estimate: ObstacleEstimate | None) -> str:
    if estimate is None:
        return "unknown"
    return {Disc: "discs", Rectangle: "walls", Polygon: "heaps"}[type(estimate.mean)]


def gap_warnings(records: Sequence[Record]) -> list[str]:
    """Return that odometry is silent far longer than it mostly is, from where on, and what is made of that."""
    moves = [record for record in records if isinstance(record, Odometry | Increment)]
    t = np.array([record.t for record in moves])
    read = [record.t for record in records if isinstance(record, Detection | Scan)]
    usual = float(np.median(np.diff(t))) if len(t) > 1 else math.inf
    t = np.append(t, read[-1:])
    gaps = np.diff(t)
    long = np.flatnonzero((gaps > max(GAP, UNUSUAL * usual)) & (gaps < DAY))
    if len(long) == 0:
        return []
    i = long[gaps[long].argmax()]
    others = f" ({len(long)} gaps in all)" if len(long) > 1 else ""
    held = "the last velocity is taken to have held" if isinstance(moves[i], Odometry) else "no motion is known in it"
    return [f"odometry: a gap of {gaps[i]:.0f} s from {t[i]:g} s on{others}: {held}"]


def top_speed(trajectory: FloatArray) -> float:
    """Return the speed (m/s) that a hundredth of a trajectory, rows t, x, y, theta, is faster than; 0 if it is short.

    Over ten poses each, since single times arrive late.
    """
    if len(trajectory) < 12:
        return 0.0
    travel = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(trajectory[:, 1:3], axis=0).T))])
    time, way = trajectory[10:, 0] - trajectory[:-10, 0], travel[10:] - travel[:-10]
    return float(np.quantile(way[time > 0.0] / time[time > 0.0], 0.99)) if (time > 0.0).any() else 0.0


def duration(times: FloatArray) -> float | None:
    """Return the seconds from the first to the last of times, shape (n,), without jumps of the clock by a day or more.

    None where the times are rounded so far that most are equal: they do not tell.
    """
    if len(times) > 10 and 10 * len(np.unique(times)) < len(times):
        return None
    gaps = np.diff(times)
    return float(gaps[gaps < DAY].sum())


def log_warnings(records: Sequence[Record], detected: bool) -> list[str]:
    """Return what looks wrong with the log itself: clocks that differ, scans that met nothing.

    Args:
        records: of the log, in the order of time.
        detected: whether obstacles come from its detections, else from its scans.
    """
    what = "detections" if detected else "scans"
    read = [record for record in records if isinstance(record, Detection if detected else Scan)]
    moves = [record for record in records if isinstance(record, Odometry | Increment)]
    found = []
    # Velocities hold on after the last of them.
    if moves and read:
        end = np.inf if isinstance(moves[-1], Odometry) else moves[-1].t
        if read[-1].t < moves[0].t or end < read[0].t:
            found.append(
                f"the times of odometry ({moves[0].t:.3f} to {moves[-1].t:.3f} s) and of {what} ({read[0].t:.3f} to "
                f"{read[-1].t:.3f} s) do not overlap: are they of different clocks?"
            )
    scans = [record for record in read if isinstance(record, Scan)]
    blind = sum(not ((scan.ranges > 0.0) & (scan.ranges < scan.range_max)).any() for scan in scans)
    if 2 * blind > len(scans):
        found.append(f"{blind:,} of {len(scans):,} scans met nothing: they place neither the robot nor an obstacle")
    return found


def revisit_warnings(matched: ScanPoses) -> list[str]:
    """Return that what was seen of places on later visits contradicts what had been seen there."""
    found = matched.revisits
    if found is None or found.off is None or found.worst is None or found.off <= MAX_OFF:
        return []
    return [
        f"places that were seen again do not look as before: of one scan in ten, {found.off:.0%} or more of the end "
        f"points lie {OFF:g} m off (expected at most {MAX_OFF:.0%}), most of all near ({found.worst[0]:.1f}, "
        f"{found.worst[1]:.1f}): a wrong loop closure, drift, or things that moved; look at the map with --plot"
    ]


def placement_doubts(matched: ScanPoses, trajectory: FloatArray) -> list[str]:
    """Return why the places of matched scans are not known, with times and places."""
    if not matched.unplaced:
        return []
    where = places_text(trajectory, matched.unplaced)
    return [f"odometry missing or wrong, and the scan fits nowhere or in several places: {where}"]


def places_text(trajectory: FloatArray, which: Sequence[int]) -> str:
    """Return the times and places of some rows t, x, y, theta of a trajectory."""
    shown = [f"at {t:.3f} s near ({x:.1f}, {y:.1f})" for t, x, y, _ in trajectory[list(which[:SHOWN])].tolist()]
    return ", ".join(shown) + (f" and {len(which) - SHOWN} more" if len(which) > SHOWN else "")


def association_doubts(result: SlamResult, estimates: Sequence[ObstacleEstimate], poses: str) -> list[str]:
    """Return why a map without identities may be wrong as a whole: what its covariances cannot show."""
    number = {feature.id: i for i, feature in enumerate(result.features)}
    used = [a for a in result.assignments if a.feature in number]
    if not used:
        return []
    times, instant = np.unique([a.t for a in used], return_inverse=True)
    feature = np.array([number[a.feature] for a in used if a.feature is not None])
    read = np.zeros((len(times), len(number)), dtype=bool)
    read[instant, feature] = True
    places, found = np.array([f.mean for f in result.features]), list[str]()
    at = np.clip(np.searchsorted(result.trajectory[:, 0], times, side="right") - 1, 0, None)
    pose = result.trajectory[at, 1:]
    ranges, bearings = seen_from(pose, places)
    rows = ranges[instant, feature], bearings[instant, feature]
    (near, far), (right, left) = (np.quantile(row, [0.05, 0.95]) for row in rows)
    inside = (ranges >= near) & (ranges <= far) & (bearings >= right) & (bearings <= left)
    share = (read & inside).sum() / max(1, inside.sum())
    if share < READ:
        found.append(
            f"features in the sensor's view were read {share:.0%} of the times that they should have been (expected "
            f"{READ:.0%}): some are others seen twice, or it misses many"
        )
    seen = np.flatnonzero(read.any(axis=0))
    first, last = read[:, seen].argmax(axis=0), len(times) - 1 - read[::-1, seen].argmax(axis=0)
    step = np.arange(1, len(times))[:, None]
    before, after = first < step, last >= step
    needed = np.minimum(JOINED, np.minimum(before.sum(axis=1), after.sum(axis=1)))
    lacking = np.flatnonzero((before & after).sum(axis=1) < needed)
    if poses == "slam" and len(lacking):
        t = times[lacking[0] + 1]
        found.append(
            f"fewer than {JOINED} features were read both before and after {t:.3f} s: odometry alone joins what lies "
            "on either side"
        )
    sigma = np.sqrt([np.linalg.eigvalsh(estimate.covariance[:2, :2])[-1] for estimate in estimates])
    gaps = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1)) + np.diag(np.full(len(places), np.inf))
    close = np.flatnonzero((gaps < APART * np.maximum(sigma[:, None], sigma[None])).any(axis=1))
    if len(close):
        x, y = places[close[0]].tolist()
        found.append(
            f"{len(close)} of {len(places)} features lie less than {APART:g} standard deviations from another, so that "
            f"one is taken for the other: the first at ({x:.1f}, {y:.1f})"
        )
    left_out = result.counts.ambiguous + result.counts.detections - result.counts.used
    if left_out > MAX_LEFT_OUT * max(1, result.counts.detections):
        found.append(f"{left_out / result.counts.detections:.0%} of the readings are of no feature")
    return found


def detection_warnings(
    result: SlamResult, estimates: Sequence[ObstacleEstimate], fitted: bool, poses: str
) -> list[str]:
    """Return what looks wrong with a map of detections, and what to try.

    Args:
        result: features and readings; of its NIS that of the filter.
        estimates: of its features, with covariances relative to the map.
        fitted: whether noise was estimated from the log after the filter, so that its NIS says nothing of the map.
        poses: what they are by.
    """
    found, counts, nis = [], result.counts, result.nis()
    judged = not fitted and nis.size >= MIN_UPDATES
    if judged and not (nis.inside or MIN_RATIO < nis.mean / nis.expected < 1.0 / MIN_RATIO):
        kind = "larger" if nis.mean > nis.expected else "smaller"
        found.append(
            f"the readings' errors are {kind} than the noise that is stated (NIS {nis.mean:.3g}, expected "
            f"{nis.expected:.3g}): the setting fit_noise: on estimates it"
        )
    left_out = counts.outliers + counts.ambiguous
    if left_out > MAX_LEFT_OUT * max(1, counts.detections):
        found.append(
            f"{left_out / counts.detections:.0%} of the readings fit no feature: misread identities, things that "
            "moved, or wrong noise (setting fit_noise: on)"
        )
    if (doubled := _doubled(estimates)) > 0:
        found.append(
            f"{doubled} of {len(estimates)} features may be others seen twice, so that the map shows more than there "
            "is: look at it with --plot; the setting slam.confirm: 20 keeps those with more readings"
        )
    return [*found, *(speed_warnings(result.trajectory) if poses == "slam" else [])]


def _doubled(estimates: Sequence[ObstacleEstimate]) -> int:
    """Return how many features lie so near to another one that, by their covariances, they may be the same."""
    points = np.array([estimate.mean.center for estimate in estimates if isinstance(estimate.mean, Disc)])
    if len(points) < 2:
        return 0
    blocks = np.array([estimate.covariance[:2, :2] for estimate in estimates])
    i, j = np.triu_indices(len(points), 1)
    gap, spread = points[j] - points[i], blocks[i] + blocks[j] + 1e-12 * np.eye(2)
    d2 = np.einsum("ni,nij,nj->n", gap, np.linalg.inv(spread), gap)
    return len(np.unique(j[d2 <= chi_square_quantile(SAME, 2)]))


def speed_warnings(trajectory: FloatArray) -> list[str]:
    """Return what looks wrong with a trajectory, rows t, x, y, theta: speeds that no robot has."""
    if (speed := top_speed(trajectory)) <= MAX_SPEED:
        return []
    limit = f"expected at most {MAX_SPEED:g}; are the log's times right, and its odometry without jumps?"
    return [f"speeds of {speed:.3g} m/s and more: {limit}"]
