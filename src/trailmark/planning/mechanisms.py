"""Mechanisms of the planner, each of which can be switched off, and the planners that are made so."""

from __future__ import annotations

from typing import Literal, get_args

__all__ = ["MECHANISMS", "PLACEMENTS", "Placement"]

Placement = Literal["k-means", "samples", "paper", "none"]
PLACEMENTS: tuple[Placement, ...] = get_args(Placement)
"""What landmarks are: K-means centres of samples, as many plain samples, those of the source method as published
(:mod:`trailmark.planning.published`), or none at all."""

MECHANISMS = {
    "lattice": "paths over lattices of configurations: the first one, and other ways around",
    "straight-level": "of the lattices, the one that the straight distance guides",
    "coarse-level": "the one that coarse costs to go guide",
    "small-levels": "those of which at most 2,000 nodes are expanded",
    "large-levels": "those of which at most 10,000 nodes are expanded",
    "largest-levels": "those of which more nodes are expanded",
    "node-retraction": "nodes of a lattice that collide by little are pushed off the obstacles",
    "multi-steps": "a lattice's moves across several positions",
    "other-ways": "lattices searched for other ways around once there is a path",
    "disc-path": "a disc's exact shortest path",
    "bands": "samples drawn where short paths are likely, not from all that the robot might reach",
    "bridges": "landmarks where the parts of the roadmap come closest",
    "hybrid-astar": "a car's short drives from the parts of its roadmap",
    "redriving": "drives from a car's path back to it with fewer changes of direction",
    "background-proof": "a proof that no path exists, sought beside the search for one",
    "shortening": "paths are shortened",
    "improvement": "rounds after the first path, until it is settled",
}
"""What can be switched off by :attr:`trailmark.planning.settings.PlannerSettings.without`, by name."""
