"""From a log to a world: EKF-SLAM over detections, or a map from laser scans, and obstacles grown by their risk."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter

import numpy as np

from trailmark.estimation.errors import EstimationError
from trailmark.estimation.logs.records import Log, Scan
from trailmark.estimation.maps.log_poses import OnProgress, SlamRun, Sources, poses_of_scans, run_slam, sources_of
from trailmark.estimation.maps.map_settings import MapSettings
from trailmark.estimation.maps.mapped_log import MappedLog
from trailmark.estimation.maps.obstacle_estimates import disc_estimates
from trailmark.estimation.maps.scan_map import ScanMap, map_scans
from trailmark.se2 import FloatArray, transform
from trailmark.world import Query, Robot, World

__all__ = ["map_log"]

_LOOKED_AT = 2000
"""Poses of the robot's way, at most, that are looked at for the ends of queries."""


def map_log(
    log: Log,
    settings: MapSettings | None = None,
    *,
    robot: Robot | None = None,
    confidence: float | None = None,
    on_progress: OnProgress | None = None,
) -> MappedLog:
    """Return the world that a log shows.

    Detections of points become discs: EKF-SLAM estimates them together with the robot's way. Laser scans become walls,
    discs and groups of cells (:func:`trailmark.estimation.maps.scan_map.map_scans`). In a log with both, the scans make
    the obstacles; detections and odometry say where the scans were taken.

    The world keeps the covariances, so that :func:`trailmark.estimation.regrow` can grow it for another confidence. Its
    queries are ``driven``, from the first place on the robot's way where it stands free to the last, and
    ``farthest``, from the first to the one farthest from it.

    Args:
        log: of :func:`trailmark.estimation.load_log` or :func:`trailmark.estimation.simulate`.
        settings: how to go about it.
        robot: of the world.
        confidence: grow the obstacles so that a valid path meets none of the true ones with this probability at
            least; None leaves them as they were measured.
        on_progress: called with "records" or "scans", the number of them done, and their total.

    Raises:
        EstimationError: a log that shows no obstacles, or does not say how the robot moved; a confidence out of
            range.
    """
    s, begin = settings or MapSettings(), perf_counter()
    _check(s, robot, confidence)
    sources = sources_of(log, s)
    scan_map: ScanMap | None = None
    scan_seconds = 0.0
    run = run_slam(log, s, sources.poses, on_progress) if _needs_slam(sources) else None
    if run is not None and sources.obstacles == "detections":
        trajectory, world = run.result.trajectory, _world_of_discs(log, s, run, robot)
    else:
        scan_begin = perf_counter()
        trajectory, scan_map = _map_scans(log, s, sources, run, robot, on_progress)
        world, scan_seconds = scan_map.world, perf_counter() - scan_begin
    if confidence is not None:
        world = _grown(world, confidence, s)
    if scan_map is None:
        world = replace(world, bounds=_bounds(world, trajectory[:, 1:3], s.margin))
    world = replace(world, queries=_queries(world, trajectory[:, 1:]))
    return MappedLog(
        log=log,
        world=world,
        trajectory=trajectory,
        poses=sources.poses,
        association=None if run is None else run.association,
        slam=None if run is None else run.result,
        tentative=0 if run is None else run.tentative,
        scans=scan_map,
        seconds=perf_counter() - begin,
        scan_seconds=scan_seconds,
        notes=(*log.notes, *(() if run is None else run.notes), *_notes(s, sources, world)),
    )


def _check(s: MapSettings, robot: Robot | None, confidence: float | None) -> None:
    if confidence is not None and not 0.0 < confidence < 1.0:
        raise EstimationError(f"confidence: {confidence} given, allowed: above 0 and below 1")
    if s.robot_sigma is not None and (robot is None or confidence is None):
        raise EstimationError("robot_sigma: given without robot and confidence, allowed: with both")


def _needs_slam(sources: Sources) -> bool:
    return sources.obstacles == "detections" or sources.poses == "slam"


