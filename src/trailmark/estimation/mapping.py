"""From a log to a world: poses by matching, EKF-SLAM or the log, obstacles from scans or detections, grown by risk."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, replace
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from trailmark.arguments import Probability, checked_arguments
from trailmark.estimation.ekf_slam import SlamResult
from trailmark.estimation.errors import EstimationError, NotCertifiedError
from trailmark.estimation.landmark_slam import BatchResult, OnProgress, SlamRun, run_slam
from trailmark.estimation.laser_slam import ScanPoses, match_scans
from trailmark.estimation.map_settings import MapSettings, ObstacleSource, PoseSource
from trailmark.estimation.obstacles import ScanMap, disc_estimates, map_scans
from trailmark.estimation.odometry import missing_odometry, scan_poses
from trailmark.estimation.pose_graph import OFF, GraphSettings
from trailmark.estimation.records import Detection, Increment, Log, Odometry, Pose, Record, Scan, with_own_times
from trailmark.estimation.risk import regrow
from trailmark.estimation.unnamed_features import seen_from
from trailmark.se2 import FloatArray, transform
from trailmark.shapes import Disc, Polygon, Rectangle
from trailmark.world import ObstacleEstimate, Query, Robot, World
from trailmark.world.estimates import FRAMES, Frame

_KINDS = {Odometry: "odometry", Increment: "increments", Detection: "detections", Scan: "scans", Pose: "poses"}
# Kinds of obstacles: heaps are groups of cells that beams met, unknown is what no beam has reached.
_OBSTACLES = ("discs", "walls", "heaps", "unknown")
MAX_SPEED = 10.0  # Metres a second: no indoor robot is as fast, and few outdoors are.
# NIS to its expectation: what is nearer to 1 changes a covariance by less than a fifth of its deviation.
MIN_RATIO = 0.7
MIN_UPDATES = 30  # Updates before which the NIS says little.
TOLD = 1.5  # Squared difference of the maps of a log's halves, for each expected one, from which on it is told.
MAX_LEFT_OUT = 0.05  # Share of the readings that may fit no feature.
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
        risk, slam, scans, matched, times = self.world.risk, self.slam, self.scans, self.matched, self.trajectory[:, 0]
        kinds = Counter(_KINDS[type(record)] for record in self.log.records)
        every = len(self.world.obstacles)
        obstacles = Counter(_kind(estimate) for estimate in self.world.estimates or (None,) * every)
        frame = next((estimate.frame for estimate in self.world.estimates if estimate is not None), None)
        features = {"confirmed": 0, "tentative": self.tentative, "dropped": 0}
        nis = per_update = None
        if scans is not None:
            features = {"confirmed": scans.walls + scans.discs, "tentative": 0, "dropped": scans.dropped}
            per_update = self.scan_seconds / len(scans.poses)
        elif slam is not None:
            features |= {"confirmed": len(slam.features), "dropped": slam.counts.dropped}
            per_update = slam.seconds_per_update if slam.updates else None
        if slam is not None and (found := slam.nis()).size:
            names = ("mean", "expected", "low", "high", "inside")
            nis = {**{name: getattr(found, name) for name in names}, "updates": found.size}
        return {
            "name": self.log.name,
            "records": {"all": len(self.log.records), **{name: kinds[name] for name in _KINDS.values()}},
            "dropped": self.log.dropped,
            "poses": self.poses,
            "association": self.association,
            "matching": None
            if matched is None
            else {
                "nodes": len(matched.keys),
                "relations": len(matched.relations),
                "closures": matched.closures,
                "rejected": matched.rejected,
                "revisits": None if matched.revisits is None else matched.revisits.figures(),
            },
            "features": features,
            "nis": nis,
            "batch": None if self.batch is None else self.batch.figures,
            "counts": None if slam is None else asdict(slam.counts),
            "obstacles": {
                "all": every,
                **{name: obstacles[name] for name in _OBSTACLES},
                **({"frame": frame} if frame else {}),
            },
            "bounds": list(self.world.bounds),
            "trajectory": {
                "poses": len(times),
                "length": float(np.hypot(*np.diff(self.trajectory[:, 1:3], axis=0).T).sum()),
                "duration": _duration(times),
            },
            "queries": [query.name for query in self.world.queries],
            "risk": None
            if risk is None
            else {"confidence": risk.confidence, "collision_at_most": 1.0 - risk.confidence},
            "time": {"total": self.seconds, "per_update": per_update},
            "not_certified": self.world.not_certified,
            "warnings": list(self.warnings),
            "notes": list(self.notes),
        }


def _kind(estimate: ObstacleEstimate | None) -> str:
    if estimate is None:
        return "unknown"
    return {Disc: "discs", Rectangle: "walls", Polygon: "heaps"}[type(estimate.mean)]


def _duration(times: FloatArray) -> float | None:
    """Return the seconds from the first to the last of times, without jumps of the clock by a day or more.

    None where the times are rounded so far that most are equal: they do not tell.
    """
    if len(times) > 10 and 10 * len(np.unique(times)) < len(times):
        return None
    gaps = np.diff(times)
    return float(gaps[gaps < DAY].sum())


class Sources(NamedTuple):
    """What a log's obstacles are made of, and its poses."""

    obstacles: ObstacleSource
    poses: PoseSource


