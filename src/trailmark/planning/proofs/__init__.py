"""Proven lower bounds on a path's cost, by the robot's inscribed disc, and proofs that there is none, with headings."""

from trailmark.planning.proofs.bound import LowerBound
from trailmark.planning.proofs.enclosure import enclosed

__all__ = ["LowerBound", "enclosed"]
