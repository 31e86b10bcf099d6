"""The colour, dash and mark by which each planner is recognised in all charts of a report.

Colour and mark tell the algorithm, the dash tells which of the baselines it runs in. The
colours are of the palettes by Okabe & Ito and by Paul Tol, chosen for readers with any kind of colour vision and for
white paper; trailmark's own planners are black, grey and brown.
"""

# Tested by tests/benchmark/report/test_summary.py.
from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from trailmark.sketch.svg import element

__all__ = ["FAMILIES", "Style", "algorithm_of", "family_of", "legend_mark", "legend_marks", "styles_of"]

OWN = {
    "landmark": "#111111",
    "roadmap": "#5a5a5a",
    "roadmap-uniform": "#9a9a9a",
    "lattice": "#6d4c41",
    "paper": "#a1887f",
}
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#aa4499", "#b8860b", "#4aa3df", "#882255", "#7a7a1f")
DASHES = {"landmark": "", "certified": "", "discrete": "6 3", "native": "1.5 3", "own": "9 2 2 2"}
MARKS = (
    *("M-4 0a4 4 0 1 0 8 0a4 4 0 1 0-8 0z", "M-3.6-3.6h7.2v7.2h-7.2z", "M0-4.8l4.6 8h-9.2z", "M0-5l5 5l-5 5l-5-5z"),
    *("M0 4.8l4.6-8h-9.2z", "M-1.5-4.5h3v3h3v3h-3v3h-3v-3h-3v-3h3z", "M0-5l4.8 3.5l-1.8 5.6h-6l-1.8-5.6z"),
)
"""A disc, a square, a triangle, a diamond, a triangle upside down, a cross, a pentagon."""

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
    """How a planner is drawn: no two planners of a report have the same colour, dash and mark.

    Attributes:
        colour: of lines and marks, ``#rrggbb``.
        dash: SVG's ``stroke-dasharray``; empty for a whole line.
        mark: path data of the mark on its lines, around the origin.
        width: of lines.
        number: tells it from all others of a report.
    """

    colour: str
    dash: str
    mark: str
    width: float
    number: int


def family_of(planner: str) -> str:
    """Return the group of a planner, a key of :data:`FAMILIES`."""
    if planner.startswith("native:"):
        return "native"
    if re.split("[ :]", planner)[0] in OWN:
        return "landmark"
    base, _, last = planner.rpartition(":")
    if ":" in (base if "=" in last else planner):  # module:function, perhaps with parameters: …:name=value
        return "own"
    return "certified" if "+certified" in planner else "discrete"


def algorithm_of(planner: str) -> str:
    """Return a planner's name without what tells its group."""
    return planner.removeprefix("native:").replace("+certified", "")


def styles_of(planners: Sequence[str]) -> dict[str, Style]:
    """Return a style for each planner; one algorithm has one colour and one mark in all groups, as far as they go."""
    algorithms = sorted({algorithm_of(p) for p in planners if family_of(p) != "landmark"}, key=_rank)
    found: dict[str, Style] = {}
    taken: set[tuple[str, str, str]] = set()
    for number, planner in enumerate(planners):
        family, marks = family_of(planner), list(MARKS)
        if family == "landmark":
            name = re.split("[ :]", planner)[0]
            place, colour, width = list(OWN).index(name), OWN[name], 2.6
        else:
            # The numbers of colours and marks have no divisor in common: after a round the two part company.
            place = algorithms.index(algorithm_of(planner))
            colour, width = COLOURS[place % len(COLOURS)], 1.7
        marks = marks[place % len(marks) :] + marks[: place % len(marks)]
        dashes = [DASHES[family], *DASHES.values()]
        looks = ((colour, dash, mark) for dash in dashes for mark in marks)
        look = next((look for look in looks if look not in taken), (colour, DASHES[family], marks[0]))
        taken.add(look)
        found[planner] = Style(*look, width, number)
    return found


def legend_mark(style: Style) -> str:
    """Return a small picture of a planner's line, for legends and tables; it says nothing to a screen reader."""
    return f'<svg class="key" viewBox="0 0 28 14" aria-hidden="true"><use href="#k{style.number}"/></svg>'


def legend_marks(styles: Iterable[Style]) -> str:
    """Return the definitions of each planner's mark (``#m…``) and line with mark (``#k…``); once a page."""
    drawn = []
    for s in styles:
        mark = element("path", d=s.mark, fill=s.colour, stroke="#fff", stroke_width=0.8, id=f"m{s.number}")
        line = element("path", d="M1 7H27", stroke=s.colour, stroke_width=s.width, stroke_dasharray=s.dash or None)
        drawn.append(mark + element("g", line + element("use", href=f"#m{s.number}", x=14.0, y=7.0), id=f"k{s.number}"))
    return f'<svg class="defs" aria-hidden="true"><defs>{"".join(drawn)}</defs></svg>'


def _rank(algorithm: str) -> tuple[int, str]:
    return (_KNOWN.index(algorithm) if algorithm in _KNOWN else len(_KNOWN), algorithm)
