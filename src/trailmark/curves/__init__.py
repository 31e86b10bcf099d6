"""Curves of car-like robots: the shortest ones between two configurations for a turning radius, and paths of them."""

from trailmark.curves.path import CurvePath
from trailmark.curves.steering import Curves, Steering

__all__ = ["CurvePath", "Curves", "Steering"]
