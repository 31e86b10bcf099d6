# ruff: noqa: N803, N806 # the names are those of the literature: x, P, F, W, Q, H, R, S, K
"""Lines and discs in laser scans, and over scans: found again by gate and place, refined by the EKF.

A line is (ρ, α), {p : p·(cos α, sin α) = ρ}, its normal pointing away from the scanner: ρ is then negative where the
scanner stands farther out than the line, seen from the robot's origin. Features stand (F is the identity, Q is 0), so
each scan that shows one is one update. The errors of poses that follow one another are not independent: what they do
to a feature does not average out over its scans (:meth:`Tracks.covariance`).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark.arguments import Positive, PositiveOrInfinite, checked_fields
from trailmark.estimation.covariance import chi_square_quantile
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.records import Scan
from trailmark.se2 import FloatArray, transform, wrap

IntArray = NDArray[np.intp]

STEPS = 25  # Gauss-Newton steps of a fit at most; a handful do.
SETTLED = 1e-8  # A step this small, relative to the points' extent, ends a fit.


class LineFit(NamedTuple):
    """A stretch of a straight line."""

    line: FloatArray  # ρ (metres), α (radians), shape (2,).
    covariance: FloatArray  # Of ρ and α, shape (2, 2).
    span: tuple[float, float]  # First and last place of its end points along (−sin α, cos α), metres.
    misfit: float  # Sum of squared residuals over variances, per degree of freedom.
    indices: IntArray  # Its end points' places in the arrays that it was fitted to, in the order of the sweep.


class DiscFit(NamedTuple):
    """An arc of a circle."""

    disc: FloatArray  # x, y, radius (metres), shape (3,).
    covariance: FloatArray  # Of x, y and radius, shape (3, 3).
    misfit: float  # As for a line.
    indices: IntArray  # As for a line.


def fit_line(points: ArrayLike, covariances: ArrayLike, origin: ArrayLike = (0.0, 0.0)) -> LineFit:
    """Return the line that makes the points likeliest: weighted total least squares.

    Each point counts by its variance across the line, nᵀ C n (Pfister, Roumeliotis & Burdick 2003, IEEE International
    Conference on Robotics and Automation). The covariance is the inverse of the information Σ j jᵀ / nᵀ C n with
    j = (1, −p·t), by which ρ − p·n changes with ρ and α.

    Args:
        points: shape (n, 2), n >= 2, not all the same.
        covariances: shape (n, 2, 2), positive definite.
        origin: where the points were seen from, shape (2,): the normal points away from there.
    """
    p, C = np.asarray(points, dtype=np.float64), np.asarray(covariances, dtype=np.float64)
    centre = p.mean(axis=0)
    # From the centre, so that ρ and α are hardly correlated and far from the origin no digits are lost.
    q = p - centre
    _, values, axes = np.linalg.svd(q, full_matrices=False)
    alpha, rho = math.atan2(float(axes[0, 0]), -float(axes[0, 1])), 0.0
    for _ in range(STEPS):
        residual, _, _, information, gradient = _line_system(q, C, rho, alpha)
        (a, b), (_, d) = information
        det = a * d - b * b
        turn = (a * gradient[1] - b * gradient[0]) / det
        shift = (d * gradient[0] - b * gradient[1]) / det
        rho, alpha = rho + shift, alpha + turn
        if abs(shift) < SETTLED * values[0] and abs(turn) < SETTLED:
            break
    if float(_axes(alpha)[0] @ (centre - np.asarray(origin, dtype=np.float64)) + rho) < 0.0:
        rho, alpha = -rho, alpha + math.pi
    alpha = float(wrap(alpha))
    n, t = _axes(alpha)
    residual, variance, along, information, _ = _line_system(q, C, rho, alpha)
    # Back from the centre c: ρ + c·n, whose change with α is c·t.
    back = np.array([[1.0, float(centre @ t)], [0.0, 1.0]])
    covariance = back @ np.linalg.inv(information) @ back.T
    places = along + float(centre @ t)
    misfit = float((residual**2 / variance).sum()) / max(1, len(p) - 2)
    line = np.array([rho + float(centre @ n), alpha])
    span = (float(places.min()), float(places.max()))
    return LineFit(line, 0.5 * (covariance + covariance.T), span, misfit, np.arange(len(p)))


def fit_circle_roughly(points: ArrayLike) -> FloatArray | None:
    """Return centre and radius (3,) of a circle through points (n, 2), n >= 3, or None for points on a line.

    The algebraic fit of Kåsa 1976 (IEEE Transactions on Instrumentation and Measurement), biased by short arcs.
    """
    p = np.asarray(points, dtype=np.float64)
    centre = p.mean(axis=0)
    q = p - centre
    # x² + y² = 2ax + 2by + c.
    A = np.column_stack([2.0 * q, np.ones(len(q))])
    (a, b, c), _, rank, _ = np.linalg.lstsq(A, (q**2).sum(axis=1), rcond=None)
    square = float(c + a * a + b * b)
    return np.array([a + centre[0], b + centre[1], math.sqrt(square)]) if rank == 3 and square > 0.0 else None


def fit_disc(points: ArrayLike, covariances: ArrayLike) -> DiscFit | None:
    """Return the circle that makes the points likeliest, or None where they are too straight for one.

    The rough circle is refined by Gauss-Newton steps on the distances to it, each weighted by the point's variance
    along the radius. Points have shape (n, 2), n >= 3, covariances (n, 2, 2), positive definite.
    """
    p, C = np.asarray(points, dtype=np.float64), np.asarray(covariances, dtype=np.float64)
    first = fit_circle_roughly(p)
    if first is None:
        return None
    centre = p.mean(axis=0)
    q, disc = p - centre, first - [*centre, 0.0]
    size = float(np.abs(q).max())
    for _ in range(STEPS):
        away = q - disc[:2]
        distance = np.hypot(*away.T)
        if not (distance.min() > 0.0 and disc[2] < 1e3 * size):
            return None
        u = away / distance[:, None]
        variance = np.einsum("ni,nij,nj->n", u, C, u)
        J = np.column_stack([u, np.ones(len(q))])
        information = J.T @ (J / variance[:, None])
        try:
            step = np.linalg.solve(information, J.T @ ((distance - disc[2]) / variance))
        except np.linalg.LinAlgError:
            return None
        disc = disc + step
        if np.abs(step).max() < SETTLED * size:
            break
    if not 0.0 < disc[2] < 1e3 * size or np.abs(step).max() > 1e-3 * size:
        return None
    misfit = float((((np.hypot(*(q - disc[:2]).T) - disc[2]) ** 2) / variance).sum()) / max(1, len(p) - 3)
    disc[:2] += centre
    covariance = np.linalg.inv(information)
    if not (np.diag(covariance) > 0.0).all():
        return None
    return DiscFit(disc, 0.5 * (covariance + covariance.T), misfit, np.arange(len(p)))


def _line_system(
    q: FloatArray, C: FloatArray, rho: float, alpha: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return residuals, their variances, places along the line, and the normal equations of a Gauss-Newton step."""
    n, t = _axes(alpha)
    variance = n[0] * n[0] * C[:, 0, 0] + 2.0 * n[0] * n[1] * C[:, 0, 1] + n[1] * n[1] * C[:, 1, 1]
    residual, along = q @ n - rho, q @ t
    weight = 1.0 / variance
    moment = -float(weight @ along)
    information = np.array([[weight.sum(), moment], [moment, weight @ along**2]])
    gradient = np.array([weight @ residual, -float((weight * along) @ residual)])
    return residual, variance, along, information, gradient


