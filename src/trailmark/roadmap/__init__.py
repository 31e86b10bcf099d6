"""Roadmap: landmarks joined by certified motions, shortest paths over them, and their files."""

from trailmark.roadmap.files import load_roadmap, read_route_graph, save_roadmap
from trailmark.roadmap.roadmap import EdgeStatus, Roadmap, neighbour_count

__all__ = ["EdgeStatus", "Roadmap", "load_roadmap", "neighbour_count", "read_route_graph", "save_roadmap"]
