"""From a log of laser scans to a world: walls and discs with their covariances, and cells where nothing else fits.

Lines and discs of single scans are found again from scan to scan and refined by the EKF
(:mod:`trailmark.estimation.tracks`). Beside them a grid counts where beams ended and what they went through. It says
along which stretches a line is a wall, what neither walls nor discs explain, and what nobody has looked into.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark.errors import did_you_mean
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.obstacles import wall_estimate
from trailmark.estimation.records import Increment, Log, Odometry, Pose, Scan
from trailmark.estimation.scan_features import ScanSettings, find_features
from trailmark.se2 import FloatArray, compose, configurations, transform
from trailmark.shapes import Disc, Shape
from trailmark.world import ObstacleEstimate, Robot, World

if TYPE_CHECKING:
    from trailmark.estimation.evidence import EvidenceGrid
    from trailmark.estimation.tracks import DiscTracks, LineTracks

__all__ = ["MappingSettings", "ScanMap", "map_from_scans", "map_scans", "scan_poses"]

BoolArray = NDArray[np.bool_]
Poses = Literal["auto", "log", "odometry"]
Unknown = Literal["blocked", "free"]


@dataclass(frozen=True)
class MappingSettings:
    """How scans become a world.

    Raises:
        EstimationError: a value that is not allowed.
    """

    scan: ScanSettings = field(default_factory=ScanSettings)
    """How single scans are taken apart."""
    pose_sigma: tuple[float, float] = (0.02, 0.005)
    """Standard deviation of the poses: of x and y each (metres), of theta (radians)."""
    cell: float = 0.05
    """Side of the grid's cells, metres."""
    clear_range: float = 8.0
    """Metres: how far a beam that met nothing shows space to be free, at most."""
    min_hits: int = 2
    """Beams that must have ended in a cell for it to count as occupied."""
    least_share: float = 0.2
    """The share of the beams that came to a cell that must have ended there: less, and what was there is gone."""
    gate: float = 0.99
    """Probability with which a scan's feature passes the gate of its own track."""
    confirm: int = 3
    """Scans that must have shown a feature; others are dropped."""
    thickness: float = 0.05
    """Metres that walls reach behind the front that was seen."""
    gap: float = 0.3
    """Metres between stretches of a wall that are taken to be joined, unless beams went through there."""
    min_wall: float = 0.2
    """Shortest stretch that becomes a wall, metres."""
    explained: float = 0.1
    """Metres from a wall or disc within which occupied cells are taken to be part of it."""
    crumbs: int = 4
    """Cells of an unknown patch, met by no beam, up to which it counts as free like what is around it."""
    unknown: Unknown = "blocked"
    """What nobody looked into, or what is cut off from where the robot was: an obstacle, or free."""

    def __post_init__(self) -> None:
        for name in ("cell", "gap", "min_wall", "thickness", "explained", "least_share"):
            if not getattr(self, name) > 0.0:
                raise EstimationError(f"{name} {getattr(self, name)!r} given, allowed: above 0")
        if not (min(self.pose_sigma) >= 0.0 and self.clear_range >= 0.0 and 0.0 < self.gate < 1.0):
            raise EstimationError(
                f"pose_sigma, clear_range, gate {self.pose_sigma}, {self.clear_range}, {self.gate} given, allowed: 0 "
                "or more, 0 or more, between 0 and 1"
            )
        if self.min_hits < 1 or self.confirm < 1:
            raise EstimationError(f"min_hits, confirm {self.min_hits}, {self.confirm} given, allowed: 1 or more")
        if self.unknown not in get_args(Unknown):
            raise EstimationError(f"unknown {self.unknown!r} given, {did_you_mean(self.unknown, get_args(Unknown))}")


class ScanMap(NamedTuple):
    """A map and what it was made from."""

    world: World
    """Its obstacles are the estimates' means: walls, discs, groups of cells; last, without estimates, the unknown."""
    readings: tuple[FloatArray, ...]
    """The end points behind each wall and disc, arrays of shape (n, 2): see :func:`trailmark.estimation.plain_box`."""
    poses: FloatArray
    """Where the scans were taken, shape (m, 3)."""
    grid: EvidenceGrid
    """Hits and passes."""
    walls: int
    """How many obstacles are walls."""
    discs: int
    """How many are discs."""
    dropped: int
    """Lines and discs that too few scans showed."""


def map_from_scans(
    log: Log | Sequence[Scan],
    poses: Poses | ArrayLike = "auto",
    *,
    settings: MappingSettings | None = None,
    robot: Robot | None = None,
    confidence: float | None = None,
) -> World:
    """Return the world that a log's laser scans show; see :func:`map_scans`."""
    return map_scans(log, poses, settings=settings, robot=robot, confidence=confidence).world


