"""Resolution: how far apart the states lie that OMPL's discrete motion validation checks."""

from __future__ import annotations

import math
from typing import NamedTuple

from trailmark.benchmark.errors import SuiteError
from trailmark.world import Robot

__all__ = ["DEFAULT", "OWN", "Resolution", "resolution_of"]


class Resolution(NamedTuple):
    """Metres, or a share of a robot's inscribed radius.

    Attributes:
        value: above 0.
        share: whether it is a share.
    """

    value: float
    share: bool

    @classmethod
    def parse(cls, text: str) -> Resolution:
        """Return what ``0.02`` (metres) or ``10%`` (of the inscribed radius) says.

        Raises:
            SuiteError: anything else.
        """
        share = text.endswith("%")
        try:
            value = float(text.removesuffix("%")) / (100.0 if share else 1.0)
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and value > 0.0):
            raise SuiteError(f"expected metres above 0, or a share of the inscribed radius such as 10%, got {text!r}")
        return cls(value, share)

    def metres(self, robot: Robot) -> float:
        """Return the distance for a robot."""
        return self.value * robot.inscribed_disc.radius if self.share else self.value


DEFAULT = Resolution(0.1, share=True)
"""Of OMPL's planners from Python. In two pilots (``benchmarks/resolution.py`` is the second) the referee refused 1 of
168 paths that they found at a tenth of the inscribed radius, 12 of 216 at a fifth and 36 of 252 at a half."""

NATIVE = Resolution(0.05, share=True)
"""Of native planners, whose checks cost less: 1 of 269 paths was refused; at a tenth 4 of 355, at a half 68 of 392."""

OWN = f"{100.0 * DEFAULT.value:g} % of the robot's inscribed radius, native planners {100.0 * NATIVE.value:g} %"
"""What the results say where each planner has its own."""


def resolution_of(planner: str) -> Resolution:
    """Return the resolution at which refusals of a planner are rare."""
    return NATIVE if planner.startswith("native:") else DEFAULT
