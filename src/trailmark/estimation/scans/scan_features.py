"""Features of one laser scan: its end points in groups, and in the groups lines, discs and what is neither.

All features are given in the robot's frame. A line is (ρ, α), {p : p·(cos α, sin α) = ρ}, its normal pointing away
from the scanner: ρ is then negative where the scanner stands farther out than the line, seen from the robot's origin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark.arguments import Positive, PositiveOrInfinite, checked_fields
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.logs.records import Scan
from trailmark.estimation.scans.fits import DiscFit, LineFit, fit_circle_roughly, fit_disc, fit_line
from trailmark.se2 import FloatArray, transform, wrap

__all__ = [
    "ScanFeatures",
    "ScanPoints",
    "ScanSettings",
    "find_features",
    "jump_groups",
    "scan_points",
    "split_and_merge",
]


IntArray = NDArray[np.intp]

INCIDENCE = math.radians(10.0)
"""The smallest angle, radians, between a beam and a continuous surface that it is assumed to meet."""

SPLIT = 0.06
"""Metres that an end point may lie off a line before the line is split: three deviations of a range."""

MIN_POINTS = 6
"""End points that a line or a disc needs: of fewer, noise alone makes either."""

MIN_LENGTH = 0.3
"""Metres that a line needs."""

LINE_MISFIT = 4.0
"""Sum of squared residuals over variances, per degree of freedom, that a line may have: walls are not flat."""

DISC_RADII = (0.03, 0.6)
"""Metres: radii that a disc may have, from a table's leg to a column."""

DISC_ARC = math.radians(100.0)
"""Radians of a disc's outline that must be seen: of less, corners and bent walls make circles too."""

DISC_MISFIT = 2.0
"""The sum of a disc; where a line has no more, it is a line."""


@dataclass(frozen=True)
class ScanSettings:
    """What is known of a scanner.

    Raises:
        EstimationError: a value that is not allowed.
    """

    sigma_range: Positive = 0.02
    """Standard deviation of a range, metres (a SICK LMS's: some 1 to 2 cm)."""
    sigma_bearing: Positive = 0.003
    """Standard deviation of a beam's direction, radians: its width, not the step from beam to beam."""
    max_range: PositiveOrInfinite = math.inf
    """Metres: end points farther away are left out."""

    def __post_init__(self) -> None:
        checked_fields(self, EstimationError)


class ScanPoints(NamedTuple):
    """Where the beams of a scan ended, in the order of the sweep, in the robot's frame."""

    points: FloatArray
    """Shape (n, 2), metres."""
    covariances: FloatArray
    """Shape (n, 2, 2), from the noise of range and bearing."""
    ranges: FloatArray
    """Shape (n,), metres from the scanner."""
    beams: IntArray
    """Shape (n,), which beams these are."""
    origin: FloatArray
    """Where the scanner is, shape (2,)."""
    step: float
    """Radians from beam to beam, positive."""
    closed: bool
    """Whether the last beam is the first one's neighbour."""


class ScanFeatures(NamedTuple):
    """What a scan shows."""

    lines: tuple[LineFit, ...]
    discs: tuple[DiscFit, ...]
    others: tuple[IntArray, ...]
    """The end points, by group, that are part of neither."""


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
    step = abs(scan.angle_increment)
    return ScanPoints(points, covariances, r, beams, mount[:2], step, len(ranges) * step > 2.0 * math.pi - 0.5 * step)


def jump_groups(hits: ScanPoints, settings: ScanSettings) -> list[IntArray]:
    """Return the end points' places by group: it ends where the next point is farther away than a surface explains.

    That is farther than r·sin Δφ / sin(λ − Δφ) + 3σ_r, λ the flattest incidence and Δφ the angle from beam to beam
    (the adaptive breakpoint detector of Borges & Aldon 2004, Journal of Intelligent and Robotic Systems 40), or than
    3σ_r where so many beams in between met nothing that Δφ comes near λ.
    """
    n = len(hits.points)
    if n == 0:
        return []
    following = np.roll(np.arange(n), -1)
    gap = np.hypot(*(hits.points[following] - hits.points).T)
    angle = (hits.beams[following] - hits.beams) * hits.step
    angle[-1] = math.inf if not hits.closed else wrap(float(angle[-1]))
    grazing = np.minimum(np.abs(angle), INCIDENCE)
    reach = np.divide(
        np.minimum(hits.ranges, hits.ranges[following]) * np.sin(grazing),
        np.sin(INCIDENCE - grazing),
        out=np.zeros(n),
        where=grazing < 0.9 * INCIDENCE,
    )
    ends = np.flatnonzero((gap > reach + 3.0 * settings.sigma_range) | ~np.isfinite(angle))
    if len(ends) == 0:
        return [np.arange(n)]
    # From behind one break to the next; in a closed sweep the last group goes on at the beginning.
    order = np.roll(np.arange(n), -(int(ends[-1]) + 1))
    return np.split(order, (ends[:-1] - int(ends[-1])) % n)


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
    """Return the end points of a scan, and the lines, discs and other groups in them.

    A group is a disc if a circle of an allowed radius, of which enough is seen, bulges towards the scanner and fits
    it as its noise would, which no line does. Else it is split into straight pieces; those that are long and straight
    enough are lines. The rest is given as it is.
    """
    s = settings or ScanSettings()
    hits = scan_points(scan, s)
    lines, discs, others = list[LineFit](), list[DiscFit](), list[IntArray]()
    for group in jump_groups(hits, s):
        disc = _disc_in(hits, group)
        if disc is not None:
            discs.append(disc)
            continue
        rest = []
        for piece in split_and_merge(hits.points[group], SPLIT):
            own = group[piece]
            line = _line_in(hits, own)
            if line is None:
                rest.append(own)
            else:
                lines.append(line)
        if rest:
            others.append(np.concatenate(rest))
    return hits, ScanFeatures(tuple(lines), tuple(discs), tuple(others))


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
