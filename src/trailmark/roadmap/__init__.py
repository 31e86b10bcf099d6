"""Roadmap: landmarks joined by certified motions, and shortest paths over them."""

from trailmark.roadmap.roadmap import Roadmap, neighbour_count

__all__ = ["Roadmap", "neighbour_count"]
