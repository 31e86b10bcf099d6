"""Planning methods by name: the planner as it is, and planners of their own that are made of parts of it."""

from __future__ import annotations

from trailmark.planning.settings import PlannerSettings

__all__ = ["METHODS"]

_ROADMAP = ("lattice", "disc-path", "bridges", "hybrid-astar")

METHODS = {
    "landmark": PlannerSettings(),
    "roadmap": PlannerSettings(without=_ROADMAP),
    "roadmap-uniform": PlannerSettings(placement="samples", without=_ROADMAP),
    "lattice": PlannerSettings(placement="none", without=("disc-path",)),
    "paper": PlannerSettings(
        placement="paper",
        first_landmarks=12,
        landmark_growth=2.0,
        samples_per_landmark=84,
        without=(*_ROADMAP, "shortening", "improvement"),
    ),
}
"""Settings of :class:`~trailmark.planning.planner.LandmarkPlanner` that are a planner of their own:

- ``landmark``: all mechanisms.
- ``roadmap``: landmarks by K-means where the relaxed problem's short paths run, their roadmap and its shortest path,
  which is shortened, and further rounds of these; nothing else leads to a path.
- ``roadmap-uniform``: the same with as many plain valid samples in place of the K-means centres.
- ``lattice``: no landmarks; lattices alone give the first path and other ways around. Not for cars.
- ``paper``: the source method. Its Algorithm 2 draws about 1,000 points and places 12 landmarks, both doubled in each
  round until there is a path; each obstacle's box is taken from its true outline, as if it had been sensed without
  error. A centre becomes a node at its widest heading, or at the nearest point where the robot can stand. The
  roadmap's shortest path of certified motions is the answer; it is neither shortened nor improved.
"""
