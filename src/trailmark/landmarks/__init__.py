"""Landmarks: free samples, the relaxed problem that guides them, K-means; and the source method as published."""

from trailmark.landmarks.executions import Repair, Spread, matched_distances, repair_centres, spread_of_runs
from trailmark.landmarks.paper import (
    Clusters,
    PaperLandmarks,
    algorithm_1,
    algorithm_2,
    enclosed_cells,
    enclosed_points,
)
from trailmark.landmarks.relaxation import Relaxation
from trailmark.landmarks.sampling import draw, free_samples, k_means_landmarks

__all__ = [
    "Clusters",
    "PaperLandmarks",
    "Relaxation",
    "Repair",
    "Spread",
    "algorithm_1",
    "algorithm_2",
    "draw",
    "enclosed_cells",
    "enclosed_points",
    "free_samples",
    "k_means_landmarks",
    "matched_distances",
    "repair_centres",
    "spread_of_runs",
]
