"""PlannerName: what one planner of a benchmark is called, parameters included."""

from __future__ import annotations

from typing import NamedTuple

from trailmark.benchmark.errors import SuiteError

__all__ = ["CERTIFIED", "PlannerName"]

CERTIFIED = "+certified"
"""Ends the name of one of OMPL's planners that plans with trailmark's certified motion validator."""


class PlannerName(NamedTuple):
    """A planner and the parameters that it is given, as in ``RRTConnect+certified:range=2,intermediate_states=true``.

    Attributes:
        base: such as ``landmark``, ``PRM+certified``, ``native:PRM`` or ``module:function``.
        parameters: values as they were given, by name.
    """

    base: str
    parameters: dict[str, str]

    @classmethod
    def parse(cls, text: str) -> PlannerName:
        """Return what a name says.

        Raises:
            SuiteError: parameters that are not ``name=value,name=value``.
        """
        base, colon, last = text.rpartition(":")
        if not colon or "=" not in last:
            return cls(text, {})
        parameters: dict[str, str] = {}
        for word in last.split(","):
            name, equals, value = (part.strip() for part in word.partition("="))
            if not (name and equals and value) or name in parameters:
                raise SuiteError(f"planner {text!r}: expected PLANNER:name=value,name=value, each once, got {word!r}")
            parameters[name] = value
        return cls(base, parameters)

    @property
    def algorithm(self) -> str:
        """The name of OMPL's planner, certified or not."""
        return self.base.removesuffix(CERTIFIED)

    @property
    def certified(self) -> bool:
        """Whether OMPL's planner gets certified motions."""
        return self.base.endswith(CERTIFIED)

    def __str__(self) -> str:
        given = ",".join(f"{name}={value}" for name, value in self.parameters.items())
        return f"{self.base}:{given}" if given else self.base
