"""The plot of benchmarks/change.py: times from a change to a certified path, and a drive's memory and times."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trailmark.formats.files import write_atomically

__all__ = ["plot"]

TOUCHED, UNTOUCHED, ANEW = "#d55e00", "#0072b2", "#999999"


def plot(found: dict[str, Any], file: Path) -> None:
    """Write the plot of what was measured, as PNG.

    Args:
        found: by part; ``planner`` and ``drive`` are drawn.
        file: to write.
    """
    figure = Figure(figsize=(10.0, 4.2), dpi=110, layout="constrained")
    times, drive = figure.subplots(1, 2, width_ratios=(3, 2))
    scenes = found["planner"]["scenes"]
    at = np.arange(len(scenes))
    groups = (("untouched", UNTOUCHED, -0.25), ("touched", TOUCHED, 0.0))
    for name, colour, shift in groups:
        median, high = (np.array([scene[name][i] for scene in scenes]) for i in (1, 2))
        times.bar(at + shift, median, 0.22, color=colour, label=f"path {name}: median, whisker to 95 %")
        times.errorbar(at + shift, median, [0.0 * median, high - median], fmt="none", ecolor="#333333", capsize=3, lw=1)
    anew = [scene["anew"] for scene in scenes]
    times.bar(at + 0.25, anew, 0.22, color=ANEW, label="a new planner alone, without a path")
    for limit, colour in ((1.0, UNTOUCHED), (5.0, TOUCHED)):
        times.axhline(limit, color=colour, lw=0.8, ls=(0, (4, 3)))
    times.set(yscale="log", ylabel="from the change to a certified path [ms]")
    breaks = (
        (" polygons", ""),
        (", robot ", "\nrobot\n"),
        (" on the same", "\non the\nsame"),
        (" as dense", "\nas dense\n"),
    )
    names = [scene["name"] for scene in scenes]
    for words, lines in breaks:
        names = [name.replace(words, lines) for name in names]
    times.set_xticks(at, names, fontsize=8)
    times.legend(fontsize=7, frameon=False, loc="upper left")
    times.set_ylim(top=40.0 * max(anew))
    minutes = found["drive"]["minutes"]
    minute = np.arange(1, len(minutes) + 1)
    drive.plot(
        minute, [m["update"] + m["replan"] for m in minutes], "o-", color=UNTOUCHED, label="update + replan, medians"
    )
    drive.plot(minute, [m["p95"] for m in minutes], "s-", color=TOUCHED, label="both, 95 %")
    drive.set(
        xlabel="minute of the drive, 10 changes a second",
        ylabel="[ms]",
        ylim=(0.0, 1.35 * max(m["p95"] for m in minutes)),
    )
    memory = drive.twinx()
    memory.plot(minute, [m["memory"] for m in minutes], "^--", color="#009e73", label="memory")
    memory.set(ylabel="memory [MB]", ylim=(0.0, 2.0 * max(m["memory"] for m in minutes)))
    handles = [axes.get_legend_handles_labels() for axes in (drive, memory)]
    drive.legend(*(a + b for a, b in zip(*handles, strict=True)), fontsize=7, frameon=False, loc="upper left")
    data = io.BytesIO()
    figure.savefig(data, format="png", metadata={"Description": found["planner"]["machine"]})
    write_atomically(file, data.getvalue())