def _map_scans(
    log: Log,
    s: MapSettings,
    sources: Sources,
    run: SlamRun | None,
    robot: Robot | None,
    on_progress: OnProgress | None,
) -> tuple[FloatArray, ScanMap]:
    """Return where the scans were taken, shape (m, 4), rows t, x, y, theta, and their map."""
    scans, mapping = [record for record in log.records if isinstance(record, Scan)], s.mapping
    if run is not None:
        at, mapping = run.poses_of(scans), run.with_pose_sigma(scans, mapping)
    else:
        at = poses_of_scans(log, "log" if sources.poses == "log" else "odometry", s.start)

    def report(done: int, total: int) -> None:
        if on_progress is not None:
            on_progress("scans", done, total)

    found = map_scans(log, at, settings=mapping, robot=robot, on_progress=report)
    return np.column_stack([[scan.t for scan in scans], at]), found


def _world_of_discs(log: Log, s: MapSettings, run: SlamRun, robot: Robot | None) -> World:
    """Return a disc for each confirmed feature, in bounds that are still to be set."""
    features = run.result.features
    if not features:
        counts = run.result.counts
        raise EstimationError(
            f"no feature confirmed by {counts.detections} detections ({counts.unidentified} without the identity asked "
            f"for, {run.tentative} tentative features, {counts.dropped} dropped), allowed: {s.confirm} readings of a "
            "feature, or identities"
        )
    means = np.array([feature.mean for feature in features])
    covariances = np.array([feature.covariance for feature in features])
    estimates = disc_estimates(means, covariances, s.radius, s.radius_sigma)
    discs = tuple(estimate.mean for estimate in estimates)
    low, high = means.min(axis=0) - s.radius, means.max(axis=0) + s.radius
    bounds = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
    return World(log.name, bounds, discs, robot, estimates=tuple(estimates))


def _grown(world: World, confidence: float, s: MapSettings) -> World:
    from trailmark.estimation.risk.allocation import regrow

    if s.robot_sigma is None:
        return regrow(world, confidence)
    x, theta = s.robot_sigma
    return regrow(world, confidence, pose_covariance=np.diag([x**2, x**2, theta**2]))


def _bounds(world: World, way: FloatArray, margin: float) -> tuple[float, float, float, float]:
    """Return bounds with room for the robot around all obstacles and its way, in whole decimetres."""
    boxes = np.array([shape.bounding_box() for shape in world.obstacles]).reshape(-1, 4)
    points = np.vstack([boxes[:, :2], boxes[:, 2:], way])
    room = margin + (0.0 if world.robot is None else 2.0 * world.robot.circumradius)
    low = np.floor(10.0 * (points.min(axis=0) - room)) / 10.0
    high = np.ceil(10.0 * (points.max(axis=0) + room)) / 10.0
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _queries(world: World, way: FloatArray) -> tuple[Query, ...]:
    """Return queries between places on the robot's way, shape (n, 3), where it stands free."""
    looked = np.unique(np.linspace(0, len(way) - 1, min(len(way), _LOOKED_AT)).round().astype(np.intp))
    free = way[looked[_free(world, way[looked])]]
    if len(free) < 2:
        return ()
    away = np.hypot(*(free[:, :2] - free[0, :2]).T)
    ends = {"driven": free[-1], "farthest": free[away.argmax()]}
    start = _triple(free[0])
    return tuple(Query(name, start, _triple(goal)) for name, goal in ends.items())


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


def _triple(pose: FloatArray) -> tuple[float, float, float]:
    x, y, theta = (float(value) for value in pose)
    return x, y, theta


def _notes(s: MapSettings, sources: Sources, world: World) -> list[str]:
    """Return what a reader of the result should know."""
    notes = []
    if sources.obstacles == "detections" and s.radius == MapSettings.radius:
        notes.append(f"discs are taken to have a radius of {s.radius:g} m: the log does not say")
    if sources.poses == "odometry":
        notes.append("poses by odometry alone: its drift is in no covariance, and the stated risk leaves it out")
    if not world.queries:
        notes.append("no queries: the robot stands free nowhere on its way")
    return notes
