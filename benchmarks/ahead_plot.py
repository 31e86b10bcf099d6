"""The picture of benchmarks/ahead.py: shares of problems solved over time, and costs of each kind of world."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks.ahead_problems import Case
from benchmarks.ahead_results import COST_LIMIT, FIRST_LIMIT, LANDMARK, Results
from benchmarks.ahead_targets import CERTIFIED, NATIVE, PYTHON, SOON
from benchmarks.machine import describe_machine

__all__ = ["draw"]

# Okabe & Ito's colours, which colour-blind readers tell apart.
STYLES = {
    LANDMARK: ("#d55e00", "-", 2.4),
    PYTHON: ("#0072b2", "-", 1.4),
    CERTIFIED: ("#0072b2", "--", 1.4),
    NATIVE: ("#000000", "-", 1.4),
    "native:RRTConnect+certified": ("#000000", "--", 1.4),
    "BITstar": ("#009e73", "-", 1.4),
    "BITstar+certified": ("#009e73", "--", 1.4),
}
OTHERS = "#aaaaaa"
WIDTH = 27
"""Characters in a line of the legend."""


def draw(results: Results) -> bytes:
    """Return a PNG: shares of problems solved over time, and costs of each kind."""
    compared = results.compared
    figure = Figure(figsize=(12.5, max(5.0, 1.6 + 0.22 * len(compared))), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    planners = results.planners()
    chosen = results.timed(planners)
    others = [name for name in planners if name not in STYLES]
    if others:
        # Of functions of one's own the module tells which they are.
        named = [name.removeprefix("benchmarks.").removesuffix(":plan") for name in others]
        left.plot([], [], color=OTHERS, label=textwrap.fill(", ".join(named), WIDTH, break_on_hyphens=False))
    for name in sorted(planners, key=lambda name: (name == LANDMARK, name in STYLES)):
        times, shares = results.first_times(name, chosen)
        colour, line, width = STYLES.get(name, (OTHERS, "-", 1.0))
        known = np.isfinite(times)
        at = np.concatenate([1e3 * times[known], [1e3 * FIRST_LIMIT]])
        height = np.concatenate([100.0 * shares[known], [100.0 * shares[known][-1] if known.any() else 0.0]])
        label = name if name in STYLES else None
        left.step(at, height, where="post", color=colour, linestyle=line, linewidth=width, label=label)
    left.axvline(1e3 * SOON, color="#888888", linewidth=0.8, linestyle=":")
    left.set(xscale="log", xlim=(0.1, 1e3 * FIRST_LIMIT), ylim=(0.0, 101.0))
    left.set(xlabel="ms to the first path that the referee passes", ylabel="% of feasible problems")
    left.set_title(f"First path, {len(chosen)} problems", loc="left")
    left.grid(visible=True, color="#dddddd", linewidth=0.6)
    left.legend(loc="upper left", fontsize=8, frameon=False, reverse=True)
    if not compared:
        right.set_visible(False)
    else:
        _draw_costs(right, results, compared)
        figure.legend(*right.get_legend_handles_labels(), loc="outside lower right", ncols=3, fontsize=8, frameon=False)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=120, metadata={"Description": describe_machine()})
    return buffer.getvalue()


def _draw_costs(axes: Any, results: Results, compared: Sequence[Case]) -> None:
    rows = np.arange(len(compared))
    best = np.array([results.best_known(case) for case in compared])
    for values, colour, marker, label in (
        ([results.rivals_cost(case)[0] for case in compared], "#0072b2", "o", "best other planner, 10 s, simplified"),
        ([results.landmark_cost(case, 1.0) for case in compared], "#d55e00", "D", "landmark, 1 s"),
        ([results.landmark_cost(case, COST_LIMIT) for case in compared], "#d55e00", "|", "landmark, 10 s"),
    ):
        above = 100.0 * (np.array(values) / best - 1.0)
        axes.plot(above, rows, marker, color=colour, markersize=10 if marker == "|" else 5, label=label, alpha=0.9)
    axes.set_yticks(rows, [case.kind for case in compared], fontsize=8)
    axes.set_ylim(len(compared) - 0.5, -0.5)
    axes.set(xlabel="% above the best known cost")
    axes.set_xscale("symlog", linthresh=1.0, linscale=1.5)
    axes.set_xlim(left=-0.1)
    axes.set_xticks([0, 0.5, 1, 2, 5, 10, 20, 50], ["0", "0.5", "1", "2", "5", "10", "20", "50"])
    axes.minorticks_off()
    axes.grid(visible=True, color="#dddddd", linewidth=0.6)
    axes.set_title("Cost, one problem of every kind", loc="left")
