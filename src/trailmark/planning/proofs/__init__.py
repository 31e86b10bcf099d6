"""Proven lower bounds on a path's cost, by the robot's inscribed disc, and proofs that there is none, with headings."""

from trailmark.planning.proofs.bound import LowerBound, lower_bound_of
from trailmark.planning.proofs.enclosure import Enclosure, enclosed

__all__ = ["Enclosure", "LowerBound", "enclosed", "lower_bound_of"]
