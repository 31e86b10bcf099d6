"""Objective: what a path costs, beyond its length: time, nearness to obstacles, and what drivers avoid."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any

from trailmark.arguments import brief, number
from trailmark.errors import ConfigurationError, expected_name
from trailmark.robot import Robot
from trailmark.se2 import ROTATION_WEIGHT

__all__ = ["Objective"]

NAMED: dict[str, dict[str, float]] = {
    "length": {},
    "time": {"length": 0.0, "time": 1.0},
    "clearance": {"clearance": 5.0},
}
"""Weights that have a name."""

DRIVERS = {"reverse": 1.5, "direction_change": 3.0}
"""What a driver avoids, by default: a change of direction takes about as long as 3 m of manoeuvring."""

LEAST = {"decay": 1e-6, "max_speed": 1e-6, "max_turn_rate": 1e-6, "reverse": 1.0}
"""Least values of attributes; of the others 0."""


@dataclass(frozen=True)
class Objective:
    """Weights of what a path is charged for.

    A path with the reference point's way s and heading theta costs

        ∫ (length · f + time / v + clearance · exp(−d / decay)) ds + rotation · Σ |Δθ|

    where f is the product of the factors of the cost zones that hold the reference point (1 outside), v the least of
    ``max_speed`` and the limits of the speed zones there, and d the distance of the reference point to the nearest
    obstacle, keep-out zone, boundary or bound. So the unit is the metre for ``length`` and the second for ``time``.
    ``time`` counts turning as if it took its own time, which is exact for a robot that turns in place and an upper
    bound for one that turns while it moves. For cars, metres in reverse count ``reverse`` times, and each change
    between forwards and backwards costs ``direction_change``; a car's turning costs nothing by itself.

    Source of the exponential: the inflation layer of ROS navigation's costmaps.

    Attributes:
        length: cost of a metre.
        time: cost of a second.
        clearance: what a metre beside an obstacle costs in addition; with 5 and ``decay`` 0.5 m a metre costs twice as
            much 0.8 m from the nearest obstacle as far out in the open.
        decay: metres over which that falls to 37 %.
        max_speed: metres per second.
        max_turn_rate: radians per second.
        reverse: factor on a car's metres in reverse, >= 1.
        direction_change: metres that a car's change of direction counts as.

    Raises:
        ConfigurationError: a number out of range, or neither ``length`` nor ``time`` above 0.
    """

    length: float = 1.0
    time: float = 0.0
    clearance: float = 0.0
    decay: float = 0.5
    max_speed: float = 1.0
    max_turn_rate: float = 1.0
    reverse: float = 1.0
    direction_change: float = 0.0

    def __post_init__(self) -> None:
        for setting in fields(self):
            least = LEAST.get(setting.name, 0.0)
            value = number(getattr(self, setting.name), f"objective: {setting.name}:", minimum=least, maximum=1e6)
            object.__setattr__(self, setting.name, value)
        if self.length == 0.0 and self.time == 0.0:
            raise ConfigurationError("objective: expected a weight of length or of time above 0, got 0 for both")

    @property
    def rotation(self) -> float:
        """Cost of turning by a radian."""
        return ROTATION_WEIGHT * self.length + self.time / self.max_turn_rate

    @property
    def maneuver_costs(self) -> tuple[float, float]:
        """What a car's change of direction costs, and what a metre in reverse costs beyond one forwards."""
        metre = self.length + self.time / self.max_speed
        return self.direction_change * metre, (self.reverse - 1.0) * metre

    @property
    def position_dependent(self) -> bool:
        """Whether a metre is charged by more than its length, or by another weight than 1."""
        return self.length != 1.0 or self.time > 0.0 or self.clearance > 0.0

    @classmethod
    def of(cls, given: Objective | str | None, robot: Robot | None = None, **limits: float) -> Objective:
        """Return an objective by its name, or by weights such as ``length=1,clearance=3``; None is the length.

        A car that reverses is also charged what a driver avoids, but by the plain name ``length``: changes of direction
        at 3 m each and metres in reverse 1.5 times, unless other attributes are given.

        Args:
            given: ``length``, ``time``, ``clearance`` (length and nearness to obstacles), ``name=weight`` pairs
                separated by commas (what is not named has its default, ``length`` 0 unless named), or an objective.
            robot: that it is for; None for one that moves in every direction.
            limits: other attributes, such as ``max_speed``.

        Raises:
            ConfigurationError: another name, or a weight that is no number.
        """
        if isinstance(given, Objective):
            return given
        if given is not None and not isinstance(given, str):
            raise ConfigurationError(f"objective: expected an Objective or a name, got {brief(given)}")
        if isinstance(robot, Robot) and robot.turning_radius is not None and robot.reverse and given != "length":
            limits = DRIVERS | limits
        if given is None or given in NAMED:
            return cls(**NAMED[given or "length"], **limits)
        names = [setting.name for setting in fields(cls)]
        values = {"length": 0.0, **limits}
        pairs = [[part.strip() for part in pair.partition("=")] for pair in given.split(",")]
        for name, equals, text in pairs:
            if not equals:
                raise ConfigurationError(f"objective: {expected_name(name, NAMED)} (or name=weight,name=weight)")
            if name not in names:
                raise ConfigurationError(f"objective: {expected_name(name, names)}")
            if [other for other, _, _ in pairs].count(name) > 1:
                raise ConfigurationError(f"objective: expected each weight once, got {given!r}")
            try:
                values[name] = float(text)
            except ValueError:
                raise ConfigurationError(f"objective: {name}: expected a number, got {text!r}") from None
        return cls(**values)

    def to_dict(self) -> dict[str, Any]:
        """Return the weights by name, as JSON has them."""
        return asdict(self)
