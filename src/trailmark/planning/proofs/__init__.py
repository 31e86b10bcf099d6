"""Proven lower bounds on a path's cost, by the robot's inscribed disc, and proofs that there is none, with headings."""

from trailmark.planning.proofs.bound import LowerBound
from trailmark.planning.proofs.enclosure import Enclosure, enclosed
from trailmark.planning.proofs.weighted_bound import WeightedBound, lower_bound_of

__all__ = ["AnyBound", "Enclosure", "LowerBound", "WeightedBound", "enclosed", "lower_bound_of"]

AnyBound = LowerBound | WeightedBound
"""What proves lower bounds on costs, on lengths and turns or under another objective."""
