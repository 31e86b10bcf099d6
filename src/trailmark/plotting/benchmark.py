"""Charts of a benchmark's report, as SVG that a page holds: they take the page's own text colour, light or dark."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping

import matplotlib as mpl
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

__all__ = ["line_chart"]

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8c564b", "#7f7f7f")
"""Of planners, in their order (Okabe and Ito's, told apart by most colour-blind people)."""
DASHES = ("-", "--", ":", "-.")
TEXT = "#010203"
"""Stands for the page's text colour until the SVG is done: matplotlib knows no currentColor."""


def line_chart(
    lines: Mapping[str, tuple[ArrayLike, ArrayLike]], x_label: str, y_label: str, *, percent: bool = False
) -> str:
    """Return a chart of step lines over time on a logarithmic axis, with a legend, as an ``<svg>`` element.

    Args:
        lines: for each name, in the order of the legend, x (seconds, positive) and y, both of shape (n,); NaN and
            infinity are left out.
        x_label: of the axis.
        y_label: of the axis.
        percent: whether y is a share, from 0 to 1.
    """
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "trailmark", "font.size": 10}):
        figure = Figure(figsize=(7.2, 3.6), layout="constrained")
        FigureCanvasSVG(figure)
        axes = figure.subplots()
        for number, (name, (x, y)) in enumerate(lines.items()):
            colour, dash = COLOURS[number % len(COLOURS)], DASHES[number // len(COLOURS) % len(DASHES)]
            axes.step(x, y, where="post", color=colour, linestyle=dash, linewidth=1.8, label=name)
        axes.set_xscale("log")
        axes.set_xlabel(x_label)
        axes.set_ylabel(y_label)
        if percent:
            axes.set_ylim(-0.02, 1.02)
            axes.yaxis.set_major_formatter(lambda value, _: f"{100.0 * value:.0f} %")
        axes.grid(color=TEXT, alpha=0.15)
        axes.tick_params(colors=TEXT, which="both")
        for spine in axes.spines.values():
            spine.set_color(TEXT)
        axes.xaxis.label.set_color(TEXT)
        axes.yaxis.label.set_color(TEXT)
        figure.legend(loc="outside right upper", frameon=False, labelcolor=TEXT, fontsize=9)
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    text = buffer.getvalue().replace(TEXT, "currentColor")
    # Within a page neither the XML declaration nor a fixed size is of use.
    return re.sub(r'^(<svg[^>]*?) width="[^"]*" height="[^"]*"', r"\1", text[text.index("<svg") :], count=1)