def map_scans(
    log: Log | Sequence[Scan],
    poses: Poses | ArrayLike = "auto",
    *,
    settings: MappingSettings | None = None,
    robot: Robot | None = None,
    confidence: float | None = None,
    on_progress: Callable[[int, int], None] | None = None,
) -> ScanMap:
    """Return the map that a log's laser scans show, taken from known or estimated poses.

    Args:
        log: with scans.
        poses: where they were taken from: see :func:`scan_poses`; or configurations, shape (m, 3), such as a
            filter's, one for each scan.
        settings: how to go about it.
        robot: of the world.
        confidence: grow the obstacles so that a path meets none with this probability at least
            (:func:`trailmark.estimation.regrow`); None leaves them as they were measured.
        on_progress: called with the number of scans done and their total.

    Raises:
        EstimationError: a log without scans, poses that are not there or not one for each scan.
    """
    from trailmark.estimation.risk import regrow

    s = settings or MappingSettings()
    if isinstance(poses, str):
        scans, x = scan_poses(log, poses)  # type: ignore[arg-type]  # which checks the name
    else:
        scans, x = [record for record in _records(log) if isinstance(record, Scan)], configurations(poses)
        if x.shape != (len(scans), 3):
            raise EstimationError(f"poses: shape {x.shape} given for {len(scans)} scans, allowed: ({len(scans)}, 3)")
    if not scans:
        raise EstimationError("log: no scans given, allowed: one or more")
    grid, lines, discs = _read(scans, x, s, on_progress)
    dropped = 0
    for tracks in (lines, discs):
        tracks.merge()
        dropped += tracks.drop_unconfirmed(s.confirm)
    occupied = grid.occupied(s.min_hits, s.least_share)
    seen_free = (grid.passes > 0) & ~occupied
    if s.unknown == "blocked":
        seen_free = _reached(seen_free | _crumbs((grid.passes == 0) & (grid.hits == 0), s.crumbs), grid, x)
    walls = _walls(lines, grid, occupied, s)
    posts = _posts(discs, grid, occupied)
    if s.unknown == "blocked":
        walls, posts = (_facing(found, seen_free, grid) for found in (walls, posts))
    found = walls + posts
    explained = _explained(occupied, [estimate.mean for estimate, _ in found], grid, s)
    heaps, others = _cells(grid, occupied & ~explained, explained, seen_free, s)
    estimates = [estimate for estimate, _ in found] + heaps
    world = World(
        log.name if isinstance(log, Log) else "map",
        grid.bounds,
        (*(estimate.mean for estimate in estimates), *others),
        robot,
        estimates=(*estimates, *(None for _ in others)),
    )
    if confidence is not None:
        world = regrow(world, confidence)
    return ScanMap(world, tuple(points for _, points in found), x, grid, len(walls), len(posts), dropped)


def scan_poses(log: Log | Sequence[Scan], source: Poses = "auto") -> tuple[list[Scan], FloatArray]:
    """Return a log's scans, and where they were taken from, shape (m, 3).

    Args:
        log: with scans.
        source: ``log`` takes the poses that the scans carry; ``odometry`` adds up increments and velocities from
            the log's first pose on, or the first scan's, or else the origin; ``auto`` takes the scans' own if all
            carry one.

    Raises:
        EstimationError: an unknown source, or ``log`` and a scan without a pose.
    """
    if source not in get_args(Poses):
        raise EstimationError(f"poses {source!r} given, {did_you_mean(source, get_args(Poses))}")
    records = _records(log)
    scans = [record for record in records if isinstance(record, Scan)]
    stated = [scan.pose for scan in scans if scan.pose is not None]
    if source == "log" and len(stated) < len(scans):
        raise EstimationError(f"poses: {len(scans) - len(stated)} of {len(scans)} scans carry none, allowed: odometry")
    if source != "odometry" and len(stated) == len(scans):
        return scans, np.array(stated, dtype=np.float64).reshape(-1, 3)
    return scans, _dead_reckoning(records, stated[0] if stated else (0.0, 0.0, 0.0))


def _records(log: Log | Sequence[Scan]) -> Sequence[object]:
    return log.records if isinstance(log, Log) else log


