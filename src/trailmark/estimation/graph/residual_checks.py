# ruff: noqa: N806 # the names are those of the literature: P, R, S
"""What an estimate leaves, judged: does it fit its noise, which association is better, how sure is the map?"""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any, NamedTuple

import numpy as np

from trailmark.estimation.filter.consistency import chi_square_quantile
from trailmark.estimation.graph.batch import GATE, ROUGH, Batch
from trailmark.estimation.graph.smoother import Estimate, IntArray, Smoother, gauge_free

__all__ = ["Misfit", "Scale", "description_length", "figures", "inflation", "misfit", "scale"]

SCALE_SHARE = 0.25
"""How uncertain the scale of all ranges is, as a share of the relative error that is found across the view: no reading
shows it, and a sensor that is wrong by some percent from one bearing to another is not right on average."""

ODOMETRY_SCALE_SIGMA = 0.03
"""How uncertain the scale of all that was driven is: the size of wheels is known to a few percent."""

FEW = 30.0
"""Expected squares below which no ratio is judged: that of 30 varies by a quarter."""


class Scale(NamedTuple):
    """The scale of a map, which nothing but the instruments' own calibration states."""

    factor: float
    """By which to multiply what was estimated as if ranges were right on average."""
    sigma: float
    """Relative standard deviation of what that gives."""


class Misfit(NamedTuple):
    """How the residuals compare to the noise that an estimate was made with."""

    ratios: dict[str, float]
    """Squared residuals for each expected one, of "range", "bearing", "distance" and "heading"."""
    times: dict[str, float]
    """How many successive errors are worth one, likewise."""

    @property
    def understated(self) -> bool:
        """Whether there is more noise than stated, by a share that is no accident and matters.

        Errors that last count as often as they repeat.
        """
        lasting = max(self.ratios[name] * self.times[name] for name in ("range", "bearing"))
        return bool(max(self.ratios.values()) > 1.5 or lasting > 2.0)

    @property
    def overstated(self) -> bool:
        """Whether there is much less noise than stated in readings, and no more in odometry."""
        return not self.understated and max(self.ratios["range"], self.ratios["bearing"]) < 0.5


def misfit(batch: Batch, estimate: Estimate) -> Misfit:
    """Return how an estimate's residuals compare to its noise."""
    smoother, solution = estimate.smoother, estimate.solution
    n = len(solution.poses) - 1
    moved, read = smoother.residuals(solution)
    square = smoother.whitened(solution, moved[:, :, None], np.nan_to_num(read)[:, :, None])[:, 0] ** 2
    redundancy = estimate.system.redundancy(batch.rng)
    ratios = {}
    for name, rows in (
        ("range", slice(3 * n, -3, 2)),
        ("bearing", slice(3 * n + 1, -3, 2)),
        ("distance", slice(0, 3 * n, 3)),
        ("heading", slice(2, 3 * n, 3)),
    ):
        expected = float(redundancy[rows].sum())
        # A sum of squares that is expected to be small says nothing.
        ratios[name] = float(square[rows].sum()) / expected if expected > FEW else 1.0
    times = batch.correlation_times(smoother, solution, moved, estimate.feature)
    return Misfit(ratios, dict(zip(("range", "bearing", "distance", "heading"), times, strict=True)))


def description_length(batch: Batch, estimate: Estimate, feature: IntArray) -> float:
    """Return how badly features explain the readings: less for a better association, fewer features among the like.

    The criterion of Schwarz 1978 (Estimating the dimension of a model, Annals of Statistics 6(2)), in which a
    reading that is of no feature costs as much as the gate allows.

    Args:
        batch: the log, with its noise.
        estimate: with these features.
        feature: for each reading the number of its feature, or -1.
    """
    y = np.nan_to_num(estimate.smoother.reading_residuals(estimate.solution, feature))
    R = batch.readings(single=True).covariance
    limit = float(chi_square_quantile(GATE, 2))
    d2 = np.minimum(np.einsum("ni,nij,nj->n", y, np.linalg.inv(R), y), limit)
    d2[feature < 0] = limit
    fit = d2 + np.log(np.linalg.det(R))
    return float(fit.sum() + 2.0 * len(estimate.solution.features) * np.log(max(2, len(fit))))