def _axes(alpha: float) -> tuple[FloatArray, FloatArray]:
    cos, sin = math.cos(alpha), math.sin(alpha)
    return np.array([cos, sin]), np.array([-sin, cos])


# The smallest angle, radians, between a beam and a continuous surface that it is assumed to meet.
INCIDENCE = math.radians(10.0)
SPLIT = 0.06  # Metres that an end point may lie off a line before the line is split: three deviations of a range.
MIN_POINTS = 6  # End points that a line or a disc needs: of fewer, noise alone makes either.
MIN_LENGTH = 0.3  # Metres that a line needs.
# Sum of squared residuals over variances, per degree of freedom, that a line may have: walls are not flat.
LINE_MISFIT = 4.0
DISC_RADII = (0.03, 0.6)  # Metres: radii that a disc may have, from a table's leg to a column.
# Radians of a disc's outline that must be seen: of less, corners and bent walls make circles too.
DISC_ARC = math.radians(100.0)
DISC_MISFIT = 2.0  # The sum of a disc; where a line has no more, it is a line.


@dataclass(frozen=True)
class ScanSettings:
    """What is known of a scanner.

    Raises:
        EstimationError: a value that is not allowed.
    """

    sigma_range: Positive = 0.02  #: Standard deviation of a range, metres (a SICK LMS's: some 1 to 2 cm).
    #: Standard deviation of a beam's direction, radians: its width, not the step from beam to beam.
    sigma_bearing: Positive = 0.003
    max_range: PositiveOrInfinite = math.inf  #: Metres: end points farther away are left out.

    def __post_init__(self) -> None:
        checked_fields(self, EstimationError)