def sources_of(log: Log, settings: MapSettings) -> Sources:
    """Return what obstacles and poses come from, with "auto" resolved."""
    scans = [record for record in log.records if isinstance(record, Scan)]
    there = {type(record) for record in log.records}
    if not any((np.asarray(scan.ranges) > 0.0).any() for scan in scans):  # lost readings are NaN
        there.discard(Scan)
    obstacles, poses = settings.obstacles, settings.poses
    if obstacles == "auto":
        obstacles = "scans" if Scan in there else "detections"
    if (Scan if obstacles == "scans" else Detection) not in there:
        found = "neither scans nor detections" if settings.obstacles == "auto" else f"no {obstacles}"
        found += f" ({len(scans):,} scans without one reading)" if scans and Scan not in there else ""
        raise EstimationError(f"expected a log that shows obstacles, got {found}")
    moves = bool(there & {Odometry, Increment})
    carried = [scan.pose is not None for scan in scans]
    # By more than the one pose at which odometry begins.
    stated = sum(isinstance(record, Pose) and not record.truth for record in log.records) > (1 if moves else 0)
    possible = {
        "match": moves and Scan in there,
        "slam": moves and Detection in there,
        "log": stated or (obstacles == "scans" and all(carried)),
        "odometry": moves and obstacles == "scans",
    }
    order: tuple[PoseSource, ...] = ("log", "match", "slam", "odometry") if obstacles == "scans" else ("slam", "log")
    if poses == "auto":
        poses = next((source for source in order if possible[source]), "auto")
    if poses == "auto":
        raise EstimationError("expected a log that says how the robot moved, got neither odometry nor poses")
    if not possible[poses]:
        can = ", ".join(source for source in order if possible[source]) or "none"
        raise EstimationError(f"poses: expected what the log holds for {obstacles} ({can}), got {poses!r}")
    return Sources(obstacles, poses)


SPACE = 1.0  # Metres of free space, beside the robot's own size, around all that was detected.
_MAX_PLACES = 2000  # Poses of the robot's path, at most, that are tried as the ends of queries.


