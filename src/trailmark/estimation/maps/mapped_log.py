"""The result of mapping a log: the world, the robot's trajectory, and figures on how reliable both are."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np

from trailmark.estimation.graph.scan_slam import ScanPoses
from trailmark.estimation.logs.records import Detection, Increment, Log, Odometry, Pose, Scan
from trailmark.estimation.maps.batch_slam import BatchResult
from trailmark.estimation.maps.map_checks import duration
from trailmark.estimation.maps.scan_map import ScanMap
from trailmark.estimation.slam.slam_result import SlamResult
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc, Polygon, Rectangle
from trailmark.world import ObstacleEstimate, World

__all__ = ["MappedLog"]

_KINDS = {Odometry: "odometry", Increment: "increments", Detection: "detections", Scan: "scans", Pose: "poses"}

_OBSTACLES = ("discs", "walls", "heaps", "unknown")
"""Kinds of obstacles: heaps are groups of cells that beams met, unknown is what no beam has reached."""


class MappedLog(NamedTuple):
    """The outcome of :func:`trailmark.estimation.map_log`."""

    log: Log
    """What it was made from."""
    world: World
    """The obstacles with their covariances, grown if a confidence was asked for; the robot; queries."""
    trajectory: FloatArray
    """Where the robot was, shape (n, 4), rows t, x, y, theta: after each instant of EKF-SLAM, or at each scan."""
    poses: str
    """Where it was by: "match", "slam", "log" or "odometry"."""
    association: str | None
    """How detections found their features, where EKF-SLAM ran."""
    slam: SlamResult | None
    """EKF-SLAM's result, where it ran."""
    tentative: int
    """Features that were still to be confirmed when its log ended; they are not in the world."""
    batch: BatchResult | None
    """The batch over the log after it, where one was asked for."""
    scans: ScanMap | None
    """The map from scans, where obstacles are made of those."""
    matched: ScanPoses | None
    """The poses of the scans by matching, where they were matched."""
    seconds: float
    """Time that it took."""
    scan_seconds: float
    """Of that, the time for scans."""
    warnings: tuple[str, ...] = ()
    """One sentence for each thing that looks wrong, and what to try."""
    notes: tuple[str, ...] = ()
    """One sentence for each thing left out, assumed or not used, the reader's own among them."""

    def figures(self) -> dict[str, Any]:
        """Return counts, consistency and times as plain data that JSON can hold (no NaN, no infinity)."""
        risk = self.world.risk
        kinds = Counter(_KINDS[type(record)] for record in self.log.records)
        steps = np.diff(self.trajectory, axis=0)
        times = self.trajectory[:, 0]
        return {
            "name": self.log.name,
            "records": {"all": len(self.log.records), **{name: kinds[name] for name in _KINDS.values()}},
            "dropped": self.log.dropped,
            "poses": self.poses,
            "association": self.association,
            "matching": self._matching(),
            "features": self._features(),
            "nis": self._nis(),
            "batch": None if self.batch is None else self.batch.figures,
            "counts": None if self.slam is None else asdict(self.slam.counts),
            "obstacles": self._obstacles(),
            "bounds": list(self.world.bounds),
            "trajectory": {
                "poses": len(times),
                "length": float(np.hypot(steps[:, 1], steps[:, 2]).sum()),
                "duration": duration(times),
            },
            "queries": [query.name for query in self.world.queries],
            "risk": None
            if risk is None
            else {"confidence": risk.confidence, "collision_at_most": 1.0 - risk.confidence},
            "time": {"total": self.seconds, "per_update": self._per_update()},
            "not_certified": self.world.not_certified,
            "warnings": list(self.warnings),
            "notes": list(self.notes),
        }

    def _matching(self) -> dict[str, int] | None:
        """Return what the graph of scans consists of."""
        if self.matched is None:
            return None
        names = {"nodes": len(self.matched.keys), "relations": len(self.matched.relations)}
        return {**names, "closures": self.matched.closures, "rejected": self.matched.rejected}

    def _features(self) -> dict[str, int]:
        """Return how many features there are, of those that obstacles are made of."""
        if self.scans is not None:
            confirmed = self.scans.walls + self.scans.discs
            return {"confirmed": confirmed, "tentative": 0, "dropped": self.scans.dropped}
        features, dropped = (0, 0) if self.slam is None else (len(self.slam.features), self.slam.counts.dropped)
        return {"confirmed": features, "tentative": self.tentative, "dropped": dropped}

    def _nis(self) -> dict[str, Any] | None:
        nis = None if self.slam is None else self.slam.nis()
        if nis is None or nis.size == 0:
            return None
        names = ("mean", "expected", "low", "high", "inside")
        return {**{name: getattr(nis, name) for name in names}, "updates": nis.size}

    def _obstacles(self) -> dict[str, Any]:
        """Return how many obstacles there are of each kind, and what their covariances are relative to."""
        every = len(self.world.obstacles)
        kinds = Counter(_kind(estimate) for estimate in self.world.estimates or (None,) * every)
        frame = next((estimate.frame for estimate in self.world.estimates if estimate is not None), None)
        return {"all": every, **{name: kinds[name] for name in _OBSTACLES}, **({"frame": frame} if frame else {})}

    def _per_update(self) -> float | None:
        """Return the seconds that an update took: of EKF-SLAM's state, or of the map by a scan."""
        if self.scans is not None:
            return self.scan_seconds / len(self.scans.poses)
        seconds = math.nan if self.slam is None else self.slam.seconds_per_update
        return seconds if math.isfinite(seconds) else None


def _kind(estimate: ObstacleEstimate | None) -> str:
    if estimate is None:
        return "unknown"
    return {Disc: "discs", Rectangle: "walls", Polygon: "heaps"}[type(estimate.mean)]
