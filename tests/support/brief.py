"""Programs that are made to be read, which plan for longer than a test of them needs."""

from __future__ import annotations

import re

__all__ = ["briefly"]

LIMIT = re.compile(r"(time_limit=|\.solve\()([\d.]+)")
"""How a program says how many seconds it plans."""
DEFAULT = """\
import functools, trailmark
trailmark.LandmarkPlanner.plan = functools.partialmethod(trailmark.LandmarkPlanner.plan, time_limit={seconds})
"""
"""What stands before a program that leaves it to the planner."""


def briefly(text: str, seconds: float) -> str:
    """Return a program whose plans take no more than so many seconds each."""
    shorter = LIMIT.sub(lambda found: f"{found[1]}{min(float(found[2]), seconds)}", text)
    return DEFAULT.format(seconds=seconds) + shorter if re.search(r"\.plan\((?!.*time_limit)", text) else shorter
