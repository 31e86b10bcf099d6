"""Collision: FCL scene, clearance field, compiled kernels, and the StateChecker that joins them."""

from trailmark.collision.checker import StateChecker

__all__ = ["StateChecker"]
