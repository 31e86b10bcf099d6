"""The colour, dash and mark by which each planner is recognised in all charts of a report.

The colour (and, after eight, the mark) tells the algorithm, the dash tells which of the baselines it runs in. The
colours are of the palettes by Okabe & Ito and by Paul Tol, chosen for readers with any kind of colour vision and for
white paper; trailmark's own planners are black, grey and brown.
"""

# Tested by tests/benchmark/report/test_summary.py.
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["FAMILIES", "Style", "algorithm_of", "family_of", "styles_of"]

OWN = {
    "landmark": "#111111",
    "roadmap": "#5a5a5a",
    "roadmap-uniform": "#9a9a9a",
    "lattice": "#6d4c41",
    "paper": "#a1887f",
}
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#aa4499", "#b8860b", "#4aa3df", "#882255", "#7a7a1f")
DASHES = {"landmark": "", "certified": "", "discrete": "6 3", "native": "1.5 3", "own": "9 2 2 2"}

FAMILIES = {
    "landmark": "trailmark",
    "discrete": "OMPL, discrete checks",
    "certified": "OMPL, certified checks",
    "native": "OMPL and FCL in C++",
    "own": "the user's own",
}
"""The groups that planners are shown in, and what to call them."""

_KNOWN = (
    *("PRM", "RRTstar", "RRTConnect", "BITstar", "PRMstar", "InformedRRTstar", "RRT", "AITstar"),
    *("LazyPRMstar", "FMT", "BFMT", "KPIECE1", "BKPIECE1", "LBKPIECE1", "SORRTstar", "AORRTC"),
)


@dataclass(frozen=True)
class Style:
    """How a planner is drawn.

    Attributes:
        colour: of lines and marks, ``#rrggbb``.
        dash: SVG's ``stroke-dasharray``; empty for a whole line.
        hollow: whether marks are rings, not dots.
        width: of lines.
        number: tells it from all others of a report.
    """

    colour: str
    dash: str
    hollow: bool
    width: float
    number: int

    @property
    def tint(self) -> str:
        """The colour with much white in it."""
        parts = (int(self.colour[i : i + 2], 16) for i in (1, 3, 5))
        return "#" + "".join(f"{round(255 - 0.3 * (255 - part)):02x}" for part in parts)


def family_of(planner: str) -> str:
    """Return the group of a planner, a key of :data:`FAMILIES`."""
    if planner.startswith("native:"):
        return "native"
    if planner.split(" ")[0] in OWN:
        return "landmark"
    if ":" in planner:
        return "own"
    return "certified" if "+certified" in planner else "discrete"


def algorithm_of(planner: str) -> str:
    """Return a planner's name without what tells its group."""
    return planner.removeprefix("native:").replace("+certified", "")


def styles_of(planners: Sequence[str]) -> dict[str, Style]:
    """Return a style for each planner; one algorithm has one colour in all groups."""
    algorithms = sorted({algorithm_of(p) for p in planners if family_of(p) != "landmark"}, key=_rank)
    found = {}
    for number, planner in enumerate(planners):
        family = family_of(planner)
        if family == "landmark":
            found[planner] = Style(OWN[planner.split(" ")[0]], "", False, 2.6, number)
            continue
        place = algorithms.index(algorithm_of(planner))
        hollow = (place // len(COLOURS)) % 2 == 1
        found[planner] = Style(COLOURS[place % len(COLOURS)], DASHES[family], hollow, 1.7, number)
    return found


def _rank(algorithm: str) -> tuple[int, str]:
    return (_KNOWN.index(algorithm) if algorithm in _KNOWN else len(_KNOWN), algorithm)
