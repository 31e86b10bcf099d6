"""From a log of laser scans to a world: walls and discs with their covariances, and cells where nothing else fits.

Lines and discs of single scans are found again from scan to scan and refined by the EKF
(:mod:`trailmark.estimation.scans.tracks`). Beside them a grid counts where beams ended and what they went through. It
says along which stretches a line is a wall, what neither walls nor discs explain, and what no beam has reached
(:mod:`trailmark.estimation.maps.scan_obstacles`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark.arguments import Numbers, Probability, checked_arguments, shaped
from trailmark.errors import WorldError
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.logs.records import Log, Scan
from trailmark.estimation.maps.map_settings import MappingSettings
from trailmark.estimation.scans.scan_features import find_features
from trailmark.estimation.scans.scan_poses import scan_poses
from trailmark.se2 import FloatArray, configurations, difference, transform
from trailmark.world import Robot, World

if TYPE_CHECKING:
    from trailmark.estimation.maps.evidence import EvidenceGrid
    from trailmark.estimation.scans.tracks import DiscTracks, LineTracks

__all__ = ["ScanMap", "beam_ends", "map_scans"]

BoolArray = NDArray[np.bool_]

CLEAR_RANGE = 8.0
"""Metres: how far a beam that met nothing shows space to be free, at most. Glass and what is black or tilted away throw
nothing back either, and a beam hardly misses anything near."""

STANDING = (0.05, 0.02)
"""Metres along x and y each, and radians, within which a robot stands: it sees the same features again, and no more
scans of them count than confirm a feature."""

TRACK_GATE = 0.99
"""Probability with which a scan's feature passes the gate of its own track."""

COARSEST = 0.4
"""Metres: cells that are not asked for become no larger where a map of smaller ones would have too many corners."""


class ScanMap(NamedTuple):
    """A map and what it was made from."""

    world: World
    """Its obstacles are the estimates' means: walls, discs, groups of cells; last, without estimates, the unknown."""
    readings: tuple[FloatArray, ...]
    """The end points behind each wall and disc, arrays of shape (n, 2)."""
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


@checked_arguments(EstimationError)
def map_scans(
    log: Log | Sequence[Scan],
    poses: Literal["auto", "log", "odometry"] | Numbers = "auto",
    *,
    settings: MappingSettings | None = None,
    robot: Robot | None = None,
    confidence: Probability | None = None,
    pose_covariances: Annotated[ArrayLike, shaped(None, 3, 3)] | None = None,
    on_progress: Callable[[int, int], None] | None = None,
) -> ScanMap:
    """Return the map that a log's laser scans show, taken from known or estimated poses.

    Args:
        log: with scans.
        poses: where they were taken from: see :func:`trailmark.estimation.scans.scan_poses.scan_poses`; or
            configurations, shape (m, 3), such as a filter's, one for each scan.
        settings: how to go about it.
        robot: of the world.
        confidence: grow the obstacles so that a path meets none with this probability at least
            (:func:`trailmark.estimation.regrow`); None leaves them as they were measured.
        pose_covariances: of the poses, in the world's axes, shape (m, 3, 3); by default what the settings say of all.
        on_progress: called with the number of scans done and their total.

    The grid's cells are larger than by default, up to COARSEST, where the map would have too many of them or too many
    corners; a side that the settings state stays.

    Raises:
        EstimationError: a log without scans, a map too large for its cells, poses that are not there or not one for
            each scan.
    """
    from trailmark.estimation.maps.scan_obstacles import find_obstacles
    from trailmark.estimation.risk.allocation import regrow

    s = settings or MappingSettings()
    if isinstance(poses, str):
        scans, x = scan_poses(log, poses)  # type: ignore[arg-type]  # one of the three, as was checked
    else:
        records = log.records if isinstance(log, Log) else log
        scans, x = [record for record in records if isinstance(record, Scan)], configurations(poses, name="poses")
        if x.shape != (len(scans), 3):
            raise EstimationError(f"poses: expected shape ({len(scans)}, 3), one for each scan, got {x.shape}")
    if not scans:
        raise EstimationError("log: expected one scan or more, got none")
    if pose_covariances is None:
        sigma, sigma_theta = s.pose_sigma
        covariances = np.broadcast_to(np.diag([sigma**2, sigma**2, sigma_theta**2]), (len(scans), 3, 3))
    else:
        covariances = np.asarray(pose_covariances, dtype=np.float64)
        if len(covariances) != len(scans):
            raise EstimationError(
                f"pose_covariances: expected one for each of {len(scans)} scans, got {len(covariances)}"
            )
    cell = s.cell_side(log.cell if isinstance(log, Log) else None)
    while True:
        try:
            grid, lines, discs = _read(scans, x, covariances, s, cell, on_progress)
            dropped = 0
            for tracks in (lines, discs):
                tracks.merge()
                dropped += tracks.drop_unconfirmed(s.confirm)
            found = find_obstacles(lines, discs, grid, x, s)
            break
        except WorldError as error:
            if s.cell is not None or cell >= COARSEST:
                advice = "settings mapping.cell: 0.1 and mapping.scan.max_range: 20 make fewer"
                raise EstimationError(f"{error}; {advice}") from None
            cell *= 2.0
    sighted = found.walls + found.discs
    estimates = [*(estimate for estimate, _ in sighted), *found.heaps]
    world = World(
        log.name if isinstance(log, Log) else "map",
        grid.bounds,
        (*(estimate.mean for estimate in estimates), *found.unknown),
        robot,
        estimates=(*estimates, *(None for _ in found.unknown)),
    )
    if confidence is not None:
        world = regrow(world, confidence)
    return ScanMap(world, tuple(points for _, points in sighted), x, grid, len(found.walls), len(found.discs), dropped)


