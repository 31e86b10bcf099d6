"""Pictures of a plan's progress: what the best path cost, from the first one on, and what it costs at least."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

from trailmark.colours import PATH, TEXT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["add_progress", "draw_progress"]

BOUND = "#e69f00"  # Okabe & Ito's orange
WIDTH, HEIGHT, BESIDE, BELOW = 2.3, 1.3, 0.75, 0.3  # inches: of the panel, and between it and plan or legend
LABEL_SIZE = 8  # points, at most
ROOM = 0.03
"""Share of the costs' range that stays free above and below."""


def draw_progress(axes: Axes, history: Sequence[tuple[float, float]], total: float, bound: float | None = None) -> None:
    """Draw the best path's cost over time, a step for each better path, and the lower bound as a line.

    Args:
        axes: what to draw on; time is on a logarithmic axis.
        history: (seconds, cost in metres) of each better path, one or more, by time; :attr:`PlanResult.history`.
        total: seconds until planning ended.
        bound: metres; left out if None.
    """
    times, costs = np.array(history, dtype=np.float64).T
    end = max(total, times[-1])
    axes.step(1e3 * np.append(times, end), np.append(costs, costs[-1]), where="post", color=PATH, lw=1.4, label="cost")
    axes.plot(1e3 * times, costs, "o", ms=2.6, mew=0, color=PATH)
    if bound is not None:
        axes.axhline(bound, color=BOUND, lw=1.2, ls="--", label="lower bound")
    axes.set_xscale("log")
    axes.set_xlim(1e3 * times[0] / 1.3, 1e3 * end * 1.1)
    # Within few decades their halves and fifths have room, too.
    few = times[-1] < 200.0 * times[0] and end < 200.0 * times[0]
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,), numticks=5))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda ms, _: f"{ms:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    low, high = min([costs[-1], *([] if bound is None else [bound])]), costs[0]
    room = max(ROOM * (high - low), 1e-3 * high, 1e-9)
    axes.set_ylim(low - 2.0 * room, high + 2.0 * room)
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.yaxis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 5, 10]))
    axes.set_xlabel("planning time [ms]")
    axes.set_ylabel("cost")


def add_progress(
    figure: Figure, plan: Axes, history: Sequence[tuple[float, float]], total: float, bound: float | None = None
) -> None:
    """Add a small panel with :func:`draw_progress` beside or, where the plan is wide, below a plan and its legend.

    Args:
        figure: of the plan.
        plan: the plan's axes, with its legend; the panel keeps clear of both.
        history: as in :func:`draw_progress`; without a path nothing is added.
        total: seconds until planning ended.
        bound: metres.
    """
    if not history:
        return
    legend = plan.get_legend()
    assert legend is not None  # noqa: S101  # annotate has made it
    box, entries = (part.get_window_extent() for part in (plan, legend))
    under = entries.y0 - figure.dpi * (BELOW + HEIGHT)
    if entries.y1 <= box.y0:  # the legend lies below the plan, and the panel below both
        at = (box.x0, under, box.width)
    else:  # beside the plan, at its foot if the legend leaves room there
        at = (box.x1 + figure.dpi * BESIDE, min(box.y0, under), figure.dpi * WIDTH)
    corners = figure.transFigure.inverted().transform([at[:2], (at[0] + at[2], at[1] + figure.dpi * HEIGHT)])
    axes = figure.add_axes((*corners[0], *(corners[1] - corners[0])))
    draw_progress(axes, history, total, bound)
    axes.tick_params(labelsize=7, color=TEXT, labelcolor=TEXT)
    axes.xaxis.label.set(fontsize=8, color=TEXT)
    axes.yaxis.label.set(fontsize=8, color=TEXT)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(loc="best", fontsize=7, frameon=False, handlelength=1.6, borderaxespad=0.0)
