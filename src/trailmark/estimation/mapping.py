"""From a log to a world: poses by matching, EKF-SLAM or the log, obstacles from scans or detections, grown by risk."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import NamedTuple

import numpy as np

from trailmark.arguments import Probability, checked_arguments
from trailmark.estimation.errors import EstimationError, NotCertifiedError
from trailmark.estimation.landmark_slam import OnProgress, SlamRun, run_slam
from trailmark.estimation.laser_slam import ScanPoses, match_scans
from trailmark.estimation.map_settings import MapSettings, ObstacleSource, PoseSource
from trailmark.estimation.mapped_log import (
    SHOWN,
    MappedLog,
    association_doubts,
    detection_warnings,
    gap_warnings,
    log_warnings,
    placement_doubts,
    places_text,
    revisit_warnings,
    speed_warnings,
)
from trailmark.estimation.obstacles import ScanMap, disc_estimates, map_scans
from trailmark.estimation.odometry import missing_odometry, scan_poses
from trailmark.estimation.pose_graph import GraphSettings
from trailmark.estimation.records import Detection, Increment, Log, Odometry, Pose, Scan, with_own_times
from trailmark.estimation.risk import regrow
from trailmark.se2 import FloatArray, transform
from trailmark.world import Query, Robot, World
from trailmark.world.estimates import FRAMES, Frame


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
        fitted = run.batch is not None and run.batch.figures["fitted"]
        known = [estimate for estimate in world.estimates if estimate is not None]
        warnings = detection_warnings(run.result, known, fitted, sources.poses)
        doubts = [] if run.association == "known" else association_doubts(run.result, known, sources.poses)
    else:
        warnings = speed_warnings(trajectory)
        doubts = [] if matched is None else placement_doubts(matched, trajectory)
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
        notes=(
            *log.notes,
            *_notes(s, sources, world, frame),
            *_basis(confidence, run if detected else None),
            *_coarser(scan_map, s.mapping.cell_side(log.cell)),
            *_relocations(matched, trajectory),
        ),
    )


def _frame(s: MapSettings, sources: Sources) -> Frame | None:
    """Return what the covariances are to be relative to; None where poses are taken as they are stated."""
    frames: tuple[Frame, ...] = ("map",) if sources.poses == "match" else ()
    if sources.obstacles == "detections":
        frames = FRAMES if s.smooth and sources.poses == "slam" else ("start",)
    if s.frame not in (None, *frames):
        known = " or ".join(map(repr, frames)) or "none"
        raise EstimationError(
            f"frame: expected {known} for {sources.obstacles}, poses by {sources.poses}, "
            f"smooth={s.smooth}, got {s.frame!r}"
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


def _coarser(scan_map: ScanMap | None, cell: float) -> list[str]:
    """Return a sentence on cells that are larger than the side that they should have, metres."""
    if scan_map is None or scan_map.grid.cell <= cell:
        return []
    return [f"cells of {scan_map.grid.cell:g} m: with {cell:g} m the map would be too large (setting mapping.cell)"]


def _basis(confidence: float | None, run: SlamRun | None) -> list[str]:
    """Return what a confidence rests on, and which features were seen too seldom for that, with their places."""
    notes = []
    if confidence is not None:
        notes.append(
            f"{confidence:g} holds if errors are Gaussian and as large as stated, for obstacles that were seen"
        )
    if run is not None:
        once = np.array([f.mean for f in run.result.features if f.readings < 2]).reshape(-1, 2)
        for places, what in (
            (once, "seen less than twice"),
            (run.tentative, "left out, too seldom seen to be sure of"),
        ):
            if len(places):
                shown = ", ".join(f"({x:.1f}, {y:.1f})" for x, y in places[:SHOWN].tolist())
                more = f" and {len(places) - SHOWN} more" if len(places) > SHOWN else ""
                notes.append(f"{what}: near {shown}{more}")
    return notes


def _relocations(matched: ScanPoses | None, trajectory: FloatArray) -> list[str]:
    """Return a sentence on the scans that lie where they fit and not where odometry had them."""
    if matched is None or not matched.relocated:
        return []
    return [f"odometry missing or wrong, placed by the scan alone: {places_text(trajectory, matched.relocated)}"]


def _notes(s: MapSettings, sources: Sources, world: World, frame: Frame | None) -> list[str]:
    """Return what a reader of the result should know."""
    notes = []
    if frame == "map" and any(estimate is not None and estimate.frame != frame for estimate in world.estimates):
        notes.append("covariances are those in the frame of the first pose: so few features have none of their own")
    if sources.obstacles == "detections" and s.radius == MapSettings.radius:
        notes.append(f"discs are assumed to have a radius of {s.radius:g} m: the log does not state it")
    if sources.poses == "odometry":
        notes.append("poses by odometry alone: its drift is in no covariance, and the stated risk leaves it out")
    if not world.queries:
        notes.append("no queries: the robot stands free nowhere on its path")
    return notes
