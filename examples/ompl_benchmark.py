"""The landmark planner in OMPL's Benchmark
========================================

Beside OMPL's own planners; the log becomes a database that Planner Arena reads.

``python examples/ompl_benchmark.py [WORLD] [FOLDER]``
"""

import sqlite3
import subprocess
import sys
from pathlib import Path
from tempfile import mkdtemp

import matplotlib.pyplot as plt
from ompl import geometric as og
from ompl import tools as ot

from trailmark import World
from trailmark.ompl_bridge import OmplLandmarkPlanner, SE2Problem, planning

world = World.load(sys.argv[1] if len(sys.argv) > 1 else "office")
folder = Path(sys.argv[2] if len(sys.argv) > 2 else mkdtemp())

problem = SE2Problem(world)
benchmark = ot.Benchmark(problem.setup, world.name)
benchmark.addPlanner(og.RRTConnect(problem.information))
benchmark.addPlanner(og.PRM(problem.information))
# Each run is to start from nothing, as the others' do.
benchmark.addPlanner(OmplLandmarkPlanner(problem.information, seed=0, keep_roadmap=False))

# %%
# Ctrl-C and errors in callbacks are raised at the end of the block.
request = ot.Request()
request.maxTime, request.maxMem, request.runCount, request.displayProgress = 1.0, 4000.0, 3, False
request.saveConsoleOutput = False
with planning():
    benchmark.benchmark(request)

# %%
log, database = folder / f"{world.name}.log", folder / f"{world.name}.db"
benchmark.saveResultsToFile(str(log))
statistics = Path(sys.executable).with_name("ompl_benchmark_statistics")
subprocess.run([statistics, str(log), "-d", str(database)], check=True)
print(f"written: {log.name}, {database.name}")

# %%
columns = "SELECT p.name, r.solution_length FROM runs r JOIN plannerConfigs p ON p.id = r.plannerid WHERE r.solved"
with sqlite3.connect(database) as connection:
    rows = [(name.removeprefix("geometric_"), cost) for name, cost in connection.execute(columns)]
names = sorted({name for name, _ in rows})
figure, axes = plt.subplots()
axes.boxplot([[cost for name, cost in rows if name == wanted] for wanted in names], tick_labels=names)
axes.set_ylabel("cost of the path, metres")
plt.show()
