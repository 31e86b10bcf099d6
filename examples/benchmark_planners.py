"""Benchmark planners, one of your own included
============================================

The same problem, seeds and limits for every planner, each run in a process of its own and judged by a referee.

A planner of your own is a function in a module, here in this file: it gets a collision checker, start, goal, a limit in
seconds and a seed, and returns states, or None. If it takes ``report`` as well, it may tell of each better path.
"""

import os
import sqlite3
import subprocess
import sys
from pathlib import Path
from tempfile import mkdtemp

import matplotlib.pyplot as plt
import numpy as np

from trailmark import StateChecker
from trailmark.se2 import FloatArray


def plan(checker: StateChecker, start: FloatArray, goal: FloatArray, time_limit: float, seed: int) -> FloatArray | None:
    """Try random detours by way of two configurations, ten thousand of them at once."""
    rng = np.random.default_rng(seed)
    lower, upper = np.reshape(checker.world.bounds, (2, 2))
    vias = np.dstack([rng.uniform(lower, upper, (10_000, 2, 2)), rng.uniform(-np.pi, np.pi, (10_000, 2))])
    ways = np.hstack([np.tile(start, (len(vias), 1, 1)), vias, np.tile(goal, (len(vias), 1, 1))])
    ways = ways[checker.valid(vias.reshape(-1, 3)).reshape(-1, 2).all(axis=1)]
    free = np.all([checker.motions_valid(ways[:, i], ways[:, i + 1]) for i in range(3)], axis=0)
    lengths = np.hypot(*np.diff(ways[free][:, :, :2], axis=1).transpose(2, 0, 1)).sum(axis=1)
    return ways[free][np.argmin(lengths)] if free.any() else None


# %%
# In a shell: ``trailmark benchmark lshape --query turn -p landmark -p benchmark_planners:plan --output results.db``.
# ``trailmark report results.db --html report.html`` then makes a page of the results, which are a SQLite database as
# Planner Arena reads it.
if __name__ == "__main__":
    results = Path(sys.argv[1] if len(sys.argv) > 1 else mkdtemp()) / "results.db"
    words = ["benchmark", "lshape", "--query", "turn", "--runs", "3", "--time-limit", "0.3", "--output", str(results)]
    for planner in ("landmark", "RRTConnect", "RRTstar+certified", "benchmark_planners:plan"):
        words += ["-p", planner]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(Path.cwd()), *sys.path])}
    done = subprocess.run([sys.executable, "-m", "trailmark", *words], env=environment, capture_output=True, text=True)
    print(done.stdout, done.stderr)
    with sqlite3.connect(results) as database:
        columns = "SELECT p.name, r.solved, r.solution_length FROM runs r JOIN plannerConfigs p ON p.id = r.plannerid"
        rows = database.execute(columns).fetchall()
    names = sorted({name for name, _, _ in rows})
    figure, axes = plt.subplots(layout="constrained")
    axes.boxplot(
        [[cost for name, solved, cost in rows if name == wanted and solved] for wanted in names], tick_labels=names
    )
    axes.set_ylabel("cost of the path, metres")
    plt.show()