def _read(
    scans: Sequence[Scan],
    x: FloatArray,
    covariances: FloatArray,
    s: MappingSettings,
    cell: float,
    on_progress: Callable[[int, int], None] | None,
) -> tuple[EvidenceGrid, LineTracks, DiscTracks]:
    """Enter all scans in the grid and the tracks."""
    from trailmark.estimation.maps.evidence import EvidenceGrid
    from trailmark.estimation.maps.scan_obstacles import GAP
    from trailmark.estimation.scans.tracks import DiscTracks, LineTracks

    low, high = x[:, :2].min(axis=0), x[:, :2].max(axis=0)
    # Beams are worked out twice, not kept: a log may hold a million scans.
    for scan, pose in zip(scans, x, strict=True):
        _, ends, _ = beam_ends(scan, pose, s)
        low, high = (
            np.minimum(low, ends.min(axis=0, initial=np.inf)),
            np.maximum(high, ends.max(axis=0, initial=-np.inf)),
        )
    low, high = low - 4.0 * cell, high + 4.0 * cell
    # On the lines of one grid for all maps of the same cells, so that maps can be compared.
    low, high = np.floor(low / cell) * cell, np.ceil(high / cell) * cell
    grid = EvidenceGrid((float(low[0]), float(low[1]), float(high[0]), float(high[1])), cell)
    lines, discs = LineTracks(TRACK_GATE, covariances[0], GAP), DiscTracks(TRACK_GATE, covariances[0])
    place, heading = np.sqrt(0.5 * (covariances[:, 0, 0] + covariances[:, 1, 1])), np.sqrt(covariances[:, 2, 2])
    stood, times = x[0], 0
    for i, (scan, pose) in enumerate(zip(scans, x, strict=True)):
        start, ends, met = beam_ends(scan, pose, s)
        grid.add(start, ends, met, pose_sigma=(float(place[i]), float(heading[i])))
        if on_progress is not None:
            on_progress(i + 1, len(scans))
        # A robot that stands sees the same features again, by the same error of its pose.
        moved = np.abs(difference(stood, pose))
        stands = max(moved[0], moved[1]) < STANDING[0] and moved[2] < STANDING[1]
        stood, times = (stood, times + 1) if stands else (pose, 1)
        if times > s.confirm:
            continue
        lines.pose_covariance = discs.pose_covariance = covariances[i]
        hits, features = find_features(scan, s.scan)
        lines.update([lines.observation(fit, hits.points, pose) for fit in features.lines])
        discs.update([discs.observation(fit, hits.points, pose) for fit in features.discs])
    return grid, lines, discs


def beam_ends(scan: Scan, pose: FloatArray, s: MappingSettings) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return where the scanner is, (2,), where its beams end, (n, 2), and which of them met something, (n,)."""
    ranges = np.asarray(scan.ranges, dtype=np.float64)
    readable = ~np.isnan(ranges) & (ranges > 0.0)
    angles = scan.angle_min + np.flatnonzero(readable) * scan.angle_increment
    nothing = ranges[readable] >= scan.range_max
    length = np.where(nothing, min(scan.range_max, CLEAR_RANGE), np.minimum(ranges[readable], s.scan.max_range))
    met = ~nothing & (ranges[readable] <= s.scan.max_range)
    ends = transform(scan.mount, length[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]))
    return transform(pose, np.asarray(scan.mount)[None, :2])[0], transform(pose, ends), met