def _dead_reckoning(records: Sequence[object], start: tuple[float, float, float]) -> FloatArray:
    """Return the poses of the scans, shape (m, 3), by odometry alone."""
    from trailmark.estimation.motion import Unicycle

    drive = Unicycle(0.0, 0.0)
    x, poses, odometry, begun = np.array(start), list[FloatArray](), None, False
    for record in records:
        if isinstance(record, Odometry | Scan) and odometry is not None:
            x = drive.f(x, np.array([odometry.v, odometry.omega, record.t - odometry.t]))
            odometry = odometry._replace(t=record.t)
        if isinstance(record, Odometry):
            odometry = record
        elif isinstance(record, Increment):
            x = compose(x, np.array(record[1:4]))
        elif isinstance(record, Pose) and not record.truth and not begun:
            x = np.array(record[1:4], dtype=np.float64)
        elif isinstance(record, Scan):
            poses.append(x)
        begun = begun or isinstance(record, Odometry | Increment | Scan)
    return np.array(poses).reshape(-1, 3)


def _read(
    scans: Sequence[Scan], x: FloatArray, s: MappingSettings, on_progress: Callable[[int, int], None] | None
) -> tuple[EvidenceGrid, LineTracks, DiscTracks]:
    """Take all scans into grid and tracks."""
    from trailmark.estimation.evidence import EvidenceGrid
    from trailmark.estimation.tracks import DiscTracks, LineTracks

    beams = [_beams(scan, pose, s) for scan, pose in zip(scans, x, strict=True)]
    corners = np.concatenate([x[:, :2], *(ends for _, ends, _ in beams)])
    low, high = corners.min(axis=0) - 4.0 * s.cell, corners.max(axis=0) + 4.0 * s.cell
    # On the lines of one grid for all maps of the same cells, so that maps can be compared.
    low, high = np.floor(low / s.cell) * s.cell, np.ceil(high / s.cell) * s.cell
    grid = EvidenceGrid((float(low[0]), float(low[1]), float(high[0]), float(high[1])), s.cell)
    covariance = np.diag([s.pose_sigma[0] ** 2, s.pose_sigma[0] ** 2, s.pose_sigma[1] ** 2])
    lines, discs = LineTracks(s.gate, covariance, s.gap), DiscTracks(s.gate, covariance)
    for i, (scan, pose, (start, ends, met)) in enumerate(zip(scans, x, beams, strict=True)):
        grid.add(start, ends, met)
        seen, features = find_features(scan, s.scan)
        lines.update([lines.seen(fit, seen.points, pose) for fit in features.lines])
        discs.update([discs.seen(fit, seen.points, pose) for fit in features.discs])
        if on_progress is not None:
            on_progress(i + 1, len(scans))
    return grid, lines, discs


