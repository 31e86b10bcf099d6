"""From laser scans at known poses to a world: walls and discs with covariances, cells where nothing else fits.

Lines and discs of single scans are found again from scan to scan and refined by the EKF. A grid counts where beams
ended and what they went through. It says along which stretches a line is a wall, what neither walls nor discs
explain, and what no beam has reached.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Annotated, Literal, NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from trailmark.arguments import NonNegative, Numbers, Positive, Probability, checked_arguments, shaped
from trailmark.errors import WorldError
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.grid import EvidenceGrid
from trailmark.estimation.map_settings import MappingSettings
from trailmark.estimation.odometry import scan_poses
from trailmark.estimation.records import Log, Scan
from trailmark.estimation.scan_features import DiscTracks, LineTracks, find_features
from trailmark.se2 import FloatArray, configurations, difference, transform
from trailmark.shapes import Disc, Rectangle, Shape
from trailmark.world import ObstacleEstimate, Robot, World

BoolArray = NDArray[np.bool_]

Sighted = list[tuple[ObstacleEstimate, FloatArray]]  # Obstacles, each with its end points, shape (n, 2).

GAP = 0.3  # Metres between stretches of a wall that count as joined, unless beams passed between them.
MIN_WALL = 0.2  # Shortest stretch that becomes a wall, metres.
THICKNESS = 0.05  # Metres that walls reach behind the front that was seen.
# Metres from a wall or disc within which occupied cells count as part of it; a cell in any case: its points lie
# anywhere in theirs.
EXPLAINED = 0.1
# Cells of an unknown patch, met by no beam, up to which it counts as free like what is around it.
MAX_UNKNOWN_CELLS = 4
# Share of a disc's inner cells that beams went through, from which on it is none: short arcs, such as the two faces
# at the end of a thin wall, fit circles that reach into free space. Of real posts and columns no inner cell is
# passed.
PIERCED = 0.05


@checked_arguments(EstimationError)
def disc_estimates(
    points: Annotated[ArrayLike, shaped(None, 2)],
    covariances: Annotated[ArrayLike, shaped(None, 2, 2)],
    radius: Numbers,
    radius_sigma: Numbers = 0.0,
) -> list[ObstacleEstimate]:
    """Return a disc for each point-like feature, such as a tree or a post.

    Args:
        points: estimated centres, shape (m, 2), metres.
        covariances: shape (m, 2, 2), square metres.
        radius: metres, one for all or shape (m,): known, or half of the diameters that a detector measured.
        radius_sigma: standard deviation of the radius, metres, one for all or shape (m,); assumed to be independent
            of the centre's error.

    Raises:
        EstimationError: shapes that do not fit together.
        ShapeError: a radius that is not positive, a centre that is not finite.
        WorldError: a covariance that is none.
    """
    centres, blocks = np.asarray(points, dtype=np.float64), np.asarray(covariances, dtype=np.float64)
    try:
        radii, sigmas, _ = (np.broadcast_to(v, len(centres)) for v in (radius, radius_sigma, np.empty(len(blocks))))
    except ValueError:
        shapes = [np.shape(given) for given in (points, covariances, radius, radius_sigma)]
        raise EstimationError(
            f"disc_estimates: expected shapes (m, 2), (m, 2, 2), and (m,) or () twice, got {shapes}"
        ) from None
    estimates = []
    for centre, block, r, sigma in zip(centres, blocks, radii, sigmas, strict=True):
        covariance = np.zeros((3, 3))
        covariance[:2, :2], covariance[2, 2] = block, sigma**2
        disc = Disc((float(centre[0]), float(centre[1])), float(r))
        estimates.append(ObstacleEstimate(disc, covariance if sigma else block))
    return estimates


@checked_arguments(EstimationError)
def wall_estimate(
    line: Annotated[ArrayLike, shaped(2)],
    covariance: Annotated[ArrayLike, shaped(2, 2)],
    span: tuple[float, float],
    *,
    thickness: Positive,
    along_sigma: NonNegative = 0.0,
    end_sigma: NonNegative = 0.0,
) -> ObstacleEstimate:
    """Return a wall: a rectangle whose front is a stretch of an estimated line and that lies behind it.

    With n = (cos α, sin α) and t = (−sin α, cos α), the front is {ρ n + s t : span[0] <= s <= span[1]} and the wall
    reaches from there along n, which points away from who saw it. A change of ρ and α moves the front's middle, at
    s = m, along n by δρ − m·δα, and turns the wall by δα.

    Args:
        line: ρ (metres, of either sign) and α (radians), shape (2,).
        covariance: of ρ and α, shape (2, 2).
        span: where the front begins and ends along t, metres.
        thickness: of the wall, metres. The readings do not show it.
        along_sigma: standard deviation of the wall's place along the line, metres.
        end_sigma: further standard deviation of each of the two ends by itself, metres.

    Returns:
        A rectangle with the covariance of x, y and heading; of length too, if the ends have errors of their own.

    Raises:
        ShapeError: a span or thickness that is not positive.
        WorldError: a covariance that is none.
    """
    (rho, alpha), (low, high) = (float(v) for v in np.asarray(line, dtype=np.float64)), span
    cos, sin = math.cos(alpha), math.sin(alpha)
    middle, half = 0.5 * (low + high), 0.5 * thickness
    # Columns: ρ, α, the shift of the middle along the line, the change of length.
    J = np.zeros((4, 4))  # noqa: N806 # a Jacobian
    along, across = np.array([-sin, cos]), np.array([cos, sin])
    J[:2, 0], J[:2, 1], J[:2, 2] = across, half * along - middle * across, along
    J[2, 1] = J[3, 3] = 1.0
    sources = np.zeros((4, 4))
    sources[:2, :2] = covariance
    sources[2, 2], sources[3, 3] = along_sigma**2 + 0.5 * end_sigma**2, 2.0 * end_sigma**2
    total = J @ sources @ J.T
    centre = (rho + half) * across + middle * along
    wall = Rectangle((float(centre[0]), float(centre[1])), high - low, thickness, alpha + 0.5 * math.pi)
    total = 0.5 * (total + total.T)
    return ObstacleEstimate(wall, total if end_sigma else total[:3, :3])


class MapObstacles(NamedTuple):
    """The obstacles of a map."""

    walls: Sighted  # Stretches of lines.
    discs: Sighted
    heaps: list[ObstacleEstimate]  # Groups of occupied cells that no wall and no disc explains.
    unknown: list[Shape]  # What no beam has reached, if that counts as blocked.


def find_obstacles(
    lines: LineTracks, discs: DiscTracks, grid: EvidenceGrid, x: FloatArray, s: MappingSettings
) -> MapObstacles:
    """Return the obstacles that confirmed tracks and a grid come to; the robot was at poses x, shape (m, 3)."""
    occupied = grid.occupied()
    seen_free = (grid.passes > 0) & ~occupied
    if s.unknown == "blocked":
        seen_free = _reached(seen_free | _small_patches((grid.passes == 0) & (grid.hits == 0)), grid, x)
    walls = _walls(lines, grid, occupied, s)
    posts = _posts(discs, grid, occupied)
    if s.unknown == "blocked":
        walls, posts = (_facing(found, seen_free, grid) for found in (walls, posts))
    explained = _explained(occupied, [estimate.mean for estimate, _ in walls + posts], grid)
    heaps, unknown = _cells(grid, occupied & ~explained, explained, seen_free, s)
    return MapObstacles(walls, posts, heaps, unknown)


def _walls(tracks: LineTracks, grid: EvidenceGrid, occupied: BoolArray, s: MappingSettings) -> Sighted:
    """Return the stretches of the lines where walls stand, each with its end points."""
    width, walls = 2.0 * grid.cell, []
    for at in range(len(tracks)):
        rho, alpha = tracks.states[at]
        across, along = np.array([math.cos(alpha), math.sin(alpha)]), np.array([-math.sin(alpha), math.cos(alpha)])
        points = np.concatenate(tracks.readings[at])
        points = points[np.abs(points @ across - rho) <= EXPLAINED]
        if len(points) == 0:
            continue
        places = points @ along
        bins = np.floor((places - places.min()) / width).astype(np.intp)
        middle = places.min() + width * (np.arange(bins.max() + 1) + 0.5)
        # Half a bin along the line, and a cell to either side of it.
        shifts = [u * 0.25 * width * along + v * grid.cell * across for u in (-1, 1) for v in (-1, 0, 1)]
        around_wall = [grid.cells(rho * across + middle[:, None] * along + shift) for shift in shifts]
        solid = np.any([occupied[where] for where in around_wall], axis=0)
        passed = ~solid & np.all([grid.passes[where] > 0 for where in around_wall], axis=0)
        standing = (np.bincount(bins) >= 2) & solid
        for first, last in _stretches(standing, passed, round(GAP / width)):
            own = (bins >= first) & (bins <= last)
            span = (float(places[own].min()), float(places[own].max()))
            if span[1] - span[0] >= MIN_WALL:
                covariance = tracks.covariance(at)
                cells = grid.cells(points[own])
                along_sigma = math.sqrt(_place_variance(grid.hits[cells], grid.variance[cells], s))
                wall = wall_estimate((rho, alpha), covariance, span, thickness=THICKNESS, along_sigma=along_sigma)
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


def _posts(tracks: DiscTracks, grid: EvidenceGrid, occupied: BoolArray) -> Sighted:
    """Return the discs that still stand and that no beam went through, each with its end points."""
    near, found = ndimage.binary_dilation(occupied), []
    passed = (grid.passes > 0) & ~occupied
    for at in range(len(tracks)):
        x, y, radius = (float(v) for v in tracks.states[at])
        points = np.concatenate(tracks.readings[at])
        if radius > 0.0 and near[grid.cells(points)].mean() > 0.5:
            disc = Disc((x, y), radius)
            if _share_inside(passed, disc, grid) <= PIERCED:
                found.append((ObstacleEstimate(disc, tracks.covariance(at)), points))
    return found


def _share_inside(mask: BoolArray, disc: Disc, grid: EvidenceGrid) -> float:
    """Return the share of a mask in the cells whose centres lie half a cell or more within a disc; 0 if none do."""
    centre = np.asarray(disc.center)
    rows, columns = grid.cells(centre + disc.radius * np.array([[-1.0, -1.0], [1.0, 1.0]]))
    around = mask[rows[0] : rows[1] + 1, columns[0] : columns[1] + 1]
    places = grid.centres(np.ones_like(around)) + grid.cell * np.array([columns[0], rows[0]])
    inner = np.hypot(*(places - centre).T) <= disc.radius - 0.5 * grid.cell
    return float(around.ravel()[inner].mean()) if inner.any() else 0.0


def _facing(found: Sighted, reached: BoolArray, grid: EvidenceGrid) -> Sighted:
    """Leave out what stands beyond the reach of the robot: the unknown that is blocked covers it."""
    near = ndimage.binary_dilation(reached, iterations=4)
    return [(estimate, points) for estimate, points in found if near[grid.cells(points)].mean() > 0.2]


def _explained(occupied: BoolArray, shapes: Sequence[Shape], grid: EvidenceGrid) -> BoolArray:
    """Return which of the occupied cells belong to shapes."""
    explained, reach = np.zeros_like(occupied), max(EXPLAINED, grid.cell)
    if shapes and occupied.any():
        tree = shapely.STRtree([shape.polygon(1e-2).shapely() for shape in shapes])
        inside, _ = tree.query(shapely.points(grid.centres(occupied)), predicate="dwithin", distance=reach)
        rows, columns = np.nonzero(occupied)
        explained[rows[inside], columns[inside]] = True
    return explained


def _small_patches(unseen: BoolArray) -> BoolArray:
    """Return the cells of patches of so few cells that they count as free."""
    labels, count = ndimage.label(unseen)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    return np.asarray(unseen & (sizes[labels] <= MAX_UNKNOWN_CELLS))


def _reached(free: BoolArray, grid: EvidenceGrid, x: FloatArray) -> BoolArray:
    """Return the free cells that are joined to where the robot was."""
    labels, _ = ndimage.label(free)
    own = np.unique(labels[grid.cells(x[:, :2])])
    return np.asarray(np.isin(labels, own[own > 0]))


def _cells(
    grid: EvidenceGrid, rest: BoolArray, explained: BoolArray, reached: BoolArray, s: MappingSettings
) -> tuple[list[ObstacleEstimate], list[Shape]]:
    """Return what cells must stand for: the occupied ones that nothing explains, and the unknown."""
    from trailmark.formats.grid import grid_polygons

    origin, unknown = (*grid.origin, 0.0), list[Shape]()
    if s.unknown == "blocked":
        near = ndimage.binary_dilation(reached, iterations=2)
        rest, explained = rest & near, explained & near
        unknown = list(grid_polygons(~(reached | rest | explained), grid.cell, origin))
    heaps = []
    for polygon in grid_polygons(rest, grid.cell, origin):
        rows, columns = grid.cells(polygon.vertices)
        around = np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
        own = rest[around]
        variance = _place_variance(grid.hits[around][own], grid.variance[around][own], s)
        heaps.append(ObstacleEstimate(polygon, variance * np.eye(2)))
    return heaps, unknown


def _place_variance(hits: NDArray[np.int32], variance: NDArray[np.float32], s: MappingSettings) -> float:
    """Return the variance of a place that end points in cells, (n,) each, tell: of one reading and of one pose."""
    return s.scan.sigma_range**2 + float(variance.sum()) / max(1, int(hits.sum()))


# Metres: how far a beam that met nothing shows space to be free, at most. Glass and what is black or tilted away
# throw nothing back either, and a beam hardly misses anything near.
CLEAR_RANGE = 8.0
# Metres along x and y each, and radians, within which a robot stands: it sees the same features again, and no more
# scans of them count than confirm a feature.
STANDING = (0.05, 0.02)
TRACK_GATE = 0.99  # Probability with which a scan's feature passes the gate of its own track.
# Metres: cells that are not asked for become no larger where a map of smaller ones would have too many corners.
COARSEST = 0.4


class ScanMap(NamedTuple):
    """A map and what it was made from."""

    #: Its obstacles are the estimates' means: walls, discs, groups of cells; last, without estimates, the unknown.
    world: World
    readings: tuple[FloatArray, ...]  #: The end points behind each wall and disc, arrays of shape (n, 2).
    poses: FloatArray  #: Where the scans were taken, shape (m, 3).
    grid: EvidenceGrid  #: Hits and passes.
    walls: int  #: How many obstacles are walls.
    discs: int  #: How many are discs.
    dropped: int  #: Lines and discs that too few scans showed.


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
        poses: where they were taken from: see :func:`trailmark.estimation.odometry.scan_poses`; or
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
    from trailmark.estimation.risk import regrow

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
