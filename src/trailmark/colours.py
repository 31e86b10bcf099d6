"""Colours of all pictures: Okabe & Ito's ("Color Universal Design", 2008), which colour-blind readers tell apart."""

from __future__ import annotations

__all__ = [
    *("BODY", "CANDIDATE", "COLLISION", "EDGE", "GOAL", "HATCH", "LANDMARK", "MARGIN", "OBSTACLE", "OUTSIDE"),
    *("PATH", "REPAIRED", "START", "TEXT", "AVOID", "ONE_WAY", "PREFER", "SPEED"),
]

OBSTACLE, MARGIN, OUTSIDE, HATCH, TEXT = "#3f4249", "#c9ccd2", "#eceef1", "#b4b9c2", "#55585f"
START, GOAL, PATH, BODY, LANDMARK = "#009e73", "#d55e00", "#0072b2", "#d8e9f4", "#9c4a79"
COLLISION, REPAIRED = "#c1121f", "#cc79a7"
AVOID, PREFER, ONE_WAY, SPEED = "#e69f00", "#009e73", "#56b4e9", "#f0e442"
EDGE, CANDIDATE = "#dca6c5", "#ecdde5"  # tints of Okabe & Ito's purple: the roadmap is the path's background