def _beams(scan: Scan, pose: FloatArray, s: MappingSettings) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return where the scanner is, (2,), where its beams end, (n, 2), and which of them met something, (n,)."""
    ranges = np.asarray(scan.ranges, dtype=np.float64)
    kept = ~np.isnan(ranges) & (ranges > 0.0)
    angles = scan.angle_min + np.flatnonzero(kept) * scan.angle_increment
    nothing = ranges[kept] >= scan.range_max
    length = np.where(nothing, min(scan.range_max, s.clear_range), np.minimum(ranges[kept], s.scan.max_range))
    met = ~nothing & (ranges[kept] <= s.scan.max_range)
    ends = transform(scan.mount, length[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]))
    return transform(pose, np.asarray(scan.mount)[None, :2])[0], transform(pose, ends), met


def _walls(
    tracks: LineTracks, grid: EvidenceGrid, occupied: BoolArray, s: MappingSettings
) -> list[tuple[ObstacleEstimate, FloatArray]]:
    """Return the stretches of the lines where walls stand, each with its end points."""
    width, walls = 2.0 * grid.cell, []
    for at in range(len(tracks)):
        rho, alpha = tracks.states[at]
        across, along = np.array([math.cos(alpha), math.sin(alpha)]), np.array([-math.sin(alpha), math.cos(alpha)])
        points = np.concatenate(tracks.readings[at])
        points = points[np.abs(points @ across - rho) <= s.explained]
        if len(points) == 0:
            continue
        places = points @ along
        bins = np.floor((places - places.min()) / width).astype(np.intp)
        middle = places.min() + width * (np.arange(bins.max() + 1) + 0.5)
        # Half a bin along the line, and a cell to either side of it.
        shifts = [u * 0.25 * width * along + v * grid.cell * across for u in (-1, 1) for v in (-1, 0, 1)]
        looked = [grid.cells(rho * across + middle[:, None] * along + shift) for shift in shifts]
        solid = np.any([occupied[where] for where in looked], axis=0)
        passed = ~solid & np.all([grid.passes[where] > 0 for where in looked], axis=0)
        standing = (np.bincount(bins) >= 2) & solid
        for first, last in _stretches(standing, passed, round(s.gap / width)):
            own = (bins >= first) & (bins <= last)
            span = (float(places[own].min()), float(places[own].max()))
            if span[1] - span[0] >= s.min_wall:
                covariance = tracks.covariance(at)
                wall = wall_estimate((rho, alpha), covariance, span, thickness=s.thickness, end_sigma=grid.cell)
                walls.append((wall, points[own]))
    return walls


def _stretches(standing: BoolArray, passed: BoolArray, gap: int) -> list[tuple[int, int]]:
    """Return first and last of the runs of ``standing``, joined over at most ``gap`` bins that nothing passed."""
    runs = list[tuple[int, int]]()
    for at in np.flatnonzero(standing).tolist():
        if runs and at - runs[-1][1] - 1 <= gap and not passed[runs[-1][1] + 1 : at].any():
            runs[-1] = runs[-1][0], at
        else:
            runs.append((at, at))
    return runs


def _posts(tracks: DiscTracks, grid: EvidenceGrid, occupied: BoolArray) -> list[tuple[ObstacleEstimate, FloatArray]]:
    """Return the discs that still stand, each with its end points."""
    from scipy import ndimage

    near, found = ndimage.binary_dilation(occupied), []
    for at in range(len(tracks)):
        x, y, radius = (float(v) for v in tracks.states[at])
        points = np.concatenate(tracks.readings[at])
        if radius > 0.0 and near[grid.cells(points)].mean() > 0.5:
            found.append((ObstacleEstimate(Disc((x, y), radius), tracks.covariance(at)), points))
    return found


def _facing(
    found: list[tuple[ObstacleEstimate, FloatArray]], reached: BoolArray, grid: EvidenceGrid
) -> list[tuple[ObstacleEstimate, FloatArray]]:
    """Leave out what stands beyond the reach of the robot: the unknown that is blocked covers it."""
    from scipy import ndimage

    near = ndimage.binary_dilation(reached, iterations=4)
    return [(estimate, points) for estimate, points in found if near[grid.cells(points)].mean() > 0.2]


def _explained(occupied: BoolArray, shapes: Sequence[Shape], grid: EvidenceGrid, s: MappingSettings) -> BoolArray:
    """Return which of the occupied cells belong to shapes."""
    import shapely

    explained = np.zeros_like(occupied)
    if shapes and occupied.any():
        tree = shapely.STRtree([shape.polygon(1e-2).shapely() for shape in shapes])
        inside, _ = tree.query(shapely.points(grid.centres(occupied)), predicate="dwithin", distance=s.explained)
        rows, columns = np.nonzero(occupied)
        explained[rows[inside], columns[inside]] = True
    return explained


def _crumbs(unseen: BoolArray, most: int) -> BoolArray:
    """Return the cells of patches of at most so many cells."""
    from scipy import ndimage

    labels, count = ndimage.label(unseen)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    return np.asarray(unseen & (sizes[labels] <= most))


def _reached(free: BoolArray, grid: EvidenceGrid, x: FloatArray) -> BoolArray:
    """Return the free cells that are joined to where the robot was."""
    from scipy import ndimage

    labels, _ = ndimage.label(free)
    own = np.unique(labels[grid.cells(x[:, :2])])
    return np.asarray(np.isin(labels, own[own > 0]))


def _cells(
    grid: EvidenceGrid, rest: BoolArray, explained: BoolArray, reached: BoolArray, s: MappingSettings
) -> tuple[list[ObstacleEstimate], list[Shape]]:
    """Return what cells must stand for: the occupied ones that nothing explains, and the unknown."""
    from scipy import ndimage

    from trailmark.formats.grid import grid_polygons

    origin, unknown = (*grid.origin, 0.0), list[Shape]()
    if s.unknown == "blocked":
        near = ndimage.binary_dilation(reached, iterations=2)
        rest, explained = rest & near, explained & near
        unknown = list(grid_polygons(~(reached | rest | explained), grid.cell, origin))
    heaps = []
    for polygon in grid_polygons(rest, grid.cell, origin):
        rows, columns = grid.cells(polygon.vertices.mean(axis=0)[None])
        around = np.s_[max(0, rows[0] - 3) : rows[0] + 4, max(0, columns[0] - 3) : columns[0] + 4]
        hits = max(1, int(grid.hits[around].sum()))
        turned = s.pose_sigma[1] * float(grid.reach[around].sum()) / hits
        variance = s.scan.sigma_range**2 + s.pose_sigma[0] ** 2 + turned**2
        heaps.append(ObstacleEstimate(polygon, variance * np.eye(2)))
    return heaps, unknown