def inflation(batch: Batch, estimate: Estimate) -> float:
    """Return by how much covariances are too small, at least 1: by the maps of the log's two halves.

    The halves share neither readings nor odometry. What their maps differ by, relative to all features that both
    have, should be as their covariances say; errors that last longer than any correlation shows make it larger.
    """
    cut = len(batch.instants) // 2
    parts = []
    motions, readings = batch.motions(), batch.readings()
    P = batch.motion_covariance(motions)
    for first, last in ((0, cut), (cut, len(batch.instants))):
        own = (readings.instant >= first) & (readings.instant < last)
        part = readings._replace(
            instant=readings.instant[own] - first, z=readings.z[own], covariance=readings.covariance[own]
        )
        seen, feature = np.unique(estimate.feature[own], return_inverse=True)
        seen, feature = (seen[1:], feature - 1) if len(seen) and seen[0] < 0 else (seen, feature)
        inside = slice(first, last - 1)
        smoother = Smoother(motions.u[inside], P[inside], part, feature, GATE)
        solution = smoother.solve(estimate.solution.poses[first:last], estimate.solution.features[seen], ROUGH)
        columns = 3 * (last - first) + np.arange(2 * len(seen))
        parts.append((seen, solution.features, smoother.linearised(solution).covariance(columns)))
    both = np.intersect1d(parts[0][0], parts[1][0])
    if len(both) < 4:
        return 1.0
    gap, joint = np.zeros((len(both), 2)), np.zeros((2 * len(both), 2 * len(both)))
    places = estimate.solution.features[both]
    for sign, (seen, found, covariance) in zip((1.0, -1.0), parts, strict=True):
        at = np.searchsorted(seen, both)
        rows = (2 * at[:, None] + np.arange(2)).reshape(-1)
        gap += sign * found[at]
        joint += covariance[np.ix_(rows, rows)]
    S = gauge_free(places)
    difference = S @ gap.reshape(-1)
    dof = 2 * len(both) - 3
    values, vectors = np.linalg.eigh(S @ joint @ S.T)
    d2 = float(((vectors[:, 3:].T @ difference) ** 2 / values[3:]).sum())
    return max(1.0, d2 / dof)


def scale(batch: Batch, estimate: Estimate) -> Scale:
    """Return the scale that ranges and odometry agree on, each weighed by how well it is known.

    Of ranges it is known the better, the less they err from one bearing to another.
    """
    if not batch.fitted:
        return Scale(1.0, 0.0)
    sensor = batch.noise.sensor
    ranges = SCALE_SHARE * float(np.std(sensor.basis(batch.raw.z[:, 1]) @ sensor.array()))
    raw = batch.track.motions(batch.instants, replace(batch.noise.odometry, distance=1.0), covariances=False).u
    real = estimate.smoother.motions_of(estimate.solution)[:, :2]
    stated = np.hypot(*raw[:, :2].T)
    along = (real * raw[:, :2]).sum(axis=1) / np.where(stated > 0.0, stated, 1.0)
    weight = ranges**2 / (ranges**2 + ODOMETRY_SCALE_SIGMA**2)
    excess = np.log(stated.sum() / along.sum()) if along.sum() > 0.0 else 0.0
    return Scale(float(np.exp(weight * excess)), float(ranges * np.sqrt(1.0 - weight)))


def figures(batch: Batch, estimate: Estimate, stated: Misfit) -> dict[str, Any]:
    """Return what was found, as plain data that JSON can hold."""
    used = int(np.count_nonzero(estimate.feature >= 0))
    noise, of_map = batch.noise, scale(batch, estimate)
    return {
        "fitted": batch.fitted,
        "readings": used,
        "stated_noise": {"ratio": stated.ratios, "repeated": stated.times},
        "odometry": asdict(noise.odometry) if batch.fitted else None,
        "range": {"tilt": noise.sensor.tilt, "projection": noise.sensor.projection} if batch.fitted else None,
        "scale": {"factor": of_map.factor, "sigma": of_map.sigma},
    }