class ScanPoints(NamedTuple):
    """Where the beams of a scan ended, in the order of the sweep, in the robot's frame."""

    points: FloatArray  # Shape (n, 2), metres.
    covariances: FloatArray  # Shape (n, 2, 2), from the noise of range and bearing.
    ranges: FloatArray  # Shape (n,), metres from the scanner.
    beams: IntArray  # Shape (n,), which beams these are.
    origin: FloatArray  # Where the scanner is, shape (2,).
    step: float  # Radians from beam to beam, positive.


class ScanFeatures(NamedTuple):
    """What a scan shows."""

    lines: tuple[LineFit, ...]
    discs: tuple[DiscFit, ...]


def scan_points(scan: Scan, settings: ScanSettings) -> ScanPoints:
    """Return the end points of the beams that met something.

    A point's covariance is that of (r cos β, r sin β) to first order: σ_r² along the beam, (r·σ_β)² across it.
    """
    ranges = np.asarray(scan.ranges, dtype=np.float64)
    met = np.isfinite(ranges) & (ranges > 0.0) & (ranges < scan.range_max)
    beams = np.flatnonzero(met & (np.nan_to_num(ranges) <= settings.max_range))
    r, angles = ranges[beams], scan.angle_min + beams * scan.angle_increment
    mount = np.asarray(scan.mount, dtype=np.float64)
    points = transform(mount, r[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]))
    direction = angles + mount[2]
    along = np.column_stack([np.cos(direction), np.sin(direction)])
    across = np.column_stack([-along[:, 1], along[:, 0]])
    covariances = settings.sigma_range**2 * along[:, :, None] * along[:, None]
    covariances += ((settings.sigma_bearing * r) ** 2)[:, None, None] * across[:, :, None] * across[:, None]
    return ScanPoints(points, covariances, r, beams, mount[:2], abs(scan.angle_increment))


def jump_groups(hits: ScanPoints, settings: ScanSettings) -> list[IntArray]:
    """Return the end points' places by group: it ends where the next point is farther away than a surface explains.

    That is farther than r·sin Δφ / sin(λ − Δφ) + 3σ_r, λ the flattest incidence and Δφ the angle from beam to beam
    (the adaptive breakpoint detector of Borges & Aldon 2004, Journal of Intelligent and Robotic Systems 40), or than
    3σ_r where so many beams in between met nothing that Δφ comes near λ.
    """
    if len(hits.points) == 0:
        return []
    gap, angle = np.hypot(*np.diff(hits.points, axis=0).T), np.diff(hits.beams) * hits.step
    grazing = np.minimum(angle, 0.9 * INCIDENCE)
    near = np.minimum(hits.ranges[:-1], hits.ranges[1:])
    reach = np.where(angle < 0.9 * INCIDENCE, near * np.sin(grazing) / np.sin(INCIDENCE - grazing), 0.0)
    ends = np.flatnonzero(gap > reach + 3.0 * settings.sigma_range) + 1
    return np.split(np.arange(len(hits.points)), ends)


def split_and_merge(points: ArrayLike, threshold: float) -> list[IntArray]:
    """Return the points' places by straight piece, in order.

    Split: between the first and the last point of a piece, at the point farthest from the line through them, while
    that is farther than the threshold (Ramer 1972, Douglas & Peucker 1973: iterative end point fit). Merge:
    neighbouring pieces whose common least-squares line keeps all of their points within it (Pavlidis & Horowitz
    1974). A corner's point goes to the piece before it.

    Args:
        points: shape (n, 2), along a curve.
        threshold: metres.
    """
    p = np.asarray(points, dtype=np.float64)
    if len(p) == 0:
        return []
    pieces, stack = list[tuple[int, int]](), [(0, len(p))]
    while stack:
        first, last = stack.pop()
        at = _farthest(p[first:last], threshold)
        if at is None:
            pieces.append((first, last))
        else:
            stack += [(first + at + 1, last), (first, first + at + 1)]
    merged = pieces[:1]
    for first, last in pieces[1:]:
        if _straight(p[merged[-1][0] : last], threshold):
            merged[-1] = merged[-1][0], last
        else:
            merged.append((first, last))
    return [np.arange(first, last) for first, last in merged]


