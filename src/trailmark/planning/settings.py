"""PlannerSettings: the numbers of the planner that a person might want to change, and its stages by name."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Literal, get_args

from trailmark.arguments import each_of, number, one_of, whole
from trailmark.errors import ConfigurationError, expected_name

__all__ = ["METHODS", "PLACEMENTS", "STAGES", "Placement", "PlannerSettings"]

STAGES = {
    "roadmap": "the roadmap of the queries before",
    "lattice": "paths over lattices of configurations: the first one, and other ways around",
    "disc-path": "a disc's exact shortest path",
    "landmarks": "rounds of landmarks where the relaxed problem's short paths run",
    "improvement": "rounds after the first path, until it is settled",
    "node-retraction": "within lattices: nodes that collide by little are pushed off the obstacles",
    "multi-steps": "within lattices: moves across several positions",
    "other-ways": "within the improvement: lattices searched for other ways around",
    "redriving": "within the improvement: drives back to a car's path with fewer changes of direction",
    "bands": "within the landmarks: samples drawn where short paths are likely, not all over free space",
    "bridges": "within the landmarks: more of them where the parts of the roadmap come closest",
    "hybrid-astar": "within the landmarks: a car's short drives from the parts of its roadmap",
    "background-proof": "within the landmarks: a proof that no path exists, sought beside the search for one",
    "shortening": "within all of them: paths are shortened",
}
"""What :attr:`PlannerSettings.without` may name: the stages of :mod:`trailmark.planning.pipeline` that a query can do
without, and parts of stages."""

Placement = Literal["k-means", "samples", "paper", "none"]
PLACEMENTS: tuple[Placement, ...] = get_args(Placement)
"""Kinds of landmarks: K-means centres of samples, as many plain samples, those of the source method as published
(:mod:`trailmark.planning.placement`), or none at all."""


def _count(default: int) -> int:
    return field(default=default, metadata={"least": 1})


def _number(default: float, least: float = 0.0) -> float:
    return field(default=default, metadata={"least": least})


@dataclass(frozen=True)
class PlannerSettings:
    """How the planner divides its work. The defaults are those that the benchmarks were run with.

    Attributes:
        first_landmarks: landmarks of the first round; enough to cross a room with furniture.
        landmark_growth: each round places so many times the landmarks of the one before, >= 1.
        samples_per_landmark: samples that are clustered for each landmark.
        max_kept_nodes: size of the planner's own roadmap above which it no longer takes nodes from queries that it can
            answer without them; bounds the memory of a planner that runs for hours.
        max_query_nodes: nodes that the rounds of one query place before they begin anew in an empty roadmap; bounds the
            memory of a query without a path.
        sweeps: sweeps of shortening at most, for a promising path.
        first_sweeps: sweeps that show whether a path is promising.
        polishing_sweeps: sweeps with added vertices that the best path gets in each round of improvement.
        patience: rounds of improvement in a row that gain less than ``least_gain``, after which a path is settled.
        least_gain: share of the cost that a round has to gain to count as one that helped.
        probes: random queries that test whether a roadmap over all free space is dense enough.
        max_spread_landmarks: number up to which landmarks over all free space are doubled.
        build_share: share of the time limit that spreading landmarks over all free space may take.
        last_proof_share: share of the time left that a proof may be expected to take once little else is left to do.
        drives: configurations in the first hybrid A* search from one part of a car's roadmap.
        space_time_directions: directions in which the robot may give way to moving obstacles.
        space_time_step: length of one such step, as a share of the robot's reach plus half the width of the smallest
            moving obstacle, which is about the distance that lets the obstacle pass.
        space_time_nodes: expanded nodes (place and time) at most.
        placement: kind of landmarks, one of :data:`PLACEMENTS`.
        without: names of :data:`STAGES` that are left out, for ablations.
    """

    first_landmarks: int = _count(120)
    landmark_growth: float = _number(1.4, 1.0)
    samples_per_landmark: int = _count(5)
    max_kept_nodes: int = _count(2_000)
    max_query_nodes: int = _count(20_000)
    sweeps: int = _count(40)
    first_sweeps: int = _count(5)
    polishing_sweeps: int = _count(10)
    patience: int = _count(16)
    least_gain: float = _number(3e-4)
    probes: int = _count(200)
    max_spread_landmarks: int = _count(16_000)
    build_share: float = _number(0.5)
    last_proof_share: float = _number(0.6)
    drives: int = _count(6_000)
    space_time_directions: int = _count(16)
    space_time_step: float = _number(1.0, 1e-3)
    space_time_nodes: int = _count(1_000)
    placement: Placement = "k-means"
    without: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for setting in fields(self):
            if (least := setting.metadata.get("least")) is not None:
                value, name = getattr(self, setting.name), f"{setting.name}:"
                whole_number = isinstance(setting.default, int)
                value = whole(value, name, least) if whole_number else number(value, name, minimum=least)
                object.__setattr__(self, setting.name, value)
        object.__setattr__(self, "without", each_of(self.without, str, "without"))
        named = [("placement:", self.placement, PLACEMENTS), *(("without:", name, STAGES) for name in self.without)]
        for what, name, allowed in named:
            if one_of(name, str, what) not in allowed:
                raise ConfigurationError(f"{what} {expected_name(name, allowed)}")

    def uses(self, stage: str) -> bool:
        """Return whether a stage, or part of one, is not left out."""
        return stage not in self.without

    @classmethod
    def load(cls, path: str | Path) -> PlannerSettings:
        """Return the settings of a YAML file of ``name: value`` lines; what it leaves out keeps its default.

        Raises:
            FormatError: a file that cannot be read, a name that is no setting's, a value out of range.
        """
        from trailmark.formats.settings_yaml import read_settings

        return read_settings(Path(path), cls())[0]

    def to_dict(self) -> dict[str, Any]:
        """Return all settings by name, as JSON has them."""
        return asdict(self) | {"without": list(self.without)}


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

- ``landmark``: all stages.
- ``roadmap``: landmarks by K-means where the relaxed problem's short paths run, their roadmap and its shortest path,
  which is shortened, and further rounds of these; nothing else leads to a path.
- ``roadmap-uniform``: the same with as many plain valid samples in place of the K-means centres.
- ``lattice``: no landmarks; lattices alone give the first path and other ways around. Not for cars.
- ``paper``: the source method. Its Algorithm 2 draws about 1,000 points and places 12 landmarks, both doubled in each
  round until there is a path; each obstacle's box is taken from its true outline, as if it had been sensed without
  error. A centre becomes a node at its widest heading, or at the nearest point where the robot can stand. The
  roadmap's shortest path of certified motions is the answer; it is neither shortened nor improved.
"""
