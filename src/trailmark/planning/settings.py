"""PlannerSettings: every number of the planner that a person might want to change, with its unit and its reason."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Literal, get_args

from trailmark.arguments import each_of, number, one_of, whole
from trailmark.errors import ConfigurationError, FormatError, expected_name

__all__ = ["MECHANISMS", "METHODS", "PLACEMENTS", "Placement", "PlannerSettings"]


def _counted(default: int, unit: str) -> int:
    return field(default=default, metadata={"unit": unit, "least": 1})


def _factor(default: float, unit: str, least: float = 0.0) -> float:
    return field(default=default, metadata={"unit": unit, "least": least})


@dataclass(frozen=True)
class PlannerSettings:
    """How the planner divides its work. The defaults are those that the benchmarks were run with.

    Attributes:
        first_landmarks: landmarks of the first round; enough to cross a room with furniture.
        landmark_growth: each round places so many times the landmarks of the one before, >= 1.
        samples_per_landmark: samples that are clustered for each landmark; half as many for those that join others
            over all free space (:mod:`trailmark.planning.growth`).
        lloyd_steps: steps of K-means in a round; more move the centres by little.
        rounds_per_grid: rounds without a path after which the relaxed problem is looked at on cells half as large.
        max_kept_nodes: nodes up to which the planner's own roadmap takes in what queries bring that it might answer
            without; the memory of a planner that answers for hours stays bounded by it.
        max_query_nodes: nodes that the rounds of one query place before they begin anew in an empty roadmap; else a
            query that cannot be answered would take memory as long as it has time.
        sweeps: sweeps of shortening at most, for a promising path.
        first_sweeps: sweeps that show whether a path is promising.
        promising: a path gets all sweeps only if the first few bring it within this factor of the best path's cost.
        polishing_sweeps: sweeps with added vertices that the best path gets in each round of improvement.
        patience: rounds of improvement in a row that gain less than ``least_gain``, after which a path is settled.
        least_gain: share of the cost that a round has to gain to count as one that helped.
        duplicate: shares of the inscribed disc's radius: a landmark nearer than that to a joined node is not added.
        worth_shortening: a path of the roadmap is worth shortening if it costs at most so many times the best one.
        spread_steps: steps of K-means for landmarks over all free space: samples are then on the mean at most a
            thousandth farther from their centres than where it ends.
        probes: random queries that tell whether a roadmap over all free space is dense enough.
        least_probe_gain: share by which doubling its landmarks must shorten the probes' paths to be done again.
        max_spread_landmarks: landmarks over all free space up to which they are doubled.
        build_share: share of the time limit that spreading landmarks over all free space may take.
        first_batch_sweeps: sweeps of shortening in ``plan_many`` before other paths are looked for.
        other_paths: paths looked for in ``plan_many`` that avoid the tightest places of those before.
        close_to_optimal: share of the optimum: to a path proven to be as near as that, ``plan_many`` seeks no other.
        proof_share: share of the time left that a proof may be expected to take while much else is left to do.
        last_proof_share: the same after all else.
        longest_drive: turning radii: a car's first drives in a tight place; those of later rounds are half as long
            each time.
        drives: configurations that drives from one part of a car's roadmap reach at first.
        drive_landmarks: landmarks kept of them.
        redrive_step: turning radii: a car's drives that look for fewer changes of direction, at first; half as long
            from the second time on.
        redrive_nodes: configurations that the shortest of them reach at most.
        replan_shortening: seconds: what a repaired path is shortened for while a robot waits for it.
        space_time_directions: in which the robot may give way to moving obstacles.
        space_time_step: what it moves in one of them at a time, as a share of the reach of the robot and of half the
            width of the smallest moving obstacle together: about what takes it out of the other's way.
        space_time_nodes: places and times from which it is looked on, at most.
        placement: what landmarks are: ``k-means`` centres, as many plain ``samples``, those of the source method as
            published (``paper``), or ``none``.
        without: names of mechanisms (:data:`trailmark.planning.settings.MECHANISMS`) that are switched off, to see
            what each is good for.
    """

    first_landmarks: int = _counted(120, "landmarks")
    landmark_growth: float = _factor(1.4, "ratio", 1.0)
    samples_per_landmark: int = _counted(5, "samples")
    lloyd_steps: int = _counted(3, "steps")
    rounds_per_grid: int = _counted(2, "rounds")
    max_kept_nodes: int = _counted(2_000, "nodes")
    max_query_nodes: int = _counted(20_000, "nodes")
    sweeps: int = _counted(40, "sweeps")
    first_sweeps: int = _counted(5, "sweeps")
    promising: float = _factor(1.03, "ratio", 1.0)
    polishing_sweeps: int = _counted(10, "sweeps")
    patience: int = _counted(16, "rounds")
    least_gain: float = _factor(3e-4, "share")
    duplicate: float = _factor(0.05, "share of the inscribed radius")
    worth_shortening: float = _factor(1.3, "ratio", 1.0)
    spread_steps: int = _counted(5, "steps")
    probes: int = _counted(200, "queries")
    least_probe_gain: float = _factor(0.02, "share")
    max_spread_landmarks: int = _counted(16_000, "landmarks")
    build_share: float = _factor(0.5, "share of the time limit")
    first_batch_sweeps: int = _counted(3, "sweeps")
    other_paths: int = _counted(2, "paths")
    close_to_optimal: float = _factor(0.01, "share")
    proof_share: float = _factor(0.25, "share of the time left")
    last_proof_share: float = _factor(0.6, "share of the time left")
    longest_drive: float = _factor(0.1, "turning radii")
    drives: int = _counted(6_000, "configurations")
    drive_landmarks: int = _counted(80, "landmarks")
    redrive_step: float = _factor(0.07, "turning radii", 1e-3)
    redrive_nodes: int = _counted(200_000, "configurations")
    replan_shortening: float = _factor(0.002, "s")
    space_time_directions: int = _counted(16, "directions")
    space_time_step: float = _factor(1.0, "share", 1e-3)
    space_time_nodes: int = _counted(1_000, "nodes")
    placement: Placement = field(default="k-means", metadata={"unit": "name"})
    without: tuple[str, ...] = field(default=(), metadata={"unit": "names"})

    def __post_init__(self) -> None:
        for setting in fields(self):
            if "least" not in setting.metadata:
                continue
            value, name, least = getattr(self, setting.name), f"{setting.name}:", setting.metadata["least"]
            counted = isinstance(setting.default, int)
            checked = whole(value, name, 1) if counted else number(value, name, minimum=least)
            object.__setattr__(self, setting.name, checked)
        _require_name(self.placement, "placement:", PLACEMENTS)
        object.__setattr__(self, "without", each_of(self.without, str, "without"))
        for mechanism in self.without:
            _require_name(mechanism, "without:", MECHANISMS)

    def uses(self, mechanism: str) -> bool:
        """Return whether a mechanism, one of :data:`~trailmark.planning.settings.MECHANISMS`, is not switched off."""
        return mechanism not in self.without

    @classmethod
    def load(cls, path: str | Path) -> PlannerSettings:
        """Return the settings of a YAML file of ``name: value`` lines; what it leaves out keeps its default.

        Raises:
            FormatError: a file that cannot be read, a name that is no setting's, a value out of range.
        """
        import yaml

        from trailmark.formats.files import read_text

        try:
            given: Any = yaml.safe_load(read_text(Path(path)))
        except yaml.YAMLError as error:
            raise FormatError(Path(path), f"expected YAML, got {' '.join(str(error).split())}") from None
        names = [setting.name for setting in fields(cls)]
        if not isinstance(given, dict):
            raise FormatError(Path(path), f"expected lines 'name: value', got {type(given).__name__}")
        for name in given:
            if name not in names:
                raise FormatError(Path(path), f"setting: expected one of {', '.join(names)}, got {name!r}")
        try:
            return cls(**given)
        except ConfigurationError as error:
            raise FormatError(Path(path), str(error)) from None

    def to_dict(self) -> dict[str, Any]:
        """Return all settings by name, as JSON has them."""
        return asdict(self) | {"without": list(self.without)}


def _require_name(name: str, what: str, allowed: Iterable[str]) -> None:
    if one_of(name, str, what) not in allowed:
        raise ConfigurationError(f"{what} {expected_name(name, allowed)}")


# --- Mechanisms of the planner, each of which can be switched off, and the planners that are made so.

Placement = Literal["k-means", "samples", "paper", "none"]
PLACEMENTS: tuple[Placement, ...] = get_args(Placement)
"""What landmarks are: K-means centres of samples, as many plain samples, those of the source method as published
(:mod:`trailmark.planning.placement`), or none at all."""

MECHANISMS = {
    "lattice": "paths over lattices of configurations: the first one, and other ways around",
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

# --- Planning methods by name: the planner as it is, and planners of their own that are made of parts of it.

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