def find_features(scan: Scan, settings: ScanSettings | None = None) -> tuple[ScanPoints, ScanFeatures]:
    """Return the end points of a scan, and the lines and discs in them.

    A group is a disc if a circle of an allowed radius, of which enough is seen, bulges towards the scanner and fits
    it as its noise would, which no line does. Else it is split into straight pieces; those that are long and straight
    enough are lines.
    """
    s = settings or ScanSettings()
    hits = scan_points(scan, s)
    lines, discs = list[LineFit](), list[DiscFit]()
    for group in jump_groups(hits, s):
        disc = _disc_in(hits, group)
        if disc is not None:
            discs.append(disc)
            continue
        pieces = (_line_in(hits, group[piece]) for piece in split_and_merge(hits.points[group], SPLIT))
        lines += [line for line in pieces if line is not None]
    return hits, ScanFeatures(tuple(lines), tuple(discs))


def _line_in(hits: ScanPoints, own: IntArray) -> LineFit | None:
    if len(own) < MIN_POINTS:
        return None
    ends = hits.points[own[[0, -1]]]
    if np.hypot(*(ends[1] - ends[0])) < MIN_LENGTH:
        return None
    fit = fit_line(hits.points[own], hits.covariances[own], hits.origin)
    if fit.misfit > LINE_MISFIT:
        return None
    # A surface rougher than the sensor's noise: its scatter is what the line is known by.
    return fit._replace(covariance=max(1.0, fit.misfit) * fit.covariance, indices=own)


def _disc_in(hits: ScanPoints, group: IntArray) -> DiscFit | None:
    if len(group) < MIN_POINTS:
        return None
    points, covariances = hits.points[group], hits.covariances[group]
    if np.ptp(points, axis=0).max() > 2.0 * DISC_RADII[1]:
        return None
    rough = fit_circle_roughly(points)
    if rough is None or rough[2] > 2.0 * DISC_RADII[1] or _arc(points, rough) < 0.5 * DISC_ARC:
        return None
    if fit_line(points, covariances, hits.origin).misfit <= DISC_MISFIT:
        return None
    fit = fit_disc(points, covariances)
    if fit is None or not DISC_RADII[0] <= fit.disc[2] <= DISC_RADII[1] or fit.misfit > DISC_MISFIT:
        return None
    bulge = float((points.mean(axis=0) - fit.disc[:2]) @ (hits.origin - fit.disc[:2]))
    if _arc(points, fit.disc) < DISC_ARC or bulge <= 0.0:
        return None
    return fit._replace(indices=group)


def _arc(points: FloatArray, disc: FloatArray) -> float:
    """Return how many radians of a circle its points span, in the order of the sweep."""
    away = points - disc[:2]
    return float(np.ptp(np.unwrap(np.arctan2(away[:, 1], away[:, 0]))))


def _farthest(points: FloatArray, threshold: float) -> int | None:
    """Return the inner point farthest from the chord of a piece, if that is beyond the threshold."""
    if len(points) < 3:
        return None
    chord, inner = points[-1] - points[0], points[1:-1] - points[0]
    length = float(np.hypot(*chord))
    off = np.hypot(*inner.T) if length == 0.0 else np.abs(inner[:, 0] * chord[1] - inner[:, 1] * chord[0]) / length
    at = int(off.argmax())
    # The point stays with the part before it, and both parts are shorter than the whole.
    return at + 1 if off[at] > threshold else None


def _straight(points: FloatArray, threshold: float) -> bool:
    q = points - points.mean(axis=0)
    _, _, axes = np.linalg.svd(q, full_matrices=False)
    return bool(np.abs(q @ axes[-1]).max() <= threshold) if len(axes) > 1 else True


MAX_READINGS = 500  # Scans whose end points a track keeps as they are; then one remains for each square of side THIN.
THIN = 0.02  # Metres: a scanner's noise.


class Observation(NamedTuple):
    """A feature of one scan, in the world."""

    state: FloatArray  # Shape (d,).
    R: FloatArray  # Its covariance from the sensor's noise, shape (d, d).
    R_pose: FloatArray  # Its covariance from the pose's errors, shape (d, d).
    readings: FloatArray  # Its end points in the world, shape (n, 2).


