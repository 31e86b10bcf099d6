"""Landmarks: free samples, the relaxed problem that guides them, K-means; and the source method as published."""

from trailmark.landmarks.enclosed import enclosed_cells, enclosed_points
from trailmark.landmarks.kmeans import k_means_landmarks
from trailmark.landmarks.paper import Clusters, PaperLandmarks, algorithm_1, algorithm_2
from trailmark.landmarks.relaxation import Relaxation
from trailmark.landmarks.repair import Repair, repair_centres
from trailmark.landmarks.sampling import draw, free_samples
from trailmark.landmarks.stability import Spread, matched_distances, spread_of_runs

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
