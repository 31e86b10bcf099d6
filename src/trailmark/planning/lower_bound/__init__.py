"""Proven lower bounds on the cost of a path, and proofs that there is none: the robot's inscribed disc, exactly."""

from trailmark.planning.lower_bound.bound import LowerBound

__all__ = ["LowerBound"]
