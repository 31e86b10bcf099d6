"""Curves of car-like robots: the shortest ones between two configurations for a turning radius."""

from trailmark.curves.steering import Curves, Steering

__all__ = ["Curves", "Steering"]