class Tracks(ABC):
    """Features of one kind.

    Args:
        dim: numbers of a feature, d.
        gate: probability with which a reading of a feature passes its gate.
        pose_covariance: of the scan that observations are made of next, shape (3, 3).
    """

    def __init__(self, dim: int, gate: float, pose_covariance: FloatArray) -> None:
        self.states = np.empty((0, dim))
        self.P = np.empty((0, dim, dim))  # covariances as the filter has them
        self.scans = np.empty(0, dtype=np.intp)  # how many scans showed each
        self.sightings = np.empty(0, dtype=np.intp)  # how many features of scans make up each
        # Of each, the end points of its scans, arrays of shape (m, 2), thinned where they are very many.
        self.readings: list[list[FloatArray]] = []
        self._pose_part = np.empty((0, dim, dim))
        self._gate = float(chi_square_quantile(gate, dim))
        self.pose_covariance = np.asarray(pose_covariance, dtype=np.float64)

    def __len__(self) -> int:
        return len(self.states)

    @abstractmethod
    def difference(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Return a − b, shape (..., d)."""

    @abstractmethod
    def near(self, observed: Observation) -> FloatArray:
        """Return which tracks lie where the feature is, shape (n,)."""

    def update(self, found: list[Observation]) -> None:
        """Take in the features of one scan, each into the nearest track that lets it through its gate, or a new one."""
        updated = set[int]()
        for observed in found:
            at = self._match(observed)
            if at is None:
                at = self._start(observed)
            else:
                self._refine(at, observed)
            if at not in updated:
                self.scans[at] += 1
                updated.add(at)

    def covariance(self, at: int) -> FloatArray:
        """Return a track's covariance with the part of the poses, which does not average out, shape (d, d)."""
        return np.asarray(self.P[at] + self._pose_part[at] / self.sightings[at])

    def merge(self) -> None:
        """Join tracks that turn out to be one: those that let each other through their gates."""
        for at in range(len(self) - 1, -1, -1):
            readings = np.concatenate(self.readings[at])
            whole = Observation(self.states[at], self.P[at], self._pose_part[at] / self.sightings[at], readings)
            other = self._match(whole, without=at)
            if other is not None:
                self._refine(other, whole)
                self.readings[other][-1:] = self.readings[at]
                self._pose_part[other] += self._pose_part[at] - whole.R_pose
                self.scans[other] += self.scans[at]
                self.sightings[other] += self.sightings[at] - 1
                self._drop(at)

    def drop_unconfirmed(self, confirm: int) -> int:
        """Drop the tracks that fewer than ``confirm`` scans showed, and return how many."""
        stale = np.flatnonzero(self.scans < confirm)
        for at in stale[::-1]:
            self._drop(int(at))
        return len(stale)

    def _match(self, observed: Observation, without: int = -1) -> int | None:
        if len(self) == 0:
            return None
        candidates = np.flatnonzero(self.near(observed))
        candidates = candidates[candidates != without]
        if len(candidates) == 0:
            return None
        y = self.difference(observed.state, self.states[candidates])
        S = self.P[candidates] + observed.R + observed.R_pose
        d2 = np.einsum("ni,ni->n", y, np.linalg.solve(S, y[..., None])[..., 0])
        best = int(d2.argmin())
        return int(candidates[best]) if d2[best] <= self._gate else None

    def _start(self, observed: Observation) -> int:
        self.states = np.concatenate([self.states, observed.state[None]])
        self.P = np.concatenate([self.P, (observed.R + observed.R_pose)[None]])
        self._pose_part = np.concatenate([self._pose_part, observed.R_pose[None]])
        self.scans, self.sightings = np.append(self.scans, 0), np.append(self.sightings, 1)
        self.readings.append([observed.readings])
        return len(self) - 1

    def _refine(self, at: int, observed: Observation) -> None:
        P, R = self.P[at], observed.R + observed.R_pose
        K = P @ np.linalg.inv(P + R)
        self.states[at] += K @ self.difference(observed.state, self.states[at])
        I_K = np.eye(len(P)) - K
        self.P[at] = I_K @ P @ I_K.T + K @ R @ K.T
        self._pose_part[at] += observed.R_pose
        self.sightings[at] += 1
        self.readings[at].append(observed.readings)
        if len(self.readings[at]) > MAX_READINGS:
            points = np.concatenate(self.readings[at])
            _, one = np.unique(np.floor(points / THIN).astype(np.int64), axis=0, return_index=True)
            self.readings[at] = [points[np.sort(one)]]

    def _drop(self, at: int) -> None:
        self.states, self.P = np.delete(self.states, at, axis=0), np.delete(self.P, at, axis=0)
        self._pose_part, self.scans = np.delete(self._pose_part, at, axis=0), np.delete(self.scans, at)
        self.sightings = np.delete(self.sightings, at)
        del self.readings[at]


class LineTracks(Tracks):
    """Lines (ρ, α) of the world, each seen from the side that its normal points away from; d = 2.

    The two faces of a thin wall are two lines, and so are two stretches of one line more than ``gap`` metres apart.
    """

    def __init__(self, gate: float, pose_covariance: FloatArray, gap: float) -> None:
        super().__init__(2, gate, pose_covariance)
        self._gap = gap
        self._track_ends = np.empty((0, 2, 2))  # first and last place of each track, in the world

    def observation(self, fit: LineFit, points: FloatArray, pose: FloatArray) -> Observation:
        """Return a line of a scan's end points (robot frame, shape (n, 2)), seen from a pose."""
        x, y, theta = pose
        rho, alpha = fit.line[0], fit.line[1] + theta
        cos, sin = math.cos(alpha), math.sin(alpha)
        lean = y * cos - x * sin
        state = np.array([rho + x * cos + y * sin, wrap(alpha)])
        G_z, G_pose = np.array([[1.0, lean], [0.0, 1.0]]), np.array([[cos, sin, lean], [0.0, 0.0, 1.0]])
        readings = transform(pose, points[fit.indices])
        return Observation(state, G_z @ fit.covariance @ G_z.T, G_pose @ self.pose_covariance @ G_pose.T, readings)

    def difference(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Return a − b, shape (..., 2), the angle in (−π, π]."""
        y = np.asarray(a - b)
        y[..., 1] = wrap(y[..., 1])
        return y

    def near(self, observed: Observation) -> FloatArray:
        """Return which lines have the same direction and (nearly) overlap the stretch along themselves; shape (n,)."""
        along = np.column_stack([-np.sin(self.states[:, 1]), np.cos(self.states[:, 1])])
        new = _track_ends(observed.readings) @ along.T
        old = np.einsum("nki,ni->nk", self._track_ends, along)
        apart = np.maximum(new.min(axis=0) - old.max(axis=1), old.min(axis=1) - new.max(axis=0))
        turned = np.abs(wrap(observed.state[1] - self.states[:, 1]))
        return np.asarray((apart <= self._gap) & (turned < 0.5))

    def _start(self, observed: Observation) -> int:
        self._track_ends = np.concatenate([self._track_ends, _track_ends(observed.readings)[None]])
        return super()._start(observed)

    def _refine(self, at: int, observed: Observation) -> None:
        super()._refine(at, observed)
        _, alpha = self.states[at]
        both = np.concatenate([self._track_ends[at], observed.readings])
        along = both @ np.array([-math.sin(alpha), math.cos(alpha)])
        self._track_ends[at] = both[[along.argmin(), along.argmax()]]

    def _drop(self, at: int) -> None:
        super()._drop(at)
        self._track_ends = np.delete(self._track_ends, at, axis=0)


class DiscTracks(Tracks):
    """Discs (x, y, radius) of the world; d = 3."""

    def __init__(self, gate: float, pose_covariance: FloatArray) -> None:
        super().__init__(3, gate, pose_covariance)

    def observation(self, fit: DiscFit, points: FloatArray, pose: FloatArray) -> Observation:
        """Return a disc of a scan's end points (robot frame, shape (n, 2)), seen from a pose."""
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        centre = transform(pose, fit.disc[:2][None])[0]
        G_z = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        G_pose = np.zeros((3, 3))
        G_pose[:2] = [[1.0, 0.0, pose[1] - centre[1]], [0.0, 1.0, centre[0] - pose[0]]]
        readings = transform(pose, points[fit.indices])
        R_pose = G_pose @ self.pose_covariance @ G_pose.T
        return Observation(np.append(centre, fit.disc[2]), G_z @ fit.covariance @ G_z.T, R_pose, readings)

    def difference(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Return a − b, shape (..., 3)."""
        return np.asarray(a - b)

    def near(self, observed: Observation) -> FloatArray:
        """Return which discs overlap the new one, shape (n,)."""
        apart = np.hypot(*(self.states[:, :2] - observed.state[:2]).T)
        return np.asarray(apart <= self.states[:, 2] + observed.state[2])


def _track_ends(readings: FloatArray) -> FloatArray:
    """Return two of the readings that lie farthest apart along their longer side, shape (2, 2)."""
    axis = int(np.ptp(readings, axis=0).argmax())
    return np.asarray(readings[[readings[:, axis].argmin(), readings[:, axis].argmax()]])
