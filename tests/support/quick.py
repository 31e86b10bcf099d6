"""Settings of planners whose paths need not be the shortest."""

from __future__ import annotations

from trailmark.planning.settings import PlannerSettings

__all__ = ["QUICK"]

QUICK = PlannerSettings(sweeps=10, first_sweeps=3, polishing_sweeps=3, patience=2)
"""Rounds are short, and paths settle after two that gain nothing."""
