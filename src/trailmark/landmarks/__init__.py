"""Landmarks: free samples, the relaxed problem that guides them, and K-means."""

from trailmark.landmarks.kmeans import k_means_landmarks
from trailmark.landmarks.relaxation import Relaxation
from trailmark.landmarks.sampling import draw, free_samples

__all__ = ["Relaxation", "draw", "free_samples", "k_means_landmarks"]