@checked_arguments(EstimationError)
def map_log(
    log: Log,
    settings: MapSettings | None = None,
    *,
    robot: Robot | None = None,
    confidence: Probability | None = None,
    even_if_uncertain: bool = False,
    on_progress: OnProgress | None = None,
) -> MappedLog:
    """Return the world that a log shows.

    Detections of points become discs: EKF-SLAM estimates them together with the robot's path. Laser scans become walls,
    discs and groups of cells (:func:`trailmark.estimation.map_scans`). In a log with both, the scans make the
    obstacles; detections and odometry say where the scans were taken.

    The world keeps the covariances, so that :func:`trailmark.estimation.regrow` can grow it for another confidence. Its
    queries are ``driven``, from the first place on the robot's path where it stands free to the last, and
    ``farthest``, from the first to the one farthest from it.

    Args:
        log: of :func:`trailmark.estimation.load_log` or :func:`trailmark.estimation.simulate`.
        settings: how to go about it.
        robot: of the world.
        confidence: grow the obstacles so that a valid path meets none of the true ones with this probability at
            least; None leaves them as they were measured.
        even_if_uncertain: grow them though the data cannot tell features or places apart, so that the covariances are
            not to be relied on (``World.not_certified`` says why).
        on_progress: called with "records" or "scans", the number of them done, and their total.

    Raises:
        EstimationError: a log that shows no obstacles, or does not say how the robot moved; a confidence out of
            range.
        NotCertifiedError: a confidence for a map that is not certified.
    """
    s, begin = settings or MapSettings(), perf_counter()
    log = with_own_times(log)
    if s.robot_sigma is not None and (robot is None or confidence is None):
        raise EstimationError("robot_sigma: expected a robot and a confidence with it, got one without them")
    sources = sources_of(log, s)
    detected, frame = sources.obstacles == "detections", _frame(s, sources)
    run = run_slam(log, s, sources.poses, on_progress) if detected or sources.poses == "slam" else None
    scan_map, matched, scan_begin = None, None, perf_counter()
    if run is not None and detected:
        trajectory, world = run.result.trajectory, _world_of_discs(log, s, run, robot, frame)
    else:
        scans, mapping = [record for record in log.records if isinstance(record, Scan)], s.mapping
        covariances = None
        if sources.poses == "match":
            matching = None if on_progress is None else lambda done, total: on_progress("scans matched", done, total)
            _, odometry = scan_poses(log, "odometry", s.start)
            graph = GraphSettings(max_range=min(GraphSettings.max_range, mapping.scan.max_range))
            matched = match_scans(scans, odometry, graph, matching, missing_odometry(log))
            poses, covariances = matched.poses, matched.covariances
        elif run is not None:
            poses, mapping = run.poses_of(scans), run.with_pose_sigma(scans, mapping)
        else:
            _, poses = scan_poses(log, "log" if sources.poses == "log" else "odometry", s.start)
        report = None if on_progress is None else lambda done, total: on_progress("scans", done, total)
        scan_map = map_scans(
            log, poses, settings=mapping, robot=robot, pose_covariances=covariances, on_progress=report
        )
        trajectory, world = np.column_stack([[scan.t for scan in scans], poses]), _framed(scan_map.world, frame)
    if scan_map is None and run is not None:
        known = [estimate for estimate in world.estimates if estimate is not None]
        warnings = detection_warnings(run, sources.poses)
        doubts = [] if run.association == "known" else association_doubts(run.result, known, sources.poses)
    else:
        warnings = speed_warnings(trajectory)
        doubts = []
        if matched is not None and matched.unplaced:
            where = places_text(trajectory, matched.unplaced)
            doubts.append(f"odometry missing or wrong, and the scan fits nowhere or in several places: {where}")
        warnings += [] if matched is None else revisit_warnings(matched)
    warnings += [] if sources.poses == "log" else gap_warnings(log.records)
    if doubts:
        world = replace(world, not_certified="; ".join(doubts))
        warnings.append(f"not certified: {world.not_certified}")
        if confidence is not None and not even_if_uncertain:
            raise NotCertifiedError(f"not certified: {world.not_certified}")
    scan_seconds = 0.0 if scan_map is None else perf_counter() - scan_begin
    if confidence is not None:
        x, theta = s.robot_sigma or (0.0, 0.0)
        own = None if s.robot_sigma is None else np.diag([x**2, x**2, theta**2])
        world = regrow(world, confidence, pose_covariance=own)
    if scan_map is None:
        world = replace(world, bounds=_bounds(world, trajectory[:, 1:3]))
    world = replace(world, queries=_queries(world, trajectory[:, 1:]))
    return MappedLog(
        log=log,
        world=world,
        trajectory=trajectory,
        poses=sources.poses,
        association=None if run is None else run.association,
        slam=None if run is None else run.result,
        tentative=0 if run is None else len(run.tentative),
        scans=scan_map,
        matched=matched,
        seconds=perf_counter() - begin,
        scan_seconds=scan_seconds,
        warnings=(*log_warnings(log.records, detected), *warnings),
        batch=None if run is None else run.batch,
        notes=(*log.notes, *_notes(s, log, sources, world, frame, confidence, run, scan_map, matched, trajectory)),
    )


def _frame(s: MapSettings, sources: Sources) -> Frame | None:
    """Return what the covariances are to be relative to; None where poses are taken as they are stated."""
    frames: tuple[Frame, ...] = ("map",) if sources.poses == "match" else ()
    if sources.obstacles == "detections":
        frames = FRAMES if sources.poses == "slam" else ("start",)
    if s.frame not in (None, *frames):
        known = " or ".join(map(repr, frames)) or "none"
        raise EstimationError(
            f"frame: expected {known} for {sources.obstacles}, poses by {sources.poses}, got {s.frame!r}"
        )
    preferred = s.frame or ("map" if s.start is None else "start")
    return preferred if preferred in frames else next(iter(frames), None)


