"""Roadmap: landmarks joined by certified motions, shortest paths over them, and their files."""

from trailmark.roadmap.files import load_roadmap, save_roadmap
from trailmark.roadmap.insertion import neighbour_count
from trailmark.roadmap.nav2_route import read_route_graph
from trailmark.roadmap.roadmap import Roadmap
from trailmark.roadmap.store import EdgeStatus

__all__ = ["EdgeStatus", "Roadmap", "load_roadmap", "neighbour_count", "read_route_graph", "save_roadmap"]
