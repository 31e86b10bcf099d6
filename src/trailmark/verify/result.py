"""PathAudit: what an audit of a path says."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from trailmark.path import Path

__all__ = ["Collision", "PathAudit", "Undrivable"]


@dataclass(frozen=True)
class Collision:
    """An interval of a path on which the robot collides with one obstacle.

    Attributes:
        begin: where it begins: metres along the path, by the length of its xy curve; known to 0.1 mm.
        end: where it ends, likewise.
        obstacle: the obstacle's id, its index if it has none, ``keep-out zone i``, ``one-way zone i``, ``bounds``
            or ``boundary``.
        depth: metres of the shortest translation that would take the robot out of it (for bounds and boundary: back
            inside; for a one-way zone its reference point), where that is largest, to a thousandth.
        motions: the same interval as indices of the path's motions and shares of them: 2.25 is a quarter into the
            third motion. While a robot turns in place, the length stays the same, and this does not.
    """

    begin: float
    end: float
    obstacle: str | int
    depth: float
    motions: tuple[float, float]


@dataclass(frozen=True)
class Undrivable:
    """A motion of a path that the robot's drive cannot make.

    Attributes:
        motion: its index: 0 is the first one.
        begin: where it begins: metres along the path, by the length of its xy curve; known to 0.1 mm.
        end: where it ends, likewise.
        why: ``sideways by 90 degrees``, ``backwards``, ``a turn in place`` or ``a turn of radius 1 m``.
    """

    motion: int
    begin: float
    end: float
    why: str


@dataclass(frozen=True)
class PathAudit:
    """What an audit of a path found.

    Attributes:
        path: what was audited; of a car's curve, straight motions that follow it within 5e-8 m.
        free: whether the robot overlaps no obstacle by more than 1e-7 m anywhere along the path, and stays inside.
        collisions: in their order along the path, by obstacle; empty if it is free.
        min_clearance: least clearance along the path, metres; found by exact distances, at most 5e-7 m above the true
            one; 0 if it collides, or leaves a keep-out zone.
        min_clearance_at: where, metres along the path's xy curve; where the first collision begins if it collides.
        min_clearance_state: configuration there (x, y, theta).
        length: of the xy curve, metres.
        rotation: Σ |Δθ|, radians.
        cost: Σ (‖Δxy‖ + 0.5·|Δθ|), metres; that of a robot with a turning radius is the length.
        lower_bound: proven lower bound on the cost of any path between the same ends; None if none was computed.
        max_curvature: largest curvature (1/metres) of a motion in which the robot moves: 2·sin(|Δθ|/2)/‖Δxy‖, that of
            the circle which both states lie on; infinite where it turns in place.
        direction_changes: how often a robot with a turning radius changes between forwards and backwards; else None.
        reverse_length: metres that it drives backwards.
        undrivable: the motions that a differential drive or a car cannot make, in their order; None of another robot.
            Such a path is ``free`` all the same where nothing is met.
    """

    path: Path = field(repr=False)
    free: bool
    collisions: tuple[Collision, ...]
    min_clearance: float
    min_clearance_at: float
    min_clearance_state: tuple[float, float, float]
    length: float
    rotation: float
    cost: float
    max_curvature: float
    lower_bound: float | None = None
    direction_changes: int | None = None
    reverse_length: float | None = None
    undrivable: tuple[Undrivable, ...] | None = None

    def to_dict(self, world: str) -> dict[str, Any]:
        """Return the record that ``check --json`` prints, made of plain numbers, strings and lists.

        An infinite curvature, which JSON cannot hold, is null.
        """
        car = {"direction_changes": self.direction_changes, "reverse_length": self.reverse_length}
        return {
            "world": world,
            "free": self.free,
            "collisions": [
                {"from": c.begin, "to": c.end, "obstacle": c.obstacle, "depth": c.depth} for c in self.collisions
            ],
            "min_clearance": self.min_clearance,
            "min_clearance_at": self.min_clearance_at,
            "length": self.length,
            "rotation": self.rotation,
            "cost": self.cost,
            "lower_bound": self.lower_bound,
            "max_curvature": self.max_curvature if self.max_curvature < float("inf") else None,
            **(car if self.direction_changes is not None else {}),
            **({} if self.undrivable is None else {"undrivable": [asdict(motion) for motion in self.undrivable]}),
        }