def _world_of_discs(log: Log, s: MapSettings, run: SlamRun, robot: Robot | None, frame: Frame | None) -> World:
    """Return a disc for each confirmed feature, in bounds that are still to be set."""
    features = run.result.features
    if not features:
        counts = run.result.counts
        raise EstimationError(
            f"expected {s.slam.confirm} readings of a feature, or identities, got no feature confirmed by "
            f"{counts.detections} detections ({counts.unidentified} without the identity asked for, "
            f"{len(run.tentative)} tentative features, {counts.dropped} dropped)"
        )
    means = np.array([feature.mean for feature in features])
    within = run.batch.relative if run.batch is not None and frame == "map" else None
    covariances = np.array([feature.covariance for feature in features]) if within is None else within
    estimates = disc_estimates(means, covariances, s.radius, s.radius_sigma)
    low, high = means.min(axis=0) - s.radius, means.max(axis=0) + s.radius
    bounds = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
    discs = tuple(estimate.mean for estimate in estimates)
    world = World(log.name, bounds, discs, robot, estimates=tuple(estimates))
    return _framed(world, "start" if within is None else "map")


def _framed(world: World, frame: Frame | None) -> World:
    """Return the world with what its covariances are relative to."""
    return replace(world, estimates=tuple(e and replace(e, frame=frame) for e in world.estimates))


def _bounds(world: World, path: FloatArray) -> tuple[float, float, float, float]:
    """Return bounds, in whole decimetres, with space for the robot around all obstacles and its path."""
    boxes = np.array([shape.bounding_box() for shape in world.obstacles]).reshape(-1, 4)
    points = np.vstack([boxes[:, :2], boxes[:, 2:], path])
    space = SPACE + (0.0 if world.robot is None else 2.0 * world.robot.circumradius)
    low = np.floor(10.0 * (points.min(axis=0) - space)) / 10.0
    high = np.ceil(10.0 * (points.max(axis=0) + space)) / 10.0
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _queries(world: World, path: FloatArray) -> tuple[Query, ...]:
    """Return queries between places on the robot's path, shape (n, 3), where it stands free."""
    tried = np.unique(np.linspace(0, len(path) - 1, min(len(path), _MAX_PLACES)).round().astype(np.intp))
    free = path[tried[_free(world, path[tried])]]
    if len(free) < 2:
        return ()
    away = np.hypot(*(free[:, :2] - free[0, :2]).T)
    start, last, farthest = (tuple(pose.tolist()) for pose in (free[0], free[-1], free[away.argmax()]))
    return Query("driven", start, last), Query("farthest", start, farthest)


def _free(world: World, poses: FloatArray) -> FloatArray:
    """Return at which poses, shape (n, 3), the robot lies within bounds and meets no obstacle, shape (n,) of bool."""
    import shapely

    if world.robot is None:
        placed = shapely.points(poses[:, :2])
    else:
        placed = shapely.polygons(transform(poses, world.robot.outline.vertices))
    free = np.asarray(shapely.within(placed, shapely.box(*world.bounds)))
    tree = shapely.STRtree([shape.polygon(1e-3).shapely() for shape in world.obstacles])
    free[tree.query(placed, predicate="intersects")[0]] = False
    return free


