# ruff: noqa: N806 # the names are those of the literature: A, P, R, S, V
"""Poses, features, calibration and noise of a whole log, estimated in turns; what an estimate leaves, judged.

Given noise and calibration, poses and features are the optimum of the factors. Given these, the calibration's next step
is the one that least squares takes with poses and features free to follow (variable projection: Golub & Pereyra 1973,
SIAM Journal on Numerical Analysis 10(2)), and the noise is what the residuals show (variance components).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np

from trailmark.estimation.covariance import chi_square_quantile
from trailmark.estimation.landmark_graph import (
    Estimate,
    IntArray,
    Readings,
    Smoother,
    Solution,
    gauge_free,
    motions_of,
)
from trailmark.estimation.odometry import UNCALIBRATED, Motions, OdometryTrack
from trailmark.se2 import FloatArray

SMALLEST = 1e-12  # the least variance, so that a source that shows no noise can come back
ROUNDS = 5  # how often poses, calibration and noise are estimated in turns: mostly four settle them
# Probability that a good reading passes: of ten thousand one is left out wrongly, a misread one nearly always.
GATE = 0.9999
# Standard deviations of the errors that instruments are expected to have before anything is known of the log: of the
# scale of distances and of turns, as slip and an uncertain wheelbase leave it; radians between the sensor's axis
# and the direction of driving (a mount is 3 degrees off); of a range's relative error that grows with the bearing, by
# each radian, and with its square: a camera that takes depth for range has −0.5.
EXPECTED = np.array([0.2, 0.2, 0.05, 0.1, 0.5])
# Up to twice the gate's distance a reading is weighed down by the kernel, beyond that it is left out.
LOST = 4.0
ROUGH = 1e-4  # relative error that is enough while noise is still estimated
STEP = 1e-4  # how far each number of the odometry's calibration is moved to see what the motions become
# How uncertain the scale of all ranges is, as a share of the relative error that is found across the view: no reading
# shows it, and a sensor that is wrong by some percent from one bearing to another is not right on average.
SCALE_SHARE = 0.25
ODOMETRY_SCALE_SIGMA = 0.03  # how uncertain the scale of all that was driven is: the size of wheels is known to a few %
SURE = 0.99  # probability that maps of two halves of a log pass as agreeing, if the noise stated is right
FEW = 30.0  # expected squares below which no ratio is judged: that of 30 varies by a quarter


def _updated_variances(
    variances: FloatArray, components: FloatArray, roots: FloatArray, left: FloatArray, redundancy: FloatArray
) -> FloatArray:
    """Return better variances of the k sources of noise, shape (k,).

    ``components`` (n, k, d, d) are covariances of n residuals for a variance of one of each source, ``left`` (n, d) the
    residuals, whitened by ``roots`` (n, d, d); ``redundancy`` (n, d) is the share of the noise that each still shows.
    """
    V = np.einsum("nij,nkjl,nml->nkim", roots, components, roots)
    shown = np.einsum("ni,nkij,nj->k", left, V, left)
    expected = np.einsum("nkii,ni->k", V, redundancy)
    ratio = np.where(expected > 0.0, shown / np.where(expected > 0.0, expected, 1.0), 1.0)
    return np.asarray(np.maximum(variances * ratio, SMALLEST))


def correlation_time(sequences: Iterable[FloatArray], longest: int = 200) -> float:
    """Return τ >= 1: how many successive residuals are worth one that is independent of the others.

    The sequences are of residuals in the order of time, each of one feature or one axis; ``longest`` is a lag.
    """
    products, counts, square, size = np.zeros(longest + 1), np.zeros(longest + 1), 0.0, 0
    for sequence in sequences:
        n = len(sequence)
        square, size = square + float(sequence @ sequence), size + n
        for lag in range(1, min(longest, n - 1) + 1):
            products[lag] += sequence[lag:] @ sequence[:-lag]
            counts[lag] += n - lag
    if size == 0 or square == 0.0:
        return 1.0
    tau = 1.0
    for lag in range(1, longest + 1):
        if counts[lag] < 0.1 * size:
            break
        rho = products[lag] / counts[lag] / (square / size)
        if rho <= 0.0:
            break
        tau += 2.0 * rho
    return tau


class Noise(NamedTuple):
    """What readings and odometry are taken to be like."""

    calibration: FloatArray  # systematic errors: the odometry's three, then a and b of ranges, shape (5,)
    motion_variances: FloatArray  # of each source of odometry's noise, shape (k,)
    motion_times: FloatArray  # how many successive errors of odometry are worth one, for the same sources, shape (k,)
    reading_variances: FloatArray  # of each source of the readings' noise, shape (j,)
    reading_times: FloatArray  # how many successive errors of readings are worth one, likewise, shape (j,)


class Batch:
    """A log's odometry and readings.

    Ranges err by the bearing β: what is read is r·exp(a (β − β₁) + b (β² − β₂)), r the range, β₁ and β₂ the means over
    the log's readings. A camera that reads depth for range has b = −1/2, since cos β is about 1 − β²/2.

    Args:
        track: the odometry.
        readings: as they were read.
        instants: of the poses, shape (n,), ascending.
        motion_variances: of the odometry's sources of noise, as stated, shape (k,).
    """

    def __init__(
        self, track: OdometryTrack, readings: Readings, instants: FloatArray, motion_variances: FloatArray
    ) -> None:
        self.track, self.raw, self.instants, self.rng = track, readings, instants, np.random.default_rng(0)
        powers = readings.z[:, 1:] ** [1, 2]
        self.bent = powers - powers.mean(axis=0)  # what a and b are multiplied by, shape (r, 2)
        calibration = np.append(UNCALIBRATED, [0.0, 0.0])
        self.noise = Noise(calibration, motion_variances, np.ones(len(motion_variances)), np.ones(2), np.ones(2))
        # Until noise is estimated: ranges' and bearings' own covariance, as stated.
        self.sources = np.zeros((len(readings.z), 2, 2, 2))
        self.sources[:, 0, 0, 0] = readings.covariance[:, 0, 0]
        self.sources[:, 1, 1, 1] = readings.covariance[:, 1, 1]
        self.fitted = False

    def motions(self, instants: FloatArray | None = None) -> Motions:
        """Return the motions between the instants, or others, calibrated."""
        return self.track.motions(self.instants if instants is None else instants, self.noise.calibration[:3])

    def motion_covariance(self, motions: Motions) -> FloatArray:
        """Return their covariances, shape (n − 1, 3, 3)."""
        return motions.covariance(self.noise.motion_variances * self.noise.motion_times)

    def motion_changes(self) -> FloatArray:
        """Return how the motions between the instants change with odometry's calibration, shape (n − 1, 3, 3)."""
        by = [self.noise.calibration[:3] + step for step in STEP * np.vstack([np.zeros(3), np.eye(3)])]
        u, *others = (self.track.motions(self.instants, each, covariances=False).u for each in by)
        return np.stack([(other - u) / STEP for other in others], axis=2)

    def readings(self, *, single: bool = False) -> Readings:
        """Return the readings, calibrated, with their noise; ``single``: as one is spread, not what many are worth."""
        if not self.fitted:
            return self.raw
        times = 1.0 if single else self.noise.reading_times
        R = np.einsum("k,nkij->nij", self.noise.reading_variances * times, self.sources)
        ranges = self.raw.z[:, 0] * np.exp(-self.bent @ self.noise.calibration[3:])
        return self.raw._replace(z=np.column_stack([ranges, self.raw.z[:, 1]]), covariance=R)

    def solve(self, poses: FloatArray, features: FloatArray, feature: IntArray) -> Estimate:
        """Return the optimum with noise and calibration as they are, readings beyond the gate left out.

        Args:
            poses: a first guess, shape (n, 3).
            features: likewise, shape (m, 2).
            feature: for each reading the number of its feature; negative ones are left out.
        """
        solution, good = Solution(poses, features, np.inf), feature
        for _ in range(3):
            smoother, motions = self._smoother(good)
            solution = smoother.solve(solution.poses, solution.features)
            before, good = good, self._judged(smoother, solution, feature)
            if (before == good).all():
                break
        calibrated, precision = self._calibration_columns(smoother, solution, motions)
        return Estimate(solution, before, smoother, smoother.linearised(solution), calibrated, precision)

    def fit(
        self,
        poses: FloatArray,
        features: FloatArray,
        feature: IntArray,
        on_round: Callable[[int, int], None] | None = None,
    ) -> Estimate:
        """Return the optimum with noise and calibration estimated from the log; see :meth:`solve`."""
        self._begin_fit()
        solution, good = Solution(poses, features, np.inf), feature
        for i in range(1, ROUNDS + 1):
            smoother, motions = self._smoother(good)
            solution = smoother.solve(solution.poses, solution.features, ROUGH)
            good = self._improve(smoother, solution, motions, feature)
            if on_round is not None:
                on_round(i, ROUNDS)
        return self.solve(solution.poses, solution.features, feature)

    def correlation_times(
        self, smoother: Smoother, solution: Solution, moved: FloatArray, feature: IntArray
    ) -> tuple[float, float, float, float]:
        """Return how many successive errors are worth one: of ranges, bearings, distances and headings."""
        sigma = np.sqrt(np.diagonal(self.readings(single=True).covariance, axis1=1, axis2=2))
        off = smoother.reading_residuals(solution, feature) / sigma
        tracks = [off[feature == j] for j in range(len(solution.features))]
        ranges, bearings = (correlation_time([track[:, a] for track in tracks]) for a in (0, 1))
        return ranges, bearings, correlation_time([moved[:, 0]]), correlation_time([moved[:, 2]])

    def _smoother(self, feature: IntArray) -> tuple[Smoother, Motions]:
        motions = self.motions()
        return Smoother(motions.u, self.motion_covariance(motions), self.readings(), feature, GATE), motions

    def _begin_fit(self) -> None:
        """Give the readings' noise the sources that are estimated: by range where the log states nothing.

        With two factors of what is stated instead, robot 1 of MRCLAM 6 is mapped wrongly without identities.
        """
        self.fitted = True
        if self.raw.stated:
            return
        r = np.maximum(self.raw.z[:, 0], 0.05)
        self.sources = np.zeros((len(r), 4, 2, 2))
        self.sources[:, 0, 0, 0], self.sources[:, 1, 0, 0] = 1.0, r**2
        self.sources[:, 2, 1, 1], self.sources[:, 3, 1, 1] = 1.0, 1.0 / r**2
        if len(self.noise.reading_variances) == 2:
            size, level = np.median(r), [np.median(self.raw.covariance[:, j, j]) for j in (0, 1)]
            start = 0.5 * np.array([level[0], level[0] / size**2, level[1], level[1] * size**2])
            self.noise = self.noise._replace(reading_variances=start, reading_times=np.ones(4))

    def _improve(self, smoother: Smoother, solution: Solution, motions: Motions, feature: IntArray) -> IntArray:
        """Take the next step in calibration and noise; return the readings' features without outliers."""
        noise, n, system = self.noise, len(motions.u), smoother.linearised(solution)
        moved, read = smoother.residuals(solution)
        b = smoother.whitened(solution, moved[:, :, None], np.nan_to_num(read)[:, :, None])
        calibrated, precision = self._calibration_columns(smoother, solution, motions)
        left = system.unexplained(calibrated)
        now = noise.calibration - np.append(UNCALIBRATED, [0.0, 0.0])
        step = np.linalg.solve(calibrated.T @ left + np.diag(precision), (left.T @ b)[:, 0] + precision * now)
        redundancy = system.redundancy(self.rng)
        of_motions, of_readings = (
            _updated_variances(
                variances, components, roots, b[rows].reshape(-1, width), redundancy[rows].reshape(-1, width)
            )
            for variances, components, roots, rows, width in (
                (noise.motion_variances * noise.motion_times, smoother.components_at_end(motions.components),
                 smoother.motion_roots, slice(0, 3 * n), 3),
                (noise.reading_variances * noise.reading_times, self.sources[smoother.used],
                 smoother.reading_roots, slice(3 * n, -3), 2),
            )
        )  # fmt: skip
        self.noise = noise._replace(
            calibration=noise.calibration - step, motion_variances=of_motions, reading_variances=of_readings
        )
        good = self._judged(smoother, solution, feature)
        ranges, bearings, along, turning = self.correlation_times(smoother, solution, moved, good)
        k = len(of_motions)
        self.noise = self.noise._replace(
            reading_times=np.repeat([ranges, bearings], len(of_readings) // 2),
            motion_times=np.where(np.arange(k) < k // 2, along, turning),
        )
        return good

    def _judged(self, smoother: Smoother, solution: Solution, feature: IntArray) -> IntArray:
        """Return the readings' features, negative for readings that are farther from them than the gate allows."""
        if not (feature >= 0).any():
            return feature
        y = np.nan_to_num(smoother.reading_residuals(solution, feature))
        d2 = np.einsum("ni,nij,nj->n", y, np.linalg.inv(self.readings(single=True).covariance), y)
        # While the noise is still unknown, half of the readings are taken to be good ones.
        scale = max(1.0, float(np.median(d2[feature >= 0]) / chi_square_quantile(0.5, 2)))
        good = np.where(d2 <= LOST * scale * chi_square_quantile(GATE, 2), feature, -1)
        # A feature without any reading is nowhere: the kernel alone weighs down what it has.
        read = np.bincount(good[good >= 0], minlength=len(solution.features)) > 0
        return np.where((feature >= 0) & ~read[np.maximum(feature, 0)], feature, good)

    def _calibration_columns(
        self, smoother: Smoother, solution: Solution, motions: Motions
    ) -> tuple[FloatArray, FloatArray]:
        """Return how the whitened residuals change with calibration, and the precision it has before the log."""
        r, n = len(self.raw.z), len(motions.u)
        if not self.fitted:
            return np.zeros((3 * n + 2 * len(smoother.used) + 3, 0)), np.zeros(0)
        of_motions, of_readings = np.zeros((n, 3, 5)), np.zeros((r, 2, 5))
        for i, change in enumerate(np.moveaxis(self.motion_changes(), 2, 0)):
            of_motions[:, :, i] = smoother.at_end(change)
        of_readings[:, 0, 3:] = -self.readings().z[:, :1] * self.bent
        return smoother.whitened(solution, of_motions, of_readings), EXPECTED**-2.0


class Scale(NamedTuple):
    """The scale of a map, which nothing but the instruments' own calibration states."""

    factor: float  # by which to multiply what was estimated as if ranges were right on average
    sigma: float  # relative standard deviation of what that gives


class Misfit(NamedTuple):
    """How the residuals of "range", "bearing", "distance" and "heading" compare to the noise of an estimate."""

    ratios: dict[str, float]  # squared residuals for each expected one
    times: dict[str, float]  # how many successive errors are worth one

    @property
    def understated(self) -> bool:
        """Whether there is more noise than stated, by a share that is no accident; what lasts counts as it repeats."""
        lasting = max(self.ratios[name] * self.times[name] for name in ("range", "bearing"))
        return bool(max(self.ratios.values()) > 1.5 or lasting > 2.0)

    @property
    def overstated(self) -> bool:
        """Whether there is much less noise than stated in readings, and no more in odometry."""
        return not self.understated and max(self.ratios["range"], self.ratios["bearing"]) < 0.5


def misfit(batch: Batch, estimate: Estimate) -> Misfit:
    """Return how an estimate's residuals compare to its noise."""
    smoother, solution = estimate.smoother, estimate.solution
    moved, read = smoother.residuals(solution)
    square = smoother.whitened(solution, moved[:, :, None], np.nan_to_num(read)[:, :, None])[:, 0] ** 2
    redundancy, n = estimate.system.redundancy(batch.rng), 3 * len(moved)
    names, ratios = ("range", "bearing", "distance", "heading"), {}
    places = slice(n, -3, 2), slice(n + 1, -3, 2), slice(0, n, 3), slice(2, n, 3)
    for name, rows in zip(names, places, strict=True):
        expected = float(redundancy[rows].sum())
        # A sum of squares that is expected to be small says nothing.
        ratios[name] = float(square[rows].sum()) / expected if expected > FEW else 1.0
    times = batch.correlation_times(smoother, solution, moved, estimate.feature)
    return Misfit(ratios, dict(zip(names, times, strict=True)))


def disagreement(batch: Batch, estimate: Estimate) -> float:
    """Return by how much covariances are too small, by the maps of the log's two halves: 1 where they may be right.

    The halves share neither readings nor odometry. What their maps differ by, relative to all features that both
    have, should be as their covariances say; errors that last longer than any correlation shows make it larger.
    """
    readings, used, n = batch.readings(), estimate.feature >= 0, len(batch.instants)
    halves = [(0, n // 2), (n // 2, n)]
    owns = [(readings.instant >= first) & (readings.instant < last) & used for first, last in halves]
    both = np.intersect1d(estimate.feature[owns[0]], estimate.feature[owns[1]])
    if len(both) < 4:
        return 1.0
    motions = batch.motions()
    P = batch.motion_covariance(motions)
    gap, joint = np.zeros((len(both), 2)), np.zeros((2 * len(both), 2 * len(both)))
    for sign, (first, last), own in zip((1.0, -1.0), halves, owns, strict=True):
        part = Readings(readings.instant[own] - first, readings.z[own], readings.covariance[own], readings.stated)
        seen, feature = np.unique(estimate.feature[own], return_inverse=True)
        smoother = Smoother(motions.u[first : last - 1], P[first : last - 1], part, feature, GATE)
        solution = smoother.solve(estimate.solution.poses[first:last], estimate.solution.features[seen], ROUGH)
        at = np.searchsorted(seen, both)
        gap += sign * solution.features[at]
        columns = 3 * (last - first) + 2 * at[:, None] + np.arange(2)
        joint += smoother.linearised(solution).covariance(columns.reshape(-1))
    S, dof = gauge_free(estimate.solution.features[both]), 2 * len(both) - 3
    values, vectors = np.linalg.eigh(S @ joint @ S.T)
    d2 = float(((vectors[:, 3:].T @ (S @ gap.reshape(-1))) ** 2 / values[3:]).sum())
    # Noise that was estimated takes what lasts for white, so that any excess counts; stated noise may well be right.
    return d2 / dof if d2 > (dof if batch.fitted else chi_square_quantile(SURE, dof)) else 1.0


def scale(batch: Batch, estimate: Estimate) -> Scale:
    """Return the scale that ranges and odometry agree on, each weighed by how well it is known.

    Of ranges it is known the better, the less they err from one bearing to another.
    """
    if not batch.fitted:
        return Scale(1.0, 0.0)
    ranges = SCALE_SHARE * float(np.std(batch.bent @ batch.noise.calibration[3:]))
    uncalibrated = np.append(1.0, batch.noise.calibration[1:3])
    raw = batch.track.motions(batch.instants, uncalibrated, covariances=False).u[:, :2]
    stated = np.hypot(*raw.T)
    real = (motions_of(estimate.solution.poses)[:, :2] * raw).sum(axis=1)
    along = float((real / np.where(stated > 0.0, stated, 1.0)).sum())
    weight = ranges**2 / (ranges**2 + ODOMETRY_SCALE_SIGMA**2)
    excess = np.log(stated.sum() / along) if along > 0.0 else 0.0
    return Scale(float(np.exp(weight * excess)), float(ranges * np.sqrt(1.0 - weight)))


def figures(batch: Batch, estimate: Estimate, stated: Misfit, halves: float) -> dict[str, Any]:
    """Return what was found, as plain data that JSON can hold."""
    found, of_map = batch.noise.calibration.tolist(), scale(batch, estimate)
    names = ("distance", "turn", "direction")
    return {
        "fitted": batch.fitted,
        "readings": int(np.count_nonzero(estimate.feature >= 0)),
        "stated_noise": {"ratio": stated.ratios, "repeated": stated.times},
        "odometry": dict(zip(names, found, strict=False)) if batch.fitted else None,
        "range": {"tilt": found[3], "projection": found[4]} if batch.fitted else None,
        "scale": of_map._asdict(),
        "halves": halves,
    }