def _notes(
    s: MapSettings,
    log: Log,
    sources: Sources,
    world: World,
    frame: Frame | None,
    confidence: float | None,
    run: SlamRun | None,
    scan_map: ScanMap | None,
    matched: ScanPoses | None,
    trajectory: FloatArray,
) -> list[str]:
    """Return what a reader of the result should know."""
    notes, detected = list[str](), sources.obstacles == "detections"
    if frame == "map" and any(estimate is not None and estimate.frame != frame for estimate in world.estimates):
        notes.append("covariances are those in the frame of the first pose: so few features have none of their own")
    if detected and s.radius == MapSettings.radius:
        notes.append(f"discs are assumed to have a radius of {s.radius:g} m: the log does not state it")
    if sources.poses == "odometry":
        notes.append("poses by odometry alone: its drift is in no covariance, and the stated risk leaves it out")
    if not world.queries:
        notes.append("no queries: the robot stands free nowhere on its path")
    if confidence is not None:
        notes.append(
            f"{confidence:g} holds if errors are Gaussian and as large as stated, for obstacles that were seen"
        )
    if run is not None and detected:
        once = np.array([f.mean for f in run.result.features if f.readings < 2]).reshape(-1, 2)
        for places, what in (
            (once, "seen less than twice"),
            (run.tentative, "left out, too seldom seen to be sure of"),
        ):
            if len(places):
                shown = ", ".join(f"({x:.1f}, {y:.1f})" for x, y in places[:SHOWN].tolist())
                more = f" and {len(places) - SHOWN} more" if len(places) > SHOWN else ""
                notes.append(f"{what}: near {shown}{more}")
    if scan_map is not None and scan_map.grid.cell > (cell := s.mapping.cell_side(log.cell)):
        coarse = f"cells of {scan_map.grid.cell:g} m: with {cell:g} m the map would be too large"
        notes.append(f"{coarse} (setting mapping.cell)")
    if matched is not None and matched.relocated:
        where = places_text(trajectory, matched.relocated)
        notes.append(f"odometry missing or wrong, placed by the scan alone: {where}")
    return notes


def gap_warnings(records: Sequence[Record]) -> list[str]:
    """Return warnings of gaps in odometry, with their times."""
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
    """Return a warning if later visits to places contradict the map from earlier ones."""
    found = matched.revisits
    if found is None or found.off is None or found.worst is None or found.off <= MAX_OFF:
        return []
    return [
        f"places that were seen again do not look as before: of one scan in ten, {found.off:.0%} or more of the end "
        f"points lie {OFF:g} m off (expected at most {MAX_OFF:.0%}), most of all near ({found.worst[0]:.1f}, "
        f"{found.worst[1]:.1f}): a wrong loop closure, drift, or things that moved; look at the map with --plot"
    ]


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


def detection_warnings(run: SlamRun, poses: str) -> list[str]:
    """Return warnings about a map of detections, and what to try."""
    found, counts, nis, batch = list[str](), run.result.counts, run.result.nis(), run.batch
    if run.failure is not None:
        found.append(f"no batch fits the log ({run.failure}): the map is the filter's")
    # Where noise was estimated after the filter, its NIS says nothing of the map.
    judged = nis.size >= MIN_UPDATES and not (batch is not None and batch.figures["fitted"])
    if judged and not (nis.inside or MIN_RATIO < nis.mean / nis.expected < 1.0 / MIN_RATIO):
        kind = "larger" if nis.mean > nis.expected else "smaller"
        found.append(
            f"the readings' errors are {kind} than the noise that is stated (NIS {nis.mean:.3g}, expected "
            f"{nis.expected:.3g}): the setting fit_noise: true estimates it"
        )
    if batch is not None and batch.figures["halves"] > TOLD:
        found.append(
            f"the maps of the log's two halves differ by {math.sqrt(batch.figures['halves']):.1f} times what their "
            "covariances say, which are enlarged by as much: errors of sensor or odometry last"
        )
    left_out = counts.outliers + counts.ambiguous
    if left_out > MAX_LEFT_OUT * max(1, counts.detections):
        found.append(
            f"{left_out / counts.detections:.0%} of the readings fit no feature: misread identities, things that "
            "moved, or wrong noise (setting fit_noise: true)"
        )
    return [*found, *(speed_warnings(run.result.trajectory) if poses == "slam" else [])]


def speed_warnings(trajectory: FloatArray) -> list[str]:
    """Return that a hundredth of a trajectory, rows t, x, y, theta, is faster than any robot."""
    if len(trajectory) < 12:
        return []
    travel = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(trajectory[:, 1:3], axis=0).T))])
    # Over ten poses each, since single times arrive late.
    time, way = trajectory[10:, 0] - trajectory[:-10, 0], travel[10:] - travel[:-10]
    speed = float(np.quantile(way[time > 0.0] / time[time > 0.0], 0.99)) if (time > 0.0).any() else 0.0
    if speed <= MAX_SPEED:
        return []
    limit = f"expected at most {MAX_SPEED:g}; are the log's times right, and its odometry without jumps?"
    return [f"speeds of {speed:.3g} m/s and more: {limit}"]
